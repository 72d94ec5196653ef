"""Stacks: the arrays of many variations of a scene, assembled together.

Variations that share a mesh are assembled by the same functions as a single scene: a number that varies is an array of
shape (M, 1), and what follows from it has a leading axis of variations. Rules are checked for all variations at once;
one that may break a rule is validated by itself, so that its message is the scene's.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel

from crawler_model.body.body import Body
from crawler_model.errors import LARGEST, SceneError
from crawler_model.run.transport import length_of
from crawler_model.scene.assemble import assemble_together
from crawler_model.scene.assembly import AXES, Assembly
from crawler_model.scene.scene import Scene

from .keys import KeyPath
from .vary import Variations, keeps_mesh

_BOUNDS = {
    "minimum": np.less,
    "maximum": np.greater,
    "exclusiveMinimum": np.less_equal,
    "exclusiveMaximum": np.greater_equal,
}


@dataclass(frozen=True, eq=False)
class Stack:
    """M variations of a scene whose bodies have the same contacts and springs.

    Attributes:
        assembly: the parts and arrays of all. These have a leading axis of variations: `body.stiffness` (M, S),
            `ground.weight` (M, N), `columns.slope_load` (M, N), `drive.times` (M, W), `drive.period` (M, 1),
            `drive.rows` (M, W, C), `drive.targets` (M, W, F) and `start_displacement` (M, N). Everything else belongs
            to the first variation.
        length: length of the body in its reference shape, shape (M,) [m].
        reasons: why a variation is invalid, by index; the arrays of these variations may hold anything.
    """

    assembly: Assembly
    length: np.ndarray
    reasons: dict[int, str]

    def __len__(self) -> int:
        """Count the variations."""
        return int(self.length.size)

    @property
    def body(self) -> Body:
        """The body; its stiffness has shape (M, S) [N/m]."""
        return self.assembly.body

    @property
    def stiffness(self) -> np.ndarray:
        """Stiffness k of each spring, shape (M, S) [N/m]."""
        return self.assembly.body.stiffness

    @property
    def targets(self) -> np.ndarray:
        """Targets at the waypoints, as in `Columns`, shape (M, W, F) [m, N]."""
        return self.assembly.drive.targets

    @property
    def times(self) -> np.ndarray:
        """Times of the waypoints, shape (M, W) [s]."""
        return self.assembly.drive.times

    @property
    def period(self) -> np.ndarray | None:
        """The waypoints repeat after it, shape (M,) [s]; None if they are played once."""
        period: Any = self.assembly.drive.period
        return None if period is None else period[:, 0]

    @property
    def start(self) -> np.ndarray:
        """Displacement at the start, shape (M, N) [m]."""
        return self.assembly.start_displacement

    def select(self, at: np.ndarray | slice) -> Stack:
        """Select some of the variations.

        Args:
            at: their indices, or a slice of the stack.

        Returns:
            A stack of them.
        """
        places = np.arange(len(self))[at]
        arrays = {name: array[at] for name, array in self.assembly.arrays().items()}
        reasons = {i: self.reasons[int(m)] for i, m in enumerate(places) if int(m) in self.reasons}
        return Stack(self.assembly.with_arrays(arrays), self.length[at], reasons)


def stack(variations: Sequence[Scene], check: bool = True) -> Stack:
    """Assemble variations of a scene together.

    Args:
        variations: from `vary`, or any sequence of scenes on a line whose bodies have the same contacts and springs.
        check: whether to look for invalid variations. Without it, numbers outside of their bounds are assembled, too,
            if they do not change the mesh: differences of such arrays are derivatives.

    Returns:
        The stack. Its arrays equal, to the bit, the arrays of scenes assembled one by one.

    Raises:
        SceneError: if the variations do not have the same contacts and springs, lie in the plane, or are all invalid.
    """
    if isinstance(variations, Variations) and shares_mesh(variations.base, variations.paths):
        return _assemble_variations(variations, check)
    scenes: list[Scene] = []
    places, reasons = [], {}
    for i in range(len(variations)):
        try:
            scenes.append(variations[i])
            places.append(i)
        except SceneError as error:
            reasons[i] = str(error)
    if not scenes:
        raise SceneError(f"stack: no variation is valid; the reason of the first: {reasons.get(0, 'there is none')}")
    first = scenes[0]
    for i, scene in zip(places, scenes, strict=True):
        if fingerprint(scene) != fingerprint(first):
            raise SceneError(
                f"stack: variations {places[0]} and {i} differ in their contacts, springs or columns; only variations "
                "on a line that share them can be stacked"
            )
    whole = stack_scenes(scenes)
    at = np.zeros(len(variations), np.int64)
    at[places] = np.arange(len(scenes))
    return dataclasses.replace(whole.select(at), reasons=reasons)


def stack_scenes(scenes: Sequence[Assembly]) -> Stack:
    """Stack the arrays of scenes that were assembled one by one.

    Args:
        scenes: at least one, with equal fingerprints.

    Returns:
        The stack.
    """
    each = [scene.arrays() for scene in scenes]
    arrays = {name: np.array([one[name] for one in each]) for name in each[0]}
    if "period" in arrays:
        arrays["period"] = arrays["period"].reshape(-1, 1)
    length = np.array([length_of(scene.body) for scene in scenes])
    return Stack(scenes[0].with_arrays(arrays), length, {})


def can_be_stacked(scene: Assembly) -> bool:
    """Determine whether a scene can be run with others: on a line, on even ground, with linear springs.

    Args:
        scene: the scene.

    Returns:
        Whether it can.
    """
    return scene.dimension == 1 and scene.ground.track is None and not scene.body.bends


def fingerprint(scene: Assembly) -> tuple[Any, ...]:
    """Compute what scenes must have in common to be stacked.

    Args:
        scene: the scene.

    Returns:
        A key; a scene that cannot be stacked has a key that equals no other.
    """
    if not can_be_stacked(scene):
        return (id(scene),)
    body, columns, drive = scene.body, scene.columns, scene.drive
    arrays = (body.ends, body.share, columns.index, columns.factor, *columns.further)
    segments = tuple((segment.first, segment.elements) for segment in body.segments)
    return (
        *(array.tobytes() for array in arrays),
        segments,
        columns.slope_load is None,
        drive.period is None,
        drive.rows.shape,
    )


def shares_mesh(scene: Scene, paths: Sequence[KeyPath]) -> bool:
    """Determine whether variations can be assembled together: on a line, with linear springs, one mesh and one layout.

    Args:
        scene: the scene that is varied.
        paths: to the numbers that vary.

    Returns:
        False if some of these change more than numbers of the arrays.
    """
    parts = scene.parts
    if parts.dimension == 2 or (parts.ground is not None and parts.ground.varies):
        return False
    if parts.body.is_bent or parts.body.shares_contacts or parts.couplings:
        return False
    return all(keeps_mesh(path) and _is_plain(path) for path in paths)


def _is_plain(path: KeyPath) -> bool:
    """Return whether arrays follow from a number by arithmetic: not a wave's times and samples, nor tables."""
    in_table = path[:2] == ("body", "segments") and len(path) > 3 and path[-1] not in _SEGMENT_NUMBERS
    one_time = path == ("drive", "times")  # a number instead of a list
    in_wave = path[:2] in (("drive", "wave"), ("drive", "friction_wave"))
    return not in_table and not one_time and not (in_wave and path[-1] in ("period", "samples"))


