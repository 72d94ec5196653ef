"""The page of an optimal gait: commands, motion, and the objective around the optimum."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import Front, Optimum, simulate
from crawler_model.optimise.landscape import map_plane, profile

from .colors import ACTUATION, BACK, FORWARD, GREY, STICK, TENSION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LABELS = {
    "translation": "gain per period [m]",
    "cost-of-transport": "cost of transport",
    "travel": "gain / travel of the actuators",
}
_PERIODS = 2
_SETTLING = 8
_MOST_LINES = 40
_DASHES = ("-", "--", "-.", ":")
"""Links that move alike lie on one line: each shows through the gaps of the next."""


def draw_optimum(optimum: Optimum, png: Path) -> None:
    """Draw an optimal gait: commands and motion over two periods, and the objective around it.

    Args:
        optimum: the gait.
        png: the file to write.
    """
    plt = _pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(11, 8), layout="constrained")
    _draw_commands(axes[0, 0], optimum)
    _draw_motion(axes[1, 0], optimum)
    _draw_profiles(axes[0, 1], optimum)
    _draw_plane(figure, axes[1, 1], optimum)
    unit = "" if optimum.unit == "1" else f" {optimum.unit}"
    figure.suptitle(
        f"{optimum.scene.name}: {_LABELS[optimum.objective].split(' [')[0]} {optimum.value:.5g}{unit}", fontsize=12
    )
    figure.savefig(png, dpi=110)
    plt.close(figure)


def _pyplot() -> Any:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    return plt


def _colors(count: int) -> Any:
    from matplotlib import colormaps

    return colormaps["viridis"](np.linspace(0.0, 0.88, max(count, 2)))[:count]


def _draw_commands(axis: Axes, optimum: Optimum) -> None:
    """Draw the rest lengths, and the friction if the drive commands it, over two periods."""
    scene = optimum.scene
    drive, columns = scene.drive, scene.columns
    assert drive.period is not None
    times, rows = drive.times, drive.rows
    if drive.period > times[-1]:
        times, rows = np.append(times, drive.period), np.vstack((rows, rows[:1]))
    times = np.concatenate([times + k * drive.period for k in range(_PERIODS)])
    rows = np.tile(rows, (_PERIODS, 1))
    lengths = rows[:, : columns.lengths][:, :_MOST_LINES]
    for i, (column, color) in enumerate(zip(lengths.T, _colors(lengths.shape[1]), strict=True)):
        label = columns.names[i].replace("_", " ") if lengths.shape[1] <= 8 else None
        axis.plot(times, column, color=color, linewidth=1.6, linestyle=_DASHES[i % 4], label=label)
    segments, links = bool(scene.body.segments), columns.links > 0
    axis.set(xlabel="time [s]", ylabel=" and ".join(["rest length [m]"] * links + ["strain"] * segments), title="gait")
    friction = rows[:, columns.lengths :][:, : columns.frictions // 2]
    if np.ptp(friction, axis=0).any():
        other = axis.twinx()
        for column, color in zip(friction.T, _colors(friction.shape[1]), strict=True):
            other.plot(times, column, color=color, linewidth=1.1, linestyle=":")
        other.set_ylabel("friction [N], dotted" if not segments else "friction [N, N/m], dotted")
    if lengths.shape[1] <= 8:
        axis.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.08), ncols=lengths.shape[1])
    axis.grid(alpha=0.25)


def _draw_motion(axis: Axes, optimum: Optimum) -> None:
    """Draw the positions of the contacts over two periods of the periodic regime."""
    scene = optimum.scene
    period = scene.drive.period
    assert period is not None
    run = simulate(scene, duration=(_SETTLING + _PERIODS) * period, rate=200.0 / period)
    shown = run.time >= (_SETTLING - 1e-9) * period
    time = run.time[shown] - _SETTLING * period
    chosen = np.unique(np.linspace(0, scene.body.contacts - 1, min(scene.body.contacts, _MOST_LINES)).astype(int))
    x = (scene.body.position + run.displacement)[shown][:, chosen]
    x -= x[0, 0]
    state = run.contact_state[shown][:, chosen]
    for column, slid in zip(x.T, state.T, strict=True):
        axis.plot(time, column, color=STICK, linewidth=1.2, zorder=1)
        for sign, color in ((1, FORWARD), (-1, BACK)):
            moving = np.append(slid[1:] == sign, False) | (slid == sign)
            axis.plot(time, np.where(moving, column, np.nan), color=color, linewidth=1.8, zorder=2)
    for label, color in (("slides forward", FORWARD), ("slides backward", BACK), ("sticks", STICK)):
        axis.plot([], [], color=color, label=label)
    axis.legend(fontsize=8, loc="upper left")
    axis.set(xlabel="time in the periodic regime [s]", ylabel="position of the contacts [m]", title="motion")
    axis.grid(alpha=0.25)


def _draw_profiles(axis: Axes, optimum: Optimum) -> None:
    """Draw the objective with one unknown at a time moved between its bounds; the most sensitive ones are named."""
    part, values = profile(optimum)
    order = np.argsort(-np.nan_to_num(np.ptp(np.nan_to_num(values), axis=1)), kind="stable")[:_MOST_LINES]
    for rank, i in reversed(list(enumerate(order))):
        named = rank < 4
        color = (TENSION, ACTUATION, FORWARD, BACK)[rank] if named else STICK
        axis.plot(
            part, values[i], color=color, linewidth=1.6 if named else 0.8, label=optimum.names[i] if named else None
        )
    width = optimum.high - optimum.low
    axis.plot(((optimum.values - optimum.low) / width)[order], [optimum.value] * order.size, "o", color="black", ms=4)
    axis.legend(fontsize=7)
    axis.set(xlabel="one unknown, from its lower to its upper bound", title="around the optimum: one unknown at a time")
    axis.set_ylabel(_LABELS[optimum.objective])
    axis.grid(alpha=0.25)


def _draw_plane(figure: Figure, axis: Axes, optimum: Optimum) -> None:
    """Draw the objective over the two unknowns that matter most."""
    if len(optimum.names) < 2:
        axis.set_axis_off()
        return
    pair, x, y, values = map_plane(optimum)
    cmap = "viridis_r" if optimum.objective == "cost-of-transport" else "viridis"
    finite = values[np.isfinite(values)]
    most = float(np.quantile(finite, 0.9)) if optimum.objective == "cost-of-transport" and finite.size else None
    drawn = axis.pcolormesh(x, y, values, shading="nearest", cmap=cmap, rasterized=True, vmax=most)
    axis.set_facecolor(GREY)
    figure.colorbar(drawn, ax=axis, label=_LABELS[optimum.objective])
    axis.plot(optimum.values[pair[0]], optimum.values[pair[1]], "o", color="black", mfc="white", ms=7, clip_on=False)
    axis.set(xlabel=optimum.names[pair[0]], ylabel=optimum.names[pair[1]], title="around the optimum: two unknowns")


def draw_front(front: Front, png: Path) -> None:
    """Draw the curve of gain against cost of transport.

    Args:
        front: the curve.
        png: the file to write.
    """
    plt = _pyplot()
    figure, axis = plt.subplots(figsize=(7, 5), layout="constrained")
    gains = [point.gain for point in front.points]
    costs = [point.cost_of_transport for point in front.points]
    axis.plot(costs, gains, color=TENSION, linewidth=1.0, marker="o", ms=5)
    axis.set(xlabel="cost of transport", ylabel="gain per period [m]")
    axis.set_title(f"{front.points[0].scene.name}: going far and going cheaply", fontsize=11)
    axis.grid(alpha=0.25)
    figure.savefig(png, dpi=110)
    plt.close(figure)
