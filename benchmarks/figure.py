"""The picture of a case: time per period of the gait against error, both logarithmic; lower left is better."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import Any

from crawler_pictures.style import own_style

from .report import EXACT, write_time
from .result import BenchResult

_STYLES = {  # colour, marker
    "exact": ("#00713f", "*"),
    "exact, one call a tick": ("#00713f", "*"),
    "catch_up": ("#1a9e55", "o"),
    "catch_up, refined": ("#1a9e55", "o"),
    "catch_up, one call a tick": ("#1a9e55", "o"),
    "OSQP 1e-3": ("#9ecae9", "s"),
    "OSQP 1e-6": ("#4c8fcf", "s"),
    "OSQP 1e-9": ("#14529c", "s"),
    "OSQP polished": ("#17a2b8", "p"),
    "Clarabel 1e-6": ("#f5a25d", "D"),
    "Clarabel 1e-8": ("#e8730c", "D"),
    "Clarabel 1e-9": ("#e8730c", "D"),
    "Clarabel 1e-12": ("#a34800", "D"),
    "DAQP": ("#8a4fbf", "^"),
    "PIQP 1e-9": ("#e377c2", "v"),
    "PIQP 1e-12": ("#ad3a8a", "v"),
    "ProxQP": ("#8c6d46", "P"),
    "MuJoCo, tuned": ("#d62728", "X"),
    "smooth friction, LSODA": ("#6b6b6b", "h"),
}
_SOLVERS = ("OSQP", "Clarabel", "DAQP", "PIQP", "ProxQP")
_LABELLED = ("MuJoCo, tuned", "smooth friction, LSODA")
_LEFT = 1e-17
"""Left end of the picture; between it and `EXACT` each method has a column, and the position shows no error."""
_UPON = 0.5
"""Points of one error whose times differ by less than this, in natural logarithms, lie upon each other."""
_INK = "#222222"


@own_style()
def draw_case(bench: BenchResult, case: str, file: Path) -> None:
    """Draw a case."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = [row for row in bench.rows if row["case"] == case]
    reference = bench.references[case]["reference"]
    drawn = [row for row in rows if row["error"] is not None and row["us_per_period"] is not None]
    figure = Figure(figsize=(12.0, 7.4), dpi=110, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.075, 0.125, 0.655, 0.755))
    methods = list(dict.fromkeys(row["method"] for row in drawn))
    known = [method for method in methods if any(_is_exact(row) for row in drawn if row["method"] == method)]
    lanes = {method: _LEFT * (EXACT / _LEFT) ** ((i + 0.5) / len(known)) for i, method in enumerate(known)}
    for method in methods:
        own = [row for row in drawn if row["method"] == method]
        x = [lanes[method] if _is_exact(row) else row["error"] for row in own]
        _draw_method(axes, method, own, x)
    _format_axes(axes, drawn)
    stopped = _draw_unfinished(axes, [row for row in rows if row["method"] not in methods])
    n = rows[0]["n"]
    figure.text(0.075, 0.945, f"{case}: {bench.titles[case]}", size=15, weight="bold", color=_INK)
    figure.text(
        *(0.075, 0.905, f"N = {n:,} contacts. Each point is a method at a number of ticks per period of the drive."),
        size=10.5,
        color="#555555",
    )
    known = sorted(
        zip(*axes.get_legend_handles_labels(), strict=True), key=lambda item: list(_STYLES).index(_name(item))
    )
    axes.legend(
        *zip(*known, strict=True),
        loc="upper left",
        bbox_to_anchor=(1.015, 1.01),
        frameon=False,
        fontsize=9.5,
        labelspacing=0.55,
    )
    figure.text(
        0.742,
        0.125,
        _notes(bench, case, rows, reference, stopped),
        size=8.2,
        color="#555555",
        va="bottom",
        linespacing=1.35,
    )
    figure.text(0.075, 0.012, _footer(bench, reference), size=8, color="#777777")
    figure.savefig(file)


def _name(item: tuple[Any, str]) -> str:
    """Return the method of a legend entry."""
    return (
        item[1].removesuffix(" (ours)").removesuffix(", stopped").replace("a Python call per tick", "one call a tick")
    )


def _is_exact(row: dict[str, Any]) -> bool:
    return bool(row["error"] <= EXACT)


