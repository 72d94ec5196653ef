"""What an identification knows about the numbers of a scene, as a distribution."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model.arrays import frozen
from crawler_model.errors import CrawlerError, SceneError
from crawler_model.scene.scene import Scene

from ...sweep.keys import find_path
from ...sweep.vary import Variations
from ..replica.playback import relax

_ROUNDING = 1e-9
"""Part of the variances by which a covariance may differ from a symmetric, positive semidefinite one."""
_FARTHEST = 20.0
"""Factor beyond its bound up to which a parameter is drawn."""
_CLEAR = 1.25
"""Factor beyond its bound from which on a parameter may stay: at the bound itself forces balance exactly, as where one
contact held just as much as others slid, and the translation of such a scene is not unique."""
GAIN = "gain"
"""Name among the parameters for the error of the gain of the actuators."""
Interval = tuple[float | None, float | None]


@dataclass(frozen=True, eq=False)
class Posterior:
    """The fitted numbers of a scene with their covariance, and what is known about the others.

    Attributes:
        names: the P parameters with the verdicts `identified` and `ratio`, without any that only fix a scale; and
            `gain`, if the actuators have one, which multiply lengths by 1 + gain.
        values: shape (P,) [unit of each key].
        covariance: of the values, shape (P, P) [product of both units].
        bounds: lower and upper bound of each parameter that is only bounded; None on the side that is not known.
        held: parameters whose value in the scene fixes the scale of ratios, with this value.
        groups: parameters whose ratios only are known, held ones included.
        unknown: parameters that the record does not excite.
        freedom: degrees of freedom from which the size of the covariance was estimated; infinite if it is known [1].
        ended: bounded parameters that the fit moved to a bound that was given to it.
        speeds: fastest commanded change of each length in the record [m/s, of segments 1/s]; empty if not known.
        fits: whether the model fitted the record, whose start was told or found; else all values are doubtful.
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    bounds: Mapping[str, Interval] = field(default_factory=dict)
    held: Mapping[str, float] = field(default_factory=dict)
    groups: tuple[tuple[str, ...], ...] = ()
    unknown: tuple[str, ...] = ()
    freedom: float = np.inf
    ended: tuple[str, ...] = ()
    speeds: Mapping[str, float] = field(default_factory=dict)
    fits: bool = True

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            CrawlerError: if lengths differ, a number is not finite, or the covariance is none.
        """
        names, values, covariance = tuple(self.names), frozen(self.values), frozen(self.covariance)
        count = len(names)
        named = (*names, *self.bounds, *self.held, *self.unknown)
        for name in named:
            if named.count(name) > 1:
                raise CrawlerError(f"posterior: names: {name} is named twice; each parameter has one verdict")
        if values.shape != (count,):
            raise CrawlerError(f"posterior: values: shape {values.shape}; it must be ({count},), one for each name")
        if covariance.shape != (count, count) and covariance.size + count > 0:
            raise CrawlerError(f"posterior: covariance: shape {covariance.shape}; it must be ({count}, {count})")
        for what, array in (("values", values), ("covariance", covariance)):
            if not np.isfinite(array).all():
                place = np.argwhere(~np.isfinite(array))[0].tolist()
                raise CrawlerError(f"posterior: {what}{place}: {array[tuple(place)]}; it must be finite")
        if not self.freedom >= 1.0:
            raise CrawlerError(
                f"posterior: freedom: {self.freedom:g}; it must be at least 1, or null if it is not known"
            )
        covariance = covariance.reshape(count, count)
        _check_covariance(names, covariance)
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "covariance", frozen(0.5 * (covariance + covariance.T)))

    def as_plain(self, others: bool = False) -> dict[str, Any]:
        """Convert to the entry `posterior` of `crawler identify --json`.

        Args:
            others: whether it lists the other parameters, too, because the verdicts in `parameters` do not.

        Returns:
            Plain numbers, lists and text.
        """
        plain = {
            "names": list(self.names),
            "values": self.values.tolist(),
            "covariance": self.covariance.tolist(),
            "freedom": self.freedom if np.isfinite(self.freedom) else None,
        }
        if not others:
            return plain
        return plain | {
            "bounds": {name: list(ends) for name, ends in self.bounds.items()},
            "held": dict(self.held),
            "groups": [list(group) for group in self.groups],
            "unknown": list(self.unknown),
            "ended": list(self.ended),
            "fits": self.fits,
        }

    def known_numbers(self) -> tuple[str, ...]:
        """Name all numbers of the scene about which something is known.

        Returns:
            Parameters with a covariance, bounded ones, and held ones.
        """
        return (*(name for name in self.names if name != GAIN), *self.bounds, *self.held)

    @property
    def gain(self) -> float:
        """Error of the gain of the actuators, which multiply lengths by 1 + gain [1]."""
        return float(self.values[self.names.index(GAIN)]) if GAIN in self.names else 0.0

    def check(self, scene: Scene) -> None:
        """Check that a scene has all parameters.

        Args:
            scene: the scene.

        Raises:
            CrawlerError: if it lacks one.
        """
        for name in (*self.known_numbers(), *self.unknown):
            try:
                find_path(scene, name)
            except SceneError:
                raise CrawlerError(
                    f"posterior: {name}: {scene.name} has no such number; it must belong to the scene that was fitted"
                ) from None

    def apply(self, scene: Scene) -> Scene:
        """Put the values into a scene.

        Args:
            scene: the scene that was fitted.

        Returns:
            The scene with the best values; parameters that are only bounded stay as near to the scene's as they may,
            clear of their bounds. Springs are relaxed at the start if these values do not hold them there otherwise.

        Raises:
            CrawlerError: if the scene lacks a parameter, or the values do not fit together.
        """
        self.check(scene)
        values = {**dict(zip(self.names, self.values.tolist(), strict=True)), **self.held}
        values.pop(GAIN, None)
        for name, bound in self.bounds.items():
            low, high = bound if name in self.ended else _clear(bound)
            try:
                value = Variations(scene, {name: np.zeros(1)}, (1,)).origin(name)
            except SceneError:  # the scene leaves it out
                value = np.inf if high is None else -np.inf
            value = min(max(value, -np.inf if low is None else low), np.inf if high is None else high)
            values[name] = value if np.isfinite(value) else float(low if low is not None else high or 0.0)
        columns = {key: np.array([v]) for key, v in values.items()}
        try:
            return Variations(scene, columns, (1,))[0] if columns else scene
        except SceneError:
            others = {key: column for key, column in columns.items() if not key.startswith("start")}
            with contextlib.suppress(SceneError):
                return Variations(relax(scene), others, (1,))[0]
            raise

    @property
    def factor(self) -> np.ndarray:
        """A square root of the covariance: C = F F^T, shape (P, P)."""
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        size = np.where(deviation > 0.0, deviation, 1.0)
        eigenvalues, vectors = np.linalg.eigh(self.covariance / np.outer(size, size))
        return np.asarray(size[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Draw values of the parameters with a covariance.

        Of positive values, which are larger than their standard deviation, logarithms are drawn with the relative
        covariance, so that they stay positive.

        Args:
            rng: source of random numbers.
            count: number of draws K.

        Returns:
            Shape (K, P) [unit of each key].
        """
        moved = rng.standard_normal((count, len(self.names))) @ self.factor.T
        positive = self.values > np.sqrt(np.diag(self.covariance))
        safe = np.where(positive, self.values, 1.0)
        drawn = np.where(positive, safe * np.exp(np.where(positive, moved / safe, 0.0)), self.values + moved)
        return np.asarray(drawn)

    def draw_bodies(self, rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
        """Draw values of all numbers of the scene about which something is known.

        Args:
            rng: source of random numbers.
            count: number of draws K.

        Returns:
            Values by name, shape (K,): as `draw`; between the bound and 20 times beyond, uniform in the logarithm, for
            parameters that are only bounded; the value that fixes the scale of ratios.
        """
        drawn = dict(zip(self.names, self.draw(rng, count).T, strict=True))
        drawn.pop(GAIN, None)
        for name, interval in self.bounds.items():
            part = rng.random(count)
            drawn[name] = np.array([beyond_bound(interval, float(_FARTHEST**one)) for one in part])
        return drawn | {name: np.full(count, value) for name, value in self.held.items()}


def beyond_bound(interval: Interval, factor: float) -> float:
    """Compute a value on the side of a bound that is allowed.

    Args:
        interval: lower and upper bound; None for one that is not known.
        factor: 1 for the bound itself, more for values beyond it; between two bounds, 20 or more for the other one [1].

    Returns:
        The value [unit of the parameter].
    """
    low, high = interval
    if low is not None and high is not None:
        part = min(float(np.log(factor) / np.log(_FARTHEST)), 1.0)
        return low + part * (high - low)
    bound = low if low is not None else high
    assert bound is not None
    up = low is not None
    if bound == 0.0:
        return (factor - 1.0) * (1.0 if up else -1.0)
    return bound * factor if (bound > 0.0) == up else bound / factor


def _clear(interval: Interval) -> Interval:
    """Narrow an interval to the values that are clear of its ends."""
    low, high = interval
    if low is not None and high is not None:
        part = np.log(_CLEAR) / np.log(_FARTHEST) * (high - low)
        return low + part, high - part
    clear = beyond_bound(interval, _CLEAR)
    return (clear, None) if low is not None else (None, clear)


def _check_covariance(names: tuple[str, ...], covariance: np.ndarray) -> None:
    """Check that a matrix is symmetric and positive semidefinite."""
    variance = np.diag(covariance)
    if (variance < 0.0).any():
        p = int(np.argmax(variance < 0.0))
        raise CrawlerError(f"posterior: covariance: the variance of {names[p]} is {variance[p]:g}; it must be >= 0")
    size = np.where(variance > 0.0, np.sqrt(variance), 1.0)
    scaled = covariance / np.outer(size, size)
    uneven = np.abs(scaled - scaled.T) > _ROUNDING
    if uneven.any():
        i, j = np.argwhere(uneven)[0]
        raise CrawlerError(
            f"posterior: covariance: [{i}][{j}] is {covariance[i, j]:g} and [{j}][{i}] is {covariance[j, i]:g}; it "
            "must be symmetric"
        )
    least = float(np.linalg.eigvalsh(scaled).min(initial=0.0))
    if least < -_ROUNDING * max(len(names), 1):
        raise CrawlerError(
            f"posterior: covariance: an eigenvalue of the correlations is {least:g}; it must be positive semidefinite"
        )


def read_posterior(source: str | Path | Mapping[str, Any], scene: Scene | None = None) -> Posterior:
    """Read what `crawler identify --json` printed.

    Args:
        source: the file, or its content.
        scene: the scene that was fitted, to check the names; None not to check them.

    Returns:
        The posterior.

    Raises:
        CrawlerError: if the file cannot be read, is no result of `crawler identify`, or does not fit the scene.
    """
    name, found = ("posterior", source) if isinstance(source, Mapping) else (str(source), _read_json(Path(source)))
    if not isinstance(found, Mapping):
        raise CrawlerError(f"{name}: {type(found).__name__}; it must be an object, as `crawler identify --json` prints")
    if found.get("schema") != 1:
        raise CrawlerError(
            f"{name}: schema: {found.get('schema')!r}; it must be 1, as `crawler identify --json` prints"
        )
    entry, listed = found.get("posterior"), found.get("parameters", [])
    if not isinstance(entry, Mapping):
        raise CrawlerError(f"{name}: no posterior; print it with `crawler identify --json`")
    try:
        speeds = {str(key): float(value) for key, value in dict(found.get("speeds") or {}).items()}
        posterior = dataclasses.replace(_from_plain(entry, listed), speeds=speeds)
    except CrawlerError as error:
        raise CrawlerError(f"{name}: {error}") from None
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise CrawlerError(
            f"{name}: posterior: {type(error).__name__} {' '.join(str(error).split())}; it must have names, values and "
            "covariance, as `crawler identify --json` prints"
        ) from None
    if scene is not None:
        try:
            posterior.check(scene)
        except CrawlerError as error:
            raise CrawlerError(f"{name}: {error}") from None
    return posterior


def collect_posterior(parameters: Sequence[Mapping[str, Any]], covariance: np.ndarray, freedom: float) -> Posterior:
    """Collect what an identification knows.

    Args:
        parameters: the verdicts, as `crawler identify --json` prints them; and `gain`, if the actuators have one.
        covariance: of the values of all of these, shape (P, P); zero in the rows and columns of held parameters.
        freedom: degrees of freedom from which the size of the covariance was estimated [1].

    Returns:
        The posterior.
    """
    known = np.array([parameter["verdict"] in ("identified", "ratio", "sum") for parameter in parameters], np.bool_)
    gain = np.array([parameter["name"] == GAIN for parameter in parameters], np.bool_)  # which may be known exactly
    chosen = np.array([parameter["verdict"] == "sum" for parameter in parameters], np.bool_)  # some have no variance
    determined = np.flatnonzero(known & (np.diag(covariance) > 0.0) | chosen | gain).tolist()
    own = covariance[np.ix_(determined, determined)]
    size = np.where(np.diag(own) > 0.0, np.sqrt(np.diag(own)), 1.0)
    values, vectors = np.linalg.eigh(0.5 * (own + own.T) / np.outer(size, size))  # its rounding may be negative
    own = (vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(size, size)
    entry = {
        "names": [parameters[k]["name"] for k in determined],
        "values": [parameters[k]["value"] for k in determined],
        "covariance": own,
        "freedom": freedom,
    }
    return _from_plain(entry, parameters)


def _read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CrawlerError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, RecursionError) as error:
        raise CrawlerError(f"{path}: cannot be read: {error}") from None
    except json.JSONDecodeError as error:
        raise CrawlerError(f"{path}: not JSON in line {error.lineno}: {error.msg}") from None


def _read_interval(name: str, ends: Sequence[Any]) -> Interval:
    """Read the ends of what bounds a parameter."""
    low, high = (None if end is None else float(end) for end in ends)
    if low is None and high is None:
        raise CrawlerError(f"posterior: {name}: interval [null, null]; one end of a bound must be a number")
    if low is not None and high is not None and low > high:
        raise CrawlerError(f"posterior: {name}: interval [{low:g}, {high:g}]; the lower end must come first")
    return low, high


def _from_plain(entry: Mapping[str, Any], listed: Sequence[Mapping[str, Any]]) -> Posterior:
    """Build a posterior from the entry `posterior`, and `parameters` unless it lists what is known of the others."""
    names = tuple(str(name) for name in entry["names"])
    values = np.array(entry["values"], dtype=np.float64).reshape(-1)
    covariance = np.array(entry["covariance"], dtype=np.float64)
    freedom = entry.get("freedom")
    posterior = Posterior(names, values, covariance, freedom=np.inf if freedom is None else float(freedom))
    if "unknown" in entry:
        return dataclasses.replace(
            posterior,
            bounds={str(name): _read_interval(str(name), ends) for name, ends in dict(entry["bounds"]).items()},
            held={str(name): float(value) for name, value in dict(entry["held"]).items()},
            groups=tuple(tuple(map(str, group)) for group in entry["groups"]),
            unknown=tuple(map(str, entry["unknown"])),
            ended=tuple(map(str, entry["ended"])),
            fits=bool(entry["fits"]),
        )
    bounds: dict[str, Interval] = {}
    held: dict[str, float] = {}
    groups: list[tuple[str, ...]] = []
    unknown: list[str] = []
    ended = tuple(str(parameter["name"]) for parameter in listed if parameter.get("ended"))
    for parameter in listed:
        name, verdict = str(parameter["name"]), parameter["verdict"]
        if verdict == "bound":
            bounds[name] = _read_interval(name, parameter["interval"])
        elif verdict == "not excited":
            unknown.append(name)
        elif verdict == "ratio" and name not in names:
            held[name] = float(parameter["value"])
        if verdict == "ratio":
            group = tuple(sorted({name, *map(str, parameter.get("with", ()))}))
            groups += [] if group in groups else [group]
    posterior = dataclasses.replace(posterior, bounds=bounds, held=held, ended=ended)
    return dataclasses.replace(posterior, groups=tuple(groups), unknown=tuple(unknown))
