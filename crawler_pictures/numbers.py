"""Numbers as text, and text of limited length."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .style import page

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from crawler_model.body.plan import Plan

_ANGLE = 1e-6
"""Error of an angle [rad]."""
ROUNDING = 1e-12
"""Numbers below this fraction of the size of what they were computed from are rounding."""
_PREFIXES = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def shorten(text: str, most: int = 60) -> str:
    """Shorten a text for which there is no room, as a name of a scene may be.

    Args:
        text: the text.
        most: letters for which there is room.

    Returns:
        The text; a longer one ends in an ellipsis.
    """
    return text if len(text) <= most else f"{text[: most - 3]}..."


def write_angle(angle: float) -> str:
    """Write an angle by which a body turned.

    Args:
        angle: the angle [rad].

    Returns:
        The text, with the digits that the tolerance of a run stands behind.
    """
    return write_length(angle, 1.0, _ANGLE)


def write_length(value: Any, size: float, error: float = 0.0) -> str:
    """Write a length, or a vector in the plane; numbers that are rounding relative to `size` are 0.

    Args:
        value: a number or two [m].
        size: size of the numbers from which it was computed [m].
        error: its error, whose first digit is the last one that is written [m]; 0 for all twelve digits.

    Returns:
        The text.
    """
    decimals = max(-math.floor(math.log10(error)), 0) if error > 0.0 else 17
    shown = [0.0 if abs(v) <= 1e-13 * size else round(float(v), decimals) for v in np.atleast_1d(value)]
    return ", ".join(f"{v + 0.0:.12g}" for v in shown)


def error_of(scene: Plan) -> float:
    """Find the error that the lengths of a run may have.

    Args:
        scene: the scene.

    Returns:
        The tolerance of a ramp in the plane [m]; 0 on a line, where only rounding is left.
    """
    from crawler_model.run.account import tolerance_of

    lengths = scene.drive.actuation.reshape(scene.drive.times.size, -1)[:, : scene.body.lengths]
    return tolerance_of(scene) * float(np.ptp(lengths, axis=0).max(initial=0.0))


def write_stability(margin: float, when: float) -> str:
    """Write the least stability margin of a body that turns.

    Args:
        margin: the margin [1].
        when: the time at which it was least [s].

    Returns:
        The text.
    """
    grows = "; below 0 a small deviation grows along the path" if margin < 0.0 else ""
    return f"stability margin: at least {margin:.4g}, at {when:g} s{grows}"


def write_size(value: float, size: float) -> str:
    """Write an energy or a force; numbers that are rounding relative to `size` are 0.

    Args:
        value: the energy [J], or the force [N].
        size: size of the numbers from which it was computed [same unit].

    Returns:
        The text.
    """
    return f"{0.0 if abs(value) <= ROUNDING * size else value:.6g}"


def choose_prefix(size: float, unit: str) -> tuple[float, str]:
    """Choose the decimal prefix with which numbers of a size are easy to read.

    Args:
        size: the largest number, >= 0.
        unit: its unit; "1" has no prefix.

    Returns:
        What a number is divided by, and the unit with its prefix; empty for "1".
    """
    if unit == "1":
        return 1.0, ""
    if not 0.0 < size < np.inf or 0.05 <= size < 1e4:
        return 1.0, unit
    for scale, prefix in _PREFIXES:
        if size >= scale:
            return scale, prefix + unit
    return 1.0, unit


def label_values(axis: Axes, what: str, unit: str, size: float) -> float:
    """Label a vertical axis in a unit that suits its numbers; numbers that are only rounding stay flat.

    Args:
        axis: the axes; its limits are the limits of the data.
        what: the quantity.
        unit: unit of the data.
        size: size of the numbers from which the data were computed.

    Returns:
        What the numbers on the axis are divided by.
    """
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    low, high = axis.get_ylim()
    if high - low <= 1e3 * ROUNDING * size or high == low:
        middle, half = 0.5 * (low + high), 0.05 * size or 1.0
        axis.set_ylim(middle - half, middle + half)
        low, high = axis.get_ylim()
    scale, named = choose_prefix(max(abs(low), abs(high)), unit)
    axis.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / scale:.10g}".replace("-", "\u2212")))
    between = "\n" if page().narrow and "\n" not in what else " "
    axis.set_ylabel(f"{what}{between}[{named}]" if named else what)
    return scale
