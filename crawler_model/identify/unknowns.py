"""The unknowns of a fit: parameters, offsets of the measurements, delays; and the residuals as functions of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..errors import CrawlerError
from .replica import Prediction, Replica

Offset = Literal["none", "frame", "each"]
_WIDE = 100.0
_SIGNED = (
    *("loads", "slope", "displacement", "actuation", "mean", "amplitude", "contacts", "wavelength", "load"),
    *("curve", "least", "shortest", "longest"),
)
_ENOUGH = 30
"""Residuals from which a standard deviation is estimated."""
_UNEQUAL = 1.5
_EXACT = 1e-9
_LONGEST_DELAY = 0.1
"""Of a delay, as a fraction of the recording."""


@dataclass(frozen=True)
class Space:
    """The parameters as coordinates: the logarithm of those that are positive.

    Attributes:
        names: names of the parameters, shape (P,).
        origin: their values in the scene, shape (P,).
        low: their lower bounds, shape (P,).
        high: their upper bounds, shape (P,).
        logarithmic: whether the coordinate is a logarithm, bool, shape (P,).
        scale: unit of the other coordinates, shape (P,).
    """

    names: tuple[str, ...]
    origin: np.ndarray
    low: np.ndarray
    high: np.ndarray
    logarithmic: np.ndarray
    scale: np.ndarray

    def to_values(self, coordinates: np.ndarray) -> np.ndarray:
        """Convert coordinates to values.

        Args:
            coordinates: shape (P,).

        Returns:
            Values within their bounds, shape (P,).
        """
        safe = np.where(self.logarithmic, coordinates, 0.0)
        return np.clip(np.where(self.logarithmic, np.exp(safe), coordinates * self.scale), self.low, self.high)

    def to_coordinates(self, values: np.ndarray) -> np.ndarray:
        """Convert values to coordinates.

        Args:
            values: shape (P,).

        Returns:
            Coordinates, shape (P,).
        """
        safe = np.where(self.logarithmic, values, 1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.logarithmic, np.log(safe), values / self.scale)

    def slope(self, values: np.ndarray) -> np.ndarray:
        """Compute the derivatives of the values with respect to the coordinates.

        Args:
            values: shape (P,).

        Returns:
            Shape (P,).
        """
        return np.where(self.logarithmic, values, self.scale)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw values within the bounds: those of the scene, up to five times smaller or larger.

        Args:
            rng: source of random numbers.

        Returns:
            Shape (P,).
        """
        spread = rng.uniform(-1.0, 1.0, self.origin.size)
        size = np.where(np.isfinite(self.high - self.low), 0.5 * (self.high - self.low), self.scale)
        with np.errstate(invalid="ignore"):
            drawn = np.where(self.logarithmic, self.origin * 5.0**spread, self.origin + spread * size)
        return np.clip(drawn, self.low, self.high)


def build_space(names: Sequence[str], origin: np.ndarray, bounds: Mapping[str, tuple[float, float]] | None) -> Space:
    """Choose coordinates and bounds.

    Args:
        names: names of the parameters.
        origin: their values in the scene, shape (P,).
        bounds: lower and upper bounds by name, or by a key that names a list.

    Returns:
        The space. Without bounds, positive parameters may change by a factor of 100.

    Raises:
        CrawlerError: if a bound is not of a parameter, or does not contain the value of the scene.
    """
    signed = np.array([any(word in name for word in _SIGNED) for name in names])
    positive = (origin > 0.0) & ~signed
    low = np.where(positive, origin / _WIDE, np.where(signed, -np.inf, 0.0))
    high = np.where(positive, origin * _WIDE, np.inf)
    for key, (least, most) in (bounds or {}).items():
        at = [p for p, name in enumerate(names) if name == key or name.startswith((f"{key}[", f"{key}."))]
        if not at:
            raise CrawlerError(f"identify: bounds of {key}: it is not fitted; fitted are {', '.join(names)}")
        if not least < most:
            raise CrawlerError(f"identify: bounds of {key}: {least:g} to {most:g}; the first must be smaller")
        for p in at:
            if not least <= origin[p] <= most:
                raise CrawlerError(
                    f"identify: bounds of {names[p]}: {least:g} to {most:g} do not contain its value in the scene, "
                    f"{origin[p]:g}"
                )
            low[p], high[p] = least, most
    logarithmic = positive & (low > 0.0)
    scale = np.where(origin != 0.0, np.abs(origin), 1.0)
    return Space(tuple(names), origin, low, high, logarithmic, scale)


@dataclass(frozen=True)
class Residuals:
    """Residuals of all recordings at some unknowns.

    Attributes:
        all: simulated minus measured, per recording, shape (T, M) [m].
        fitted: those that are fitted, one after another, each times the weight of its channel, shape (R,) [m].
        jacobian: the derivatives of `fitted` with respect to the unknowns, shape (R, U).
        one_sided: parameters whose derivative is one-sided somewhere, bool, shape (P,).
    """

    all: tuple[np.ndarray, ...]
    fitted: np.ndarray
    jacobian: np.ndarray
    one_sided: np.ndarray


