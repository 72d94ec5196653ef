"""Comparison of two recorded runs on simulated time: where they begin to differ, and by how much."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Column, Table

from crawler_model import Scene
from crawler_model.body.drive import NS
from crawler_pictures.numbers import write_angle, write_length

from ...recording.bag import BagError
from ..analysis import Replay, analyse
from ..cycle_table import Cycle
from ..cycles import ROUNDING
from ..ramps import RampTable

_MOST_SHOWN = 8
_OVERLAP = 0.9
"""Part of the longer of two cycles that both have to share to be compared."""
_RARE = {"loads_work": "work of loads", "jump_loss": "lost in jumps", "internal_dissipation": "lost in springs"}
"""Energies that are shown only where there are any, and their names in the table."""


@dataclass(frozen=True, eq=False)
class RunComparison:
    """The differences between two runs: the second minus the first.

    Attributes:
        first: the first run.
        second: the second run.
        commands_differ: simulated time from which the commands differ [s]; None when they never do.
        motion_differs: simulated time from which the net translations differ [s]; None when they never do.
        resets: number of resets before these differences, of the commands and of the net translations.
        max_difference: largest difference of the net translation [m].
        pairs: cycles at the same time, by their numbers in both runs, from 0.
        unpaired: why no or not all cycles have a partner at the same time; empty when all have.
        translation: difference of each pair [m], in the plane for x and y.
        energy: differences of work, dissipation and stored energy [J]; None when one is not known.
        slips: for each contact and end of a segment, the differences of number and total distance [m].
    """

    first: Replay
    second: Replay
    commands_differ: float | None
    motion_differs: float | None
    resets: tuple[int, int]
    max_difference: float
    pairs: tuple[tuple[int, int], ...]
    unpaired: str
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
                **({"turned": [cycle.turned for cycle in run.cycles]} if run.table.turns else {}),
                "energy": None if run.energy is None else asdict(run.energy),
                "slips": int(run.slips.contact.size),
                "healthy": run.healthy,
            }
            for run in (self.first, self.second)
        ]
        return {
            "schema": 1,
            "runs": runs,
            "commands": {"first_difference": self.commands_differ, "resets": self.resets[0]},
            "motion": {
                "first_difference": self.motion_differs,
                "resets": self.resets[1],
                "max_difference": self.max_difference,
            },
            "cycles": {"pairs": [list(pair) for pair in self.pairs], "unpaired": self.unpaired or None},
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
        first: a recording.
        second: another one.
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
    return _compare_runs(one, two)


def _compare_runs(one: Replay, two: Replay) -> RunComparison:
    """Compare two analysed recordings of the same contacts."""
    if one.stations != two.stations:
        raise BagError(
            f"{one.path} has the contacts {', '.join(one.stations[:6])} and {two.path} {', '.join(two.stations[:6])}: "
            "runs of different bodies cannot be compared"
        )
    size = max(one.table.size, two.table.size)
    same_kind = one.table.place.any() == two.table.place.any()
    places = ROUNDING * max(_largest(one, "place"), _largest(two, "place"))
    commands, commands_resets, _ = _first_difference(one, two, "place", places)
    motion, motion_resets, most = _first_difference(one, two, "net_translation", ROUNDING * size)
    pairs, unpaired = _pair_cycles(one.cycles, two.cycles)
    gains = [np.subtract(two.cycles[b].translation, one.cycles[a].translation) for a, b in pairs]
    energy = None
    if one.energy is not None and two.energy is not None:
        energy = {
            name: getattr(two.energy, name) - getattr(one.energy, name)
            for name in ("work", "loads_work", "dissipation", "internal_dissipation", "jump_loss", "stored")
        }
    return RunComparison(
        first=one,
        second=two,
        commands_differ=commands if same_kind else 0.0,
        motion_differs=motion,
        resets=(commands_resets if same_kind else 0, motion_resets),
        max_difference=most,
        pairs=pairs,
        unpaired=unpaired,
        translation=tuple(gains),
        energy=energy,
        slips=tuple(_slips(one, two, contact) for contact in range(len(one.stations))),
    )


def _pair_cycles(one: Sequence[Cycle], two: Sequence[Cycle]) -> tuple[tuple[tuple[int, int], ...], str]:
    """Pair the cycles of two runs that take place at the same time; explain in a line why others have no partner."""
    pairs, k = [], 0
    for i, a in enumerate(one):
        while k < len(two) and (two[k].run, two[k].end) <= (a.run, a.start):
            k += 1
        for j in range(k, min(k + 2, len(two))):
            b = two[j]
            shared = min(a.end, b.end) - max(a.start, b.start)
            if a.run == b.run and shared >= _OVERLAP * max(a.end - a.start, b.end - b.start):
                pairs.append((i, j))
                k = j + 1
                break
    if not one or not two:
        which = "both runs" if not one and not two else "A" if not one else "B"
        return (), f"cycles: none are compared, as the commands of {which} do not repeat"
    if not pairs:
        spans = [
            f"cycles of {n} last {c.end - c.start:g} s from {c.start:g} s on" for n, c in (("A", one[0]), ("B", two[0]))
        ]
        why = f"they are not at the same times: {', '.join(spans)}; --by-phase compares them"
        return (), f"cycles: none are compared, as {why}"
    left = [f"{n} of {name}" for name, n in (("A", len(one) - len(pairs)), ("B", len(two) - len(pairs))) if n]
    return tuple(pairs), f"cycles: {' and '.join(left)} without a partner at the same time" if left else ""


def _largest(run: Replay, name: str) -> float:
    return float(np.abs(getattr(run.table, name)).max(initial=0.0))


def _first_difference(one: Replay, two: Replay, name: str, tolerance: float) -> tuple[float | None, int, float]:
    """Find when a quantity of two recordings first differs, and its largest difference, while both runs last.

    Commands are straight lines between their vertices and are compared at the vertices of both. The translation is not,
    so it is compared where both have a state.

    Returns:
        The simulated time of the first difference, and the resets before it; and the largest difference.
    """
    first, most = None, 0.0
    for run in range(min(one.table.resets, two.table.resets) + 1):
        times, values = zip(*(_read_run(each.table, run, name) for each in (one, two)), strict=True)
        if min(v.size for v in values) == 0 or values[0].shape[1] != values[1].shape[1]:
            continue
        grid = np.union1d(*times) if name == "place" else np.intersect1d(*times)
        grid = grid[(grid <= min(t[-1] for t in times)) & (grid >= max(t[0] for t in times))]
        apart = np.zeros(grid.size)
        for k in range(values[0].shape[1]):
            read = [np.interp(grid, t, v[:, k]) for t, v in zip(times, values, strict=True)]
            apart = np.maximum(apart, np.abs(read[1] - read[0]))
        differs = np.flatnonzero(apart > tolerance)
        if differs.size and first is None:
            first = float(grid[differs[0]]) / NS, run
        most = max(most, float(apart.max(initial=0.0)))
    return (None, 0, most) if first is None else (*first, most)


def _read_run(table: RampTable, run: int, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Read the ends of the ramps of a run, shape (K,) [ns], and a quantity there, shape (K, D)."""
    rows = table.run == run
    return table.end_ns[rows], getattr(table, name)[rows]


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
    # the runs, and what differs in their set-ups, commands and motion
    one, two = found.first, found.second
    for letter, run in (("A", one), ("B", two)):
        name = "scene not known" if run.scene is None else run.scene.name
        problem = "" if run.healthy else f"; [yellow]problem:[/] {run.problems[0]}"
        screen.print(f"{letter}: {run.path}: {name}, {run.seconds:g} s, {len(run.cycles)} cycle(s){problem}")
    for line in _set_ups(one, two):
        screen.print(line)
    if one.table.resets != two.table.resets:
        screen.print(f"resets (A / B): {one.table.resets} / {two.table.resets}; runs of the same number are compared")
    when, moved = (
        "" if time is None else f"{time:g} s {f'after reset {resets} ' if resets else ''}on"
        for time, resets in zip((found.commands_differ, found.motion_differs), found.resets, strict=True)
    )
    screen.print(f"commands: {f'different from {when}' if when else 'the same'} while both runs last")
    if moved:
        screen.print(f"net translation: differs from {moved}, by up to {found.max_difference:.6g} m")
    else:
        screen.print(f"net translation: the same (largest difference {found.max_difference:.1e} m)")
    if found.unpaired:
        screen.print(found.unpaired)
    # a row each: gain of the cycles, angles, energies, slips
    table = Table(*(Column(name, justify="right") for name in ("", "A", "B", "B - A")))
    if abs(one.seconds - two.seconds) > 1e-6:
        screen.print("the runs have different durations: work, energy and slips below are sums over each whole run")
    size = max(one.table.size, two.table.size)
    for (a, b), gain in list(zip(found.pairs, found.translation, strict=True))[:_MOST_SHOWN]:
        pair = one.cycles[a].translation, two.cycles[b].translation
        number = f"{a + 1}" if a == b else f"{a + 1} / {b + 1}"
        table.add_row(f"cycle {number}: translation, m", *(write_length(v, size) for v in (*pair, gain)))
    if len(found.translation) > _MOST_SHOWN:
        table.add_row(f"({len(found.translation) - _MOST_SHOWN} more)", "", "", "")
    last = [(one.cycles[a], two.cycles[b]) for a, b in found.pairs][-1:]
    for cycle, other in last:
        _add_angles(table, f"turned in cycle {found.pairs[-1][0] + 1}", cycle.turned, other.turned)
    _add_angles(table, "turned", one.table.turned, two.table.turned)
    if last and found.energy is not None:
        works = [cycle.energy.work for cycle in last[0] if cycle.energy is not None]
        table.add_row(
            f"work in cycle {found.pairs[-1][0] + 1}, J", *(f"{v:.6g}" for v in (*works, works[1] - works[0]))
        )
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


def _add_angles(table: Table, what: str, a: float | None, b: float | None) -> None:
    """Add a row of angles by which two bodies turned, if they do and it is known."""
    if a is not None and b is not None:
        table.add_row(f"{what}, rad", *(write_angle(angle) for angle in (a, b, b - a)))
