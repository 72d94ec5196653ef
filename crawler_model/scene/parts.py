"""The parts of a scene: the keys of a scene file, with the checks of single values."""

from __future__ import annotations

import itertools
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ConfigDict, model_validator

from ..arrays import spread
from ..body.build_body import touch
from .friction_parts import (
    CouplingPart,
    Deep,
    FrictionPart,
    FrictionRowsPart,
    Number,
    Numbers,
    Part,
    ProfilePart,
    Table,
    explain_friction,
    key,
    optional,
)
from .link_parts import Bendable, JointsPart, Links, LinksPart, SegmentPart
from .sensors import SensorsPart

LARGEST_TOLERANCE = 0.5
"""Largest tolerance of a body in the plane [1]."""
LEAST_TOLERANCE = 1e-9
"""Least tolerance of a body in the plane [1]: rounding would exceed smaller ones."""


class BodyPart(Part):
    """Contacts, segments and links."""

    contacts: tuple[Numbers, ...] = key(
        "Reference positions of the isolated contacts: strictly increasing, or [x, y] in the plane.", "m", default=()
    )
    points: tuple[Numbers, ...] | None = optional(
        "With `springs: length`, another word for `contacts`: contacts, and points without friction.", "m"
    )
    springs: Literal["vector", "length"] = key(
        "In the plane: whether a link remembers its direction, or only its length, so that the body can turn.",
        default="vector",
    )
    segments: tuple[SegmentPart, ...] = key(
        "Parts that touch the ground along their whole length; they must not overlap. Segments that touch share the "
        "contact between them, as does an isolated contact at an end of a segment.",
        default=(),
    )
    weights: Numbers | None = optional(
        "Weight of each isolated contact (N), then of each segment (N/m): one number for all, or one each. Slopes and "
        "coefficients of friction need it.",
        "N, N/m",
        minimum=0,
    )
    masses: Numbers | None = optional(
        "Mass of each isolated contact (kg), then of each segment (kg/m): one number for all, or one each. Masses "
        "change no motion; they tell how slow a drive has to be. Default: weight / 9.81, if there are weights.",
        "kg, kg/m",
        minimum=0,
    )
    radius: Numbers | None = optional(
        "Radius of the isolated contacts: one number for all, or one each. `shortest: contact` needs it.",
        "m",
        exclusiveMinimum=0,
    )
    links: Links | None = optional(
        "Springs that join contacts and ends of segments, as a mapping for all or a list with one entry each; required "
        "for two or more parts."
    )
    joints: JointsPart | None = optional("With `springs: length`: springs of the angles at points. Default: none.")

    @model_validator(mode="after")
    def _solid(self) -> BodyPart:
        if self.radius is not None:
            spread(self.radius, len(self.places), "radius", "contact")
        for radius in self.radius if isinstance(self.radius, tuple) else (self.radius,):
            if radius is not None and not radius > 0.0:
                raise ValueError(f"radius: {radius:g} m; it must be > 0")
        return self

    @property
    def places(self) -> tuple[Any, ...]:
        """Reference positions, whichever key holds them."""
        return self.contacts if self.points is None else self.points

    @property
    def gaps(self) -> int:
        """Number of pairs of neighbouring parts that do not touch, which the links of a chain join."""
        count = len(self.places) + len(self.segments) - 1
        if not self.segments or any(isinstance(place, tuple) for place in self.places):
            return count
        ends = sorted([(place, place) for place in self.places] + [(s.start, s.stop) for s in self.segments])
        return count - sum(touch(here[1], there[0]) for here, there in itertools.pairwise(ends))

    @property
    def shares_contacts(self) -> bool:
        """Whether some of its parts touch."""
        return self.gaps < len(self.places) + len(self.segments) - 1

    @property
    def is_bent(self) -> bool:
        """Whether a spring is anything but linear."""
        links = () if self.links is None else (self.links,) if isinstance(self.links, LinksPart) else self.links
        parts: tuple[Bendable, ...] = (*links, *self.segments)
        return any(part.is_bent for part in parts)


class StartPart(Part):
    """Displacements of the contacts at the start."""

    displacement: Table = key(
        "Displacements of the isolated contacts, then of both ends of each segment, linear in between; in the plane "
        "[x, y] each.",
        "m",
    )
    hysteresis: tuple[tuple[Number, ...], ...] | None = optional(
        "Forces of the elements of hysteresis: a list for each link, then for each segment, with a force for each "
        "element, at most its `yield` either way. Default: none.",
        "N",
    )
    backlash: tuple[Number, ...] | None = optional(
        "How far the actuators are ahead of their commands: a length for each link, then a strain for each segment, at "
        "most half of its `backlash` either way. Default: 0, in the middle of the slack.",
        "m, 1",
    )


