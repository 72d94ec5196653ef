"""An identification as tables and lines, on the screen and on a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from crawler_model import Identification
from crawler_model.identify.fit.misfit import Misfit
from crawler_model.identify.judge.explain import Explanation
from crawler_model.identify.judge.held_out import HeldOut
from crawler_model.identify.judge.sensors import SensorNumber
from crawler_model.identify.judge.verdicts import Parameter

_NARROW = 120
"""Columns of a console below which sentences are written beneath their table."""
_WORDS = ("why", "change", "would move", "largest")
"""Columns of sentences."""
_NAMES = ("parameter", "sensor")
"""Columns of names, which may be broken; all others stay on one line."""
_MOST_NAMED = 4
"""More rows with the same sentence are counted."""
_SHORTEST = 12
"""Columns of the console that a name has at least."""


@dataclass(frozen=True)
class Listing:
    """A table as text.

    Attributes:
        title: above it.
        heads: of its columns.
        rows: its cells.
    """

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def words(self) -> tuple[bool, ...]:
        """Which columns contain sentences."""
        return tuple(head in _WORDS for head in self.heads)

    def without(self, *heads: str) -> Listing:
        """Leave out columns.

        Args:
            heads: their heads.

        Returns:
            The table with all others.
        """
        kept = [c for c, head in enumerate(self.heads) if head not in heads]
        rows = tuple(tuple(row[c] for c in kept) for row in self.rows)
        return Listing(self.title, tuple(self.heads[c] for c in kept), rows)


def list_parameters(parameters: Sequence[Parameter], title: str) -> Listing:
    """List what is known about parameters.

    Args:
        parameters: the verdicts.
        title: above the table.

    Returns:
        A row for each parameter.
    """
    rows = []
    for p in parameters:
        ends = ["" if end is None else f"{end:.6g}" for end in p.interval]
        interval = " .. ".join(ends) if any(ends) else ""
        rows.append((p.name, p.verdict, "" if p.value is None else f"{p.value:.6g}", interval, p.why))
    return Listing(title, ("parameter", "verdict", "value", "95 % interval", "why"), tuple(rows))


def list_sensors(sensors: Sequence[SensorNumber], title: str) -> Listing:
    """List what is known about sensors.

    Args:
        sensors: their numbers.
        title: above the table.

    Returns:
        A row for each number that is not held at 0.
    """
    rows = []
    for one in sensors:
        if one.verdict == "held" and one.value == 0.0:
            continue
        low, high = (_with_unit(one.name, end) for end in one.interval)
        before = f"{_with_unit(one.name, one.prior.mean)} +- {_with_unit(one.name, one.prior.deviation)}"
        interval = "" if one.verdict == "held" else f"{low} .. {high}"
        rows.append((one.name, one.recording, one.verdict, _with_unit(one.name, one.value), interval, before))
    return Listing(title, ("sensor", "recording", "verdict", "value", "95 % interval", "before"), tuple(rows))


def list_misfits(misfits: Sequence[Misfit]) -> Listing:
    """List how far the model is from each channel.

    Args:
        misfits: of the channels.

    Returns:
        A row for each channel; phases as parts of the period of the commands, or of the recording without one.
    """
    rows = []
    for one in misfits:
        size = len(one.phases)
        part = f"{100.0 * one.residual / one.motion:.2g} %" if one.motion else ""
        phase = f"{one.worst / size:.3g} .. {(one.worst + 1) / size:.3g}" if any(one.phases) else ""
        since = "" if one.since is None else f"{one.since:.4g}"
        numbers = (f"{1e3 * one.residual:.3g}", f"{1e3 * one.noise:.3g}", f"{one.ratio:.3g}")
        rows.append((one.recording, one.channel, *numbers, part, phase, since))
    heads = ("recording", "channel", "residual, mm", "noise, mm", "ratio", "of motion", "worst phase", "since, s")
    return Listing("Residuals", heads, tuple(rows))


def list_explanations(explanations: Sequence[Explanation]) -> Listing:
    """List changes of the model that would explain a misfit.

    Args:
        explanations: the changes.

    Returns:
        A row for each change.
    """
    rows = [
        (
            f"{100.0 * one.explained:.0f} %",
            one.what,
            ", ".join(f"{name} to {value:.4g}" for name, value in one.moved.items()) or "nothing beyond its interval",
        )
        for one in explanations
    ]
    return Listing("What would explain the misfit", ("explains", "change", "would move"), tuple(rows))


def list_score(score: HeldOut | None) -> Listing:
    """List how well the rows held out are predicted.

    Args:
        score: None if no row was held out.

    Returns:
        One row, or none.
    """
    heads = ("residual, mm", "within 95 % bands", "in predicted deviations", "net translation", "largest")
    if score is None:
        return Listing("Prediction of the rows held out", heads, ())
    gain = "" if score.gain_error is None else f"{100.0 * score.gain_error:+.1f} %"
    numbers = (f"{1e3 * score.residual:.3g}", f"{100.0 * score.coverage:.0f} %", f"{score.size:.3g}")
    return Listing("Prediction of the rows held out", heads, ((*numbers, gain, score.worst),))


def _with_unit(name: str, value: float) -> str:
    """Write a number of a sensor in a unit that suits it."""
    factor, unit = (1e3, " ms") if name == "lag" else (1e3, " mm") if name.startswith("drift") else (1e2, " %")
    return f"{factor * value:.3g}{unit}"


def describe_misfit(found: Identification) -> list[str]:
    """Describe how far the model is from the measurements.

    Args:
        found: the identification.

    Returns:
        One line each.
    """
    out = "" if found.held_out is None else f", held out {1e3 * found.held_out:.3g} mm"
    lines = [f"residuals: fitted {1e3 * found.residual:.3g} mm{out}; noise {1e3 * found.noise:.3g} mm"]
    worst = max(found.misfits, key=lambda one: one.ratio, default=None)
    if worst is not None:
        lines.append(
            f"misfit: at most {worst.ratio:.3g} times the noise ({worst.channel} of {worst.recording})"
            + ("; the model fits: its residuals are noise" if found.model_fits else "")
        )
    if found.score is not None:
        gain = found.score.gain_error
        lines.append(
            f"prediction of the rows held out: {100.0 * found.score.coverage:.0f} % within 95 % bands"
            + ("" if gain is None else f", net translation {100.0 * gain:+.1f} %")
        )
    if not found.model_fits:
        lines.append(f"the model does not fit: {found.where}")
    if _rests_on_gain(found):
        lines.append(
            "forces hold for actuators that move exactly as commanded: 1 % of gain is 1 % of every friction "
            "(--sensor gain=1% carries it through)"
        )
    return lines


def _rests_on_gain(found: Identification) -> bool:
    """Determine whether friction was found from commands whose gain was taken for exact."""
    exact = all(one.value == 0.0 and one.verdict == "held" for one in found.sensors if one.name == "gain")
    return exact and any(p.name.startswith("friction") and p.verdict == "identified" for p in found.parameters)


def print_listing(listing: Listing, console: Console) -> None:
    """Print a table, with every number whole; on a narrow console sentences follow the table.

    Args:
        listing: the table.
        console: the console.
    """
    below = [c for c, words in enumerate(listing.words) if words and console.width < _NARROW]
    table = Table(title=listing.title, title_justify="left")
    least = 1
    for c, (head, words) in enumerate(zip(listing.heads, listing.words, strict=True)):
        if c in below:
            continue
        broken = words or head in _NAMES
        longest = max(len(text) for text in (head, *(row[c] for row in listing.rows)))
        least += 3 + (min(longest, _SHORTEST) if broken else longest)
        table.add_column(head, overflow="fold", no_wrap=not broken)
    for row in listing.rows:
        table.add_row(*(cell for c, cell in enumerate(row) if c not in below))
    # a table that cannot be narrow enough is wider than the console, which breaks its lines, but cuts nothing
    table.width = least if least > console.width else None
    console.print(table, crop=False)
    for c in below:
        sentences: dict[str, list[str]] = {}
        for row in listing.rows:
            if row[c]:
                sentences.setdefault(row[c], []).append(row[0])
        for sentence, names in sentences.items():
            subject = ", ".join(names) if len(names) <= _MOST_NAMED else f"{len(names)} of {len(listing.rows)}"
            console.print(f"{subject}: {sentence}")


def print_identification(found: Identification, console: Console) -> None:
    """Print the verdicts, the sensors and the misfit.

    Args:
        found: the identification.
        console: the console.
    """
    count = len(found.recordings)
    title = f"{found.scene.name}: {count} recording{'s' if count > 1 else ''}"
    print_listing(list_parameters(found.parameters, title), console)
    for name in dict.fromkeys(one.recording for one in found.sensors):
        sensors = list_sensors([one for one in found.sensors if one.recording == name], f"the measurement: {name}")
        if sensors.rows:
            print_listing(sensors.without("recording", *(["before"] if console.width < _NARROW else [])), console)
    explained = [f"would explain {100.0 * one.explained:.0f} % of it: {one.what}" for one in found.explanations]
    for line in (*describe_misfit(found), *explained, *found.warnings):
        console.print(line)
