"""Draw the net translation of each friction strategy over amplitude and phase: pictures/gallery/phase_diagram.png."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from crawler_lab import ManyRuns, simulate_many, vary
from crawler_model import Scene
from crawler_model.body.drive import strategy_waypoints

PICTURE = Path(__file__).parent / "pictures" / "gallery" / "phase_diagram.png"
MOST = 6.0
"""Greatest amplitude drawn, k Lmax / mu."""
CLOSED_FORMS = {
    "A": (lambda a: np.maximum(a - 2.0, 0.0), "max(0, a - 2)"),
    "B": (lambda a: np.clip(a - 1.0, 0.0, 2.0), "a - 1, limited to 0 .. 2"),
    "C": (lambda a: np.maximum(a - 2.0, 0.0), "max(0, a - 2)"),
}
"""Net translation per period at shift 0 in units of mu / k, a = k Lmax / mu."""
KINKS = {"A": (2.0,), "B": (1.0, 3.0), "C": (2.0,)}
"""Amplitudes of their bends: where motion begins, and where strategy B stops gaining."""
_WHOLE = [-4, -3, -2, -1, 1, 2, 3, 4]
_BLUE = "#2f5fc4"
_SHAPE = np.array([0.0, 0.25, 0.5, 0.75])


def shifted_drives(strategy: str, amplitude: np.ndarray, shift: np.ndarray) -> dict[str, np.ndarray]:
    """Compute drives whose friction lags behind the shape, as numbers of one document.

    Args:
        strategy: "A", "B" or "C".
        amplitude: Lmax of each, shape (M,) [m].
        shift: delay of the friction, as part of a period, no multiple of 1/4, shape (M,).

    Returns:
        For `vary`, side by side: eight waypoints of the shape and eight of the friction.
    """
    _, length, friction = strategy_waypoints(strategy, 1.0, 1.0, 1.0)
    times = np.sort(np.hstack((np.tile(_SHAPE, (shift.size, 1)), np.mod(_SHAPE + shift[:, None], 1.0))), axis=1)
    quarters = np.append(_SHAPE, 1.0)
    values: dict[str, np.ndarray] = {}
    for i, at in enumerate(times.T):
        values[f"drive.times.{i}"] = at
        values[f"drive.actuation.{i}.0"] = amplitude * np.interp(at, quarters, length[:, 0])
        for contact in (0, 1):
            mu = np.interp(np.mod(at - shift, 1.0), quarters, friction[:, contact])
            values[f"drive.friction.isotropic.{i}.{contact}"] = mu
    return values


def template() -> Scene:
    """Build the scene whose numbers are varied: two contacts, k = 1 N/m, mu = 1 N, period 1 s."""
    rows = len(_SHAPE) * 2
    document: dict[str, Any] = {
        "name": "two_anchors",
        "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}},
        "friction": {"isotropic": 1.0},
        "start": "relaxed",
        "drive": {
            "times": [i / rows for i in range(rows)],
            "period": 1.0,
            "actuation": [[0.0]] * rows,
            "friction": {"isotropic": [[1.0, 1.0]] * rows},
        },
    }
    return Scene.model_validate(document)


def run_map(strategy: str, amplitude: np.ndarray, shift: np.ndarray) -> ManyRuns:
    """Run a strategy for every amplitude and shift.

    Args:
        strategy: "A", "B" or "C".
        amplitude: shape (X,) [m].
        shift: part of a period, shape (Y,).

    Returns:
        Rows with the shift slowest, shape (Y X,).
    """
    y, x = np.meshgrid(shift, amplitude, indexing="ij")
    drives = shifted_drives(strategy, x.ravel(), y.ravel())
    return simulate_many(vary(template(), drives, grid=False))


def draw(maps: dict[str, np.ndarray], amplitude: np.ndarray, shift: np.ndarray, png: Path) -> None:
    """Draw a map for each strategy, and below each its section at shift 0.

    Args:
        maps: net translation per period, shape (Y, X) [mu / k].
        amplitude: shape (X,) [mu / k].
        shift: part of a period, shape (Y,).
        png: the file to write.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    with matplotlib.rc_context({"font.size": 9, "mathtext.fontset": "dejavusans"}):
        figure, axes = plt.subplots(
            2, 3, figsize=(12, 7.8), sharex=True, sharey="row", height_ratios=(2.3, 1), layout="constrained"
        )
        limit = max(float(np.abs(table).max()) for table in maps.values())
        for (strategy, table), (top, bottom) in zip(maps.items(), axes.T, strict=True):
            drawn = top.pcolormesh(amplitude, shift, table, cmap="PRGn", vmin=-limit, vmax=limit, rasterized=True)
            _draw_lines(top, strategy, table, amplitude, shift)
            _draw_section(bottom, strategy, amplitude)
        axes[0, 0].set_ylabel(
            "delay of the friction, as part of the period\n(negative: earlier; 0: the strategy itself)"
        )
        axes[0, 0].set_yticks(np.arange(-0.5, 0.51, 0.25), ["-1/2", "-1/4", "0", "1/4", "1/2"])
        axes[1, 0].set_ylabel("net translation\n" + r"per period [$\mu / k$]")
        axes[1, 0].set_xlim(0.0, MOST)
        bar = figure.colorbar(drawn, ax=axes[0], pad=0.01)
        bar.set_label(r"net translation per period [$\mu / k$]: green forward, purple backward")
        figure.savefig(png, dpi=100, pil_kwargs={"optimize": True})
        plt.close(figure)