class WavePart(Part):
    """A sampled, travelling sine wave."""

    amplitude: Number = key(
        "Amplitude of the lengths of links (m) and of the strain of segments; for a `friction_wave` in N, along "
        "segments in N/m.",
        "m, 1; N, N/m",
    )
    wavelength: Number = key(
        "Wavelength in the reference shape, not 0; positive for a wave towards +x, negative for one towards -x.", "m"
    )
    period: Number = key("Period of the wave.", "s", exclusiveMinimum=0)
    mean: Number = key("Mean value; for a `friction_wave` at least the amplitude.", "m, 1; N, N/m", default=0.0)
    samples: int = key("Waypoints per period, with linear interpolation.", default=64, minimum=3, maximum=1_000_000)

    @model_validator(mode="after")
    def _sane(self) -> WavePart:
        if self.wavelength == 0.0:
            raise ValueError("wavelength: 0 m; it must not be 0")
        if not self.period > 0.0:
            raise ValueError(f"period: {self.period:g} s; it must be > 0")
        if not 3 <= self.samples <= 1_000_000:
            raise ValueError(f"samples: {self.samples}; it must be between 3 and 1000000")
        return self


class DrivePart(Part):
    """Open-loop commands: times, or wave and friction_wave, or strategy."""

    times: tuple[Number, ...] | None = optional(
        "Times of the waypoints: from 0, strictly increasing; linear in between.", "s"
    )
    period: Number | None = optional(
        "With `times`: the drive repeats after it; by default it is played once, then held. With a `strategy`: default "
        "1 s.",
        "s",
        exclusiveMinimum=0,
    )
    actuation: Deep | None = optional(
        "With `times`: a row per time, a column per link (m), then per segment (strain); in the plane [x, y] each, "
        "with `springs: length` a column per link (m), then per joint (rad).",
        "m, 1, rad",
    )
    friction: FrictionRowsPart | Number | None = optional(
        "With `times`: commanded friction; default: the scene's. With a `strategy`: mu, the mean friction of "
        "both contacts.",
        "N",
        minimum=0,
    )
    loads: Deep | None = optional(
        "With `times`: commanded loads along the ground, instead of the scene's: a row per time, a column per isolated "
        "contact (N), then per segment (N/m); or one number for all. In the plane a row is [x, y] for all contacts, or "
        "one pair each.",
        "N, N/m",
    )
    wave: WavePart | None = optional("A travelling wave of lengths and strains.")
    friction_wave: WavePart | None = optional(
        "A travelling wave of isotropic friction, with or without a `wave` of the same period."
    )
    strategy: Literal["A", "B", "C"] | None = optional(
        "Two contacts on one link, driven as in the paper's section 5.2."
    )
    length: Number | None = optional("With a `strategy`: Lmax, the largest actuation.", "m")

    @property
    def commands_friction(self) -> bool:
        """Whether the drive commands friction, so that the scene's own has no effect."""
        return self.friction is not None or self.friction_wave is not None

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
        for name in sorted(self.model_fields_set - allowed):
            if getattr(self, name) is not None:
                raise ValueError(
                    f"`{name}` does not belong to this kind of drive; its keys are {', '.join(sorted(allowed))}"
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


_TURN = 6.2832
_FLAT = 1e-9
"""Corners of a polygon that are less than this part of its size from its other edges are on them."""


class PatchPart(Part):
    """Other ground between two places of the track; borders belong to neither side."""

    start: Number = key("Start on the track.", "m", alias="from")
    stop: Number = key("End on the track, beyond `from`.", "m", alias="to")
    friction: Number | None = optional(
        "Factor on the friction of contacts there, commanded or not. Default: 1.", "1", minimum=0
    )
    forward: Number | None = optional(
        "Instead of `friction`: factor on the friction against sliding towards +x. Default: 1.", "1", minimum=0
    )
    backward: Number | None = optional("The same against sliding towards -x. Default: 1.", "1", minimum=0)
    slope: Number | None = optional(
        "Slope of the patch, positive uphill towards +x. Default: the track's.",
        "degrees",
        exclusiveMinimum=-90,
        exclusiveMaximum=90,
    )

    @model_validator(mode="after")
    def _sane(self) -> PatchPart:
        if not self.stop > self.start:
            raise ValueError(f"to: {self.stop:g} m; it must be greater than `from`, {self.start:g} m")
        sides = {"friction": self.friction, "forward": self.forward, "backward": self.backward}
        for name, factor in sides.items():
            if factor is not None and factor < 0.0:
                raise ValueError(f"{name}: {factor:g}; a factor on friction must be >= 0")
        if self.friction is not None and (self.forward is not None or self.backward is not None):
            raise ValueError("give `friction`, or `forward` and `backward`, not both")
        if self.slope is not None:
            _check_slope(self.slope)
        elif all(factor is None for factor in sides.values()):
            raise ValueError(
                "give `friction`, `forward`, `backward` or `slope`; without any of them the patch changes nothing"
            )
        return self

    @property
    def factors(self) -> tuple[float, float]:
        """Factors on friction, forward and backward."""
        if self.friction is not None:
            return self.friction, self.friction
        forward, backward = (1.0 if factor is None else factor for factor in (self.forward, self.backward))
        return forward, backward


class WallPart(Part):
    """A wall: contacts stand at it, whatever force pushes them against it."""

    at: Number = key("Place of the wall on the track.", "m")
    stops: Literal["forward", "backward"] = key("The direction in which it stops contacts; `forward` is towards +x.")
    contacts: tuple[int, ...] | None = optional(
        "The isolated contacts that it stops, counted from 0. Default: all contacts, segments included."
    )


class RegionPart(Part):
    """Other ground in a convex part of the plane."""

    polygon: tuple[tuple[Number, Number], ...] | None = optional("Corners [x, y] of a convex polygon, in order.", "m")
    left_of: tuple[tuple[Number, Number], tuple[Number, Number]] | None = optional(
        "Instead of `polygon`: two points; the region is the half plane to the left of the line from the first to the "
        "second.",
        "m",
    )
    friction: Number = key("Factor on the friction of contacts there, commanded or not.", "1", minimum=0)

    @model_validator(mode="after")
    def _sane(self) -> RegionPart:
        if self.friction < 0.0:
            raise ValueError(f"friction: {self.friction:g}; a factor on friction must be >= 0")
        if (self.polygon is None) == (self.left_of is None):
            raise ValueError("give `polygon` or `left_of`, one of them")
        if self.left_of is not None:
            if self.left_of[0] == self.left_of[1]:
                raise ValueError("left_of: both points are the same; two different ones determine a line")
            return self
        corners = self.corners
        if len(corners) < 3:
            raise ValueError(f"polygon: {len(corners)} corner(s); give at least 3")
        for corner, after in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if (corner == after).all():
                raise ValueError(f"polygon: [{corner[0]:g}, {corner[1]:g}] twice in a row; leave out one of them")
        normals, offsets = self.half_planes
        size, count = float(np.ptp(corners, axis=0).max()), len(corners)
        inside = corners @ normals.T - offsets  # of each corner, the distance from each edge
        near = {(i, (i + step) % count) for i in range(count) for step in (-1, 0)}  # the edges that meet there
        for k in range(count):
            if any(not inside[i, k] > _FLAT * size for i in range(count) if (i, k) not in near):
                x, y = corners[k]
                raise ValueError(
                    f"polygon: it is not convex at the edge that begins at [{x:g}, {y:g}]; divide it into convex "
                    "polygons, and leave out corners on straight edges"
                )
        return self

    @property
    def corners(self) -> np.ndarray:
        """Corners of the polygon, counterclockwise, or the two points of the line, shape (K, 2) [m]."""
        if self.polygon is None:
            return np.array(self.left_of, np.float64)
        corners = np.array(self.polygon, np.float64)
        x, y = corners.T
        area = float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
        return corners if area >= 0.0 else corners[::-1]

    @property
    def half_planes(self) -> tuple[np.ndarray, np.ndarray]:
        """Inward unit normals n, shape (K, 2), and offsets c, shape (K,) [m], of { p | n . p >= c }."""
        corners = self.corners
        along = np.roll(corners, -1, axis=0) - corners
        if self.polygon is None:
            corners, along = corners[:1], along[:1]
        normals = np.column_stack((-along[:, 1], along[:, 0])) / np.hypot(*along.T)[:, None]
        return normals, np.einsum("ij,ij->i", normals, corners)


def _check_slope(slope: float) -> None:
    if not -90.0 < slope < 90.0:
        raise ValueError(f"slope: {slope:g} degrees; it must be between -90 and 90")


class GroundPart(Part):
    """The ground: on a line the track, its slope, patches, profile and walls; in the plane its slope and regions."""

    slope: Number = key(
        "Slope of the ground, positive uphill towards +x; in the plane uphill towards `direction`.",
        "degrees",
        default=0.0,
        exclusiveMinimum=-90,
        exclusiveMaximum=90,
    )
    direction: Number | None = optional(
        "Only in the plane: angle of uphill from the x axis. Default: 0.", "rad", minimum=-_TURN, maximum=_TURN
    )
    patches: tuple[PatchPart, ...] = key(
        "Other ground between two places of the track: in order, without overlap.", default=()
    )
    profile: ProfilePart | None = optional(
        "Ground that changes gradually: friction and slope linear between places of the track, together with patches. "
        "Default: none."
    )
    walls: tuple[WallPart, ...] = key("Walls on the track, at which contacts stand.", default=())
    regions: tuple[RegionPart, ...] = key(
        "Only in the plane: convex regions with other friction, without overlap.", default=()
    )

    @property
    def varies(self) -> bool:
        """Whether the track differs from place to place."""
        return bool(self.patches or self.walls or self.profile)

    @property
    def even(self) -> GroundPart:
        """The same ground where it does not differ from place to place."""
        return self.model_copy(update={"patches": (), "walls": (), "profile": None})

    @model_validator(mode="after")
    def _sane(self) -> GroundPart:
        _check_slope(self.slope)
        if self.direction is not None and not abs(self.direction) <= _TURN:
            raise ValueError(f"direction: {self.direction:g} rad; it must be between -{_TURN} and {_TURN}, a full turn")
        if self.profile is not None and self.profile.slope is not None and self.slope != 0.0:
            raise ValueError(f"slope: {self.slope:g} degrees, but `profile.slope` is given; give one of them")
        for i, (one, other) in enumerate(zip(self.patches, self.patches[1:], strict=False)):
            if other.start < one.stop:
                raise ValueError(
                    f"patches: patch {i + 1} starts at {other.start:g} m, before patch {i} ends at {one.stop:g} m; "
                    "give them in order, without overlap"
                )
        return self


def _check_printable(name: str) -> str:
    if not name.isprintable():
        raise ValueError(f"{name!r} contains control characters; they must not get into terminals and descriptions")
    return name


class SceneParts(Part):
    """A crawler, its ground, its start and its drive, as a scene file holds them: SI units throughout."""

    model_config = ConfigDict(title="Scene")

    name: Annotated[str, AfterValidator(_check_printable)] = key("Name in tables and recordings.")
    dimension: Literal[1, 2] = key("1 on a line, 2 in the plane.", default=1)
    body: BodyPart = key("The parts of the crawler.")
    friction: Annotated[FrictionPart, BeforeValidator(explain_friction)] | None = optional(
        "Friction of the isolated contacts; required if there are any."
    )
    loads: Table | None = optional(
        "Forces along the ground, towards +x positive: one number for all, or one per isolated contact (N), then per "
        "segment (N/m). In the plane [x, y] for all contacts, or one pair each.",
        "N, N/m",
    )
    ground: GroundPart | None = optional("The ground; level if omitted.")
    heading: tuple[int, int] | None = optional(
        "With `springs: length`: the two points whose direction is the yaw. Default: the first and the last one."
    )
    on_instability: Literal["jump", "refuse"] | None = optional(
        "With `springs: length`: a body that buckles jumps (default), or the command is refused."
    )
    tolerance: Number | None = optional(
        "Only in the plane: largest error of a ramp, relative to the largest commanded change. Default: 1e-4; with "
        "`springs: length` 1e-5.",
        minimum=LEAST_TOLERANCE,
        maximum=LARGEST_TOLERANCE,
    )
    start: StartPart | Literal["relaxed"] | None = optional(
        "Displacements at the start; `relaxed`: without spring forces, or with the least that hold the loads. Default: "
        "x = 0."
    )
    drive: DrivePart | None = optional(
        "Drive for `crawler simulate` and the gait player. Default: none; the crawler then waits for commands."
    )
    sensors: SensorsPart | None = optional(
        "How sensors measure, in the simulator and in the Gymnasium environment. Default: exact states only."
    )

    @property
    def couplings(self) -> tuple[CouplingPart, ...]:
        """What changes friction with elongations."""
        return () if self.friction is None else self.friction.with_elongation

    @property
    def angles(self) -> tuple[float, ...]:
        """Angles of the directions of friction in the plane, none for isotropic friction [rad]."""
        return () if self.friction is None else self.friction.given.directions or ()
