"""Draw what a crawler gains with motors that stall, over their force and the slope: the figure of motors.md."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_lab import simulate_many, vary
from crawler_model import load_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURE = Path(__file__).parent / "pictures" / "motors.png"
STIFFNESS, STROKE = 20.0, 0.1
"""Of `slope_climber` [N/m, m]."""
_COLORS = ("#007d5c", "#2f5fc4", "#b8860b")


def bounds_on(degrees: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the bounds of `slope_climber`: against sliding uphill, and against sliding back [N]."""
    theta = np.radians(degrees)
    return 0.2 * np.cos(theta) + np.sin(theta), 0.8 * np.cos(theta) - np.sin(theta)


def gain_of_motor(force: np.ndarray, degrees: float) -> np.ndarray:
    """Compute the gain D - 2 min(a, b)/k, towards the smaller bound, of a motor that reaches it, or else 0 [m]."""
    a, b = (float(side) for side in bounds_on(np.array(degrees)))
    return np.where(force >= min(a, b), math.copysign(STROKE - 2.0 * min(a, b) / STIFFNESS, b - a), 0.0)


def gain_beside_spring(force: np.ndarray, spring: float, a: float, stroke: float, k: float) -> np.ndarray:
    """Compute the gain [m] with a return spring [N/m] next to the motor, which slides only towards a bound a [N]."""
    longest = np.minimum((k * stroke - a) / (k + spring), (force - a) / spring)
    shortest = np.maximum(a / (k + spring), (a - force) / spring)
    return np.maximum(0.0, longest - shortest)


def draw_map(figure: Figure, axis: Axes) -> None:
    """Draw the gain over the force of the motor and the slope, with both bounds as lines."""
    force, degrees = np.linspace(0.05, 0.8, 76), np.linspace(0.0, 24.0, 49)
    runs = simulate_many(vary(load_scene("slope_climber"), {"body.links.tension": force, "ground.slope": degrees}))
    gain = 1e3 * runs.per_period.reshape(force.size, degrees.size).T
    drawn = axis.pcolormesh(force, degrees, gain, cmap="PRGn", vmin=-80, vmax=80, shading="nearest", rasterized=True)
    figure.colorbar(drawn, ax=axis, label="gain of a period [mm]")
    fine = np.linspace(0.0, 24.0, 400)
    for bound, style, label in zip(bounds_on(fine), ("-", "--"), ("a: uphill", "b: back"), strict=True):
        axis.plot(bound, fine, color="black", lw=1.2, ls=style, label=label)
    axis.set(xlabel="stall force F [N]", ylabel="slope [degrees]", xlim=(0.05, 0.8), ylim=(0.0, 24.0))
    axis.set_title("a  slope_climber, gain over stall force and slope", fontsize=10)
    axis.legend(fontsize=8, loc="lower right")


def draw_jumps(axis: Axes) -> None:
    """Draw the gain over the force of the motor on three slopes."""
    force, fine = np.linspace(0.05, 0.8, 76), np.linspace(0.05, 0.8, 2000)
    for degrees, color in zip((0.0, 5.0, 10.0), _COLORS, strict=True):
        variations = vary(load_scene("slope_climber"), {"ground.slope": [degrees], "body.links.tension": force})
        runs = simulate_many(variations)
        axis.plot(fine, 1e3 * gain_of_motor(fine, degrees), color=color, lw=0.8)
        some = runs.unique
        axis.plot(force[some], 1e3 * runs.per_period[some], ".", color=color, ms=4, label=f"{degrees:g} degrees")
        axis.plot(force[~some], 1e3 * runs.per_period[~some], "o", color=color, mfc="white", ms=5)
    _style(axis, "b  the same on three slopes: a jump")


def draw_springs(axis: Axes) -> None:
    """Draw the gain over the force of a motor with return springs."""
    scene = load_scene("stalling_inchworm")
    force, fine = np.linspace(0.2, 4.0, 58), np.linspace(0.2, 4.0, 2000)
    for spring, color in zip((0.25, 1.0, 2.0), _COLORS, strict=True):
        key = "body.links[0].passive.stiffness"
        runs = simulate_many(vary(scene, {key: [spring], "body.links[0].tension": force}))
        axis.plot(fine, 1e3 * gain_beside_spring(fine, spring, 1.0, 2.0, 8.0), color=color, lw=0.8)
        axis.plot(force, 1e3 * runs.per_period, ".", color=color, ms=4, label=f"return spring {spring:g} N/m")
    _style(axis, "c  stalling_inchworm: a ramp")


def _style(axis: Axes, title: str) -> None:
    axis.set(xlabel="stall force F [N]", ylabel="gain of a period [mm]")
    axis.set_title(title, fontsize=10)
    axis.grid(alpha=0.25)
    axis.legend(fontsize=8, frameon=False)


def main() -> None:
    """Draw the figure."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    style: dict[Any, Any] = {"font.size": 9, "axes.titlesize": 10}
    with matplotlib.rc_context(style):
        figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13.5, 4.2), layout="constrained")
        draw_map(figure, left)
        draw_jumps(middle)
        draw_springs(right)
        figure.savefig(PICTURE, dpi=100, pil_kwargs={"optimize": True})
    print("written: docs/pictures/motors.png")


if __name__ == "__main__":
    main()
