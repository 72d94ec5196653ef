"""An identification as tables and lines, on the screen and on a page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from rich.console import Console
from rich.table import Table

from ...identify.fit.misfit import FITS, Misfit
from ...identify.identification import Identification
from ...identify.judge.explain import Explanation
from ...identify.judge.held_out import HeldOut
from ...identify.judge.sensors import SensorNumber
from ...identify.judge.verdicts import Parameter

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
_STYLE = """:root { color-scheme: light dark; --text: #1f2a30; --ground: #fff; --line: #cfd8dc; --bad: #b02a0c }
@media (prefers-color-scheme: dark) {
  :root { --text: #dfe5e8; --ground: #14191c; --line: #3a454b; --bad: #ff9b7d }
}
body { font: 15px/1.5 sans-serif; max-width: 75rem; margin: 1.5rem auto; padding: 0 1rem;
  color: var(--text); background: var(--ground) }
h1 { font-size: 1.4rem; overflow-wrap: anywhere } h2 { font-size: 1.1rem; margin: 1.6rem 0 .4rem }
p { margin: .3rem 0; overflow-wrap: anywhere } .bad { color: var(--bad); font-weight: bold }
.scroll { overflow-x: auto }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
th, td { text-align: left; vertical-align: top; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid var(--line);
  white-space: nowrap }
td.words { white-space: normal; min-width: 16rem }
img { display: block; width: 100%; min-width: 45rem; background: #fff }"""
_PHASES = (
    "Residuals without outliers; the worst phase as a part of the period of the commands, or of the recording if they "
    f"do not repeat. Residuals of at most {FITS} times the noise are called noise."
)


@dataclass(frozen=True)
class _Listing:
    """A table as text: its title, the heads of its columns, and its cells."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def words(self) -> tuple[bool, ...]:
        """Which columns contain sentences."""
        return tuple(head in _WORDS for head in self.heads)

    def without(self, heads: Sequence[str]) -> _Listing:
        """Leave out columns of some heads."""
        kept = [c for c, head in enumerate(self.heads) if head not in heads]
        rows = tuple(tuple(row[c] for c in kept) for row in self.rows)
        return _Listing(self.title, tuple(self.heads[c] for c in kept), rows)


def _list_parameters(parameters: Sequence[Parameter], title: str) -> _Listing:
    """List what is known about parameters."""
    rows = []
    for p in parameters:
        ends = ["" if end is None else f"{end:.6g}" for end in p.interval]
        interval = " .. ".join(ends) if any(ends) else ""
        rows.append((p.name, p.verdict, "" if p.value is None else f"{p.value:.6g}", interval, p.why))
    return _Listing(title, ("parameter", "verdict", "value", "95 % interval", "why"), tuple(rows))


def _list_sensors(sensors: Sequence[SensorNumber], title: str) -> _Listing:
    """List what is known about sensors: a row for each number that is not held at 0."""
    rows = []
    for one in sensors:
        if one.verdict == "held" and one.value == 0.0:
            continue
        low, high = (one.write(end) for end in one.interval)
        before = f"{one.write(one.prior.mean)} +- {one.write(one.prior.deviation)}"
        interval = "" if one.verdict == "held" else f"{low} .. {high}"
        rows.append((one.name, one.recording, one.verdict, one.write(one.value), interval, before))
    return _Listing(title, ("sensor", "recording", "verdict", "value", "95 % interval", "before"), tuple(rows))


def _list_misfits(misfits: Sequence[Misfit]) -> _Listing:
    """List how far the model is from each channel; phases are parts of the period, or of the recording without one."""
    rows = []
    for one in misfits:
        size = len(one.phases)
        part = f"{100.0 * one.residual / one.motion:.2g} %" if one.motion else ""
        phase = f"{one.worst / size:.3g} .. {(one.worst + 1) / size:.3g}" if any(one.phases) else ""
        since = "" if one.since is None else f"{one.since:.4g}"
        numbers = (f"{1e3 * one.residual:.3g}", f"{1e3 * one.noise:.3g}", f"{one.ratio:.3g}")
        rows.append((one.recording, one.channel, *numbers, part, phase, since))
    heads = ("recording", "channel", "residual, mm", "noise, mm", "ratio", "of motion", "worst phase", "since, s")
    return _Listing("Residuals", heads, tuple(rows))


def _list_explanations(explanations: Sequence[Explanation]) -> _Listing:
    """List changes of the model that would explain a misfit."""
    rows = [
        (
            f"{100.0 * one.explained:.0f} %",
            one.what,
            ", ".join(f"{name} to {value:.4g}" for name, value in one.moved.items()) or "nothing beyond its interval",
        )
        for one in explanations
    ]
    return _Listing("What would explain the misfit", ("explains", "change", "would move"), tuple(rows))


def _list_score(score: HeldOut | None) -> _Listing:
    """List how well the rows held out are predicted: one row, or none if no row was held out."""
    heads = ("residual, mm", "within 95 % bands", "in predicted deviations", "net translation", "largest")
    if score is None:
        return _Listing("Prediction of the rows held out", heads, ())
    gain = "" if score.gain_error is None else _write_error(score.gain_error)
    numbers = (f"{1e3 * score.residual:.3g}", f"{100.0 * score.coverage:.0f} %", f"{score.size:.3g}")
    return _Listing("Prediction of the rows held out", heads, ((*numbers, gain, score.worst),))


def _write_error(part: float) -> str:
    """Write a relative error [1] in per cent; one that rounds to zero is +0.0."""
    return f"{round(100.0 * part, 1) + 0.0:+.1f} %"


def _describe_misfit(found: Identification) -> list[str]:
    """Describe how far the model is from the measurements, one line each."""
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
            + ("" if gain is None else f", net translation {_write_error(gain)}")
            + ("" if found.model_fits else "; a model that does not fit predicts neither")
        )
    if not found.model_fits:
        lines.append(f"the model does not fit: {found.where}")
    if found.rate is not None:
        lines.append(found.rate.describe())
    if found.inertia is not None:
        lines.append(found.inertia.describe(found.scene.body))
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


def _print_listing(listing: _Listing, console: Console) -> None:
    """Print a table, with every number whole; on a narrow console sentences follow the table."""
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


def print_parameters(parameters: Sequence[Parameter], title: str, console: Console) -> None:
    """Print what is known about parameters.

    Args:
        parameters: the verdicts.
        title: above the table.
        console: the console.
    """
    _print_listing(_list_parameters(parameters, title), console)


def print_identification(found: Identification, console: Console) -> None:
    """Print the verdicts, the sensors and the misfit.

    Args:
        found: the identification.
        console: the console.
    """
    count = len(found.recordings)
    title = f"{found.scene.name}: {count} recording{'s' if count > 1 else ''}"
    print_parameters(found.parameters, title, console)
    for name in dict.fromkeys(one.recording for one in found.sensors):
        sensors = _list_sensors([one for one in found.sensors if one.recording == name], f"the measurement: {name}")
        if sensors.rows:
            left_out = ["recording", "before"] if console.width < _NARROW else ["recording"]
            _print_listing(sensors.without(left_out), console)
    explained = [f"would explain {100.0 * one.explained:.0f} % of it: {one.what}" for one in found.explanations]
    for line in (*_describe_misfit(found), *explained, *found.warnings):
        console.print(line)


def write_page(found: Identification, picture: Path, path: Path) -> None:
    """Write a page that loads nothing from elsewhere.

    Args:
        found: the identification.
        picture: its .png file.
        path: the .html file.
    """
    count = len(found.recordings)
    title = f"{found.scene.name}: identification from {count} recording{'s' if count > 1 else ''}"
    lines = "".join(
        f"<p{' class=bad' if line.startswith('the model does not fit') else ''}>{escape(line)}</p>\n"
        for line in [*_describe_misfit(found), *found.warnings]
    )
    misfits = _list_misfits(found.misfits)
    parts = (
        _write_table(_list_parameters(found.parameters, "Parameters")),
        f"<h2>Fit</h2>\n{lines}",
        _write_table(_list_explanations(found.explanations)),
        _write_table(_list_score(found.score)),
        _write_table(_list_sensors(found.sensors, "The measurement")),
        _write_table(misfits) + (f"<p>{_PHASES}</p>\n" if misfits.rows else ""),
    )
    image = base64.b64encode(picture.read_bytes()).decode()
    path.write_text(
        f"<!doctype html>\n<html lang=en><head><meta charset=utf-8>\n"
        f"<meta name=viewport content='width=device-width, initial-scale=1'>\n"
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style></head>\n<body><h1>{escape(title)}</h1>\n"
        f"{''.join(parts)}<h2>Measured, simulated, and the difference</h2>\n"
        f"<div class=scroll><img alt='measured and simulated positions, and residuals over time and phase' "
        f"src='data:image/png;base64,{image}'></div></body></html>\n",
        encoding="utf-8",
    )


def _write_table(listing: _Listing) -> str:
    """Write a table with its title; nothing if it has no rows."""
    if not listing.rows:
        return ""
    head = "".join(f"<th scope=col>{escape(name)}</th>" for name in listing.heads)
    rows = "".join(
        "<tr>"
        + "".join(
            f"<td{' class=words' if words else ''}>{escape(cell)}</td>"
            for cell, words in zip(row, listing.words, strict=True)
        )
        + "</tr>\n"
        for row in listing.rows
    )
    return f"<h2>{escape(listing.title)}</h2>\n<div class=scroll><table><tr>{head}</tr>\n{rows}</table></div>\n"
