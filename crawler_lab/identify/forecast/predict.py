"""Predictions of what another drive does with an identified body, with 95 % bands."""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model.arrays import frozen
from crawler_model.errors import CommandError, CrawlerError, SceneError
from crawler_model.notebook import write_html
from crawler_model.run.inertia import Inertia
from crawler_model.run.simulate import find_inertia
from crawler_model.scene.file import coerce_scene, load_drive
from crawler_model.scene.scene import Scene
from crawler_model.theory.uniqueness import UNDETERMINED

from ...derivative.sensitivities import check_differentiable
from ...sweep.vary import Variations, vary
from ..replica.playback import measure_speeds, scale_drive
from ..sensor.noise import find_quantile
from .outcome import FARTHEST, TOTALS, Evaluate, Outcome, attempt, explore, find_outcome
from .posterior import GAIN, Interval, Posterior, read_posterior

_SAMPLES = 400
"""Samples of the positions unless a rate is given."""
_PERIODS = 10
_UNKNOWN = (1.0 / 3.0, 3.0)
"""Factors by which an unknown parameter is moved to see whether the motion depends on it."""
_FASTER = 1.01
"""Ratio of speeds from which on a drive is called faster than the record."""
_STEP = 2.0**-20
"""Step of the differences by the gain of the actuators [1]."""
_SCALE = 1e-6
"""Part of a change below which multiplying all parameters of a ratio changes nothing."""


@dataclass(frozen=True)
class Band:
    """A predicted number.

    Attributes:
        value: with the best values of all parameters [m or J].
        low: lower end of the 95 % band [m or J].
        high: upper end [m or J].
    """

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        """Write the value and its band."""
        return f"{self.value:.6g} ({self.low:.6g} .. {self.high:.6g})"


@dataclass(frozen=True)
class Beyond:
    """A parameter that is only bounded, and on which the motion depends.

    Attributes:
        name: the parameter.
        interval: lower and upper bound; None on the side that is not known.
        why: what the band covers, and why, in words.
    """

    name: str
    interval: Interval
    why: str