def _draw_method(axes: Any, method: str, rows: list[dict[str, Any]], x: list[float]) -> None:
    colour, marker = _STYLES.get(method, ("#444444", "."))
    y = [row["us_per_period"] for row in rows]
    scale = [row["us_per_period"] / row["us_per_tick"] for row in rows]
    low = [y_ - row["spread_us_per_tick"][0] * s for row, y_, s in zip(rows, y, scale, strict=True)]
    high = [row["spread_us_per_tick"][1] * s - y_ for row, y_, s in zip(rows, y, scale, strict=True)]
    single, ours = "one call" in method, method.startswith(("exact", "catch_up"))
    label = method.replace(", one call a tick", ", a Python call per tick") + (" (ours)" if ours else "")
    axes.errorbar(
        *(x, y),
        yerr=(low, high),
        color=colour,
        marker=marker,
        markersize=(15 if marker == "*" else 9) if ours else 7,
        markerfacecolor="white" if single else colour,
        markeredgecolor=colour if single else "white",
        markeredgewidth=1.4 if single else 0.7,
        linewidth=2.4 if ours and not single else 1.2,
        linestyle="--" if single else "-",
        elinewidth=0.6,
        label=label,
        zorder=5 if ours else 3,
    )
    if single or not (ours or method in _LABELLED):
        return
    for (at, y_), label in _join_labels(rows, x, y):
        axes.annotate(
            label,
            (at, y_),
            xytext=(-6, -14) if method.startswith("smooth") else (8, -4),
            textcoords="offset points",
            size=7.5,
            color=colour,
            zorder=6,
        )


def _join_labels(rows: list[dict[str, Any]], x: list[float], y: list[float]) -> list[tuple[tuple[float, float], str]]:
    """Join the labels of points that lie upon each other; each label has the place of its first point."""
    joined: list[tuple[tuple[float, float], list[str]]] = []
    for row, at, height in zip(rows, x, y, strict=True):
        if joined and joined[-1][0][0] == at and abs(math.log(height / joined[-1][0][1])) < _UPON:
            joined[-1][1].append(row["label"])
        else:
            joined.append(((at, height), [row["label"]]))
    return [
        (place, ", ".join(labels) if len(labels) < 3 else f"{labels[0]} .. {labels[-1]}") for place, labels in joined
    ]


def _draw_unfinished(axes: Any, rows: list[dict[str, Any]]) -> set[str]:
    """Draw, next to the errors, the estimated times of methods that were stopped; return their names."""
    rows = [row for row in rows if row["us_per_tick"] is not None and row["ticks_per_period"]]
    if not rows:
        return set()
    methods = list(dict.fromkeys(row["method"] for row in rows))
    left, right = axes.get_xlim()
    end = right * (right / left) ** 0.18
    for i, method in enumerate(methods):
        colour, marker = _STYLES.get(method, ("#444444", "."))
        at = right * (end / right) ** ((i + 0.7) / (len(methods) + 0.4))
        y = [row["us_per_tick"] * row["ticks_per_period"] for row in rows if row["method"] == method]
        style = {"markersize": 7, "markerfacecolor": "white", "markeredgecolor": colour, "linestyle": "none"}
        axes.plot([at] * len(y), y, color=colour, marker=marker, label=f"{method}, stopped", zorder=4, **style)
    times = [row["us_per_tick"] * row["ticks_per_period"] for row in rows]
    low, high = axes.get_ylim()
    axes.set_ylim(low, max(high, 6.0 * max(times)))
    axes.set_xlim(left, end)
    axes.axvspan(right, end, color="#f0f0f0", zorder=0.9)
    common = {"transform": axes.get_xaxis_transform(), "ha": "center", "color": "#555555"}
    axes.text((right * end) ** 0.5, 0.985, "STOPPED\nover its share\nof time", va="top", size=9, **common)
    axes.text((right * end) ** 0.5, 0.02, "estimated from\nfinished ticks", va="bottom", size=8, **common)
    return set(methods)


