"""Draw what slopes, tows, payloads and patches of ground cost a crawler: the figures of loads.md."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_lab import ManyRuns, simulate_many, vary
from crawler_model import Scene, largest_tow, load_scene, simulate, steepest_climb
from crawler_pictures.ground import draw_jumps, list_sections

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = Path(__file__).parent / "pictures"
CROSSED = ("ice", "friction_step", "hill_top", "leaving_ice")
"""Scenes with patches or a profile."""
STIFFNESS, STROKE = 20.0, 0.1
"""Of the two contacts of `slope_climber` [N/m, m]."""
RATIOS = (0.8, 0.5, 0.3)
"""Backward coefficients; the forward one is 0.2."""
STROKES = (0.1, 0.06, 0.04)
_COLORS = ("#007d5c", "#2f5fc4", "#b8860b")
_GREY = "#9a9a9a"


def slope_bounds(degrees: np.ndarray, forward: float, backward: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute the bounds per weight on a slope: against sliding uphill, and against sliding back [1]."""
    theta = np.radians(degrees)
    return forward * np.cos(theta) + np.sin(theta), backward * np.cos(theta) - np.sin(theta)


def gain_of_two(a: np.ndarray, b: np.ndarray, stroke: float) -> np.ndarray:
    """Compute the gain of two equal contacts with bounds a and b, D - 2 min(a, b)/k towards the smaller one [m]."""
    gain = np.maximum(0.0, stroke - 2.0 * np.minimum(a, b) / STIFFNESS)
    return np.where(a < b, gain, -gain)


def gain_of_payload(front: np.ndarray, a: float, b: float, stroke: float) -> np.ndarray:
    """Compute the gain with a weight of 1 N on the rear contact, bounds a and b per weight [m].

    The heavier contact stays as soon as pushing it takes more than the other one holds.
    """
    moves = (front * a < b) & (a < front * b)
    return np.where(moves, np.maximum(0.0, stroke - (1.0 + front) * a / STIFFNESS), 0.0)


def climbers(degrees: np.ndarray, backward: float, stroke: float) -> ManyRuns:
    """Run `slope_climber` on slopes [degrees] with a backward coefficient and a stroke [m]."""
    document = load_scene("slope_climber").document()
    document["friction"] = {"coefficient": {"forward": 0.2, "backward": backward}}
    document["drive"]["actuation"] = [[0.0], [stroke], [0.0]]
    return simulate_many(vary(Scene.model_validate(document), {"ground.slope": degrees}))


def _style(axis: Axes, title: str, x: str, y: str) -> None:
    axis.set(xlabel=x, ylabel=y)
    axis.set_title(title, fontsize=10)
    axis.axhline(0.0, color=_GREY, linewidth=0.8)
    axis.grid(alpha=0.25)
    axis.legend(fontsize=8, frameon=False)


def _dots(axis: Axes, x: np.ndarray, runs: ManyRuns, color: str, label: str, marker: str = ".") -> None:
    """Draw gains; a run whose translation is not unique is an open circle."""
    axis.plot(x[runs.unique], 1e3 * runs.per_period[runs.unique], marker, color=color, ms=4, label=label)
    opened = (runs.status == "done") & ~runs.unique
    axis.plot(x[opened], 1e3 * runs.per_period[opened], "o", color=color, mfc="white", ms=5)


def draw_slopes(axis: Axes) -> None:
    """Draw the gain over the slope for three ratios of friction."""
    degrees = np.linspace(-10.0, 32.0, 85)
    for backward, color in zip(RATIOS, _COLORS, strict=True):
        runs = climbers(degrees, backward, STROKE)
        _dots(axis, degrees, runs, color, f"backward {backward:g}, forward 0.2")
        fine = np.linspace(degrees[0], degrees[-1], 2000)
        a, b = slope_bounds(fine, 0.2, backward)
        axis.plot(fine, 1e3 * np.where((a >= 0) & (b >= 0), gain_of_two(a, b, STROKE), np.nan), color=color, lw=0.8)
        document = load_scene("slope_climber").document() | {"friction": {"coefficient": {"forward": 0.2}}}
        document["friction"]["coefficient"]["backward"] = backward
        limit = math.degrees(steepest_climb(Scene.model_validate(document)).value)
        axis.axvline(limit, color=color, lw=0.8, ls=":")
    _style(axis, "a  slope, two contacts of 1 N", "slope, uphill [degrees]", "gain of a period [mm]")


