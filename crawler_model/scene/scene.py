"""Scenes: a crawler, its ground, its start and its drive, checked and ready to be simulated."""

from __future__ import annotations

from typing import Any

from .assemble import assemble
from .assembly import Assembly
from .parts import SceneParts
from .validate import validate_parts


class Scene(Assembly):
    """A crawler, its ground, its start and its drive. Frozen; built by `load_scene` or `Scene.model_validate`.

    Source of the format: docs/scenes.md. SI units throughout.
    """

    @classmethod
    def model_validate(cls, document: Any) -> Scene:
        """Build a scene of plain data.

        Args:
            document: a mapping with the keys of a scene file.

        Returns:
            The scene, its arrays built and checked against each other.

        Raises:
            SceneError: one line that names the field, the value and what would be right.
        """
        return cls.from_parts(validate_parts(document))

    @classmethod
    def from_parts(cls, parts: SceneParts, like: Assembly | None = None) -> Scene:
        """Assemble a scene from validated parts.

        Args:
            parts: the parts.
            like: an assembly with the same body and the same kind of drive, whose arrays are shared.

        Returns:
            The scene.

        Raises:
            SceneError: naming the part that does not fit the others.
        """
        made = assemble(parts, like)
        return cls(made.parts, made.body, made.ground, made.columns, made.drive, made.start_displacement)

    def document(self) -> dict[str, Any]:
        """Lay the scene out as plain data that `Scene.model_validate` reads back.

        Returns:
            The scene as a mapping; segments with the number of elements that their accuracy asked for.
        """
        document = self.parts.model_dump(mode="json", exclude_none=True, by_alias=True, exclude_defaults=True)
        document["name"] = self.name
        for part, segment in zip(document["body"].get("segments", ()), self.body.segments, strict=True):
            part["elements"] = segment.elements
        return document

    def __eq__(self, other: object) -> bool:
        """Compare the parts; elements that were chosen follow from them."""
        return self.parts == other.parts if isinstance(other, Scene) else NotImplemented

    def __hash__(self) -> int:
        """Hash the name."""
        return hash(self.name)

    def __repr__(self) -> str:
        """Name the scene and what its body consists of."""
        return f"Scene({self.name}: {self.body.describe()})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel as plain data."""
        return Scene.model_validate, (self.document(),)
