"""Scenes: what a crawler is made of, what it stands on, how it starts and what drives it. Every mistake is named."""

from __future__ import annotations

import functools
import math
import re
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema, model_validator

from .body import Body
from .columns import Columns
from .drive import Drive
from .errors import LARGEST

if TYPE_CHECKING:
    from .graph_kernel import Network

_NUMBER = {"type": "number"}
_NUMBERS = {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBER}]}
_TABLE = {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBERS}]}
_DEEP = {"anyOf": [_NUMBER, {"type": "array", "items": _TABLE}]}


def _number(value: Any) -> float:
    if isinstance(value, str):  # YAML 1.1 reads 1e-3 as text
        try:
            value = float(value)
        except ValueError:
            raise ValueError(f"{value!r} is not a number") from None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f"{value!r} is not a number")
    if isinstance(value, int) and abs(value) > LARGEST:
        raise ValueError(f"an integer of {value.bit_length()} bits is too large; at most {LARGEST:g}")
    if not math.isfinite(value):
        raise ValueError(f"{value!r} is not finite")
    if abs(value) > LARGEST:
        raise ValueError(f"{value!r} is too large; at most {LARGEST:g}")
    return float(value)


def _nested(value: Any, depth: int) -> Any:
    if depth > 0 and isinstance(value, (list, tuple)):
        return tuple(_nested(v, depth - 1) for v in value)
    return _number(value)