def draw_tows(axis: Axes) -> None:
    """Draw the gain over a tow on either contact, or half on each: only their sum counts here."""
    scene = Scene.model_validate(load_scene("tow_puller").document() | {"start": "relaxed"})
    tow = np.linspace(0.0, 0.9, 46)
    shares = {"on the rear contact": (1.0, 0.0), "on the front contact": (0.0, 1.0), "half on each": (0.5, 0.5)}
    for (label, (rear, front)), color, marker in zip(shares.items(), _COLORS, "ox+", strict=True):
        runs = simulate_many(vary(scene, {"loads[0]": -rear * tow, "loads[1]": -front * tow}, grid=False))
        _dots(axis, tow, runs, color, label, marker)
    fine = np.linspace(0.0, 0.9, 2000)
    axis.plot(fine, 1e3 * gain_of_two(0.2 + fine / 2.0, 0.5 - fine / 2.0, STROKE), color="black", lw=0.8)
    axis.axvline(largest_tow(load_scene("two_contacts_anisotropic")).value, color=_GREY, lw=0.8, ls=":")
    _style(axis, "b  tow, friction 0.2 N forward, 0.5 N backward", "tow [N]", "gain of a period [mm]")


def draw_payloads(axis: Axes) -> None:
    """Draw the gain over the weight on the front contact, on three slopes."""
    weight = np.linspace(0.2, 4.0, 77)
    for degrees, color in zip((0.0, 5.0, 12.0), _COLORS, strict=True):
        variations = vary(load_scene("payload_climber"), {"ground.slope": [degrees], "body.weights[1]": weight})
        runs = simulate_many(variations)
        _dots(axis, weight, runs, color, f"{degrees:g} degrees")
        fine = np.linspace(weight[0], weight[-1], 2000)
        a, b = (float(side) for side in slope_bounds(np.array(degrees), 0.2, 0.8))
        axis.plot(fine, 1e3 * gain_of_payload(fine, a, b, STROKE), color=color, lw=0.8)
    _style(axis, "c  payload, rear contact 1 N", "weight on the front contact [N]", "gain of a period [mm]")


def draw_cost(axis: Axes) -> None:
    """Draw the cost of transport over the slope for three strokes, and body lengths on a second axis."""
    degrees = np.linspace(0.0, 16.0, 33)
    fine = np.linspace(0.0, 16.6, 500)
    axis.plot(fine, slope_bounds(fine, 0.2, 0.8)[0], color="black", lw=0.8, label="0.2 cos + sin: any stroke")
    lengths = axis.twinx()
    for stroke, color, marker in zip(STROKES, _COLORS, "ox+", strict=True):
        runs = climbers(degrees, 0.8, stroke)
        axis.plot(degrees, runs.cost_of_transport, marker, color=color, ms=4, label=f"stroke {1e3 * stroke:g} mm")
        lengths.plot(degrees, runs.body_lengths, color=color, lw=1.0, ls="--")
    lengths.set_ylabel("body lengths per period (dashed)")
    lengths.set_ylim(0.0, 0.6)
    _style(axis, "d  cost of transport: work / (distance x weight)", "slope, uphill [degrees]", "cost of transport")
    axis.set_ylim(0.0, 0.6)


def draw_crossing(axis: Axes, name: str) -> None:
    """Draw both contacts of a scene over the ground that they cross, with their jumps."""
    run = simulate(load_scene(name), 16.0, 50.0)
    place = run.scene.body.position + run.displacement
    draw_jumps(axis, run.jumps)
    for i, color in enumerate(_COLORS[: place.shape[1]]):
        axis.plot(run.time, place[:, i], color=color, lw=1.2, label=f"contact {i}")
    for section in list_sections(run.scene, float(place.min()), float(place.max())):
        for start, end, color in section.bands:
            axis.axhspan(start, end, color=color, alpha=0.35, lw=0)
        height = 0.25 * section.start + 0.75 * section.end  # all walk forward, and leave the start
        axis.text(0.2 if section.start > place[0].max() else 5.0, height, section.text, va="center", fontsize=8)
    axis.set(title=f"{name}, gains {1e3 * run.per_period[1]:.4g} .. {1e3 * run.per_period[-1]:.4g} mm a period")
    axis.set_xlabel("time [s]")
    axis.legend(fontsize=8, frameon=False, loc="lower right")
    axis.margins(x=0)


def save(figure: Figure, name: str) -> None:
    """Write a figure to the pictures."""
    figure.savefig(PICTURES / name, dpi=100, pil_kwargs={"optimize": True})
    print(f"written: docs/pictures/{name}")


def main() -> None:
    """Draw the figures."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    style: dict[Any, Any] = {"font.size": 9, "axes.titlesize": 10}
    with matplotlib.rc_context(style):
        figure, axes = plt.subplots(2, 2, figsize=(9.0, 8.4), layout="constrained")
        for axis, name in zip(axes.ravel(), CROSSED, strict=True):
            draw_crossing(axis, name)
            axis.set_ylabel("position of the contacts [m]")
        save(figure, "patches.png")
        figure, axes = plt.subplots(2, 2, figsize=(11.0, 8.0), layout="constrained")
        for axis, draw in zip(axes.ravel(), (draw_slopes, draw_tows, draw_payloads, draw_cost), strict=True):
            draw(axis)
        save(figure, "loads.png")


if __name__ == "__main__":
    main()
