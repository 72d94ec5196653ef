"""Comparison of two recorded runs on simulated time: where they begin to differ, and by how much."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crawler_model import Scene
from crawler_model.body.drive import NS
from crawler_pictures.colors import BACK, FORWARD
from crawler_pictures.numbers import write_length

from ...recording.bag import BagError
from ..analysis import Replay, analyse, size_of
from ..cycles import ROUNDING

_MOST_SHOWN = 8
_COLORS = ("#46688f", "#d07a1e")
_RARE = {"loads_work": "work of loads", "jump_loss": "lost in jumps"}
"""Energies that are shown only where there are any, and their names in the table."""


@dataclass(frozen=True, eq=False)
class RunComparison:
    """The differences between two runs: the second minus the first.

    Attributes:
        first: the first run.
        second: the second run.
        commands_differ: simulated time from which the commands differ [s]; None when they never do.
        motion_differs: simulated time from which the net translations differ [s]; None when they never do.
        max_difference: largest difference of the net translation [m].
        translation: difference in each cycle that both have [m], in the plane for x and y.
        energy: differences of work, dissipation and stored energy [J]; None when one is not known.
        slips: for each contact and end of a segment, the differences of number and total distance [m].
    """

    first: Replay
    second: Replay
    commands_differ: float | None
    motion_differs: float | None
    max_difference: float
    translation: tuple[Any, ...]
    energy: dict[str, float] | None
    slips: tuple[dict[str, Any], ...]

    def as_plain(self) -> dict[str, Any]:
        """Convert to the values that `crawler compare --json` prints.

        Returns:
            Plain numbers, lists and text, schema 1; lengths in m, times in s, energies in J.
        """
        runs = [
            {
                "recording": str(run.path),
                "scene": None if run.scene is None else run.scene.name,
                "simulated_s": run.seconds,
                "cycles": [cycle.as_plain()["translation"] for cycle in run.cycles],
                "energy": None if run.energy is None else run.energy.as_plain(),
                "slips": int(run.slips.contact.size),
                "healthy": run.healthy,
            }
            for run in (self.first, self.second)
        ]
        return {
            "schema": 1,
            "runs": runs,
            "commands": {"first_difference": self.commands_differ},
            "motion": {"first_difference": self.motion_differs, "max_difference": self.max_difference},
            "translation": [v.tolist() for v in self.translation],
            "energy": self.energy,
            "slips": list(self.slips),
        }


def compare_recordings(
    first: Path,
    second: Path,
    scene: Scene | None = None,
    namespace: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> RunComparison:
    """Read two recordings and compare them.

    Args:
        first: the first recording.
        second: the second recording.
        scene: the scene that ran, for recordings that do not hold it.
        namespace: namespace of the crawler, where several were recorded.
        progress: called with the fraction done, in [0, 1].

    Returns:
        The comparison.

    Raises:
        BagError: when one is not a recording of a crawler, or their contacts differ.
    """
    report = progress or (lambda part: None)
    one = analyse(first, scene, namespace, progress=lambda part: report(0.5 * part))
    two = analyse(second, scene, namespace, progress=lambda part: report(0.5 + 0.5 * part))
    if one.stations != two.stations:
        raise BagError(
            f"{first} has the contacts {', '.join(one.stations[:6])} and {second} {', '.join(two.stations[:6])}: "
            "runs of different bodies cannot be compared"
        )
    size = max(size_of(one.table), size_of(two.table))
    same_kind = one.table.place.any() == two.table.place.any()
    commands, _ = _first_difference(one, two, "place", ROUNDING * max(_largest(one, "place"), _largest(two, "place")))
    motion, most = _first_difference(one, two, "net_translation", ROUNDING * size)
    both = min(len(one.cycles), len(two.cycles))
    gains = [
        np.subtract(b.translation, a.translation) for a, b in zip(one.cycles[:both], two.cycles[:both], strict=True)
    ]
    energy = None
    if one.energy is not None and two.energy is not None:
        energy = {
            name: getattr(two.energy, name) - getattr(one.energy, name)
            for name in ("work", "loads_work", "dissipation", "jump_loss", "stored")
        }
    return RunComparison(
        first=one,
        second=two,
        commands_differ=commands if same_kind else 0.0,
        motion_differs=motion,
        max_difference=most,
        translation=tuple(gains),
        energy=energy,
        slips=tuple(_slips(one, two, contact) for contact in range(len(one.stations))),
    )


def _largest(run: Replay, name: str) -> float:
    return float(np.abs(getattr(run.table, name)).max(initial=0.0))


def _first_difference(one: Replay, two: Replay, name: str, tolerance: float) -> tuple[float | None, float]:
    """Find when a quantity of two runs first differs, and its largest difference, up to the end of the shorter one.

    Commands are straight lines between their vertices and are compared at the vertices of both. The translation is not,
    so it is compared where both have a state.
    """
    tables = [run.table for run in (one, two)]
    rows = [np.flatnonzero(t.run == 0) for t in tables]
    times = [t.end_ns[r] for t, r in zip(tables, rows, strict=True)]
    values = [getattr(t, name)[r] for t, r in zip(tables, rows, strict=True)]
    if min(v.size for v in values) == 0 or values[0].shape[1] != values[1].shape[1]:
        return None, 0.0
    if name == "place":
        grid = np.union1d(*times)
    else:
        grid = np.intersect1d(times[0], times[1])
    grid = grid[(grid <= min(t[-1] for t in times)) & (grid >= max(t[0] for t in times))]
    if grid.size == 0:
        return None, 0.0
    apart = np.zeros(grid.size)
    for k in range(values[0].shape[1]):
        read = [np.interp(grid, t, v[:, k]) for t, v in zip(times, values, strict=True)]
        apart = np.maximum(apart, np.abs(read[1] - read[0]))
    differs = np.flatnonzero(apart > tolerance)
    return (float(grid[differs[0]]) / NS if differs.size else None), float(apart.max())


def _slips(one: Replay, two: Replay, contact: int) -> dict[str, Any]:
    counts, distances = [], []
    for run in (one, two):
        rows = run.slips.contact == contact
        counts.append(int(rows.sum()))
        distances.append(float(run.slips.distance[rows].sum()))
    more = {"count": counts[1] - counts[0], "distance": distances[1] - distances[0]}
    return {"contact": one.stations[contact], **more}


def _set_ups(one: Replay, two: Replay) -> list[str]:
    """List the differences of scene, method and versions."""
    lines = []
    if one.scene is not None and two.scene is not None:
        pair = [_flat(run.scene.document()) for run in (one, two) if run.scene is not None]
        keys = [key for key in sorted({*pair[0], *pair[1]}) if pair[0].get(key) != pair[1].get(key) and key != "name"]
        pairs = [f"{key} {pair[0].get(key, 'none')!s:.40} / {pair[1].get(key, 'none')!s:.40}" for key in keys]
        more = f"; {len(pairs) - _MOST_SHOWN} more" if len(pairs) > _MOST_SHOWN else ""
        if pairs:
            lines.append(f"scenes (A / B): {'; '.join(pairs[:_MOST_SHOWN])}{more}")
    if one.method != two.method:
        lines.append(f"method (A / B): {one.method} / {two.method}")
    versions: list[Any] = [run.survey.attachments.get("versions") for run in (one, two)]
    if all(isinstance(v, dict) for v in versions) and versions[0] != versions[1]:
        a, b = versions
        pairs = [f"{name} {a.get(name)} / {b.get(name)}" for name in sorted({*a, *b}) if a.get(name) != b.get(name)]
        lines.append(f"versions (A / B): {'; '.join(pairs)}")
    return lines


def _flat(document: Any, key: str = "") -> dict[str, Any]:
    """Flatten a nested document to one level, with keys joined by dots."""
    if not isinstance(document, dict):
        return {key: document}
    return {k: v for name, part in document.items() for k, v in _flat(part, f"{key}.{name}".lstrip(".")).items()}


def print_comparison(found: RunComparison, screen: Console) -> None:
    """Print a comparison.

    Args:
        found: the comparison.
        screen: the console to print to.
    """
    one, two = found.first, found.second
    for letter, run in (("A", one), ("B", two)):
        name = "scene not known" if run.scene is None else run.scene.name
        problem = "" if run.healthy else f"; [yellow]problem:[/] {run.problems[0]}"
        screen.print(f"{letter}: {run.path}: {name}, {run.seconds:g} s, {len(run.cycles)} cycle(s){problem}")
    for line in _set_ups(one, two):
        screen.print(line)
    when = "the same" if found.commands_differ is None else f"different from {found.commands_differ:g} s on"
    screen.print(f"commands: {when} while both runs last")
    if found.motion_differs is None:
        screen.print(f"net translation: the same (largest difference {found.max_difference:.1e} m)")
    else:
        screen.print(
            f"net translation: differs from {found.motion_differs:g} s on, by up to {found.max_difference:.6g} m"
        )
    table = Table()
    for column in ("", "A", "B", "B - A"):
        table.add_column(escape(column), justify="right")
    if abs(one.seconds - two.seconds) > 1e-6:
        screen.print("the runs have different durations: work, energy and slips below are sums over each whole run")
    size = max(size_of(one.table), size_of(two.table))
    for k, gain in enumerate(found.translation[:_MOST_SHOWN]):
        pair = one.cycles[k].translation, two.cycles[k].translation
        table.add_row(f"cycle {k + 1}: translation, m", *(write_length(v, size) for v in (*pair, gain)))
    if len(found.translation) > _MOST_SHOWN:
        table.add_row(f"({len(found.translation) - _MOST_SHOWN} more)", "", "", "")
    both = min(len(one.cycles), len(two.cycles))
    if both and one.cycles[both - 1].energy is not None and two.cycles[both - 1].energy is not None:
        works = [run.cycles[both - 1].energy.work for run in (one, two)]  # type: ignore[union-attr]
        table.add_row(f"work in cycle {both}, J", *(f"{v:.6g}" for v in (*works, works[1] - works[0])))
    if found.energy is not None and one.energy is not None and two.energy is not None:
        for name, change in found.energy.items():
            values = getattr(one.energy, name), getattr(two.energy, name), change
            if name in _RARE and not any(values):
                continue
            table.add_row(f"total {_RARE.get(name, name)}, J", *(f"{v:.6g}" for v in values))
    for row in found.slips[:_MOST_SHOWN]:
        contact = one.stations.index(row["contact"])
        totals = [float(r.slips.distance[r.slips.contact == contact].sum()) for r in (one, two)]
        table.add_row(f"{row['contact']} total slip, m", *(write_length(v, size) for v in (*totals, row["distance"])))
    screen.print(table)


def draw_comparison(found: RunComparison, png: Path) -> None:
    """Draw both runs: net translation over time, translation of each cycle, slips, energy.

    Args:
        found: the comparison.
        png: the file to write.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(11, 7), width_ratios=[2, 1], layout="constrained")
    runs = (found.first, found.second)
    labels = [f"{letter}: {run.path.name}" for letter, run in zip("AB", runs, strict=True)]
    for run, label, color in zip(runs, labels, _COLORS, strict=True):
        rows = np.flatnonzero(run.table.run == 0)
        rows = rows[:: max(rows.size // 5000, 1)]
        time, y = run.table.end_ns[rows] / NS, run.table.net_translation[rows, 0]
        axes[0, 0].plot(time, y - y[0], color=color, linewidth=1.6, label=label)
        if run.energy is not None:
            every = run.table.run == 0
            axes[1, 0].plot(
                run.table.end_ns[every] / NS, np.cumsum(run.table.dissipation[every]), color=color, linewidth=1.6
            )
    for when, axis in ((found.motion_differs, axes[0, 0]), (found.commands_differ, axes[1, 0])):
        if when is not None:
            axis.axvline(when, color="#8a8a8a", linewidth=0.8, linestyle="--")
    axes[0, 0].set_ylabel("net translation [m]")
    axes[0, 0].legend(fontsize=8, frameon=False)
    axes[0, 0].set_title(
        "dashed: first difference of the motion (above) and of the commands (below)", fontsize=8, loc="left"
    )
    axes[1, 0].set_ylabel("dissipation [J]")
    axes[1, 0].set_xlabel("simulated time [s]")
    for k, (run, color) in enumerate(zip(runs, _COLORS, strict=True)):
        gained = np.array([np.atleast_1d(c.translation)[0] for c in run.cycles])
        axes[0, 1].bar(np.arange(gained.size) + 1 + 0.38 * k - 0.19, gained, width=0.36, color=color)
        forward, back = (
            sum(getattr(c, f"slip_{direction}") for c in run.cycles) for direction in ("forward", "backward")
        )
        axes[1, 1].bar([k - 0.2, k + 0.2], [forward, -back], width=0.36, color=[FORWARD, BACK])
    axes[0, 1].axhline(0.0, color="#9a9a9a", linewidth=0.8)
    axes[0, 1].set_xlabel("cycle")
    axes[0, 1].set_ylabel("gained [m]")
    axes[1, 1].axhline(0.0, color="#9a9a9a", linewidth=0.8)
    axes[1, 1].set_xticks([0, 1], ["A", "B"])
    axes[1, 1].set_ylabel("slips forward, back\nin all cycles [m]")
    figure.savefig(png, dpi=110)
    plt.close(figure)