_SEGMENT_NUMBERS = ("stiffness", "forward", "backward", "isotropic")


def _assemble_variations(variations: Variations, check: bool) -> Stack:
    count = len(variations)
    parts: Any = variations.pinned.parts
    doubts = np.zeros(count, np.bool_)
    for path, values in zip(variations.paths, variations.values.values(), strict=True):
        column = values[:, None]
        parts = _put(parts, path, column)
        doubts |= _out_of_bounds(variations.pinned.parts, path, values)
    assembly, found = assemble_together(parts, variations.pinned, count)
    reasons = _find_reasons(variations, doubts | found) if check else {}
    arrays = assembly.arrays()
    for name, axes in AXES.items():
        if name in arrays and np.ndim(arrays[name]) == axes:
            arrays[name] = np.repeat(np.asarray(arrays[name])[None], count, axis=0)
    if "period" in arrays:
        arrays["period"] = arrays["period"].reshape(-1, 1)
    length = np.full(count, length_of(assembly.body))
    return Stack(assembly.with_arrays(arrays), length, reasons)


def _find_reasons(variations: Variations, doubts: np.ndarray) -> dict[int, str]:
    """Validate the variations in doubt one by one, and all of them if the others are as invalid: keys may not fit."""
    reasons = {}
    others = np.flatnonzero(~doubts)[:1]
    for i in (*np.flatnonzero(doubts), *others):
        try:
            variations[int(i)]
        except SceneError as error:
            reasons[int(i)] = str(error)
    if others.size and int(others[0]) in reasons:
        return _find_reasons(variations, np.ones(doubts.size, np.bool_))
    return reasons


def _field(part: BaseModel, key: str) -> str:
    """Find the name of the field of a part behind a key of the document."""
    fields = type(part).model_fields
    return next(name for name, field in fields.items() if (field.alias or name) == key)


def _put(node: Any, path: KeyPath, column: np.ndarray) -> Any:
    """Set a number in a copy of parts without validation."""
    if not path:
        return column
    step = path[0]
    if isinstance(node, BaseModel):
        name = _field(node, str(step))
        return node.model_copy(update={name: _put(getattr(node, name), path[1:], column)})
    entries = list(node)
    entries[int(step)] = _put(entries[int(step)], path[1:], column)
    return tuple(entries)


def _out_of_bounds(part: Any, path: KeyPath, values: np.ndarray) -> np.ndarray:
    """Find the values that are outside of the bounds of their key in the schema."""
    extra: dict[str, Any] = {}
    for step in path:
        if isinstance(part, BaseModel):
            name = _field(part, str(step))
            given: Any = type(part).model_fields[name].json_schema_extra
            extra, part = given or {}, getattr(part, name)
        else:
            part = part[int(step)]
    bad = np.abs(values) > LARGEST
    for bound, breaks in _BOUNDS.items():
        if bound in extra:
            bad |= breaks(values, extra[bound])
    return bad