@dataclass(frozen=True)
class Faster:
    """A length that a drive changes faster than the record did: the model has no speed, but robots do.

    Attributes:
        name: of its column.
        speed: its fastest change in the drive [m/s, of segments 1/s].
        recorded: its fastest change in the record [m/s, of segments 1/s].
    """

    name: str
    speed: float
    recorded: float

    def describe(self) -> str:
        """Describe it.

        Returns:
            One line.
        """
        return (
            f"the drive is faster than the record was: it changes {self.name} at up to {self.speed:.3g}, "
            f"{self.speed / self.recorded:.3g} times as fast; the model has no speed, so nothing in the record shows "
            "what the robot does there"
        )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Forecast:
    """What a drive does with an identified body.

    Attributes:
        scene: the body with the best values, and the drive.
        gain: net translation in a period of the limit cycle, on ground that differs from place to place in the mean
            period of the run, or without a period in the whole drive [m].
        energy: work of the actuators in the same time [J].
        periods: number of periods of the run; None for the whole drive.
        run_gain: net translation in the run [m].
        run_energy: work in the run [J].
        time: times of the positions, shape (T,) [s].
        position: of the contacts, shape (T, N) [m].
        low: lower ends of their 95 % bands, shape (T, N) [m].
        high: upper ends, shape (T, N) [m].
        depends_on_bounds: parameters that are only bounded, and on which the motion depends.
        notes: what else limits the prediction, one line each.
        transient_left: estimate of how far `gain` is from the limit cycle's [m]; 0 without a limit cycle.
        inertia: the inertia number of the drive; None for a scene without masses and weights.
        faster: the length by which the drive is faster than the record by most; None if it is not faster.
    """

    scene: Scene
    gain: Band
    energy: Band
    periods: int | None
    run_gain: Band
    run_energy: Band
    time: np.ndarray
    position: np.ndarray
    low: np.ndarray
    high: np.ndarray
    depends_on_bounds: tuple[Beyond, ...]
    notes: tuple[str, ...]
    transient_left: float
    inertia: Inertia | None = None
    faster: Faster | None = None

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts, in the order of the positions, shape (N,)."""
        return tuple(self.scene.body.name_of(i) for i in range(self.scene.body.contacts))

    def __repr__(self) -> str:
        """Describe the prediction in one line."""
        return f"Forecast({self.scene.name}, gain {self.gain} m {self.per}, energy {self.energy} J)"

    @property
    def per(self) -> str:
        """What the gain belongs to: `a period` or `in all`."""
        return "in all" if self.periods is None else "a period"

    def _repr_html_(self) -> str:
        """Show the prediction in a notebook."""
        facts = [(f"gain [m] {self.per}", str(self.gain)), (f"energy [J] {self.per}", str(self.energy))]
        facts += [(beyond.name, beyond.why) for beyond in self.depends_on_bounds]
        return write_html(f"Forecast of {self.scene.name}, 95 % bands", facts)

    def summary(self) -> dict[str, Any]:
        """Convert to the values that `crawler predict --json` prints.

        Returns:
            Plain numbers, lists and text, schema 1.
        """

        def plain(band: Band, unit: str) -> dict[str, Any]:
            return {"value": band.value, "low": band.low, "high": band.high, "unit": unit}

        return {
            "schema": 1,
            "scene": self.scene.name,
            "confidence": 0.95,
            "per": "drive" if self.periods is None else "period",
            "gain": plain(self.gain, "m"),
            "energy": plain(self.energy, "J"),
            "run": {
                "periods": self.periods,
                "gain": plain(self.run_gain, "m"),
                "energy": plain(self.run_energy, "J"),
            },
            "positions": {
                "contacts": list(self.contacts),
                "time": self.time.tolist(),
                "value": self.position.tolist(),
                "low": self.low.tolist(),
                "high": self.high.tolist(),
            },
            "depends_on_bounds": [
                {"name": one.name, "interval": list(one.interval), "why": one.why} for one in self.depends_on_bounds
            ],
            "notes": list(self.notes),
            "inertia": None if self.inertia is None else self.inertia.summary(),
            "faster": None if self.faster is None else dataclasses.asdict(self.faster),
            "transient_left": self.transient_left if np.isfinite(self.transient_left) else None,
        }


def predict(
    scene: Scene | str | Path,
    posterior: Posterior | Mapping[str, Any] | str | Path,
    drive: Scene | Mapping[str, Any] | str | Path | None = None,
    periods: int | None = None,
    rate: float | None = None,
) -> Forecast:
    """Predict what a drive does with an identified body.

    The variance of a result r is g^T C g with its derivatives g = dr/dp and the covariance C of the parameters,
    and its band follows Student's t with the degrees of freedom from which the noise was estimated. Where the
    motion depends on a parameter that is only bounded, the band covers all values that the bound allows.

    Args:
        scene: the scene that was fitted, on a line, a path or a gallery name.
        posterior: what is known about its numbers, or the file of `crawler identify --json`, or its content.
        drive: the drive: a scene that has it, the part `drive` of one, a file or a gallery name, whose lengths the
            gain of the actuators multiplies if the posterior has one; None for the scene's drive, as it is.
        periods: number of periods of the run, ten by default; only of a drive with a period.
        rate: samples of the positions per second [Hz]; None for 400 in all.

    Returns:
        The prediction.

    Raises:
        SceneError: if the scene has no derivatives, or the drive does not fit it.
        CommandError: if an argument is out of range.
        CrawlerError: if the posterior does not fit the scene, or the motion depends on a number that it does not know.
    """
    scene = coerce_scene(scene, "predict")
    posterior, fitted = _apply(posterior, scene)
    played = _with_drive(fitted, drive, posterior.gain)
    if played.dimension == 2:
        where = f"{played.name} is in the plane, where paths have no exact derivatives for bands"
        raise SceneError(f"predict: {where}; simulate the scene of identify --out under the other drive")
    check_differentiable(played, "predict")
    period = played.drive.period
    if periods is not None and period is None:
        raise CommandError(f"predict: periods: {periods}; the drive has no period")
    if periods is not None and not 1 <= periods <= 10_000:
        raise CommandError(f"predict: periods: {periods}; it must be between 1 and 10000")
    count = periods or _PERIODS
    duration = float(played.drive.times[-1]) if period is None else count * period
    if not duration > 0.0:
        raise SceneError(f"predict: the drive of {played.name} ends where it begins; it must have a duration")
    rate = _SAMPLES / duration if rate is None else rate
    names, bounds = _parameters(posterior, played, replaced=drive is not None)

    def evaluate(values: Mapping[str, float]) -> Outcome:
        outcome = find_outcome(_put(played, values), names, count, rate)
        if GAIN not in posterior.names:
            return outcome
        sides = [_with_drive(fitted, drive, posterior.gain + step) for step in (-_STEP, _STEP)]
        results = [find_outcome(_put(side, values), (), count, rate).results for side in sides]
        slopes = np.column_stack((outcome.slopes, np.diff(results, axis=0)[0] / (2.0 * _STEP)))
        return dataclasses.replace(outcome, slopes=slopes)

    found, matter = explore(evaluate, bounds, names, np.random.default_rng(0))
    best = evaluate({}) if matter else found[0]
    _check_known(posterior, names, [best, *found], evaluate)
    low, high = _bands(posterior, names, [best, *found])
    bands = [Band(*(float(array[k]) for array in (best.results, low, high))) for k in range(TOTALS)]
    shape = (best.time.size, played.body.contacts)
    faster = _find_faster(posterior, played)
    position, lows, highs = (frozen(array[TOTALS:].reshape(shape)) for array in (best.results, low, high))
    return Forecast(
        scene=played,
        gain=bands[0],
        energy=bands[1],
        periods=None if period is None else count,
        run_gain=bands[2],
        run_energy=bands[3],
        time=best.time,
        position=position,
        low=lows,
        high=highs,
        depends_on_bounds=tuple(
            Beyond(name, bounds[name], _explain(played, name, bounds[name], far)) for name, far in matter.items()
        ),
        notes=(
            *_notes(posterior, names, best, own_drive=drive is None),
            *([] if faster is None else [faster.describe()]),
        ),
        transient_left=best.transient_left,
        inertia=find_inertia(played),
        faster=faster,
    )


def _apply(posterior: Posterior | Mapping[str, Any] | str | Path, scene: Scene) -> tuple[Posterior, Scene]:
    """Read a posterior, and put its values into the scene that was fitted; errors name its file."""
    source = "posterior" if isinstance(posterior, (Posterior, Mapping)) else posterior
    known = posterior if isinstance(posterior, Posterior) else read_posterior(posterior, scene)
    try:
        return known, known.apply(scene)
    except SceneError as error:
        raise CrawlerError(f"{source}: its values do not fit {scene.name}: {error}") from None


def _with_drive(scene: Scene, drive: Scene | Mapping[str, Any] | str | Path | None, gain: float) -> Scene:
    """Let a scene play another drive, whose lengths the actuators multiply by 1 + gain, or its own, as it is."""
    if drive is None:
        return scene
    if isinstance(drive, Scene):
        part = drive.document().get("drive")
        if part is None:
            raise SceneError(f"predict: {drive.name} has no drive; without one nothing moves")
    else:
        part = drive if isinstance(drive, Mapping) else load_drive(drive)
    played = _play(scene, part)
    return played if gain == 0.0 else _play(played, scale_drive(played.document()["drive"], 1.0 + gain))


def _play(scene: Scene, part: Mapping[str, Any]) -> Scene:
    """Let a scene play a drive."""
    document = scene.document() | {"drive": part}
    try:
        return Scene.model_validate(document)
    except SceneError as error:
        if "start" not in document:  # the first waypoint may pull contacts beyond their friction
            with contextlib.suppress(SceneError):
                return Scene.model_validate(document | {"start": "relaxed"})
        raise SceneError(f"predict: the drive does not fit {scene.name}: {error}") from None


def _put(scene: Scene, values: Mapping[str, float]) -> Scene:
    return Variations(scene, {key: np.array([v]) for key, v in values.items()}, (1,))[0] if values else scene


def _parameters(posterior: Posterior, played: Scene, replaced: bool) -> tuple[tuple[str, ...], dict[str, Interval]]:
    """List the parameters that may have an effect under a drive, and the bounds of parameters that are only bounded."""

    def acts(name: str) -> bool:
        if replaced and name.startswith("drive"):
            return False
        try:
            vary(played, {name: [0.0]})
        except SceneError:  # the drive commands it
            return False
        return True

    names = tuple(name for name in (*posterior.known_numbers(), *posterior.unknown) if acts(name))
    return names, {name: interval for name, interval in posterior.bounds.items() if name in names}


def _check_known(posterior: Posterior, names: tuple[str, ...], outcomes: list[Outcome], evaluate: Evaluate) -> None:
    """Refuse a motion that depends on an unknown parameter, at its value or within a factor of it."""
    effect = np.any([outcome.effect for outcome in outcomes], axis=0)
    best = outcomes[0]
    for name, has, value in zip(names, effect, best.values, strict=True):
        if name not in posterior.unknown:
            continue
        others = [] if has else [one for factor in _UNKNOWN for one in attempt(evaluate, {name: value * factor})]
        if has or any(best.differs(other) for other in others):
            raise CrawlerError(
                f"predict: the motion under this drive depends on {name}, which the record did not excite; identify it "
                "from a record that does, for example of a drive of `crawler excite`"
            )


def _bands(posterior: Posterior, names: tuple[str, ...], outcomes: list[Outcome]) -> tuple[np.ndarray, np.ndarray]:
    """Compute the ends of the bands, of several outcomes the ends of all together, shape (M,)."""
    listed = (*names, GAIN)  # its column is the last one
    rows = [i for i, name in enumerate(posterior.names) if name in listed]
    columns = [listed.index(posterior.names[i]) for i in rows]
    factor, quantile = posterior.factor[rows], find_quantile(posterior.freedom)
    ends = []
    for outcome in outcomes:
        half = quantile * np.linalg.norm(outcome.slopes[:, columns] @ factor, axis=1)
        half[0] += outcome.transient_left if np.isfinite(outcome.transient_left) else 0.0
        ends.append((outcome.results - half, outcome.results + half))
    return np.min([low for low, _ in ends], axis=0), np.max([high for _, high in ends], axis=0)


def _explain(scene: Scene, name: str, interval: Interval, far: bool) -> str:
    """Explain why a band covers what a bound allows."""
    low, high = interval
    friction = re.fullmatch(r"friction\.(forward|backward)(?:\[(\d+)\])?", name)
    unit = " N" if friction else ""
    ends = [f"at least {low:.4g}{unit}"] if low is not None else []
    ends += [f"at most {high:.4g}{unit}"] if high is not None else []
    covers = "all values between" if len(ends) == 2 else "all values beyond"
    covers += f", up to {FARTHEST:g} times" if far and len(ends) < 2 else ""
    known = f"the record shows only that %s is {' and '.join(ends)}: the band covers {covers}"
    if friction is None:
        return f"the motion under this drive depends on {name}; " + known % "it"
    way = f"{friction[1]}s"
    if friction[2] is None:
        return f"contacts slide {way} under this drive; " + known % "their friction"
    contact = scene.body.name_of(int(scene.body.isolated[int(friction[2])]))
    return f"{contact} slides {way} under this drive; " + known % "its friction"


def _find_faster(posterior: Posterior, played: Scene) -> Faster | None:
    """Find the length by which a drive is faster than the record by most."""
    speeds = measure_speeds(played)
    found = [Faster(name, speeds.get(name, 0.0), most) for name, most in posterior.speeds.items() if most > 0.0]
    worst = max(found, key=lambda one: one.speed / one.recorded, default=None)
    return None if worst is None or worst.speed <= _FASTER * worst.recorded else worst


def _notes(posterior: Posterior, names: tuple[str, ...], best: Outcome, own_drive: bool) -> tuple[str, ...]:
    """Collect what else limits a prediction."""
    notes = []
    if not posterior.fits:
        notes.append(
            "the model does not fit its record, or nothing tells how that began: values are doubtful, and so are these "
            "bands"
        )
    if own_drive and GAIN in posterior.names:
        notes.append(
            "the drive of the scene is taken to have the lengths that the actuators reach, as identify --out writes "
            f"them; name a drive of commands, which the actuators multiply by {1.0 + posterior.gain:.4g}"
        )
    values = {**dict(zip(posterior.names, posterior.values.tolist(), strict=True)), **posterior.held}
    for group in posterior.groups:
        members = [name for name in group if name in names and name in values]
        size = np.array([values[name] for name in members])
        if not members or (size <= 0.0).any():
            continue
        moved = best.slopes[:TOTALS, [names.index(name) for name in members]] * size
        scaled = np.abs(moved.sum(axis=1)) > _SCALE * np.abs(moved).sum(axis=1)
        kept = ", ".join(f"{name} = {posterior.held[name]:.6g}" for name in group if name in posterior.held)
        for what, rows in (("gain", scaled[::2]), ("energy", scaled[1::2])):
            if rows.any():
                notes.append(f"the {what} holds for {kept or 'the values found'}: the record determines only ratios")
    for marked, why in (
        (best.one_sided, "the gain has a kink at the value of %s: the bands are those of one side"),
        (best.unresolved, "derivatives by %s depend on the elements of segments, and so do the bands"),
    ):
        if among := [name for name, has in zip(names, marked, strict=True) if has and name in posterior.names]:
            notes.append(why % ", ".join(among))
    if not best.unique:
        notes.append(f"not unique: in some interval {UNDETERMINED}")
    if not np.isfinite(best.transient_left):
        notes.append("the motion does not settle: the gain a period belongs to the last period that was run")
    return tuple(notes)