def _draw_lines(axes: Any, strategy: str, table: np.ndarray, amplitude: np.ndarray, shift: np.ndarray) -> None:
    """Draw the contours of whole values and the start of motion over a map, and the section below it."""
    lines = axes.contour(amplitude, shift, table, levels=_WHOLE, colors="#444444", linewidths=0.6)
    axes.clabel(lines, fontsize=7, fmt="%g")
    axes.plot(_beginnings(np.abs(table), amplitude), shift, color="black", lw=1.3)
    axes.axhline(0.0, color=_BLUE, linewidth=1.0, linestyle="--")
    axes.plot(KINKS[strategy], np.zeros(len(KINKS[strategy])), "o", ms=6, mfc="white", mec=_BLUE, mew=1.5, zorder=5)
    axes.text(0.45, 0.25, "nothing moves", rotation=90, va="center", color="#555555")
    if strategy == "A":
        axes.annotate("equal to strategy B", (5.9, 0.25), (0, 3), textcoords="offset points", fontsize=8, ha="right")
    axes.set_title({"A": "strategy A", "B": "strategy B (A with friction delayed by 1/4)", "C": "strategy C"}[strategy])


def _beginnings(distance: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
    """Extrapolate, for each row of a map, the amplitude at which motion begins from the first two that move."""
    first = np.argmax(distance > 1e-9, axis=1)
    rows = np.arange(first.size)
    one, two = distance[rows, first], distance[rows, first + 1]
    step = amplitude[1] - amplitude[0]
    return amplitude[first] - step * np.clip(one / (two - one), 0.0, 1.0)


def _draw_section(axes: Any, strategy: str, amplitude: np.ndarray) -> None:
    """Draw the strategy itself, simulated and in closed form."""
    exact, formula = CLOSED_FORMS[strategy]
    line = simulate_many(vary(strategy_scene(strategy), {"drive.length": amplitude})).per_period
    few = np.linspace(0.0, MOST, 25)
    axes.plot(amplitude, line, color=_BLUE, linewidth=2.2, label="simulated, along the dashed line")
    axes.plot(few, exact(few), "o", ms=3.5, mfc="white", mec="black", label=f"closed form: {formula}")
    for kink in KINKS[strategy]:
        axes.axvline(kink, color=_BLUE, linewidth=0.8, linestyle=":")
    axes.legend(fontsize=8, loc="upper left")
    axes.grid(alpha=0.25)
    axes.set_xlabel(r"amplitude $a = k\,L_{max} / \mu$")


def strategy_scene(strategy: str) -> Scene:
    """Build a strategy with the paper's phase."""
    document = template().document()
    document["drive"] = {"strategy": strategy, "length": 1.0, "friction": 1.0}
    return Scene.model_validate(document)


def main(png: Path = PICTURE, cells: int = 120) -> None:
    """Run and draw all three strategies.

    Args:
        png: the file to write.
        cells: of each map, along both axes; a multiple of 4, so that no shift is a multiple of 1/4.
    """
    amplitude = (np.arange(cells) + 0.5) * MOST / cells
    shift = (np.arange(cells) + 0.5) / cells - 0.5
    maps = {}
    for strategy in CLOSED_FORMS:
        runs = run_map(strategy, amplitude, shift)
        print(f"strategy {strategy}: {runs}, steady to {np.abs(runs.settling).max():.1e}", file=sys.stderr)
        maps[strategy] = runs.per_period.reshape(cells, cells)
    draw(maps, amplitude, shift, png)


if __name__ == "__main__":
    main()
    print(f"written: {PICTURE.relative_to(PICTURE.parent.parent.parent.parent)}")
