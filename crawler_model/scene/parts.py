"""The parts of a scene: what a scene file may hold, key by key, each value checked where it stands."""

from __future__ import annotations

import itertools
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
    """Say of a key what the schema and docs/reference/scenes.md say; bounds by their names in JSON schema."""
    return Field(description=meaning, json_schema_extra={**({"unit": unit} if unit else {}), **bounds})


class LinksPart(_Part):
    """The springs between contacts and ends of segments."""

    stiffness: Annotated[Numbers, _key("One number, or one per link.", "N/m", exclusiveMinimum=0)]
    between: Annotated[
        tuple[tuple[int | str, int | str], ...] | None,
        _key(
            "The pair of ends that each link joins: contacts by number, ends of segments as `name.from`, `name.to`. "
            "Left out: the chain of neighbours."
        ),
    ] = None


class TablePart(_Part):
    """A value along a segment: straight lines between positions, constant beyond them."""

    at: Annotated[tuple[Number, ...], _key("Positions along the body, strictly increasing.", "m")]
    value: Annotated[
        tuple[Number, ...], _key("The value at each position, in the unit of the key that the table stands for.")
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


def _check_one_kind(part: Any) -> None:
    """Check that friction is given as forces or as coefficients, not as both."""
    if part.coefficient is None:
        _check_one_way(part)
    elif part.forward is not None or part.backward is not None or part.isotropic is not None:
        raise ValueError("give `coefficient`, or forces, not both")


def _sides(part: Any) -> tuple[Any, Any]:
    if getattr(part, "coefficient", None) is not None:
        return _sides(part.coefficient)
    return (part.forward, part.backward) if part.isotropic is None else (part.isotropic, part.isotropic)


class _TwoSided(_Part):
    @model_validator(mode="after")
    def _one_way(self) -> _TwoSided:
        _check_one_way(self)
        return self

    @property
    def sides(self) -> tuple[Any, Any]:
        """What forward and backward friction are."""
        return _sides(self)


class CoefficientPart(_TwoSided):
    """Coefficients of friction: mu = coefficient * weight * cos(slope)."""

    forward: Annotated[Numbers | None, _key("Against sliding towards +x: one number, or one each.", "1", minimum=0)] = (
        None
    )
    backward: Annotated[Numbers | None, _key("Against sliding towards -x, likewise.", "1", minimum=0)] = None
    isotropic: Annotated[Numbers | None, _key("Both in one, likewise.", "1", minimum=0)] = None


class SegmentFrictionPart(_Part):
    """Friction of a segment per length, N/m: forward and backward, or isotropic, or as coefficients."""

    forward: Annotated[Number | TablePart | None, _key("Against sliding towards +x.", "N/m", minimum=0)] = None
    backward: Annotated[Number | TablePart | None, _key("Against sliding towards -x.", "N/m", minimum=0)] = None
    isotropic: Annotated[Number | TablePart | None, _key("Both in one.", "N/m", minimum=0)] = None
    coefficient: Annotated[
        CoefficientPart | None, _key("Instead of forces: coefficients, of the weight of the segment.")
    ] = None

    @model_validator(mode="after")
    def _one_way(self) -> SegmentFrictionPart:
        _check_one_kind(self)
        return self

    @property
    def sides(self) -> tuple[Any, Any]:
        """Forward and backward friction, or the coefficients that stand for them."""
        return _sides(self)


class SegmentPart(_Part):
    """An interval of the body that touches the ground all along."""

    name: Annotated[str, _key("A word of its own; commands and joints carry it.")]
    start: Annotated[Number, _key("Where it begins in the reference shape.", "m")] = Field(alias="from")
    stop: Annotated[Number, _key("Where it ends, beyond `from`.", "m")] = Field(alias="to")
    stiffness: Annotated[Number | TablePart, _key("The modulus along it.", "N", exclusiveMinimum=0)]
    friction: Annotated[SegmentFrictionPart, BeforeValidator(_explain_friction), _key("Friction per length of ground.")]
    accuracy: Annotated[
        Number | None,
        _key(
            "Largest error of the net translation per period, relative to the largest change of length commanded; "
            "the number of elements follows from it. Give it or `elements`.",
            minimum=1e-6,
            maximum=0.5,
        ),
    ] = None
    elements: Annotated[
        int | None,
        _key("How many springs the segment is cut into; overrides `accuracy`.", minimum=1, maximum=1_000_000),
    ] = None
    shown: Annotated[
        int | None,
        _key("How many of its contacts `contact_states` lists, both ends among them. Left out: all.", minimum=2),
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
        tuple[SegmentPart, ...], _key("Parts that touch the ground all along; they overlap nothing.")
    ] = ()
    weights: Annotated[
        Numbers | None,
        _key(
            "Weight of each isolated contact (N), then of each segment (N/m): one number for all, or one each. "
            "Slopes and coefficients of friction need it.",
            "N, N/m",
            minimum=0,
        ),
    ] = None
    links: Annotated[
        LinksPart | None,
        _key("Springs that join contacts and ends of segments; needed where there are two parts or more."),
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
        Numbers | None, _key("Both in one; in the plane the same in every direction.", "N", minimum=0)
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

    coefficient: Annotated[
        CoefficientPart | None, _key("Instead of forces: coefficients, of the weights of the contacts.")
    ] = None

    @model_validator(mode="after")
    def _one_way(self) -> FrictionPart:
        if self.directions is None and self.value is None:
            _check_one_kind(self)
        elif self.directions is None or self.value is None or self.gives_sides:
            raise ValueError("give `directions` (rad) and `value` together and nothing else, or `isotropic` alone")
        return self

    @property
    def gives_sides(self) -> bool:
        """Whether friction is given other than by directions."""
        given = (self.forward, self.backward, self.isotropic, self.coefficient)
        return any(value is not None for value in given)

    @property
    def sides(self) -> tuple[Any, Any]:
        """What forward and backward friction are."""
        return _sides(self)


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
    isotropic: Annotated[Table | None, _key("Both in one, likewise.", "N, N/m", minimum=0)] = None


class StartPart(_Part):
    """Where the contacts stand at the start."""

    displacement: Annotated[
        Table,
        _key(
            "Of the isolated contacts, then of both ends of each segment, straight between; in the plane [x, y] each.",
            "m",
        ),
    ]


class WavePart(_Part):
    """A travelling sine, sampled."""

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
    period: Annotated[Number, _key("After it the wave repeats.", "s", exclusiveMinimum=0)]
    mean: Annotated[
        Number, _key("About which it swings; of a `friction_wave` at least the amplitude.", "m, 1; N, N/m")
    ] = 0.0
    samples: Annotated[int, _key("Waypoints in a period, straight lines between.", minimum=3, maximum=1_000_000)] = 64

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
        tuple[Number, ...] | None, _key("Of the waypoints: from 0, strictly increasing; straight lines between.", "s")
    ] = None
    period: Annotated[
        Number | None,
        _key(
            "With `times`: after it the drive repeats; left out, it is played once, then held. With a `strategy`: left "
            "out, 1 s.",
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
            "With `times`: commanded friction; left out, the scene's holds. With a `strategy`: mu, about which the "
            "friction of both contacts swings.",
            "N",
            minimum=0,
        ),
    ] = None
    loads: Annotated[
        Table | None,
        _key(
            "With `times`: commanded loads along the ground, instead of the scene's: a row per time, a column per "
            "isolated contact (N), then per segment (N/m); or one number for all.",
            "N, N/m",
        ),
    ] = None
    wave: Annotated[WavePart | None, _key("A travelling wave of lengths and strains.")] = None
    friction_wave: Annotated[
        WavePart | None,
        _key("A travelling wave of friction, both ways alike; alone, or beside a `wave` of the same period."),
    ] = None
    strategy: Annotated[
        Literal["A", "B", "C"] | None, _key("Two contacts on one link, driven as in the paper's section 5.2.")
    ] = None
    length: Annotated[Number | None, _key("With a `strategy`: Lmax, the greatest actuation.", "m")] = None

    @model_validator(mode="after")
    def _one_kind(self) -> DrivePart:
        waves = self.wave is not None or self.friction_wave is not None
        kinds = [self.times is not None, waves, self.strategy is not None]
        if sum(kinds) != 1:
            raise ValueError("give exactly one of `times`, `wave` and `friction_wave`, or `strategy`")
        allowed = {"times", "period", "actuation", "friction", "loads"}
        if waves:
            allowed = {"wave", "friction_wave"}
        elif self.strategy is not None:
            allowed = {"strategy", "length", "friction", "period"}
        for key in sorted(self.model_fields_set - allowed):
            if getattr(self, key) is not None:
                raise ValueError(f"`{key}` does not go with this kind of drive; it takes {', '.join(sorted(allowed))}")
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


class PatchPart(_Part):
    """A stretch of the track with a ground of its own."""

    start: Annotated[Number, _key("Where it begins on the track.", "m")] = Field(alias="from")
    stop: Annotated[Number, _key("Where it ends, beyond `from`.", "m")] = Field(alias="to")
    friction: Annotated[Number | None, _key("Factor on friction, both ways.", "1", minimum=0)] = None
    forward: Annotated[Number | None, _key("Factor on friction against sliding towards +x.", "1", minimum=0)] = None
    backward: Annotated[Number | None, _key("Factor on friction against sliding towards -x.", "1", minimum=0)] = None
    slope: Annotated[
        Number | None,
        _key(
            "Slope of this stretch, uphill towards +x positive.", "degrees", exclusiveMinimum=-90, exclusiveMaximum=90
        ),
    ] = None

    @model_validator(mode="after")
    def _sane(self) -> PatchPart:
        if not self.stop > self.start:
            raise ValueError(f"to: {self.stop:g} m; it must lie beyond from, {self.start:g} m")
        if self.friction is not None and (self.forward is not None or self.backward is not None):
            raise ValueError("give `friction` for both ways, or `forward` and `backward`, not both")
        for name in ("friction", "forward", "backward"):
            value = getattr(self, name)
            if value is not None and value < 0.0:
                raise ValueError(f"{name}: {value:g}; a factor on friction must be >= 0")
        if self.slope is not None and not -90.0 < self.slope < 90.0:
            raise ValueError(f"slope: {self.slope:g} degrees; it must lie between -90 and 90")
        if self.friction is None and self.forward is None and self.backward is None and self.slope is None:
            raise ValueError("a patch without `friction`, `forward`, `backward` or `slope` changes nothing")
        return self


class GroundPart(_Part):
    """The track: its slope, and stretches that differ from the rest."""

    slope: Annotated[
        Number,
        _key("Slope of the track, uphill towards +x positive.", "degrees", exclusiveMinimum=-90, exclusiveMaximum=90),
    ] = 0.0
    direction: Annotated[
        Number | None, _key("In the plane alone: the direction that goes uphill, from the x axis.", "rad")
    ] = None
    patches: Annotated[tuple[PatchPart, ...], _key("Stretches of the track, sorted, not overlapping.")] = ()

    @model_validator(mode="after")
    def _sane(self) -> GroundPart:
        if not -90.0 < self.slope < 90.0:
            raise ValueError(f"slope: {self.slope:g} degrees; it must lie between -90 and 90")
        for i, (before, after) in enumerate(itertools.pairwise(self.patches)):
            if after.start < before.stop:
                raise ValueError(
                    f"patches: patch {i + 1} begins at {after.start:g} m, before patch {i} ends at {before.stop:g} m; "
                    "patches must be sorted and must not overlap"
                )
        return self


class SceneParts(_Part):
    """A crawler, its ground, its start and its drive, as a scene file holds them: SI units throughout."""

    model_config = ConfigDict(title="Scene")

    name: Annotated[str, _key("What tables and recordings call it.")]
    dimension: Annotated[Literal[1, 2], _key("1 on a line, 2 in the plane.")] = 1
    body: Annotated[BodyPart, _key("What the crawler is made of.")]
    friction: Annotated[
        Annotated[FrictionPart, BeforeValidator(_explain_friction)] | None,
        _key("Friction of the isolated contacts; needed where there are any."),
    ] = None
    loads: Annotated[
        Numbers | None,
        _key(
            "Forces along the ground, towards +x positive: one number for all, or one per isolated contact (N), then "
            "per segment (N/m).",
            "N, N/m",
        ),
    ] = None
    ground: Annotated[GroundPart | None, _key("The track; left out: flat and the same everywhere.")] = None
    tolerance: Annotated[
        Number | None,
        _key(
            "In the plane alone: largest error of a ramp, relative to the largest change commanded. Left out: 1e-4.",
            minimum=1e-9,
            maximum=0.5,
        ),
    ] = None
    start: Annotated[
        StartPart | Literal["relaxed"] | None,
        _key("Where the contacts stand at the start; `relaxed`: without forces in the springs. Left out: x = 0."),
    ] = None
    drive: Annotated[
        DrivePart | None,
        _key("What `crawler simulate` and the gait player play. Left out: the crawler waits for commands."),
    ] = None
