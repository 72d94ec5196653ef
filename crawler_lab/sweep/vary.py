"""Variations of a scene: numbers of its document replaced by dotted keys, on a grid or in parallel lists."""

from __future__ import annotations

import contextlib
import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike
from pydantic import TypeAdapter

from crawler_model.arrays import frozen
from crawler_model.errors import SceneError
from crawler_model.scene.file import coerce_scene
from crawler_model.scene.parts import SceneParts
from crawler_model.scene.scene import Scene

from .keys import KeyPath, find_path, is_friction, make_room, overlap, put, read

MOST_VARIATIONS = 10_000_000
"""Upper limit of variations; their results take about a gigabyte."""
_BODY_UNCHANGED = ("friction", "start", "drive", "tolerance", "loads", "ground")
"""Parts of a scene that do not affect its body; see `keeps_mesh`."""


@dataclass(frozen=True, eq=False, repr=False)
class Variations(Sequence[Scene]):
    """Scenes that differ in a few numbers, built on access; an invalid one then raises `SceneError`.

    Attributes:
        base: the scene that is varied.
        values: for each dotted key its value in each variation, shape (M,).
        shape: shape of the grid, one axis per key in order, the last one fastest; (M,) for parallel lists.
    """

    base: Scene
    values: Mapping[str, np.ndarray]
    shape: tuple[int, ...]

    def __len__(self) -> int:
        """Count the variations."""
        return len(next(iter(self.values.values())))

    @overload
    def __getitem__(self, at: int) -> Scene: ...
    @overload
    def __getitem__(self, at: slice) -> Variations: ...
    def __getitem__(self, at: int | slice) -> Scene | Variations:
        """Build one variation, or select several."""
        if isinstance(at, slice):
            values = {key: column[at] for key, column in self.values.items()}
            part = Variations(self.base, values, (len(next(iter(values.values()))),))
            known = ("paths", "pinned", "_template", "_changed")
            part.__dict__.update({name: self.__dict__[name] for name in known if name in self.__dict__})
            return part
        document = self.document(at)
        if self.base.body.turning is None and all(keeps_mesh(path) for path in self.paths):
            with contextlib.suppress(ValueError):  # validated again as a whole for a message that names the field
                return self._scene_with_same_body(document)
        return Scene.model_validate(document)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as a document and numbers."""
        return _restore, (self._template, dict(self.values), self.shape)

    def __repr__(self) -> str:
        """Describe the variations in one line."""
        return f"Variations({self.base.name}, {' x '.join(map(str, self.shape))} of {', '.join(self.values)})"

    def document(self, at: int) -> dict[str, Any]:
        """Build the document of a variation, valid or not.

        Args:
            at: index of the variation.

        Returns:
            The input of `Scene.model_validate`.
        """
        document = self._template
        for path, column in zip(self.paths, self.values.values(), strict=True):
            document = put(document, path, float(column[at]))
        return document

    def origin(self, key: str) -> float:
        """Read the value of a varied key in the base scene.

        Args:
            key: one of the keys of `values`.

        Returns:
            The value [unit of the key]; 0 where a document may omit the number because it is 0.

        Raises:
            SceneError: if the scene does not have the number.
        """
        path = self.paths[list(self.values).index(key)]
        node = read(self._template, path, key)
        if node is None and path[0] == "ground":
            return 0.0
        if not isinstance(node, (int, float)):
            raise SceneError(f"vary: {key}: the scene does not give this number")
        return float(node)

    @functools.cached_property
    def _template(self) -> dict[str, Any]:
        """The document of the base scene, extended so that every varied key exists."""
        document = self.base.document()
        for path in self.paths:
            make_room(self.base, document, path)
        return document

    @functools.cached_property
    def paths(self) -> tuple[KeyPath, ...]:
        """The keys as paths into the document."""
        return tuple(find_path(self.base, key) for key in self.values)

    @functools.cached_property
    def pinned(self) -> Scene:
        """The base scene with fixed numbers of elements, and with a place for every varied number."""
        return Scene.model_validate(self._template)

    @functools.cached_property
    def _changed(self) -> tuple[str, ...]:
        return tuple(sorted({str(path[0]) for path in self.paths}))

    def _scene_with_same_body(self, document: dict[str, Any]) -> Scene:
        """Build a scene with the body of the base, which saves half of the work."""
        changed = {name: _part(name).validate_python(document[name]) for name in self._changed}
        return Scene.from_parts(self.pinned.parts.model_copy(update=changed), like=self.pinned)


def keeps_mesh(path: KeyPath) -> bool:
    """Return whether a number affects neither the contacts and springs of a body nor the length of its springs.

    Args:
        path: its key as a path into the document.

    Returns:
        True if variations of it share the mesh.
    """
    if path[0] != "body":
        return path[0] in _BODY_UNCHANGED
    inner = path[3:4] if path[1] == "segments" else path[1:3] if path[1] == "links" else path[1:2]
    return inner in (("stiffness",), ("friction",), ("links", "stiffness"), ("weights",))


def vary(scene: Scene | str | Path, values: Mapping[str, ArrayLike], grid: bool = True) -> Variations:
    """Build variations of a scene.

    Args:
        scene: a scene, a path or a gallery name. Its segments keep the elements of the base scene, unless the accuracy
            is varied.
        values: the values of each dotted key into the document of the scene: `friction.forward`, `drive.length`,
            `drive.wave.amplitude`, `ground.slope`, `body.links.stiffness` (of all links) or `body.links.stiffness[0]`
            (of the first; also written `body.links.stiffness.0`), `loads[2]`, `body.segments.trunk.stiffness`,
            `body.links.tension` (the force at which the motors of all links stall), for bodies that turn
            `friction.left` and `body.joints.stiffness`.
        grid: True for all combinations, False to combine the k-th values of all keys.

    Returns:
        The variations, a sequence of scenes built on access. Keys are checked here, numbers on access.

    Raises:
        SceneError: if a key does not exist in the scene or does not hold a number, or if its values are not numbers.
    """
    scene = coerce_scene(scene, "vary")
    if not values:
        raise SceneError("vary: no key; at least one is needed, for example friction.forward")
    columns = {key: _numbers(key, given) for key, given in values.items()}
    sizes = [column.size for column in columns.values()]
    if grid:
        count = math.prod(sizes)
        if count > MOST_VARIATIONS:
            raise SceneError(f"vary: {' x '.join(map(str, sizes))} = {count} variations; at most {MOST_VARIATIONS}")
        axes = np.meshgrid(*columns.values(), indexing="ij")
        columns = dict(zip(columns, (frozen(column.ravel()) for column in axes), strict=True))
    elif len(set(sizes)) > 1:
        raise SceneError(f"vary: {sizes} values; without a grid all keys need the same number of values")
    variations = Variations(scene, columns, tuple(sizes) if grid else (sizes[0],))
    paths = variations.paths
    for path, key in zip(paths, columns, strict=True):
        _check_effect(scene, path, key)
    weighed = scene.parts.body.weights is not None or any(path[:2] == ("body", "weights") for path in paths)
    if not weighed and ("ground", "slope") in paths:
        raise SceneError("vary: ground.slope: no effect, as the contacts have no weights; give body.weights")
    for (key, path), (other, way) in itertools.combinations(zip(columns, paths, strict=True), 2):
        if overlap(path, way):
            raise SceneError(f"vary: {key} and {other} set the same number")
    return variations


def _restore(document: dict[str, Any], values: dict[str, np.ndarray], shape: tuple[int, ...]) -> Variations:
    return Variations(Scene.model_validate(document), values, shape)


def _numbers(key: str, given: ArrayLike) -> np.ndarray:
    try:
        column = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"vary: {key}: {given!r}; it must be a list of numbers") from None
    if column.ndim != 1 or column.size == 0 or not np.isfinite(column).all():
        raise SceneError(f"vary: {key}: {given!r}; it must be a list of at least one number, all finite")
    return frozen(column)


@functools.cache
def _part(name: str) -> TypeAdapter[Any]:
    kind: Any = SceneParts.model_fields[name].annotation
    return TypeAdapter(kind)


def _check_effect(scene: Scene, path: KeyPath, key: str) -> None:
    """Raise an error for friction that the drive replaces, and for an accuracy that fixed elements override."""
    if path[-1] == "accuracy" and scene.parts.body.segments[int(path[2])].elements is not None:
        raise SceneError(f"vary: {key}: no effect, as the segment has fixed elements; vary elements instead")
    drive = scene.parts.drive
    if drive is not None and drive.commands_friction and is_friction(path):
        replaced = "drive.friction" if drive.friction is not None else "drive.friction_wave"
        raise SceneError(f"vary: {key}: no effect, as the drive commands friction; vary {replaced} instead")
    if path[0] == "loads" and drive is not None and drive.loads is not None:
        raise SceneError(f"vary: {key}: no effect, as the drive commands loads; vary drive.loads instead")
