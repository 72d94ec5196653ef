"""The values of a scene file, the base of its parts, and the parts that hold friction."""

from __future__ import annotations

import functools
import itertools
import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema, model_validator

from ..body.turning import SIDES
from ..errors import LARGEST

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_NUMBER = {"type": "number"}
_NUMBERS = {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBER}]}
_TABLE = {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBERS}]}
_DEEP = {"anyOf": [_NUMBER, {"type": "array", "items": _TABLE}]}


def _number(value: Any) -> float:
    if isinstance(value, np.generic):
        value = value.item()
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
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if depth > 0 and isinstance(value, (list, tuple)):
        return tuple(_nested(v, depth - 1) for v in value)
    return _number(value)


Number = Annotated[float, BeforeValidator(_number), WithJsonSchema(_NUMBER)]
Numbers = Annotated[Any, BeforeValidator(lambda v: _nested(v, 1)), WithJsonSchema(_NUMBERS)]
Table = Annotated[Any, BeforeValidator(lambda v: _nested(v, 2)), WithJsonSchema(_TABLE)]
Deep = Annotated[Any, BeforeValidator(lambda v: _nested(v, 3)), WithJsonSchema(_DEEP)]


class Part(BaseModel):
    """Base of the parts of a scene: unknown keys are refused, values are fixed."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def key(meaning: str, unit: str = "", *, default: Any = ..., alias: str | None = None, **bounds: float) -> Any:
    """Describe a key for the schema and docs/reference/scenes.md.

    Args:
        meaning: one sentence.
        unit: unit of its values.
        default: what holds if a file omits the key; it must not without one.
        alias: the key in files, if it is not the name of the field.
        **bounds: bounds, named as in JSON schema [`unit`].

    Returns:
        The field.
    """
    extra: dict[str, Any] = {**({"unit": unit} if unit else {}), **bounds}
    return Field(default, alias=alias, description=meaning, json_schema_extra=extra)


optional = functools.partial(key, default=None)
"""Describe a key that files may omit."""


class TablePart(Part):
    """A value along a segment: linear between positions, constant beyond them."""

    at: tuple[Number, ...] = key("Positions along the body, strictly increasing.", "m")
    value: tuple[Number, ...] = key("The value at each position, in the unit of the key that holds the table.")

    @model_validator(mode="after")
    def _fits(self) -> TablePart:
        if len(self.at) != len(self.value) or not self.at:
            raise ValueError(f"{len(self.at)} position(s) in `at` for {len(self.value)} value(s); give one for each")
        if any(b <= a for a, b in zip(self.at, self.at[1:], strict=False)):
            raise ValueError("the positions in `at` must be strictly increasing")
        return self


def _check_increasing(key: str, values: tuple[float, ...], unit: str, what: str) -> None:
    for before, after in itertools.pairwise(values):
        if not after > before:
            raise ValueError(f"{key}: {after:g}{unit} follows {before:g}{unit}; {what} must be strictly increasing")


class ProfileSidesPart(Part):
    """Factors on friction at the places of a profile, of each direction."""

    forward: tuple[Number, ...] = key("Of the friction against sliding towards +x.", "1", minimum=0)
    backward: tuple[Number, ...] = key("Likewise, against sliding towards -x.", "1", minimum=0)


class ProfilePart(Part):
    """Ground that changes gradually: linear between places, constant beyond them."""

    at: tuple[Number, ...] = key("Places on the track, strictly increasing.", "m")
    friction: tuple[Number, ...] | ProfileSidesPart | None = optional(
        "Factors on the friction of contacts at these places, or `forward` and `backward`. Default: 1.", "1", minimum=0
    )
    slope: tuple[Number, ...] | None = optional(
        "Slopes at these places, positive uphill towards +x; the sine is linear between them. Default: the slope "
        "of the track.",
        "degrees",
        exclusiveMinimum=-90,
        exclusiveMaximum=90,
    )

    @model_validator(mode="after")
    def _fits(self) -> ProfilePart:
        if not self.at:
            raise ValueError("at: no places; give at least one")
        _check_increasing("at", self.at, " m", "places")
        given: dict[str, tuple[float, ...] | None] = {"slope": self.slope}
        if isinstance(self.friction, ProfileSidesPart):
            given |= {"friction.forward": self.friction.forward, "friction.backward": self.friction.backward}
        else:
            given["friction"] = self.friction
        values = {name: row for name, row in given.items() if row is not None}
        if not values:
            raise ValueError("give `friction` or `slope`; without them the profile changes nothing")
        for name, row in values.items():
            if len(row) != len(self.at):
                raise ValueError(f"{name}: {len(row)} value(s) for {len(self.at)} place(s) in `at`; give one for each")
            for value in row:
                if name == "slope" and not -90.0 < value < 90.0:
                    raise ValueError(f"slope: {value:g} degrees; it must be between -90 and 90")
                if name != "slope" and value < 0.0:
                    raise ValueError(f"{name}: {value:g}; a factor on friction must be >= 0")
        return self

    @property
    def factors(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Factors on friction at each place, forward and backward."""
        if isinstance(self.friction, ProfileSidesPart):
            return self.friction.forward, self.friction.backward
        same = (1.0,) * len(self.at) if self.friction is None else self.friction
        return same, same


