"""Sweeps: a Parquet table with a row of results for every combination of values of a few numbers of a scene."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import json
import math
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet
from pyarrow.csv import write_csv

from crawler_command.screen import PICTURES, check_output, whole_file
from crawler_command.units import unit_of
from crawler_model import CrawlerError, Scene, SceneError
from crawler_model.theory.uniqueness import UNDETERMINED
from crawler_ros.recording.attachments import installed_version

from ..pictures.sweep import shown_gain
from ..sweep.many_runs import Settings, run_chunk, simulate_many
from ..sweep.results import ManyRuns, gather, name_numbers
from ..sweep.rows import ROW, SCREW
from ..sweep.vary import MOST_VARIATIONS, Variations, vary

_CHUNKS_A_THREAD, _MOST_IN_A_CHUNK = 8, 512


@dataclasses.dataclass(frozen=True)
class Sweep:
    """The variations, settings and output files of a sweep.

    Attributes:
        variations: the scenes.
        settings: settings of each run.
        specs: the values requested for each key or ratio of keys, as text.
        axes: their values in each variation, shape (M,).
        out: the table.
        png: the picture; None to draw none.
        column: the result that the picture shows; None for the net translation.
    """

    variations: Variations
    settings: Settings
    specs: Mapping[str, str]
    axes: Mapping[str, np.ndarray]
    out: Path
    png: Path | None
    column: str | None = None


def _parse_axis(text: str) -> tuple[str, np.ndarray]:
    """Parse a `--vary` option, KEY=FROM:TO:N, KEY=log:FROM:TO:N or KEY=A,B,C: the key and its numbers, shape (N,)."""
    key, equals, spec = (part.strip() for part in text.partition("="))
    help_text = f"--vary {text}: write KEY=FROM:TO:N, KEY=log:FROM:TO:N or KEY=A,B,C"
    if not key or not equals or not spec:
        raise CrawlerError(help_text)
    log = spec.startswith("log:")
    parts = spec.removeprefix("log:").split(":")
    if len(parts) == 1 and not log:
        return key, np.array([_number(part, help_text) for part in spec.split(",")])
    if len(parts) != 3:
        raise CrawlerError(help_text)
    start, stop = _number(parts[0], help_text), _number(parts[1], help_text)
    if not parts[2].strip().isdecimal():
        raise CrawlerError(f"--vary {text}: N is {parts[2]!r}; it must be a whole number, at least 1")
    count = int(parts[2])
    if not 1 <= count <= MOST_VARIATIONS:
        raise CrawlerError(f"--vary {text}: N is {count}; it must be between 1 and {MOST_VARIATIONS}")
    if log and not (start > 0.0 and stop > 0.0):
        raise CrawlerError(f"--vary {text}: with `log:` both ends must be > 0")
    return key, np.geomspace(start, stop, count) if log else np.linspace(start, stop, count)


def _number(text: str, help_text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise CrawlerError(f"{help_text}; {text!r} is not a number") from None
    if not np.isfinite(value):
        raise CrawlerError(f"{help_text}; {text!r} is not finite")
    return value


def plan_sweep(
    scene: Scene,
    axes: Sequence[str],
    settings: Settings,
    out: Path,
    png: Path | None,
    force: bool,
    column: str | None = None,
) -> Sweep:
    """Check all that can be checked before anything runs.

    Args:
        scene: the scene to vary.
        axes: the `--vary` options.
        settings: settings of each run.
        out: the table to write.
        png: the picture to write; None for one next to the table if the axes allow one.
        force: whether these files may exist.
        column: the result that the picture shows; None for the net translation.

    Returns:
        The sweep.

    Raises:
        CrawlerError: with one line about the first mistake.
    """
    values: dict[str, np.ndarray] = {}
    specs = {}
    for text in axes:
        key, numbers = _parse_axis(text)
        if key in values:
            raise CrawlerError(f"--vary {key}: the key is repeated")
        values[key], specs[key] = numbers, text.partition("=")[2].strip()
    plotted = name_numbers(scene)
    if column in SCREW and column not in plotted:
        raise CrawlerError(f"--plot: {column}: only bodies that turn have it, and {scene.name} does not")
    if column is not None and column not in plotted and f"{column}_x" not in plotted:
        raise CrawlerError(f"--plot: {column!r} is not a column of results; the columns are {', '.join(plotted)}")
    variations, columns = _vary(scene, values)
    settings.check()
    if scene.drive.holds and settings.duration is None:
        raise CrawlerError(
            f"{scene.name}: the scene has {scene.unmoving_drive}; set the simulated time with --duration"
        )
    if png is None and 1 <= sum(n > 1 for n in variations.shape) <= 2:
        png = out.with_suffix(".png")
    elif png is not None and not 1 <= sum(n > 1 for n in variations.shape) <= 2:
        raise CrawlerError(f"--png: a picture needs one or two keys that vary; this sweep has {len(values)}")
    for option, file, suffixes in (("--out", out, (".parquet", ".csv")), ("--png", png, PICTURES)):
        check_output(option, file, suffixes, force)
    if column is not None and png is None:
        raise CrawlerError(f"--plot: a picture needs one or two keys that vary; this sweep has {len(values)}")
    return Sweep(variations, settings, specs, columns, out, png, column)


def _vary(scene: Scene, axes: Mapping[str, np.ndarray]) -> tuple[Variations, Mapping[str, np.ndarray]]:
    """Vary numbers, `KEY/OTHER` at a ratio to the other, and return the variations and the values of each axis."""
    ratios = {key: key.partition("/")[::2] for key in axes if "/" in key}
    if not ratios:
        variations = vary(scene, axes)
        return variations, variations.values
    shape = tuple(numbers.size for numbers in axes.values())
    if (count := math.prod(shape)) > MOST_VARIATIONS:
        raise CrawlerError(f"--vary: {count} variations; at most {MOST_VARIATIONS}")
    grid = dict(zip(axes, (a.ravel() for a in np.meshgrid(*axes.values(), indexing="ij")), strict=True))
    columns = {key: column for key, column in grid.items() if key not in ratios}
    followers = [over for over, _ in ratios.values()]
    for key, (over, under) in ratios.items():
        if over in columns or under in followers:
            raise CrawlerError(f"--vary {key}: {over} follows {under}; no other --vary may change how they follow")
        other = grid[under] if under in grid else Variations(scene, {under: np.zeros(1)}, (1,)).origin(under)
        columns[over] = grid[key] * other
    return dataclasses.replace(vary(scene, columns, grid=False), shape=shape), grid


def _unit(scene: Scene, key: str) -> str:
    """Return the unit of a number, or of a ratio of two."""
    units = [unit_of(scene, part) for part in key.split("/")]
    return units[0] if len(units) == 1 else "1" if units[0] == units[1] else f"{units[0]} / ({units[1]})"


def run_sweep(
    sweep: Sweep, workers: int | None, scheduler: str | None, progress: Callable[[float], None] | None
) -> ManyRuns:
    """Run a sweep and write its table and picture.

    Args:
        sweep: the sweep.
        workers: number of parallel runs on this machine; None for one per core.
        scheduler: address of a Dask scheduler whose workers run it instead; None for this machine.
        progress: called with the fraction done, in [0, 1].

    Returns:
        The results; after Ctrl-C, only of the finished runs.

    Raises:
        CrawlerError: when no variation is valid, or the cluster cannot be used.
    """
    settings = sweep.settings
    if scheduler is not None:
        runs = _simulate_on_cluster(scheduler, sweep.variations, settings, progress)
    else:
        runs = simulate_many(sweep.variations, settings.duration, settings.rate, settings.method, workers, progress)
    done = runs.status == "done"
    if not done.any() and not runs.interrupted:
        raise CrawlerError(f"no variation is valid; the reason of the first: {runs.reason[0]}")
    if done.any():
        with whole_file(sweep.out) as part:
            if sweep.out.suffix == ".csv":
                write_csv(_build_table(sweep, runs), part)
            else:
                parquet.write_table(_build_table(sweep, runs), part, compression="zstd")
        if sweep.png is not None:
            from ..pictures.sweep import draw_sweep

            with whole_file(sweep.png) as part:
                units = {key: _unit(sweep.variations.base, key) for key in sweep.specs}
                logarithmic = [key for key, spec in sweep.specs.items() if spec.startswith("log:")]
                try:
                    draw_sweep(sweep.variations, units, logarithmic, runs, part, sweep.column, sweep.axes)
                except CrawlerError as error:
                    raise CrawlerError(f"{error}; the table is written: {sweep.out}") from None
    return runs


def _simulate_on_cluster(
    address: str, variations: Variations, settings: Settings, progress: Callable[[float], None] | None = None
) -> ManyRuns:
    """Run variations on the workers of the Dask scheduler at tcp://host:port; they need this package installed.

    Scenes are sent as documents and numbers, so that workers need no files of this machine. The results equal
    `simulate_many`'s, to the bit on equal processors. A `CrawlerError` tells that there is no scheduler or no worker,
    or that a worker cannot run the variations.
    """
    from crawler_command.jobs.cluster import SchedulerEndedError, connect

    began, interrupted = time.perf_counter(), False
    settings.check()
    count, done = len(variations), 0
    rows, reasons = np.zeros(count, ROW), {}
    with connect(address) as cluster:
        size = max(min(count // (_CHUNKS_A_THREAD * cluster.threads), _MOST_IN_A_CHUNK), 1)
        firsts = range(0, count, size)
        try:
            for k, (some, why) in cluster.run_jobs(run_chunk, ((variations[i : i + size], settings) for i in firsts)):
                rows[firsts[k] : firsts[k] + some.size] = some
                reasons.update({firsts[k] + i: text for i, text in why.items()})
                done += some.size
                if progress is not None:
                    progress(done / count)
        except KeyboardInterrupt:
            interrupted = True
        except SchedulerEndedError as error:
            print(f"crawler: {error}; the remaining variations are not run", file=sys.stderr)
            interrupted = True
    return gather(variations, rows, reasons, interrupted, time.perf_counter() - began)


def _build_table(sweep: Sweep, runs: ManyRuns) -> pa.Table:
    """Build the table of the variations that were run; its metadata hold scene, settings and versions."""
    table = runs.to_table().filter(pa.array(runs.status != "not run"))
    for place, key in enumerate(runs.varied):
        unit = {"unit": unit_of(sweep.variations.base, key)}
        table = table.set_column(place, pa.field(key, pa.float64(), metadata=unit), table.column(place))
    about = json.dumps(_about(sweep, runs), sort_keys=True)
    return table.replace_schema_metadata({"crawler_sweep": about})


def _about(sweep: Sweep, runs: ManyRuns) -> dict[str, Any]:
    versions = {name: installed_version(name) or "unknown" for name in ("crawler-ros", "numpy", "numba", "pyarrow")}
    settings = sweep.settings
    return {
        "schema": 1,
        "scene": sweep.variations.base.document(),
        "vary": dict(sweep.specs),
        "shape": list(sweep.variations.shape),
        "duration_s": settings.duration,
        "rate_hz": settings.rate,
        "method": settings.method,
        "complete": not runs.interrupted,
        "versions": versions | {"python": platform.python_version()},
    }


def summarise(sweep: Sweep, runs: ManyRuns) -> dict[str, Any]:
    """Summarise a sweep as `crawler sweep --json` prints it.

    Args:
        sweep: the sweep.
        runs: its results.

    Returns:
        Plain numbers, lists and text; schema 1.
    """
    counts = {name.replace(" ", "_"): int((runs.status == name).sum()) for name in ("done", "invalid", "not run")}
    name, gain = shown_gain(runs)
    best = None
    if np.isfinite(gain).any():
        at = int(np.nanargmax(np.abs(gain)))
        best = {"at": {key: float(v[at]) for key, v in sweep.variations.values.items()}, name: float(gain[at])}
    written = counts["done"] > 0
    return {
        "schema": 1,
        "scene": sweep.variations.base.name,
        "vary": dict(sweep.specs),
        "shape": list(sweep.variations.shape),
        **counts,
        "not_unique": int(((runs.status == "done") & ~runs.unique).sum()),
        "best": best,
        "notes": _describe_meshes(sweep.variations),
        "table": str(sweep.out) if written else None,
        "picture": str(sweep.png) if written and sweep.png is not None else None,
        "wall_s": runs.wall_s,
    }


def _describe_meshes(variations: Variations) -> list[str]:
    """Name the segments whose accuracy takes more elements at an end of an axis than the sweep gives them."""
    kept = [part.elements is not None for part in variations.base.parts.body.segments]
    needed: dict[str, tuple[int, str]] = {}
    ends = {int(find(column)) for column in variations.values.values() for find in (np.argmin, np.argmax)}
    for at in () if all(kept) else sorted(ends):
        document = copy.deepcopy(variations.document(at))
        for part in (part for part, keeps in zip(document["body"]["segments"], kept, strict=True) if not keeps):
            part.pop("elements", None)
        with contextlib.suppress(SceneError):
            for own, alone in zip(
                variations[at].body.segments, Scene.model_validate(document).body.segments, strict=True
            ):
                if alone.elements > max(own.elements, needed.get(own.name, (0, ""))[0]):
                    where = ", ".join(f"{key} = {column[at]:.6g}" for key, column in variations.values.items())
                    needed[own.name] = alone.elements, f"{own.elements} elements; at {where} its accuracy"
    return [
        f"segment {name} has {text} takes {count}: write `elements: {count}` for it"
        for name, (count, text) in needed.items()
    ]


def describe_sweep(sweep: Sweep, runs: ManyRuns) -> list[str]:
    """Describe the results of a sweep in a few lines.

    Args:
        sweep: the sweep.
        runs: its results.

    Returns:
        The lines.
    """
    about = summarise(sweep, runs)
    shape = " x ".join(map(str, about["shape"]))
    counts = f"{about['done']} done" + (f", {about['invalid']} invalid" if about["invalid"] else "")
    counts += f", {about['not_run']} not run" if about["not_run"] else ""
    lines = [f"{about['scene']}: {shape} variations of {', '.join(about['vary'])}; {counts} in {runs.wall_s:.3g} s"]
    if runs.interrupted:
        lines.append("stopped: the table holds the finished runs" if about["done"] else "stopped: no file is written")
    if about["best"] is not None:
        at = ", ".join(f"{key} = {value:.6g}" for key, value in about["best"]["at"].items())
        words = {
            "per_period": "net translation in the last period",
            "gained": "net translation over the run",
            "dx": "forward motion in the last period",
        }
        name = next(name for name in words if name in about["best"])
        along = " along x" if sweep.variations.base.dimension == 2 and name != "dx" else ""
        lines.append(f"largest {words[name]}{along}: {about['best'][name]:.6g} m at {at}")
    if about["not_unique"]:
        lines.append(f"{about['not_unique']} of them are not unique: in some interval {UNDETERMINED}")
    lines += about["notes"]
    first = next((reason for reason in runs.reason if reason), None)
    if first is not None:
        lines.append(f"first invalid variation: {first}")
    lines += [f"{what}: {about[what]}" for what in ("table", "picture") if about[what] is not None]
    return lines
