"""Scenes: a crawler, its ground, its start and its drive, checked and ready to be simulated."""

from __future__ import annotations

from typing import Any

from ..notebook import write_html
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
        """Build a scene from plain data.

        Args:
            document: a mapping with the keys of a scene file.

        Returns:
            The scene, with its arrays built and its parts checked against each other.

        Raises:
            SceneError: with one line that names the field, the value and the valid values.
        """
        return cls.from_parts(validate_parts(document))

    @classmethod
    def from_parts(cls, parts: SceneParts, like: Assembly | None = None) -> Scene:
        """Assemble a scene from validated parts.

        Args:
            parts: the parts.
            like: an assembly with the same body and the same kind of drive; its body and columns are reused.

        Returns:
            The scene.

        Raises:
            SceneError: if the parts are inconsistent; the message names the part.
        """
        assembly = assemble(parts, like)
        return cls(parts, assembly.body, assembly.ground, assembly.columns, assembly.drive, assembly.start_displacement)

    def document(self) -> dict[str, Any]:
        """Build the plain data from which `Scene.model_validate` rebuilds the scene.

        Returns:
            The scene as a mapping; segments include the number of elements derived from their accuracy.
        """
        document = self.parts.model_dump(mode="json", exclude_none=True, by_alias=True, exclude_defaults=True)
        document["name"] = self.name
        for part, segment in zip(document["body"].get("segments", ()), self.body.segments, strict=True):
            part["elements"] = segment.elements
        return document

    @property
    def unmoving_drive(self) -> str:
        """What a scene has whose drive holds its command, for messages: no drive, or one of a single row."""
        return "no drive" if self.parts.drive is None else "a drive of one row"

    def __eq__(self, other: object) -> bool:
        """Compare what they are rebuilt from; the number of elements that an accuracy asks for is part of it."""
        return self.document() == other.document() if isinstance(other, Scene) else NotImplemented

    def __hash__(self) -> int:
        """Hash the name."""
        return hash(self.name)

    def __repr__(self) -> str:
        """Return the name of the scene and the components of its body."""
        return f"Scene({self.name}: {self.body.describe()})"

    def _repr_html_(self) -> str:
        """Describe the scene in a notebook."""
        drive = self.drive
        period = "no period" if drive.period is None else f"period {drive.period:g} s"
        facts = {
            "body": self.body.describe(),
            "drive": self.unmoving_drive if drive.holds else f"{drive.times.size} waypoints, {period}",
            "commands": ", ".join(self.columns.names),
        }
        return write_html(f"Scene {self.name}", facts.items())

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as plain data."""
        return Scene.model_validate, (self.document(),)
