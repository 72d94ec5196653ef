"""The page of an optimal gait: commands, motion, and the objective around the optimum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import simulate
from crawler_pictures.colors import GREY, LINES, STICK, TENSION
from crawler_pictures.numbers import label_values, shorten
from crawler_pictures.run.arrays import RunArrays
from crawler_pictures.run.forces import draw_commands
from crawler_pictures.run.kymograph import draw_positions, explain_states, make_room, place_legend, write_title
from crawler_pictures.run.plane import draw_plane
from crawler_pictures.run.trajectory import read_trajectory
from crawler_pictures.style import draw_levels, open_figure, own_style, page, write_figure

from ..optimise.gait_table import name_number
from ..optimise.landscape import map_plane, profile
from ..optimise.optimum import Optimum
from ..optimise.pareto import Front
from .sweep import draw_broken, find_jumps

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LABELS = {
    "translation": "gain per period [m]",
    "cost-of-transport": "cost of transport",
    "travel": "gain / travel of the actuators",
    "turn": "turn per period [rad]",
    "screw": "distance from the target [m]",
}
_PERIODS = 2
_SETTLING = 8
_SAMPLES = {1: 200, 2: 60}
"""Samples of a period, by the dimension of the body."""
_MOST_LINES, _NAMED = 40, 4


@own_style()
def draw_optimum(optimum: Optimum, units: Mapping[str, str], png: Path) -> None:
    """Draw an optimal gait: commands and motion over two periods, and the objective around it.

    In the plane the motion is seen from above, and the objective over two unknowns, many gaits, is left out, as where
    the examination did not compute it.

    Args:
        optimum: the gait.
        units: unit of each unknown, by its name; "1" for none.
        png: the file to write.
    """
    figure = open_figure(11, 14 if page().narrow else 8, stacked=True)
    left, right = figure.subfigures(*((2, 1) if page().narrow else (1, 2)), squeeze=False).ravel()
    run, shown = _run_settled(optimum)
    if run.planar:
        above, below = left.subfigures(2, 1)
        _draw_commands(above, run, shown)
        view, names = right.subplots(), list(run.contacts)
        draw_plane(view, run.positions[shown], run.state[shown], run.mean[shown], run.ends, names)
        make_room(view)
        _draw_profiles(below.subplots(), optimum, units)
    else:
        _draw_gait(left, run, shown)
        above, below = right.subfigures(2, 1)
        _draw_profiles(above.subplots(), optimum, units)
        _draw_map(below, below.subplots(), optimum, units)
    unit = "" if optimum.unit == "1" else f" {optimum.unit}"
    title = f"{shorten(optimum.scene.name)}: {_LABELS[optimum.objective].split(' [')[0]} {optimum.value:.5g}{unit}"
    figure.suptitle(title, x=0.005, ha="left", fontsize=12, fontweight="bold", parse_math=False)
    write_figure(figure, png, 110)


def _run_settled(optimum: Optimum) -> tuple[RunArrays, np.ndarray]:
    """Run a gait; return the run, and which of its samples are in two periods of the periodic regime."""
    scene, period = optimum.scene, optimum.scene.drive.period
    assert period is not None
    rate = _SAMPLES[scene.dimension] / period
    run = read_trajectory(simulate(scene, duration=(_SETTLING + _PERIODS) * period, rate=rate))
    return run, run.time >= (_SETTLING - 1e-9) * period


def _draw_commands(part: Any, run: RunArrays, shown: np.ndarray, heights: Sequence[float] = ()) -> Any:
    """Draw the commands that change over the shown time, above other panels of these heights; return all axes."""
    time = run.time[shown] - run.time[shown][0]
    commands = [replace(kind, values=kind.values[shown]) for kind in run.commands if kind.changes]
    rows = [*[1.0] * len(commands), *heights]
    axes = np.atleast_1d(part.subplots(len(rows), 1, sharex=True, height_ratios=rows))
    for axis, kind in zip(axes, commands, strict=False):
        draw_commands(axis, time, kind)
        make_room(axis)
    axes[-1].set(xlabel="time in the periodic regime [s]", xlim=(time[0], time[-1]))
    part.align_ylabels(axes)
    return axes


def _draw_gait(part: Any, run: RunArrays, shown: np.ndarray) -> None:
    """Draw the commands that change, and the motion, over two periods of the periodic regime."""
    time = run.time[shown] - run.time[shown][0]
    axis, count = _draw_commands(part, run, shown, [2.0])[-1], run.positions.shape[1]
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST_LINES)).astype(int))
    x = run.positions[shown][:, chosen]
    draw_positions(axis, time, x - x[0, 0], run.state[shown][:, chosen], [run.contacts[i] for i in chosen])
    label_values(axis, "position", "m", float(np.ptp(x)))
    write_title(axis, "contacts over time" + (f", {chosen.size} of {count}" if chosen.size < count else ""))
    explain_states(axis, False, False)


def _with_unit(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} [{unit}]"


def _draw_profiles(axis: Axes, optimum: Optimum, units: Mapping[str, str]) -> None:
    """Draw the objective with one unknown at a time moved between its bounds; the most sensitive ones are named."""
    from matplotlib.lines import Line2D

    part, values = profile(optimum)
    order = np.argsort(-np.nan_to_num(np.ptp(np.nan_to_num(values), axis=1)), kind="stable")[:_MOST_LINES]
    for i in order[_NAMED:]:
        draw_broken(axis, part, values[i], find_jumps(values[i]), color=STICK, linewidth=0.8)
    handles = []
    # curves that coincide show through each other: each is narrower than the one below it, and has gaps
    styles: Any = zip(order, LINES, ("-", "--", "-.", ":"), (3.6, 2.8, 2.0, 2.0), strict=False)
    for i, color, dash, width in styles:
        draw_broken(axis, part, values[i], find_jumps(values[i]), color=color, linewidth=width, linestyle=dash)
        bounds = f"{optimum.low[i]:.3g} .. {optimum.high[i]:.3g}".replace("-", "\u2212")
        unit = units[optimum.names[i]]
        label = f"{name_number(optimum.scene, optimum.names[i])}, {bounds}" + ("" if unit == "1" else f" {unit}")
        handles.append(Line2D([], [], color=color, linewidth=1.6, linestyle=dash, label=label))
    place = (optimum.values - optimum.low) / (optimum.high - optimum.low)
    axis.plot(place[order], [optimum.value] * order.size, "o", color="black", ms=4, zorder=4)
    axis.set(xlabel="one unknown between its bounds", ylabel=_LABELS[optimum.objective])
    place_legend(axis, handles)
    write_title(axis, "around the optimum (dots), one unknown at a time")
    make_room(axis)


def _draw_map(part: Any, axis: Axes, optimum: Optimum, units: Mapping[str, str]) -> None:
    """Draw the objective over the two unknowns that matter most."""
    if optimum.plane is None:
        axis.set_axis_off()
        return
    pair, x, y, values = map_plane(optimum)
    cost, finite = optimum.objective == "cost-of-transport", values[np.isfinite(values)]
    limit = float(np.abs(finite).max(initial=0.0))
    scale: Any = {"cmap": "Greens_r" if cost else "Greens"}
    if cost and finite.size:
        scale["vmax"] = float(np.quantile(finite, 0.9))
    elif (finite < -1e-9 * limit).any():  # as in maps of sweeps: green forward, purple backward
        scale = {"cmap": "PRGn", "vmin": -limit, "vmax": limit}
    drawn = axis.pcolormesh(x, y, values, shading="nearest", rasterized=True, **scale)
    axis.set_facecolor(GREY)
    part.colorbar(drawn, ax=axis, label=_LABELS[optimum.objective])
    draw_levels(axis, x, y, values)
    axis.plot(
        optimum.values[pair[0]], optimum.values[pair[1]], "o", color="black", mfc="white", ms=7, zorder=4, clip_on=False
    )
    names = optimum.names
    across, upwards = (_with_unit(name_number(optimum.scene, names[i]), units[names[i]]) for i in pair)
    axis.set(xlabel=across, ylabel=upwards)
    axis.locator_params(nbins=3 if page().narrow else 5)
    outside = "; grey: no value within the limits" if np.isnan(values).any() else ""
    write_title(axis, f"around the optimum (circle), two unknowns{outside}")


@own_style()
def draw_front(front: Front, png: Path) -> None:
    """Draw the curve of gain against cost of transport.

    Args:
        front: the curve.
        png: the file to write.
    """
    figure = open_figure(7, 5)
    axis = figure.subplots()
    gains = [point.gain for point in front.points]
    costs = [point.cost_of_transport for point in front.points]
    axis.plot(costs, gains, color=TENSION, linewidth=1.0, marker="o", ms=5)
    axis.set(xlabel="cost of transport", ylabel="gain per period [m]")
    write_title(axis, f"{shorten(front.points[0].scene.name)}: going far and going cheaply")
    write_figure(figure, png, 110)
