"""The report that `crawler replay` prints: one screen."""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.table import Column, Table

from crawler_model.body.drive import NS
from crawler_model.theory.uniqueness import UNDETERMINED
from crawler_pictures.numbers import write_length, write_stability

from ..analysis import Replay
from ..cycle_table import Cycle
from ..health import TopicHealth

_MOST_CYCLES, _MOST_CONTACTS = 6, 6
_MOST_RUNS, _MOST_RESTS, _MOST_REASONS = 4, 4, 6


def print_replay(replay: Replay, screen: Console) -> None:
    """Print the report.

    Args:
        replay: the analysed recording.
        screen: the console to print to.
    """
    survey = replay.survey
    state = "complete" if survey.complete else "damaged" if survey.ended else "incomplete: its end is missing"
    state = "incomplete" if not survey.complete and survey.ended and survey.lost == 0 else state
    origin = survey.attachments.get("recovered")
    if isinstance(origin, dict):
        state += f" (recovered from {origin.get('from')})"
    what = "scene not known" if replay.scene is None else f"{replay.scene.name}, {replay.method or 'method not known'}"
    screen.print(f"{replay.path}: {state}, {survey.messages} messages; {what}, {replay.seconds:g} s simulated")
    screen.print(_topics(replay.topics))
    compared = replay.comparison
    resets = f", {compared.resets} reset(s)" if compared is not None and compared.resets else ""
    counted = "" if compared is None else f"simulated again: {compared.ticks} states{resets}, "
    screen.print(f"{counted}{replay.explanation}")
    if compared is not None and compared.max_difference:
        screen.print(f"largest difference: {compared.max_difference:.3g} m, {compared.max_force_difference:.3g} N")
    _print_translation(replay, screen)
    _print_cycles(replay, screen)
    _print_slips(replay, screen)
    _print_jumps(replay, screen)
    _print_limits(replay, screen)
    _print_account(replay, screen)
    _print_rests(replay, screen)
    _print_incidents(replay, screen)
    for problem in replay.problems:
        screen.print(f"[yellow]problem:[/] {problem}")


def _topics(topics: dict[str, TopicHealth]) -> Table:
    names = ("messages", "per second", "stamps [s]", "missing", "out of order")
    table = Table(Column("topic", no_wrap=True), *(Column(name, justify="right") for name in names))
    for name, topic in topics.items():
        stamps = "" if topic.first is None or topic.last is None else f"{topic.first:g} .. {topic.last:g}"
        wrong = [f"{topic.out_of_order} back"] * bool(topic.out_of_order)
        wrong += [f"{topic.duplicates} repeated"] * bool(topic.duplicates)
        rate = "" if topic.rate is None else f"{topic.rate:.6g}"
        table.add_row(name, str(topic.count), rate, stamps, str(topic.missing or ""), ", ".join(wrong))
    return table


def _print_translation(replay: Replay, screen: Console) -> None:
    """Print how far the body went in each run between resets, the first ones."""
    gained = replay.table.gained
    lengths = [write_length(run, replay.table.size) for run in gained[:_MOST_RUNS]]
    if len(lengths) > 1:
        lengths = [f"{length} (run {k})" for k, length in enumerate(lengths)]
    more = f"; {len(gained) - _MOST_RUNS} more run(s)" if len(gained) > _MOST_RUNS else ""
    screen.print(f"net translation from start to end [m]: {'; '.join(lengths) or 'not known'}{more}")


def _print_cycles(replay: Replay, screen: Console) -> None:
    cycles = replay.cycles
    if not cycles:
        why = "that the body followed do not repeat" if replay.table.commanded else "in force were not recorded"
        screen.print(f"cycles: none, as the commands {why}")
        return
    transient = sum(c.transient for c in cycles)
    source = "the drive's periods" if replay.cycle_source == "drive" else "by recurrence of the commands"
    known = cycles[0].energy is not None
    turns = cycles[0].turned is not None
    columns = ["time [s]", "translation [m]", *["turned [rad]"] * turns, "slip forward [m]", "slip back [m]"]
    columns += ["work [J]", "dissipation [J]", "residual", "least margin [N]"] if known else []
    columns += [""] if transient else []
    title = f"{len(cycles)} cycle(s), {source}; {transient} transient"
    table = Table(*(Column(name, justify="right") for name in columns), title=title, title_justify="left")
    count = len(cycles)
    rows = list(range(count))
    if count > _MOST_CYCLES:
        rows = [*range(_MOST_CYCLES - 2), count - 1]
    last = -1
    for i in rows:
        if i != last + 1:
            table.add_row(f"({i - last - 1} more)", *[""] * (len(table.columns) - 1))
        last = i
        table.add_row(*_cycle(cycles[i], known, replay.table.shape_size)[: len(columns)])
    screen.print(table)
    if transient:
        screen.print("transient: a cycle whose shape or translation differs from the steady one by over a thousandth")


def _cycle(cycle: Cycle, known: bool, size: float) -> list[str]:
    size = max(size, cycle.slip_forward, cycle.slip_backward)
    lengths = (cycle.translation, cycle.slip_forward, cycle.slip_backward)
    row = [f"{cycle.start:g} .. {cycle.end:g}", *(write_length(value, size) for value in lengths)]
    if cycle.turned is not None:
        row.insert(2, f"{cycle.turned:.6g}")
    if known and cycle.energy is not None:
        energy, margin = cycle.energy, cycle.least_margin or 0.0
        row += [f"{energy.work:.6g}", f"{energy.dissipation:.6g}", f"{energy.residual:.0e}"]
        row.append(f"{margin:.3g}" if abs(margin) > 1e-12 else "0")
    return [*row, "transient" if cycle.transient else ""]


