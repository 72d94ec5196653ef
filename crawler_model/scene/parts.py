"""The parts of a scene: the keys of a scene file, with the checks of single values."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema, model_validator

from ..errors import LARGEST

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


def _key(meaning: str, unit: str = "", **bounds: float) -> Any:
    """Describe a key for the schema and docs/reference/scenes.md; bounds are named as in JSON schema."""
    return Field(description=meaning, json_schema_extra={**({"unit": unit} if unit else {}), **bounds})


class LinksPart(_Part):
    """The springs between contacts and ends of segments."""

    stiffness: Annotated[Numbers, _key("One number, or one per link.", "N/m", exclusiveMinimum=0)]
    between: Annotated[
        tuple[tuple[int | str, int | str], ...] | None,
        _key(
            "The pair of ends that each link joins: contacts by number, ends of segments as `name.from`, `name.to`. "
            "Default: the chain of neighbours."
        ),
    ] = None


class TablePart(_Part):
    """A value along a segment: linear between positions, constant beyond them."""

    at: Annotated[tuple[Number, ...], _key("Positions along the body, strictly increasing.", "m")]
    value: Annotated[
        tuple[Number, ...], _key("The value at each position, in the unit of the key that holds the table.")
    ]

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
        """Forward and backward friction."""
        part: Any = self
        return (part.forward, part.backward) if part.isotropic is None else (part.isotropic, part.isotropic)


class SegmentFrictionPart(_TwoSided):
    """Friction of a segment per length, N/m: forward and backward, or isotropic."""

    forward: Annotated[Number | TablePart | None, _key("Against sliding towards +x.", "N/m", minimum=0)] = None
    backward: Annotated[Number | TablePart | None, _key("Against sliding towards -x.", "N/m", minimum=0)] = None
    isotropic: Annotated[Number | TablePart | None, _key("The same in both directions.", "N/m", minimum=0)] = None


class SegmentPart(_Part):
    """An interval of the body that touches the ground along its whole length."""

    name: Annotated[str, _key("A unique word; commands and joints use it.")]
    start: Annotated[Number, _key("Start in the reference shape.", "m")] = Field(alias="from")
    stop: Annotated[Number, _key("End in the reference shape, beyond `from`.", "m")] = Field(alias="to")
    stiffness: Annotated[Number | TablePart, _key("The modulus along the segment.", "N", exclusiveMinimum=0)]
    friction: Annotated[SegmentFrictionPart, BeforeValidator(_explain_friction), _key("Friction per length of ground.")]
    accuracy: Annotated[
        Number | None,
        _key(
            "Largest error of the net translation per period, relative to the largest commanded change of length; "
            "it determines the number of elements. Give this or `elements`.",
            minimum=1e-6,
            maximum=0.5,
        ),
    ] = None
    elements: Annotated[
        int | None,
        _key("Number of springs that represent the segment; overrides `accuracy`.", minimum=1, maximum=1_000_000),
    ] = None
    shown: Annotated[
        int | None,
        _key("Number of its contacts in `contact_states`, including both ends. Default: all.", minimum=2),
    ] = None

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

    contacts: Annotated[
        tuple[Numbers, ...],
        _key("Reference positions of the isolated contacts: strictly increasing, or [x, y] in the plane.", "m"),
    ] = ()
    segments: Annotated[
        tuple[SegmentPart, ...], _key("Parts that touch the ground along their whole length; they must not overlap.")
    ] = ()
    links: Annotated[
        LinksPart | None,
        _key("Springs that join contacts and ends of segments; required for two or more parts."),
    ] = None


class FrictionPart(_Part):
    """Friction of the isolated contacts, N: forward and backward, isotropic, or in the plane by directions."""

    forward: Annotated[
        Numbers | None, _key("Against sliding towards +x: one number, or one per contact.", "N", minimum=0)
    ] = None
    backward: Annotated[
        Numbers | None, _key("Against sliding towards -x: one number, or one per contact.", "N", minimum=0)
    ] = None
    isotropic: Annotated[
        Numbers | None, _key("The same in both directions; in the plane in every direction.", "N", minimum=0)
    ] = None
    directions: Annotated[
        tuple[Number, ...] | None,
        _key("In the plane: at least three angles, increasing within one turn, less than half a turn apart.", "rad"),
    ] = None
    value: Annotated[
        Table | None,
        _key(
            "Friction against sliding in each direction, linear between them and convex: one row, or one per contact.",
            "N",
            minimum=0,
        ),
    ] = None

    @model_validator(mode="after")
    def _one_way(self) -> FrictionPart:
        if self.directions is None and self.value is None:
            _check_one_way(self)
        elif self.directions is None or self.value is None or self.has_sides:
            raise ValueError("give `directions` (rad) and `value` together and nothing else, or `isotropic` alone")
        return self

    @property
    def has_sides(self) -> bool:
        """Whether friction is specified other than by directions."""
        return not (self.forward is None and self.backward is None and self.isotropic is None)

    @property
    def sides(self) -> tuple[Any, Any]:
        """Forward and backward friction."""
        return (self.forward, self.backward) if self.isotropic is None else (self.isotropic, self.isotropic)


class FrictionRowsPart(_TwoSided):
    """Commanded friction, a row per time: forward and backward, or isotropic."""

    forward: Annotated[
        Table | None,
        _key(
            "Against sliding towards +x: a row per time, a column per isolated contact (N), then per segment (N/m); "
            "or one number for all.",
            "N, N/m",
            minimum=0,
        ),
    ] = None
    backward: Annotated[Table | None, _key("Against sliding towards -x, likewise.", "N, N/m", minimum=0)] = None
    isotropic: Annotated[Table | None, _key("The same in both directions, likewise.", "N, N/m", minimum=0)] = None


class StartPart(_Part):
    """Displacements of the contacts at the start."""

    displacement: Annotated[
        Table,
        _key(
            "Of the isolated contacts, then of both ends of each segment, linear between; in the plane [x, y] each.",
            "m",
        ),
    ]


class WavePart(_Part):
    """A sampled, travelling sine wave."""

    amplitude: Annotated[
        Number,
        _key(
            "Of the links' lengths (m) and the segments' strain; of a `friction_wave` N, along segments N/m.",
            "m, 1; N, N/m",
        ),
    ]
    wavelength: Annotated[
        Number,
        _key("In the reference shape, not 0; a positive one travels towards +x, a negative one towards -x.", "m"),
    ]
    period: Annotated[Number, _key("Period of the wave.", "s", exclusiveMinimum=0)]
    mean: Annotated[Number, _key("Mean value; of a `friction_wave` at least the amplitude.", "m, 1; N, N/m")] = 0.0
    samples: Annotated[int, _key("Waypoints per period, with linear interpolation.", minimum=3, maximum=1_000_000)] = 64

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

    times: Annotated[
        tuple[Number, ...] | None, _key("Times of the waypoints: from 0, strictly increasing; linear between.", "s")
    ] = None
    period: Annotated[
        Number | None,
        _key(
            "With `times`: the drive repeats after it; by default it is played once, then held. With a `strategy`: "
            "default 1 s.",
            "s",
            exclusiveMinimum=0,
        ),
    ] = None
    actuation: Annotated[
        Deep | None,
        _key(
            "With `times`: a row per time, a column per link (m), then per segment (strain); in the plane [x, y] each.",
            "m, 1",
        ),
    ] = None
    friction: Annotated[
        FrictionRowsPart | Number | None,
        _key(
            "With `times`: commanded friction; default: that of the scene. With a `strategy`: mu, the mean friction of "
            "both contacts.",
            "N",
            minimum=0,
        ),
    ] = None
    wave: Annotated[WavePart | None, _key("A travelling wave of lengths and strains.")] = None
    friction_wave: Annotated[
        WavePart | None,
        _key("A travelling wave of isotropic friction; alone, or together with a `wave` of the same period."),
    ] = None
    strategy: Annotated[
        Literal["A", "B", "C"] | None, _key("Two contacts on one link, driven as in the paper's section 5.2.")
    ] = None
    length: Annotated[Number | None, _key("With a `strategy`: Lmax, the largest actuation.", "m")] = None

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
                raise ValueError(
                    f"`{key}` does not belong to this kind of drive; its keys are {', '.join(sorted(allowed))}"
                )
        if self.period is not None and not self.period > 0.0:
            raise ValueError(f"period: {self.period:g} s; it must be > 0")
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


class SceneParts(_Part):
    """A crawler, its ground, its start and its drive, as a scene file holds them: SI units throughout."""

    model_config = ConfigDict(title="Scene")

    name: Annotated[str, _key("Name in tables and recordings.")]
    dimension: Annotated[Literal[1, 2], _key("1 on a line, 2 in the plane.")] = 1
    body: Annotated[BodyPart, _key("The parts of the crawler.")]
    friction: Annotated[
        Annotated[FrictionPart, BeforeValidator(_explain_friction)] | None,
        _key("Friction of the isolated contacts; required if there are any."),
    ] = None
    tolerance: Annotated[
        Number | None,
        _key(
            "Only in the plane: largest error of a ramp, relative to the largest commanded change. Default: 1e-4.",
            minimum=1e-9,
            maximum=0.5,
        ),
    ] = None
    start: Annotated[
        StartPart | Literal["relaxed"] | None,
        _key("Displacements at the start; `relaxed`: without spring forces. Default: x = 0."),
    ] = None
    drive: Annotated[
        DrivePart | None,
        _key("Drive for `crawler simulate` and the gait player. Default: none, the crawler waits for commands."),
    ] = None
