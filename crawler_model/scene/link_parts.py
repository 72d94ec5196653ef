"""The parts of a scene that hold springs and actuators: links and segments."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Tag, model_validator

from .friction_parts import Number, Numbers, Part, SegmentFrictionPart, TablePart, explain_friction, key, optional


class CurvePart(Part):
    """A tension that was measured: straight between the knots, and on beyond them with the slopes of both ends."""

    elongation: tuple[Number, ...] = key(
        "The knots, at least two, strictly increasing; along segments strains.", "m, 1"
    )
    tension: tuple[Number, ...] = key("The tension at each knot; it must not decrease.", "N")

    @model_validator(mode="after")
    def _rises(self) -> CurvePart:
        at, value = self.elongation, self.tension
        if len(at) != len(value) or len(at) < 2:
            raise ValueError(
                f"elongation: {len(at)} knot(s) for {len(value)} value(s) of `tension`; give one each, at least two"
            )
        for i in range(1, len(at)):
            if at[i] == at[i - 1]:
                raise ValueError(
                    f"elongation: {at[i]:g} twice, with tensions of {value[i - 1]:g} N and {value[i]:g} N; "
                    "knots must be strictly increasing"
                )
            if at[i] < at[i - 1]:
                raise ValueError(
                    f"elongation: {at[i]:g} follows {at[i - 1]:g}; knots must be sorted, strictly increasing"
                )
            if value[i] < value[i - 1]:
                raise ValueError(
                    f"tension: it falls from {value[i - 1]:g} N at {at[i - 1]:g} to {value[i]:g} N at {at[i]:g}; "
                    "a tension must not decrease with elongation"
                )
        return self


class TensionPart(Part):
    """The range of tensions that an actuator reaches: below and above it yields."""

    least: Number | None = optional("Least tension: 0 for a tendon, which goes slack. Default: none.", "N")
    most: Number | None = optional("Largest tension, at which a motor stalls. Default: none.", "N")

    @model_validator(mode="after")
    def _in_order(self) -> TensionPart:
        if self.least is not None and self.most is not None and self.least > self.most:
            raise ValueError(f"least: {self.least:g} N; it must not be above `most`, {self.most:g} N")
        return self


class StopsPart(Part):
    """Mechanical stops: no force between them, a stiff spring beyond."""

    shortest: Number | Literal["contact"] | None = optional(
        "Least elongation that is free, of segments a strain; `contact`: where the two contacts of a link touch, which "
        "needs `body.radius`. Default: none.",
        "m, 1",
    )
    longest: Number | None = optional("Largest elongation that is free. Default: none.", "m, 1")
    stiffness: Number = key("Stiffness of the stops, of segments a modulus.", "N/m, N", exclusiveMinimum=0)

    @model_validator(mode="after")
    def _in_order(self) -> StopsPart:
        if self.shortest is None and self.longest is None:
            raise ValueError("give `shortest`, `longest` or both")
        if not self.stiffness > 0.0:
            raise ValueError(f"stiffness: {self.stiffness:g}; it must be > 0")
        if isinstance(self.shortest, float) and self.longest is not None and self.shortest > self.longest:
            raise ValueError(f"shortest: {self.shortest:g}; it must not be above `longest`, {self.longest:g}")
        return self


class PassivePart(Part):
    """A passive spring in parallel with the actuator, over the elongation z itself."""

    stiffness: Number | None = optional("Stiffness, of segments a modulus; or give a `curve`.", "N/m, N", minimum=0)
    curve: CurvePart | None = optional("Tension over the elongation, instead of `stiffness`.")
    stops: StopsPart | None = optional("Mechanical stops, with or without a spring.")

    @model_validator(mode="after")
    def _fits(self) -> PassivePart:
        if self.stiffness is not None and self.curve is not None:
            raise ValueError("give `stiffness` or `curve`, not both")
        if self.stiffness is None and self.curve is None and self.stops is None:
            raise ValueError("give `stiffness`, `curve` or `stops`")
        if self.stiffness is not None and not self.stiffness >= 0.0:
            raise ValueError(f"stiffness: {self.stiffness:g}; it must be >= 0")
        return self


class HysteresisPart(Part):
    """A Maxwell-slip element in parallel with a spring: a spring and a slider in series, which yield and remember."""

    stiffness: Number = key("Stiffness, of segments a modulus.", "N/m, N", exclusiveMinimum=0)
    yields_at: Number = key(
        "The force at which the element yields: beyond it only its slip grows, and the energy is lost.",
        "N",
        alias="yield",
        exclusiveMinimum=0,
    )

    @model_validator(mode="after")
    def _positive(self) -> HysteresisPart:
        for name, value in (("stiffness", self.stiffness), ("yield", self.yields_at)):
            if not value > 0.0:
                raise ValueError(f"{name}: {value:g}; it must be > 0")
        return self


_MOST_ELEMENTS = 100
HysteresisKey = Annotated[
    tuple[HysteresisPart, ...],
    key(
        "Maxwell-slip elements in parallel with the spring, over the elongation z: they draw loops of loading and "
        "unloading. Default: none."
    ),
]
CurveKey = Annotated[
    CurvePart | None, key("Tension over z - L, instead of `stiffness`; along segments over the strain.")
]
TensionKey = Annotated[
    Number | TensionPart | None,
    key(
        "Tensions that the actuator reaches; a number F for -F to F, as of a motor that stalls. Default: it "
        "reaches all.",
        "N",
        minimum=0,
    ),
]
PassiveKey = Annotated[
    PassivePart | None,
    key("Passive spring or stops parallel to the actuator, over the elongation z. Default: none."),
]
BacklashKey = Annotated[
    Number,
    key(
        "Slack between the command and the actuator, in all; for segments a strain. Behind a reversal the command "
        "crosses it before the actuator moves.",
        "m, 1",
        default=0.0,
        minimum=0,
    ),
]


class Bendable(Part):
    """Base of links and segments, which have a stiffness and all else that a spring and its actuator may have."""

    @property
    def is_bent(self) -> bool:
        """Whether the tension is anything but a stiffness times z - L, or the actuator has backlash."""
        part: Any = self
        given = (part.curve, part.tension, part.passive)
        return bool(part.hysteresis or part.backlash) or any(value is not None for value in given)

    @model_validator(mode="after")
    def _has_one_tension(self) -> Bendable:
        part: Any = self
        if part.stiffness is not None and part.curve is not None:
            raise ValueError("give `stiffness` or `curve`, not both")
        if part.stiffness is None and part.curve is None:
            if part.passive is None:
                raise ValueError("stiffness: missing; or give a `curve`, or only a `passive` spring")
            if part.tension is not None:
                raise ValueError("tension: it limits an actuator; give its `stiffness` or `curve`, too")
        if isinstance(part.tension, float) and part.tension < 0.0:
            raise ValueError(f"tension: {part.tension:g} N; it must be >= 0, for -F to F")
        if len(part.hysteresis) > _MOST_ELEMENTS:
            raise ValueError(f"hysteresis: {len(part.hysteresis)} elements; at most {_MOST_ELEMENTS}")
        if not part.backlash >= 0.0:
            raise ValueError(f"backlash: {part.backlash:g}; it must be >= 0")
        if part.backlash and part.stiffness is None and part.curve is None:
            raise ValueError("backlash: it is the slack of an actuator; give its `stiffness` or `curve`, too")
        return self


class LinksPart(Bendable):
    """The springs between contacts and ends of segments, alike but for their stiffness."""

    stiffness: Numbers | None = optional("One number, or one per link.", "N/m", exclusiveMinimum=0)
    curve: CurveKey = None
    tension: TensionKey = None
    passive: PassiveKey = None
    hysteresis: HysteresisKey = ()
    backlash: BacklashKey = 0.0
    between: tuple[tuple[int | str, int | str], ...] | None = optional(
        "The pair of ends that each link joins: contacts by number, ends of segments as `name.from`, `name.to`. "
        "Default: the chain of neighbours."
    )


class LinkPart(Bendable):
    """One link of a list."""

    stiffness: Number | None = optional("Stiffness of its actuator.", "N/m", exclusiveMinimum=0)
    curve: CurveKey = None
    tension: TensionKey = None
    passive: PassiveKey = None
    hysteresis: HysteresisKey = ()
    backlash: BacklashKey = 0.0
    between: tuple[int | str, int | str] | None = optional(
        "The two ends that it joins, as in `between` of a mapping; given for all links or for none. Default: the chain "
        "of neighbours."
    )


class JointsPart(Part):
    """The joints of a body in the plane whose springs have lengths: springs of the angles between its links."""

    stiffness: Numbers = key("One number, or one per joint.", "N m/rad", exclusiveMinimum=0)
    between: tuple[tuple[int, int, int], ...] | None = optional(
        "The three points of each joint; its turning angle lies at the second, 0 where they lie on a line, positive "
        "to the left. Default: all points that follow each other."
    )


def _kind_of_links(value: Any) -> str:
    return "LinkPart" if isinstance(value, (list, tuple)) else "LinksPart"


Links = Annotated[
    Annotated[LinksPart, Tag("LinksPart")] | Annotated[tuple[LinkPart, ...], Tag("LinkPart")],
    Discriminator(_kind_of_links),
]
"""Links that are alike, or one entry each."""


class SegmentPart(Bendable):
    """An interval of the body that touches the ground along its whole length."""

    name: str = key("A unique word; commands and joints use it.")
    start: Number = key("Start in the reference shape.", "m", alias="from")
    stop: Number = key("End in the reference shape, beyond `from`.", "m", alias="to")
    stiffness: Number | TablePart | None = optional("The modulus along the segment.", "N", exclusiveMinimum=0)
    curve: CurveKey = None
    tension: TensionKey = None
    passive: PassiveKey = None
    hysteresis: HysteresisKey = ()
    backlash: BacklashKey = 0.0
    friction: Annotated[SegmentFrictionPart, BeforeValidator(explain_friction)] = key("Friction per length of ground.")
    accuracy: Number | None = optional(
        "Largest error of the net translation per period, relative to the largest commanded change of length; it "
        "determines the number of elements. Give this or `elements`.",
        minimum=1e-6,
        maximum=0.5,
    )
    elements: int | None = optional(
        "Number of springs that represent the segment; overrides `accuracy`.", minimum=1, maximum=1_000_000
    )
    shown: int | None = optional(
        "Number of its contacts in `contact_states`, including both ends. Default: all.", minimum=2
    )

    @model_validator(mode="after")
    def _sane(self) -> SegmentPart:
        if not re.fullmatch(r"[A-Za-z_]\w*", self.name) or re.fullmatch(r"(contact|link)(_\d+)?|world", self.name):
            raise ValueError(f"name: {self.name!r}; it must be a single word that is not the name of a contact or link")
        if not self.stop > self.start:
            raise ValueError(f"to: {self.stop:g} m; it must be greater than `from`, {self.start:g} m")
        if self.accuracy is None and self.elements is None:
            raise ValueError("give `accuracy` (of the net translation per period, relative) or `elements`")
        if self.accuracy is not None and not 1e-6 <= self.accuracy <= 0.5:
            raise ValueError(f"accuracy: {self.accuracy:g}; it must be between 1e-6 and 0.5")
        if self.elements is not None and not 1 <= self.elements <= 1_000_000:
            raise ValueError(f"elements: {self.elements}; it must be between 1 and 1000000")
        if self.shown is not None and not self.shown >= 2:
            raise ValueError(f"shown: {self.shown}; it must be at least 2, as both ends are shown")
        return self