def _print_slips(replay: Replay, screen: Console) -> None:
    slips = replay.slips
    if not replay.whole:
        screen.print("slips: known only of the first contact, as contact_states was not recorded")
    if slips.contact.size == 0:
        inside = bool((replay.table.forward + replay.table.backward).any())
        still = bool((replay.table.shape == replay.table.shape[:1]).all())
        why = " of contacts and ends of segments" if inside else ", as nothing moved" if still and replay.whole else ""
        screen.print(f"slips: none{why}")
        return
    planar = replay.table.net_translation.shape[1] == 2
    directions = ((None, "slips"),) if planar else ((1.0, "forward"), (-1.0, "back"))
    parts = []
    for contact in np.unique(slips.contact).tolist()[:_MOST_CONTACTS]:
        texts = []
        for sign, word in directions:
            rows = (slips.contact == contact) & ((slips.direction == sign) if sign is not None else True)
            if rows.any():
                length = float((slips.end_ns - slips.start_ns)[rows].sum()) / NS
                texts.append(f"{rows.sum()} {word} ({slips.distance[rows].sum():.6g} m in {length:.4g} s)")
        parts.append(f"{replay.stations[contact].removeprefix('contact_')}: {', '.join(texts)}")
    more = np.unique(slips.contact).size - len(parts)
    count = "1 slip" if slips.contact.size == 1 else f"{slips.contact.size} slips"
    screen.print(f"{count}; contact " + "; ".join(parts) + (f"; {more} more" if more > 0 else ""))


def _print_jumps(replay: Replay, screen: Console) -> None:
    jumps = replay.plain_jumps()
    if not jumps:
        return
    longest = max(jumps, key=lambda jump: abs(jump["distance"]))
    loss = sum(jump["loss"] for jump in jumps)
    buckled = replay.scene is not None and not replay.scene.ground.lets_go
    why = "where stability was lost" if buckled else "onto ground that holds less"
    border = "" if longest["border"] is None else f" from the border at {longest['border']:g} m"
    screen.print(
        f"{len(jumps)} jump(s) {why}, {loss:.6g} J lost; the longest: {longest['contact']} at "
        f"{longest['time']:g} s, {longest['distance']:.6g} m{border}"
    )


def _print_limits(replay: Replay, screen: Console) -> None:
    """Print how long links were slack or stalled, the longest first."""
    times = [
        (seconds, f"{name} {word} {seconds:.4g} s")
        for name, found in (replay.at_limits or {}).items()
        for word, seconds in found.items()
    ]
    if not times:
        return
    longest = [text for seconds, text in sorted(times, key=lambda entry: -entry[0])[:_MOST_CONTACTS] if seconds > 0.0]
    screen.print(f"at limits of tension: {', '.join(longest) or 'no link'}")


def _print_rests(replay: Replay, screen: Console) -> None:
    longest = sorted(replay.rests, key=lambda rest: rest.since - rest.until)[:_MOST_RESTS]
    for rest in sorted(longest, key=lambda rest: (rest.run, rest.since)):
        screen.print((f"run {rest.run}: " if rest.run else "") + rest.explain())
    if len(replay.rests) > _MOST_RESTS:
        screen.print(f"{len(replay.rests) - _MOST_RESTS} shorter rest(s)")


def _print_incidents(replay: Replay, screen: Console) -> None:
    if replay.incidents is None:
        screen.print("refused commands and late ticks: not known, as /diagnostics was not recorded")
        return
    lines = replay.incidents.explain()
    for line in lines[:_MOST_REASONS]:
        screen.print(f"[yellow]incident:[/] {line}")
    if len(lines) > _MOST_REASONS:
        screen.print(f"{len(lines) - _MOST_REASONS} more kind(s) of incidents")
    if not lines:
        screen.print("no command was refused or lost, and no tick was late")


def _print_account(replay: Replay, screen: Console) -> None:
    energy, margins = replay.energy, replay.margins
    if energy is None or margins is None:
        screen.print("energy and margins: not known without a simulation")
        return
    jumps = f"lost in jumps {energy.jump_loss:.6g} J, " if energy.jump_loss else ""
    jumps += f"lost in springs {energy.internal_dissipation:.6g} J, " if energy.internal_dissipation else ""
    loads = f"work of loads {energy.loads_work:.6g} J, " if energy.loads_work else ""
    screen.print(
        f"whole run: work {energy.work:.6g} J, {loads}dissipation {energy.dissipation:.6g} J, {jumps}"
        f"stored {energy.stored:.6g} J, residual {energy.residual:.0e}"
    )
    least = margins.least if abs(margins.least) > 1e-12 else 0.0
    visited = "not known" if margins.visited is None else f"{margins.visited:.4g}"
    screen.print(
        f"margins: least distance from a bound {least:.3g} N, "
        f"first at {margins.least_at:g} s ({margins.least_contact}); visited margin {visited}"
    )
    if margins.stability_margin is not None and margins.stability_time is not None:
        screen.print(write_stability(margins.stability_margin, margins.stability_time))
    if not margins.unique:
        first = margins.ambiguous[0]
        screen.print(
            f"[yellow]not unique:[/] in {len(margins.ambiguous)} interval(s), the first {first[0]:g} .. {first[1]:g} "
            f"s, {UNDETERMINED}"
        )