class Problem:
    """Recordings, the rows that are fitted, and the unknowns: parameters, then offsets and a delay per recording."""

    def __init__(
        self, replicas: Sequence[Replica], rows: Sequence[np.ndarray], space: Space, offset: Offset, delay: bool
    ) -> None:
        """Count the unknowns.

        Args:
            replicas: the recordings.
            rows: which of their rows are fitted, bool, each of shape (T,).
            space: the parameters.
            offset: "none"; "frame" for one constant per recording, added to all contacts; "each" for one per channel.
            delay: whether each recording has an unknown delay.
        """
        self.replicas, self.rows, self.space = tuple(replicas), tuple(rows), space
        self.delay = delay
        self.shapes = [_offset_matrix(r.measured.on_ground, offset) for r in replicas]
        self.offsets = [s.shape[1] for s in self.shapes]
        self.weights = [np.ones(len(r.measured.channels)) for r in replicas]
        self.count = space.origin.size + sum(self.offsets) + (len(self.replicas) if delay else 0)
        self._last: tuple[bytes, Residuals | None] | None = None

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of all unknowns, each of shape (U,)."""
        low, high = np.full(self.count, -np.inf), np.full(self.count, np.inf)
        count = self.space.origin.size
        low[:count], high[:count] = (self.space.to_coordinates(v) for v in (self.space.low, self.space.high))
        if self.delay:
            most = [_LONGEST_DELAY * float(np.ptp(r.measured.time)) for r in self.replicas]
            low[-len(most) :], high[-len(most) :] = -np.array(most), most
        return low, high

    def unknowns(self, values: np.ndarray) -> np.ndarray:
        """Build a start from values of the parameters, with the offsets that fit best, and no delays.

        Args:
            values: shape (P,).

        Returns:
            Shape (U,).
        """
        found = np.zeros(self.count)
        found[: values.size] = self.space.to_coordinates(values)
        residuals = self.compute(found)
        ends = values.size + np.cumsum([0, *self.offsets])
        for i, (shape, rows) in enumerate(zip(self.shapes, self.rows, strict=True)):
            if residuals is not None and self.offsets[i] and rows.any():
                mean = residuals.all[i][rows].mean(axis=0)
                found[ends[i] : ends[i + 1]] = -np.linalg.lstsq(shape, mean, rcond=None)[0]
        return found

    def delays(self, unknowns: np.ndarray) -> np.ndarray:
        """Read the delay of each recording.

        Args:
            unknowns: shape (U,).

        Returns:
            One per recording [s].
        """
        return unknowns[-len(self.replicas) :] if self.delay else np.zeros(len(self.replicas))

    def added(self, unknowns: np.ndarray) -> list[np.ndarray]:
        """Read what is added to each channel of each recording.

        Args:
            unknowns: shape (U,).

        Returns:
            For each recording shape (M,) [m].
        """
        ends = self.space.origin.size + np.cumsum([0, *self.offsets])
        return [shape @ unknowns[ends[i] : ends[i + 1]] for i, shape in enumerate(self.shapes)]

    def weigh(self, residuals: Residuals) -> bool:
        """Choose the weights so that the residuals of positions and of elongations in each recording have one size.

        Args:
            residuals: after a fit with the weights so far.

        Returns:
            Whether a weight changed by more than what noise alone explains.
        """
        size, pooled = {}, {}
        exact = _EXACT * max(float(np.abs(r.measured.values).max()) for r in self.replicas)
        for i, (replica, found, rows) in enumerate(zip(self.replicas, residuals.all, self.rows, strict=True)):
            for kind in (False, True):
                left = found[rows][:, replica.measured.on_ground == kind]
                if left.size >= _ENOUGH:
                    size[i, kind] = max(float(np.sqrt(np.mean(left**2))), exact)
                    pooled[kind] = size[i, kind]
        if not size or max(size.values()) < _UNEQUAL * min(size.values()):
            return False
        unit = next(iter(size.values()))
        for i, replica in enumerate(self.replicas):
            kinds = replica.measured.on_ground.tolist()
            self.weights[i] = np.array([unit / size.get((i, kind), pooled.get(kind, unit)) for kind in kinds])
        self._last = None
        return True

    def compute(self, unknowns: np.ndarray) -> Residuals | None:
        """Compute residuals and their derivatives.

        Args:
            unknowns: shape (U,).

        Returns:
            None if no motion exists at these values.
        """
        key = unknowns.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = (key, self._compute(unknowns))
        return self._last[1]

    def _compute(self, unknowns: np.ndarray) -> Residuals | None:
        count = self.space.origin.size
        values = self.space.to_values(unknowns[:count])
        slope = self.space.slope(values)
        found, jacobians = [], []
        one_sided = np.zeros(count, np.bool_)
        place = count
        for i, (replica, added, delay) in enumerate(
            zip(self.replicas, self.added(unknowns), self.delays(unknowns), strict=True)
        ):
            predicted: Prediction | None = replica.predict(values, float(delay))
            if predicted is None:
                return None
            keep = self.rows[i]
            found.append(predicted.values + added - replica.measured.values)
            jacobian = np.zeros((*predicted.values[keep].shape, self.count))
            jacobian[..., :count] = predicted.jacobian[keep] * slope
            jacobian[..., place : place + self.offsets[i]] = self.shapes[i]
            if self.delay:
                jacobian[..., self.count - len(self.replicas) + i] = -predicted.velocity[keep]
            jacobian *= self.weights[i][:, None]
            jacobians.append(jacobian.reshape(-1, self.count))
            place += self.offsets[i]
            one_sided |= predicted.one_sided
        parts = zip(found, self.rows, self.weights, strict=True)
        fitted = np.concatenate([(r[keep] * weight).ravel() for r, keep, weight in parts])
        return Residuals(tuple(found), fitted, np.concatenate(jacobians), one_sided)


def _offset_matrix(on_ground: np.ndarray, offset: Offset) -> np.ndarray:
    """Build the map from the offsets of a recording to its channels, shape (M, offsets)."""
    if offset == "each":
        return np.eye(on_ground.size)
    return on_ground[:, None].astype(float) if offset == "frame" and on_ground.any() else np.zeros((on_ground.size, 0))