Number = Annotated[float, BeforeValidator(_number), WithJsonSchema(_NUMBER)]
Numbers = Annotated[Any, BeforeValidator(lambda v: _nested(v, 1)), WithJsonSchema(_NUMBERS)]
Table = Annotated[Any, BeforeValidator(lambda v: _nested(v, 2)), WithJsonSchema(_TABLE)]
Deep = Annotated[Any, BeforeValidator(lambda v: _nested(v, 3)), WithJsonSchema(_DEEP)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class LinksPart(_Part):
    """The springs between contacts and ends of segments."""

    stiffness: Numbers
    between: tuple[tuple[int | str, int | str], ...] | None = None


class TablePart(_Part):
    """A value along a segment: straight lines between positions, constant beyond them."""

    at: tuple[Number, ...]
    value: tuple[Number, ...]

    @model_validator(mode="after")
    def _fits(self) -> TablePart:
        if len(self.at) != len(self.value) or not self.at:
            raise ValueError(f"{len(self.at)} position(s) in `at` for {len(self.value)} value(s); give one for each")
        if any(b <= a for a, b in zip(self.at, self.at[1:], strict=False)):
            raise ValueError("the positions in `at` must be strictly increasing")
        return self


def _explain_friction(value: Any) -> Any:
    if isinstance(value, (int, float, list, tuple)):
        raise ValueError(f"write {{isotropic: {value}}}, or give `forward` and `backward`")
    return value


def _check_one_way(part: Any) -> None:
    both = part.forward is not None and part.backward is not None
    neither = part.forward is None and part.backward is None
    if not ((both and part.isotropic is None) or (neither and part.isotropic is not None)):
        raise ValueError("give both `forward` and `backward`, or `isotropic` alone")


class _TwoSided(_Part):
    @model_validator(mode="after")
    def _one_way(self) -> _TwoSided:
        _check_one_way(self)
        return self

    @property
    def sides(self) -> tuple[Any, Any]:
        """What forward and backward friction are."""
        part: Any = self
        return (part.forward, part.backward) if part.isotropic is None else (part.isotropic, part.isotropic)


class SegmentFrictionPart(_TwoSided):
    """Friction of a segment per length, N/m: forward and backward, or isotropic."""

    forward: Number | TablePart | None = None
    backward: Number | TablePart | None = None
    isotropic: Number | TablePart | None = None


class SegmentPart(_Part):
    """An interval of the body that touches the ground all along."""

    name: str
    start: Number = Field(alias="from")
    stop: Number = Field(alias="to")
    stiffness: Number | TablePart
    friction: Annotated[SegmentFrictionPart, BeforeValidator(_explain_friction)]
    accuracy: Number | None = None
    elements: int | None = None
    shown: int | None = None

    @model_validator(mode="after")
    def _sane(self) -> SegmentPart:
        if not re.fullmatch(r"[A-Za-z_]\w*", self.name) or re.fullmatch(r"(contact|link)(_\d+)?|world", self.name):
            raise ValueError(f"name: {self.name!r}; it must be a word, and not that of a contact or link")
        if not self.stop > self.start:
            raise ValueError(f"to: {self.stop:g} m; it must lie beyond from, {self.start:g} m")
        if self.accuracy is None and self.elements is None:
            raise ValueError("give `accuracy` (of the net translation per period, relative) or `elements`")
        if self.accuracy is not None and not 1e-6 <= self.accuracy <= 0.5:
            raise ValueError(f"accuracy: {self.accuracy:g}; it must be between 1e-6 and 0.5")
        if self.elements is not None and not 1 <= self.elements <= 1_000_000:
            raise ValueError(f"elements: {self.elements}; it must be between 1 and 1000000")
        if self.shown is not None and not self.shown >= 2:
            raise ValueError(f"shown: {self.shown}; at least the 2 ends are shown")
        return self


class BodyPart(_Part):
    """Contacts, segments and links."""

    contacts: tuple[Numbers, ...] = ()
    segments: tuple[SegmentPart, ...] = ()
    links: LinksPart | None = None


class FrictionPart(_Part):
    """Friction of the isolated contacts, N: forward and backward, isotropic, or in the plane by directions."""

    forward: Numbers | None = None
    backward: Numbers | None = None
    isotropic: Numbers | None = None
    directions: tuple[Number, ...] | None = None
    value: Table | None = None

    @model_validator(mode="after")
    def _one_way(self) -> FrictionPart:
        if self.directions is None and self.value is None:
            _check_one_way(self)
        elif self.directions is None or self.value is None or self.gives_sides:
            raise ValueError("give `directions` (rad) and `value` together and nothing else, or `isotropic` alone")
        return self

    @property
    def gives_sides(self) -> bool:
        """Whether friction is given other than by directions."""
        return not (self.forward is None and self.backward is None and self.isotropic is None)

    @property
    def sides(self) -> tuple[Any, Any]:
        """What forward and backward friction are."""
        return (self.forward, self.backward) if self.isotropic is None else (self.isotropic, self.isotropic)


class FrictionRowsPart(_TwoSided):
    """Commanded friction, a row per time: forward and backward, or isotropic."""

    forward: Table | None = None
    backward: Table | None = None
    isotropic: Table | None = None


class StartPart(_Part):
    """Where the contacts stand at the start."""

    displacement: Table


class WavePart(_Part):
    """A travelling sine, sampled."""

    amplitude: Number
    wavelength: Number
    period: Number
    mean: Number = 0.0
    samples: int = 64

    @model_validator(mode="after")
    def _sane(self) -> WavePart:
        if self.wavelength == 0.0:
            raise ValueError("wavelength: 0 m; it must not be 0")
        if not self.period > 0.0:
            raise ValueError(f"period: {self.period:g} s; it must be > 0")
        if not 3 <= self.samples <= 1_000_000:
            raise ValueError(f"samples: {self.samples}; it must be between 3 and 1000000")
        return self


class DrivePart(_Part):
    """Open-loop commands: times, or wave and friction_wave, or strategy."""

    times: tuple[Number, ...] | None = None
    period: Number | None = None
    actuation: Deep | None = None
    friction: FrictionRowsPart | Number | None = None
    wave: WavePart | None = None
    friction_wave: WavePart | None = None
    strategy: Literal["A", "B", "C"] | None = None
    length: Number | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> DrivePart:
        waves = self.wave is not None or self.friction_wave is not None
        kinds = [self.times is not None, waves, self.strategy is not None]
        if sum(kinds) != 1:
            raise ValueError("give exactly one of `times`, `wave` and `friction_wave`, or `strategy`")
        allowed = {"times", "period", "actuation", "friction"}
        if waves:
            allowed = {"wave", "friction_wave"}
        elif self.strategy is not None:
            allowed = {"strategy", "length", "friction", "period"}
        for key in sorted(self.model_fields_set - allowed):
            if getattr(self, key) is not None:
                raise ValueError(f"`{key}` does not go with this kind of drive; it takes {', '.join(sorted(allowed))}")
        if self.times is not None and self.actuation is None:
            raise ValueError("`actuation` is missing: one row per time")
        if self.times is not None and isinstance(self.friction, float):
            raise ValueError("friction: with `times`, give `isotropic`, or `forward` and `backward`, a row per time")
        if self.strategy is not None:
            if self.length is None or not isinstance(self.friction, float):
                raise ValueError("a strategy needs `length` (m) and `friction` (N), a number each")
            if self.friction < 0.0:
                raise ValueError(f"friction: {self.friction:g} N; it must be >= 0")
        return self


class Scene(_Part):
    """A crawler, its ground, its start and its drive. Frozen; made by `load_scene` or `Scene.model_validate`.

    Source of the format: docs/scenes.md. SI units throughout.
    """

    name: str
    dimension: Literal[1, 2] = 1
    body: BodyPart
    friction: Annotated[FrictionPart, BeforeValidator(_explain_friction)] | None = None
    tolerance: Number | None = None
    start: StartPart | Literal["relaxed"] | None = None
    drive: DrivePart | None = None

    @model_validator(mode="after")
    def _fits_together(self) -> Scene:
        from .assemble import check_scene

        check_scene(self)
        return self

    def document(self) -> dict[str, Any]:
        """Lay the scene out as plain data that `Scene.model_validate` reads back.

        Returns:
            The scene as a mapping; segments with the number of elements that their accuracy asked for.
        """
        document = self.model_dump(mode="json", exclude_none=True, by_alias=True, exclude_defaults=True)
        document["name"] = self.name
        for part, segment in zip(document["body"].get("segments", ()), self.mesh.segments, strict=True):
            part["elements"] = segment.elements
        return document

    @functools.cached_property
    def mesh(self) -> Body:
        """The body as contacts and springs, segments cut into elements."""
        from .assemble import build_mesh

        return build_mesh(self)

    @functools.cached_property
    def network(self) -> Network:
        """The springs of a graph as its kernel wants them."""
        from .graph_kernel import build_network

        return build_network(self.mesh)

    @functools.cached_property
    def columns(self) -> Columns:
        """What can be commanded."""
        from .assemble import build_scene_columns

        return build_scene_columns(self)

    @functools.cached_property
    def commands(self) -> Drive:
        """The drive, or for a scene without one L = 0 and the scene's friction for ever."""
        from .assemble import build_drive

        return build_drive(self)

    @functools.cached_property
    def directions(self) -> np.ndarray:
        """In the plane the unit directions in which friction is given, shape (m, 2); m = 0 where it is isotropic."""
        given = None if self.friction is None else self.friction.directions
        angles = np.array(given or ())
        directions = np.column_stack((np.cos(angles), np.sin(angles)))
        directions[np.abs(directions) < 4e-16] = 0.0  # along an axis to the bit
        return directions

    @functools.cached_property
    def start_displacement(self) -> np.ndarray:
        """X at the start, shape (N,), in the plane (N, 2) [m]."""
        from .assemble import build_start

        return build_start(self)
