"""The parameters of a fit as coordinates, with their bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from crawler_model.errors import CrawlerError

_WIDE = 100.0
_SIGNED = (
    *("loads", "slope", "displacement", "actuation", "mean", "amplitude", "contacts", "wavelength", "load"),
    *("curve", "least", "shortest", "longest"),
)


@dataclass(frozen=True)
class Space:
    """The parameters as coordinates: the logarithm of positive ones.

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

        Returns:
            Coordinates, shape (P,).
        """
        safe = np.where(self.logarithmic, values, 1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.logarithmic, np.log(safe), values / self.scale)

    def slope(self, values: np.ndarray) -> np.ndarray:
        """Compute the derivatives of the values with respect to the coordinates.

        Returns:
            Shape (P,).
        """
        return np.where(self.logarithmic, values, self.scale)

    def join(self, name: str, value: float) -> Space:
        """Add a positive parameter.

        Args:
            name: its name.
            value: its value in the scene [its unit].

        Returns:
            The coordinates of all.
        """
        origin, low, high, scale = (
            np.append(one, value * factor)
            for one, factor in ((self.origin, 1.0), (self.low, 1.0 / _WIDE), (self.high, _WIDE), (self.scale, 1.0))
        )
        return Space((*self.names, name), origin, low, high, np.append(self.logarithmic, True), scale)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw values within the bounds: the scene's, up to five times smaller or larger.

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
