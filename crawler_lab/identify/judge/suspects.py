"""Suspects of a misfit, each tried by a fit: mistakes of a table, clocks, units; then what a robot may do.

A suspect changes the recordings or the scene by a number; the model is then fitted again, on few rows and with the
noise of the misfits. What this takes of the mean square beyond noise is what the suspect would explain.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from crawler_model.errors import CrawlerError
from crawler_model.scene.scene import Scene

from ..fit.fit import Fit, fit_from
from ..fit.misfit import Misfit
from ..fit.problem import Problem
from ..fit.starts import generate_starts
from ..measurements import Measurements, check_measurements
from ..replica.replica import Replica
from ..replica.sampled import SampledReplica
from ..replica.start import begin_recordings
from ..sensor.noise import Noise
from ..sensor.sensor import Prior
from .faults import bend_positions
from .trials import Prepare, Tried, are_faults_possible, explains, rate, try_faults

_WORK = 30.0
"""Work after which no other suspect is tried [s]."""
_ROWS = 300
"""Rows of each recording in a trial."""
_EVALUATIONS, _FEW, _STARTS = 12, 4, 2
_STEPS = (4e-3, 1e-3)
"""Steps of a number around the best one that was tried, whose parabola has its minimum at a better one."""
_LATEST = 0.25
"""Largest shift of a clock, as a part of the recording."""
_ALIKE = 0.95
"""Correlations of this part of the largest one are as good; the smallest shift is then the likeliest."""
_LATE = (0.0, 0.05, 0.1, 0.15)
"""By how much less than motion the clock may be late, because motion begins after friction is overcome [s]."""
_RATES = (29.97 / 30.0, 30.0 / 29.97, 24.0 / 25.0, 25.0 / 24.0, 25.0 / 30.0, 30.0 / 25.0)
"""Ratios of clocks that are mistaken for each other, as 29.97 frames a second for 30."""
_ACTUATORS = "gain"
_GAIN = Prior(0.0, 0.3)
"""Prior of the gain of the actuators where it is a suspect [1]."""
_PROMISING = 0.9
"""Part of the mean square that the best number leaves from which others near it are tried."""
_JUMP = 1e-6
_LENSES = (0.01, 0.02, 0.04, -0.01, -0.02, -0.04)
"""Bends of a lens that are tried, as parts of half a picture."""
_FAULTS = (
    "backlash, hardening, hysteresis, wear, late actuators, viscosity, masses, friction at rest, stains and what sticks"
)

_Change = Callable[[Scene, Measurements, float], tuple[Scene, Measurements]]


class Trial(NamedTuple):
    """A suspect with its number."""

    what: str
    change: _Change
    """Change the scene and a recording by a number."""
    amounts: Sequence[float] = (1.0,)
    """Numbers that are tried."""
    continuous: bool = False
    """Whether numbers between these are possible."""
    fitted: str = ""
    """The number that is fitted with the parameters instead: `gain`, or the key of a parameter."""
    scales: bool = False
    """Whether the number multiplies all that is measured, with its noise."""


def _list_trials(scene: Scene, recordings: Sequence[Measurements], keys: Sequence[str]) -> Iterator[Trial]:
    """List all suspects, with `{}` in `what` for the number; to add one, add a trial here."""
    first = recordings[0]
    lengths = [n for n in first.command_names if n in scene.columns.names[: scene.columns.lengths]]
    links, contacts = _list_parts(lengths), _list_parts(np.array(first.channels)[first.on_ground].tolist())
    if lengths:
        yield Trial("all commands are negated", _scale_commands(lengths), (-1.0,))
        yield Trial("commanded lengths are {:.4g} times as large", _scale_commands(lengths), (0.01, 0.1, 10.0, 100.0))
    yield Trial("positions are {:.4g} times as large", _scale_values, (0.01, 0.1, 10.0, 100.0), scales=True)
    yield Trial("positions increase the other way", _scale_values, (-1.0,))
    for axis in "xy" if scene.dimension == 2 else "":
        yield Trial(f"{axis} increases the other way", _turn_axis(axis), (-1.0,))
    for name in links if len(links) > 1 else ():
        yield Trial(f"command/{name} is negated", _scale_commands([name]), (-1.0,))
    for a, b in itertools.combinations(links, 2):
        yield Trial(f"command/{a} and command/{b} are exchanged", _exchange("command_names", a, b))
    for a, b in itertools.combinations(contacts, 2):
        yield Trial(f"{a} and {b} are exchanged", _exchange("channels", a, b))
    if lengths:
        shift = _find_shift(first, scene)
        yield Trial("the clock of the positions is {:.3g} s late", _shift, [shift - late for late in _LATE])
        yield Trial("the commands end early; rows after them do not count", _end)
        yield Trial("commands are held until the next row, not straight between rows", _hold)
        yield Trial(
            "the clock of the positions runs {:.6g} times as fast as that of the commands", _stretch, _RATES, True
        )
        yield Trial("commanded lengths are {:.4g} times as large", _keep, fitted=_ACTUATORS)
    if not are_faults_possible(scene):
        half = 0.5 * float(np.nanmax(np.ptp(first.values[:, first.on_ground], axis=0), initial=0.0))
        yield Trial("a lens bends positions by some {:.2g} m at the edge", _bend, [part * half for part in _LENSES])
    stiff = any("stiffness" in key for key in keys)
    parted = isinstance(scene.document()["body"].get("links"), list)
    for k in range(scene.body.springs if scene.body.springs == scene.body.link_springs.size and not stiff else 0):
        own = f"body.links[{k}].stiffness" if parted else f"body.links.stiffness[{k}]"
        yield Trial(f"stiffness of link_{k} is {{:.3g}} times as large", _scale_stiffness, fitted=own)
    if not scene.body.segments and scene.body.turning is None:
        yield Trial("stiffness is {:.4g} times as large", _scale_stiffness, (0.001, 0.01, 0.1, 10.0, 100.0, 1000.0))


def try_suspects(scene: Scene, problem: Problem, fit: Fit, misfits: Sequence[Misfit]) -> tuple[list[Tried], list[str]]:
    """Try mistakes, as long as none leaves only noise; if none does, faults, too.

    Args:
        scene: the scene that was fitted.
        misfits: of its channels, with their noise.

    Returns:
        What each leaves, the best one first; and what was not tried.
    """
    until = problem.work.done + _WORK
    noises = {(one.recording, one.channel): one.noise for one in misfits}
    prepare = functools.partial(_set_noise, noises=noises, floor=problem.floor)
    kept = [_choose_rows(rows) for rows in problem.rows if rows.any()]
    fitted = [r.measured for r, rows in zip(problem.replicas, problem.rows, strict=True) if rows.any()]
    recordings = [
        dataclasses.replace(m, time=m.time[at], values=m.values[at]) for m, at in zip(fitted, kept, strict=True)
    ]
    found: list[Tried] = []
    base = _fit_again(scene, recordings, problem, fit, prepare, np.inf)[0]

    def attempt(trial: Trial, amount: float) -> tuple[float, float]:
        try:
            changed = [trial.change(scene, measured, amount) for measured in recordings]
            scaled = {key: size * amount for key, size in noises.items()} if trial.scales else noises
            own = functools.partial(_set_noise, noises=scaled, floor=problem.floor)
            checked = [check_measurements(*pair) for pair in changed]
            left, number = _fit_again(changed[0][0], checked, problem, fit, own, base, trial.fitted)
            return left, number * amount
        except (CrawlerError, np.linalg.LinAlgError):
            return np.inf, amount

    for trial in _list_trials(scene, recordings, problem.space.names) if np.isfinite(base) else ():
        if any(map(explains, found)):
            break
        if problem.work.done > until:
            return sorted(found), [f"all mistakes after this one: {found[-1].what}", _FAULTS]
        tried = [attempt(trial, amount) for amount in trial.amounts]
        if trial.continuous and min(tried)[0] < _PROMISING * base:
            _refine(tried, functools.partial(attempt, trial))
        left, amount = min(tried)
        found.append(rate(base, left, amount, trial.what.format(amount)))
    if any(map(explains, found)):
        return sorted(found), []
    faults, complete = try_faults(scene, problem, fit, kept, prepare, until)
    return sorted([*found, *faults]), [] if complete else [f"all of {_FAULTS}" if faults else _FAULTS]


def _refine(tried: list[tuple[float, float]], attempt: Callable[[float], tuple[float, float]]) -> None:
    """Add numbers near the best one, at the minima of parabolas."""
    for step in _STEPS:
        least, best = min(tried)
        sides = [attempt(best * (1.0 - step)), attempt(best * (1.0 + step))]
        tried += sides
        low, high = (left - least for left, _ in sides)
        if np.isfinite(low + high) and low + high > 0.0:
            near = best * (1.0 + float(np.clip(0.5 * (low - high) / (low + high), -1.0, 1.0)) * step)
            tried.append(attempt(near))


def _fit_again(
    scene: Scene,
    recordings: list[Measurements],
    problem: Problem,
    fit: Fit,
    prepare: Prepare,
    worse: float,
    fitted: str = "",
) -> tuple[float, float]:
    """Fit from two starts, with another number if one is named; a fit that is `worse` after few evaluations ends.

    Returns the least mean square of residuals in units of the noise, infinite without a motion, and this number there,
    relative to the one of the scene.
    """
    sensor = dataclasses.replace(problem.sensor, gain=_GAIN) if fitted == _ACTUATORS else problem.sensor
    keys = [*problem.space.names, *([fitted] if fitted not in ("", _ACTUATORS) else [])]
    begun, unknown = begin_recordings(scene, keys, recordings)
    kind = Replica if begun.has_exact_derivatives else SampledReplica
    replicas = [kind(begun, m, keys, "identify", unknown) for m in recordings]
    rows = [np.ones(m.time.size, np.bool_) for m in recordings]
    count, space = problem.space.origin.size, problem.space
    values = [space.origin, space.to_values(fit.unknowns[:count])]
    if len(keys) > count:
        own = float(replicas[0].start_values[-1])
        space, values = space.join(fitted, own), [np.append(one, own) for one in values]
    trial = Problem(replicas, rows, space, problem.offset, sensor)
    trial.work = problem.work
    prepare(trial)
    family, first = next(generate_starts(trial, np.random.default_rng(0)))
    begins = [trial.unknowns(one) for one in values]
    begins = [first, *begins] if family == "balance" and first is not None else begins
    costs = [(now.cost, k) for k, one in enumerate(begins) if (now := trial.compute(one)) is not None]
    held, best, number = np.zeros(trial.count, np.bool_), np.inf, 1.0
    for _, k in sorted(costs)[: _STARTS if kind is Replica else 1]:
        unknowns = begins[k]
        for most in (_FEW, _EVALUATIONS - _FEW):
            found = fit_from(trial, unknowns, held, tight=False, most=most)
            if found is None:
                break
            unknowns, left = found.unknowns, found.cost / found.residuals.fitted.size
            if left < best:
                best, number = left, _read(trial, unknowns, count)
            if left > worse:
                break
    return best, number


def _read(trial: Problem, unknowns: np.ndarray, count: int) -> float:
    """Read the number that is fitted beside so many parameters, relative to the one of the scene; 1 without any."""
    space = trial.space
    if space.origin.size > count:
        return float(space.to_values(unknowns[: space.origin.size])[-1] / space.origin[-1])
    return 1.0 + trial.sensed(unknowns, 0)[_ACTUATORS]


def _set_noise(trial: Problem, noises: Mapping[tuple[str, str], float], floor: float) -> None:
    """Set white noise, by recording and channel, of others at the floor [m]."""
    trial.set_noise(
        [
            [
                (Noise(noises.get((replica.measured.name, channel), floor)), np.zeros(int(seen.sum())))
                for channel, seen in zip(replica.measured.channels, present.T, strict=True)
            ]
            for replica, present in zip(trial.replicas, trial.present, strict=True)
        ]
    )


def _choose_rows(rows: np.ndarray) -> np.ndarray:
    """Choose evenly spaced rows among those that were fitted."""
    at = np.flatnonzero(rows)
    return at[:: max(1, at.size // _ROWS)]


def _scale_commands(names: Sequence[str]) -> _Change:
    def change(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
        own = [bool({name, name.partition("/")[0]} & {*names}) for name in measured.command_names]
        factor = np.where(own, amount, 1.0)
        return scene, dataclasses.replace(measured, commands=measured.commands * factor)

    return change


def _exchange(field: Literal["channels", "command_names"], a: str, b: str) -> _Change:
    def change(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
        other = {a: b, b: a}
        parts = [name.partition("/") for name in getattr(measured, field)]
        names: Any = {field: tuple(other.get(part, part) + slash + axis for part, slash, axis in parts)}
        return scene, dataclasses.replace(measured, **names)

    return change


def _scale_values(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
    return scene, dataclasses.replace(measured, values=measured.values * amount)


def _list_parts(names: Iterable[str]) -> list[str]:
    """List the links or contacts to which columns belong, in the plane two to each."""
    return list(dict.fromkeys(name.partition("/")[0] for name in names))


def _turn_axis(axis: str) -> _Change:
    def change(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
        factor = np.where([channel.endswith(f"/{axis}") for channel in measured.channels], amount, 1.0)
        return scene, dataclasses.replace(measured, values=measured.values * factor)

    return change


def _bend(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
    values = bend_positions(measured.values, measured.on_ground, amount, 0.0)
    return scene, dataclasses.replace(measured, values=values)


def _keep(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
    return scene, measured


def _scale_stiffness(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
    values, document = (scene.body.stiffness * amount).tolist(), scene.document()
    links = document["body"]["links"]
    if isinstance(links, list):
        document["body"]["links"] = [part | {"stiffness": v} for part, v in zip(links, values, strict=True)]
    else:
        links["stiffness"] = values
    return Scene.model_validate(document), measured


def _shift(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
    kept = measured.time > amount
    values = measured.values[kept]
    return scene, dataclasses.replace(measured, time=measured.time[kept] - amount, values=values)


def _stretch(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
    return scene, dataclasses.replace(measured, time=measured.time / amount)


def _end(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
    kept = measured.time <= measured.command_time[-1]
    return scene, dataclasses.replace(measured, time=measured.time[kept], values=measured.values[kept])


def _hold(scene: Scene, measured: Measurements, amount: float) -> tuple[Scene, Measurements]:
    time, rows = measured.command_time, measured.commands
    before = time[1:] - _JUMP * np.diff(time)
    order = np.argsort(np.concatenate((time, before)), kind="stable")
    held = np.concatenate((rows, rows[:-1]))[order]
    return scene, dataclasses.replace(measured, command_time=np.concatenate((time, before))[order], commands=held)


def _find_shift(measured: Measurements, scene: Scene) -> float:
    """Find the shift of the clock at which elongations agree best with commands, or speeds with speeds [s]."""
    even = np.linspace(measured.time[0], measured.time[-1], 1024)
    pairs = []
    for k, name in enumerate(measured.command_names):
        part, slash, axis = name.partition("/")
        link = int(part[5:]) if part.startswith("link_") else None
        ends = [] if link is None else [f"contact_{i}{slash}{axis}" for i in scene.body.ends[link]]
        if ends and set(ends) <= set(measured.channels):
            tail, head = (measured.values[:, measured.channels.index(end)] for end in ends)
            seen = np.isfinite(head - tail)
            elongation = np.interp(even, measured.time[seen], (head - tail)[seen])
            pairs.append((elongation, np.interp(even, measured.command_time, measured.commands[:, k])))
    if not pairs:  # speeds are left
        told, seen = (measured.command_time, measured.commands), (measured.time, measured.values)
        both = [np.stack([np.interp(even, at, column) for column in rows.T]) for at, rows in (seen, told)]
        pairs = [tuple(np.abs(np.gradient(np.nan_to_num(one), axis=1)).sum(axis=0) for one in both)]
    most = int(_LATEST * even.size)
    total = np.zeros(2 * most + 1)
    for elongation, command in pairs:
        for k in range(-most, most + 1):
            a, b = (elongation[k:], command[: even.size - k]) if k >= 0 else (elongation[:k], command[-k:])
            size = float(np.std(a) * np.std(b))
            total[k + most] += float(np.mean((a - a.mean()) * (b - b.mean()))) / size if size > 0.0 else 0.0
    good = np.flatnonzero(total >= _ALIKE * total.max()) - most
    peaks = [k for k in good if total[k + most] == total[max(k + most - 5, 0) : k + most + 6].max()]
    nearest = min(peaks or good, key=abs)
    return float(nearest * (even[1] - even[0]))