def explain_friction(value: Any) -> Any:
    """Refuse a bare number as friction.

    Args:
        value: the value of a `friction` key.

    Returns:
        The value, unchanged.

    Raises:
        ValueError: with the mapping to write instead.
    """
    if isinstance(value, (int, float, list, tuple)):
        raise ValueError(f"write {{isotropic: {value}}}, or give `forward` and `backward`")
    return value


class CouplingPart(Part):
    """Friction that a link or a segment adds as it changes its length: linear between values, constant beyond them."""

    link: int | None = optional("The link whose elongation counts, counted from 0.")
    contacts: tuple[int, ...] | None = optional("With `link`: the isolated contacts that it adds friction to.")
    elongation: tuple[Number, ...] | None = optional("With `link`: elongations, strictly increasing.", "m")
    segment: str | None = optional("Instead of `link`: the segment whose strain adds friction to its own ground.")
    strain: tuple[Number, ...] | None = optional("With `segment`: strains, strictly increasing.", "1")
    added: tuple[Number, ...] | None = optional(
        "Friction added in both directions at each elongation (N), or per length at each strain (N/m).",
        "N, N/m",
        minimum=0,
    )
    forward: tuple[Number, ...] | None = optional(
        "Instead of `added`: against sliding towards +x. Default: 0.", "N, N/m", minimum=0
    )
    backward: tuple[Number, ...] | None = optional(
        "The same against sliding towards -x. Default: 0.", "N, N/m", minimum=0
    )

    @property
    def knots(self) -> tuple[float, ...]:
        """The elongations [m] or strains at which friction is given."""
        return self.elongation or self.strain or ()

    @property
    def sides(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Friction added forward and backward at each of them [N, N/m]."""
        if self.added is not None:
            return self.added, self.added
        none = (0.0,) * len(self.knots)
        return self.forward or none, self.backward or none

    @model_validator(mode="after")
    def _fits(self) -> CouplingPart:
        if (self.link is None) == (self.segment is None):
            raise ValueError("give `link`, `contacts` and `elongation`, or `segment` and `strain`")
        key, unit = ("strain", "") if self.link is None else ("elongation", " m")
        for name in ("contacts", "elongation", "strain"):
            needed = self.link is None if name == "strain" else self.link is not None
            if (getattr(self, name) is not None) != needed:
                kind = "segment" if self.link is None else "link"
                raise ValueError(f"{name}: {'missing' if needed else 'given'} with `{kind}`")
        if not self.knots:
            raise ValueError(f"{key}: no values; give at least one")
        _check_increasing(key, self.knots, unit, "values")
        given = {name: getattr(self, name) for name in ("added", "forward", "backward")}
        rows = {name: row for name, row in given.items() if row is not None}
        if not rows or (self.added is not None and len(rows) > 1):
            raise ValueError("give `added`, or `forward` and `backward`, not both")
        for name, row in rows.items():
            if len(row) != len(self.knots):
                raise ValueError(f"{name}: {len(row)} value(s) for {len(self.knots)} in `{key}`; give one for each")
            for value in row:
                if value < 0.0:
                    raise ValueError(f"{name}: {value:g}; added friction must be >= 0")
        return self


class _Friction(Part):
    """Base of friction by sides, in some parts also by directions or as coefficients."""

    @model_validator(mode="after")
    def _one_kind(self) -> _Friction:
        directions, value, coefficient = (getattr(self, name, None) for name in ("directions", "value", "coefficient"))
        given = [getattr(self, name, None) is not None for name in (*SIDES, "isotropic")]
        forward, backward, left, right, isotropic = given
        if directions is not None or value is not None:
            if directions is None or value is None or any(given) or coefficient is not None:
                raise ValueError("give `directions` (rad) and `value` together and nothing else, or only `isotropic`")
        elif coefficient is not None:
            if any(given):
                raise ValueError("give `coefficient`, or forces, not both")
        elif left != right:
            raise ValueError("give both `left` and `right`, or neither")
        elif left and not (forward and backward):
            raise ValueError("give `forward`, `backward`, `left` and `right` together, or only `isotropic`")
        elif not any(given) and getattr(self, "with_elongation", None):
            pass  # of a body without isolated contacts
        elif forward != backward or forward == isotropic:
            raise ValueError("give both `forward` and `backward`, or only `isotropic`")
        return self

    @property
    def quarters(self) -> tuple[Any, ...]:
        """Forward, backward, left and right friction, or the coefficients that replace forces."""
        part: Any = getattr(self, "coefficient", None) or self
        return tuple(getattr(part, name, None) if part.isotropic is None else part.isotropic for name in SIDES)

    @property
    def sides(self) -> tuple[Any, ...]:
        """Forward and backward friction, in the same way."""
        return self.quarters[:2]


class CoefficientPart(_Friction):
    """Coefficients of friction: mu = coefficient * weight * cos(slope)."""

    forward: Numbers | None = optional("Against sliding towards +x: one number, or one each.", "1", minimum=0)
    backward: Numbers | None = optional("The same against sliding towards -x.", "1", minimum=0)
    isotropic: Numbers | None = optional(
        "The same in both directions; in the plane in every direction.", "1", minimum=0
    )
    left: Numbers | None = optional("With `springs: length`: against sliding to the left.", "1", minimum=0)
    right: Numbers | None = optional("The same to the right.", "1", minimum=0)
    directions: tuple[Number, ...] | None = optional("In the plane: angles, as for friction given as forces.", "rad")
    value: Table | None = optional("Coefficient in each direction: one row, or one per contact.", "1", minimum=0)


class SegmentFrictionPart(_Friction):
    """Friction of a segment per length, N/m: forward and backward, or isotropic, or as coefficients."""

    forward: Number | TablePart | None = optional("Against sliding towards +x.", "N/m", minimum=0)
    backward: Number | TablePart | None = optional("Against sliding towards -x.", "N/m", minimum=0)
    isotropic: Number | TablePart | None = optional("The same in both directions.", "N/m", minimum=0)
    coefficient: CoefficientPart | None = optional("Instead of forces: coefficients, of the weight of the segment.")

    @model_validator(mode="after")
    def _on_a_line(self) -> SegmentFrictionPart:
        if self.coefficient is not None and self.coefficient.directions is not None:
            raise ValueError("coefficient: directions; a segment lies on a line and has none")
        if self.coefficient is not None and any(isinstance(value, tuple) for value in self.sides):
            raise ValueError("coefficient: a list; a segment takes one number")
        return self


class FrictionPart(_Friction):
    """Friction of the isolated contacts, N: forward and backward, isotropic, or in the plane by directions."""

    forward: Numbers | None = optional("Against sliding towards +x: one number, or one per contact.", "N", minimum=0)
    backward: Numbers | None = optional("Against sliding towards -x: one number, or one per contact.", "N", minimum=0)
    isotropic: Numbers | None = optional(
        "The same in both directions; in the plane in every direction.", "N", minimum=0
    )
    left: Numbers | None = optional(
        "With `springs: length`: against sliding to the left of the frame of the point; `forward` and `backward` are "
        "along it. One number, or one per point; 0 in all four directions for a point without friction.",
        "N",
        minimum=0,
    )
    right: Numbers | None = optional("The same to the right of the frame.", "N", minimum=0)
    frame: tuple[tuple[int, int], ...] | None = optional(
        "With `springs: length`: for each point the two points of a link whose direction is its forward direction. "
        "Default: its first link."
    )
    angle: Numbers | None = optional(
        "With `springs: length`: angle from the direction of the frame to forward, to the left positive: one number, "
        "or one per point. Default: 0.",
        "rad",
    )
    law: Literal["most_dissipative", "along_velocity"] | None = optional(
        "With `springs: length`: the force of a sliding point: that which dissipates the most (default), or that along "
        "its velocity, each part times its own friction."
    )
    directions: tuple[Number, ...] | None = optional(
        "In the plane: at least three angles, increasing within one turn, less than half a turn apart.", "rad"
    )
    value: Table | None = optional(
        "Friction against sliding in each direction, linear between them and convex: one row, or one per contact.",
        "N",
        minimum=0,
    )

    coefficient: CoefficientPart | None = optional("Instead of forces: coefficients, of the weights of the contacts.")
    with_elongation: tuple[CouplingPart, ...] = key(
        "Only on a line: friction added to contacts and segments as links and segments change their lengths.",
        default=(),
    )

    @property
    def is_bare(self) -> bool:
        """Whether it holds nothing but what changes with elongations."""
        return self.coefficient is None and self.directions is None and self.quarters == (None,) * len(SIDES)

    @property
    def constant(self) -> FrictionPart | None:
        """The same friction without what changes with elongations."""
        return None if self.is_bare else self.model_copy(update={"with_elongation": ()})

    @property
    def given(self) -> FrictionPart | CoefficientPart:
        """The coefficients if friction is given so, else the forces."""
        return self if self.coefficient is None else self.coefficient


class FrictionRowsPart(_Friction):
    """Commanded friction, a row per time: forward and backward, or isotropic."""

    forward: Table | None = optional(
        "Against sliding towards +x: a row per time, a column per isolated contact (N), then per segment (N/m); or one "
        "number for all.",
        "N, N/m",
        minimum=0,
    )
    backward: Table | None = optional("The same against sliding towards -x.", "N, N/m", minimum=0)
    left: Table | None = optional("With `springs: length`: the same against sliding to the left.", "N", minimum=0)
    right: Table | None = optional("The same to the right.", "N", minimum=0)
    isotropic: Table | None = optional("The same in both directions.", "N, N/m", minimum=0)


def average(part: float | TablePart, edges: np.ndarray) -> np.ndarray:
    """Compute the mean of a quantity over each interval between edges, with Gauss quadrature between its kinks.

    Args:
        part: a constant, or a table.
        edges: shape (M + 1,), increasing [m].

    Returns:
        Shape (M,).
    """
    at, value = (np.array(part.at), part.value) if isinstance(part, TablePart) else (edges[:1], (part,))
    cuts = np.union1d(edges, at[(at > edges[0]) & (at < edges[-1])])
    half, middle = 0.5 * np.diff(cuts), 0.5 * (cuts[:-1] + cuts[1:])
    values = np.interp(middle[:, None] + half[:, None] * _POINTS, at, value) @ (0.5 * _WEIGHTS)
    weighted = np.concatenate(([0.0], np.cumsum(values * 2.0 * half)))
    return np.diff(weighted[np.searchsorted(cuts, edges)]) / np.diff(edges)