def _format_axes(axes: Any, rows: list[dict[str, Any]]) -> None:
    from matplotlib.ticker import FuncFormatter, LogFormatterSciNotation, LogLocator, NullLocator

    axes.set_xscale("log")
    axes.set_yscale("log")
    strip = any(_is_exact(row) for row in rows)
    errors = [row["error"] for row in rows if not _is_exact(row)] or [1e-2]
    axes.set_xlim(_LEFT if strip else min(errors) / 30.0, max(10.0 * max(errors), 1e-2))
    times = [row["us_per_period"] for row in rows] or [1.0]
    axes.set_ylim(min(times) / 4.0, max(times) * 4.0)
    axes.xaxis.set_major_locator(LogLocator(numticks=30))
    axes.yaxis.set_major_locator(LogLocator(numticks=30))
    axes.xaxis.set_minor_locator(NullLocator())
    powers, right = LogFormatterSciNotation(), axes.get_xlim()[1]
    axes.xaxis.set_major_formatter(
        FuncFormatter(lambda x, at: "" if (strip and x < 3.0 * EXACT) or x > 1.01 * right else powers(x, at))
    )
    axes.yaxis.set_major_formatter(FuncFormatter(lambda us, _: write_time(us)))
    axes.grid(which="major", color="#e6e6e6", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(which="both", labelsize=9, color="#999999")
    axes.set_xlabel("largest error of a displacement, relative to the range of the motion", size=11, color=_INK)
    axes.set_ylabel("computing time for one period of the drive", size=11, color=_INK)
    if strip:
        axes.axvspan(_LEFT, EXACT, color="#dff3e4", zorder=0.9)
        middle = (_LEFT * EXACT) ** 0.5
        common = {"transform": axes.get_xaxis_transform(), "ha": "center", "color": "#00713f", "weight": "bold"}
        axes.text(*(middle, 0.985, "EXACT\nup to rounding"), va="top", size=10, **common)
        axes.text(*(middle, -0.022, "exact: below 1e-13"), va="top", size=9, **common)
    axes.annotate(
        "",
        xy=(0.012, 0.015),
        xytext=(0.065, 0.095),
        xycoords="axes fraction",
        arrowprops={"arrowstyle": "-|>", "color": "#555555", "lw": 2.0},
        zorder=1,
    )
    axes.text(0.058, 0.03, "better: faster,\nmore accurate", transform=axes.transAxes, size=9, color="#555555")


def _notes(bench: BenchResult, case: str, rows: list[dict[str, Any]], reference: str, stopped: set[str]) -> str:
    lines = [] if reference == "integrated" else ["Small numbers: ticks per period."]
    solvers = [row for row in rows if row["method"].split()[0] in _SOLVERS]
    ticks = sorted({int(row["ticks_per_period"]) for row in solvers})
    names = dict.fromkeys(row["method"].split()[0] for row in solvers if row["us_per_tick"] is not None)
    if ticks:
        text = f"Solvers ({', '.join(names)}) take catch-up steps, {', '.join(map(str, ticks))} per period."
        lines += textwrap.wrap(text, 46)
    lines.append("Bars: range over the rounds.")
    shown = {row["method"] for row in rows if row["error"] is not None and row["us_per_period"] is not None}
    out: dict[str, list[str]] = {}
    for row in rows:
        if (row["error"] is None or row["us_per_period"] is None) and row["method"] not in stopped:
            partly = row["method"] in shown and row["label"]
            name = f"{row['method']} ({row['label']})" if partly else row["method"]
            out.setdefault(row["detail"].split(";")[0], []).append(name)
    for item in bench.left_out:
        if item["case"] == case:
            out.setdefault(item["reason"], []).append(item["method"])
    if out:
        lines.append("\nNot drawn:")
    for reason, methods in out.items():
        lines += textwrap.wrap(f"{', '.join(dict.fromkeys(methods))}: {reason}", 46)
    unsure = {row["method"] for row in rows if not row["solved"] and row["error"] is not None}
    if unsure:
        lines += textwrap.wrap(f"Some ticks reported unsolved by the solver: {', '.join(sorted(unsure))}", 46)
    return "\n".join(lines)


def _footer(bench: BenchResult, reference: str) -> str:
    machine = bench.machine
    against = {
        "rational": "rational arithmetic",
        "exact": "the exact path, every event followed",
        "integrated": "scipy's DOP853 on the positions of the sliding contacts, from event to event, to 1e-13",
    }[reference]
    return (
        f"Reference: {against}. Errors at every quarter of two periods; times are medians of interleaved rounds.\n"
        f"{machine['cpu']}, {machine['cores']} cores, load {machine['load_average'][0]:g}; "
        f"Python {machine['python']}, numba {machine['numba']}; one thread."
    )
