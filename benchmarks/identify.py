"""Our identification compared with MuJoCo's (`mujoco.sysid`) on the same recordings.

The recordings are of three contacts whose friction is the same in both directions, as MuJoCo's is, computed by the
exact method. Both methods get the same positions, commands, starting values and bounds.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import io
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_lab import Measurements, identify
from crawler_lab.identify.replica.replica import Replica
from crawler_lab.identify.sensor.sensor import PERFECT
from crawler_model import Scene, Trajectory, simulate

from .coverage import QUICK_ROBOTS, ROBOTS, measure_coverage
from .entrants.mujoco import Tuning, build_document

STEPS, QUICK = (1_000, 3_000), (300,)
"""Numbers of MuJoCo's steps per period of 1 s."""
TUNED: dict[tuple[str, int], Tuning] = {
    ("sliding", 300): Tuning(1e-5, 0.3, 2.0, 0.999, "Euler", 0),
    ("sliding", 1_000): Tuning(1e-6, 0.3, 2.0, 0.9999, "Euler", 0),
    ("sliding", 3_000): Tuning(5e-8, 0.3, 2.0, 0.5, "Euler", 20),
    ("one held", 300): Tuning(1.4e-5, 0.3, 2.0, 0.5, "Euler", 20),
    ("one held", 1_000): Tuning(1e-6, 0.3, 2.0, 0.5, "Euler", 20),
    ("one held", 3_000): Tuning(1.4e-7, 0.3, 2.0, 0.5, "Euler", 20),
}
"""The best tunings that `entrants.mujoco.tune` finds with the true values; a laboratory does not have these."""
_SECONDS, _RATE, _NOISES = 10.0, 100.0, (0.0, 0.01)
_STIFFNESS, _FRICTION = "body.links.stiffness", "friction.isotropic"
_TRUE_STIFFNESS = (10.0, 8.0)
_WRONG = {_STIFFNESS: (0.6, 1.5), _FRICTION: (1.5, 0.7, 1.4)}
"""Starting values relative to the true ones."""
_WIDE = 100.0
"""The unknowns may be this factor smaller or larger than their starting values."""
_WIDEST = np.log(3.0)
"""A parameter is called determined if its 95 % interval is narrower than this factor to each side."""
_ROUNDING = 1e-12
_PEER_PART = 0.2
"""Part of the progress bar for the comparison with the peer."""
_DIFFERENCE = 1e-3
"""Step of the differences by which MuJoCo's derivatives are computed, relative to the values."""


@dataclass(frozen=True)
class Task:
    """What is to be identified from which recording.

    Attributes:
        recording: name of the recording.
        friction: true friction of the contacts [N].
        keys: the unknowns.
        undetermined: indices of the unknowns that positions do not determine.
    """

    recording: str
    friction: tuple[float, ...]
    keys: tuple[str, ...]
    undetermined: tuple[int, ...]

    def values(self, start: bool) -> dict[str, np.ndarray]:
        """List stiffness [N/m] and friction [N]: the true ones, or the start of a method."""
        true = {_STIFFNESS: np.array(_TRUE_STIFFNESS), _FRICTION: np.array(self.friction)}
        return {key: v * _WRONG[key] if start and key in self.keys else v for key, v in true.items()}

    def unknowns(self, start: bool) -> np.ndarray:
        """List the values of the unknowns, true or at the start, shape (P,)."""
        return np.concatenate([self.values(start)[key] for key in self.keys])

    def scene(self, start: bool) -> Scene:
        """Build the chain with the true values, or with the start of a method."""
        values = {key: v.tolist() for key, v in self.values(start).items()}
        phase = 2.0 * np.pi * (np.arange(10)[:, None] / 10.0 - [0.0, 0.25])
        return Scene.model_validate(
            {
                "name": "three",
                "body": {"contacts": [0.0, 0.1, 0.2], "links": {"stiffness": values[_STIFFNESS]}},
                "friction": {"isotropic": values[_FRICTION]},
                "start": "relaxed",
                "drive": {
                    "times": (np.arange(10) / 10.0).tolist(),
                    "period": 1.0,
                    "actuation": (0.05 * (1.0 - np.cos(phase))).tolist(),
                },
            }
        )


TASKS = (
    Task("sliding", (0.2, 0.3, 0.25), (_FRICTION,), ()),
    Task("sliding", (0.2, 0.3, 0.25), (_STIFFNESS, _FRICTION), (0, 1, 2, 3, 4)),
    Task("one held", (0.1, 0.9, 0.12), (_FRICTION,), (1,)),
)
"""Friction with known stiffness; both, with only ratios determined; friction if the second contact holds."""


@dataclass(frozen=True)
class Found:
    """What a method reports.

    Attributes:
        value: values, shape (P,).
        half: half of the 95 % interval of the logarithm of each, shape (P,); inf if the value is not called determined.
        rollouts: how often a model followed the recording; ours computes the derivatives along with it.
    """

    value: np.ndarray
    half: np.ndarray
    rollouts: int


def load_sysid() -> Any | None:
    """Import `mujoco.sysid`.

    Returns:
        The module; None if it or one of the packages that it needs is not installed.
    """
    try:
        from mujoco import sysid
    except ImportError:
        return None
    return sysid if hasattr(sysid, "optimize") and hasattr(sysid, "build_residual_fn") else None


def missing_peers() -> dict[str, str]:
    """Find the peer, if it is not installed.

    Returns:
        The requirement that brings it, by its name.
    """
    return {} if load_sysid() is not None else {"mujoco.sysid": "mujoco[sysid]>=4,<5"}


def measure_identify(
    steps: Sequence[int], progress: Callable[[float], None], tasks: Sequence[Task] = TASKS
) -> list[dict[str, Any]]:
    """Identify the same chain by our method and by `mujoco.sysid`, if it is installed.

    Returns:
        A row for each recording, set of unknowns, noise and method: number of parameters that the method calls
        determined, how many of these are not, the worst relative error of these [1], the largest half width of their
        95 % intervals relative to the value [1], how many of these intervals miss the true value, the worst relative
        error of the ratios to the first unknown (only if nothing but ratios is determined), the time [s], and the
        number of rollouts.
    """
    sysid = load_sysid()
    methods: dict[str, Callable[[Task, Trajectory, np.ndarray], Found]] = {"crawler identify": _ours}
    for number in steps if sysid is not None else ():
        methods[f"mujoco.sysid, {number} steps/s"] = _Sysid(sysid, number)
    _ours(tasks[0], *_record(tasks[0], 0.0))  # loads the kernels
    rows = []
    total = len(tasks) * len(_NOISES) * len(methods)
    for task in tasks:
        for noise in _NOISES:
            run, positions = _record(task, noise)
            for name, method in methods.items():
                began = time.perf_counter()
                found = method(task, run, positions)
                rows.append(_row(task, noise, name, found, time.perf_counter() - began))
                progress(len(rows) / total)
    return rows


def measure_identification(steps: Sequence[int], progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure identification and the peer, then the coverage of its intervals under imperfect sensors.

    Returns:
        The rows of `measure_identify`, then of `measure_coverage`.
    """
    robots = ROBOTS if len(steps) > 1 else QUICK_ROBOTS
    rows = measure_identify(steps, lambda part: progress(_PEER_PART * part))
    return rows + measure_coverage(robots, lambda part: progress(_PEER_PART + (1.0 - _PEER_PART) * part))


def _record(task: Task, noise: float) -> tuple[Trajectory, np.ndarray]:
    """Simulate the true chain; return the run and its positions with noise relative to their largest range, (T, N)."""
    scene = task.scene(start=False)
    run = simulate(scene, _SECONDS, _RATE)
    size = noise * float(np.ptp(run.displacement, axis=0).max())
    return run, scene.body.position + run.displacement + size * np.random.default_rng(1).normal(
        size=run.displacement.shape
    )


def _row(task: Task, noise: float, method: str, found: Found, seconds: float) -> dict[str, Any]:
    """Compare what a method reports with the truth."""
    true = task.unknowns(start=False)
    called = found.half < _WIDEST
    error = np.abs(found.value / true - 1.0)
    missed = np.abs(np.log(found.value / true)) > found.half + _ROUNDING
    ratios = found.value / found.value[0] * true[0] / true
    only_ratios = len(task.undetermined) == true.size
    return {
        "case": "identify",
        "recording": task.recording,
        "unknown": " and ".join(key.removeprefix("body.links.").removesuffix(".isotropic") for key in task.keys),
        "noise": noise,
        "method": method,
        "called_determined": int(called.sum()),
        "of_these_not": int(called[list(task.undetermined)].sum()),
        "worst_error": float(error[called].max()) if called.any() else None,
        "half_width": float(np.sinh(found.half[called]).max()) if called.any() else None,
        "missed": int((missed & called).sum()),
        "ratio_error": float(np.abs(ratios - 1.0).max()) if only_ratios else None,
        "seconds": seconds,
        "rollouts": found.rollouts,
    }


def _ours(task: Task, run: Trajectory, positions: np.ndarray) -> Found:
    measured = Measurements("three", run.time, tuple(f"contact_{i}" for i in range(positions.shape[1])), positions)
    with _count_rollouts() as count:
        found = identify(task.scene(start=True), [measured], task.keys, hold_out=0.0, offset="none", sensor=PERFECT)
    half = []
    for p in found.parameters:
        low, high = p.interval
        certain = p.verdict == "identified" and low is not None and high is not None
        half.append(0.5 * float(np.log(high / low)) if certain else np.inf)  # type: ignore[operator]
    start = task.unknowns(start=True)
    value = [old if p.value is None else p.value for p, old in zip(found.parameters, start, strict=True)]
    return Found(np.array(value), np.array(half), count[0])


@contextlib.contextmanager
def _count_rollouts() -> Iterator[list[int]]:
    """Count how often our model follows a recording."""
    count, original = [0], Replica.predict

    def predict(replica: Replica, *arguments: Any) -> Any:
        count[0] += 1
        return original(replica, *arguments)

    Replica.predict = predict  # type: ignore[method-assign, assignment]
    try:
        yield count
    finally:
        Replica.predict = original  # type: ignore[method-assign]


class _Sysid:
    """The method of `mujoco.sysid`, on logarithms of the values, with SciPy's trust region: the best that was tried."""

    def __init__(self, sysid: Any, steps: int) -> None:
        self.sysid, self.steps = sysid, steps

    def __call__(self, task: Task, run: Trajectory, positions: np.ndarray) -> Found:
        sysid, scene = self.sysid, task.scene(start=True)
        spec = build_spec(scene, self.steps, TUNED[task.recording, self.steps])
        unknowns = self._unknowns(task)
        rollouts = 0

        def build_model(found: Any, changed: Any) -> Any:
            nonlocal rollouts
            rollouts += 1
            return sysid.apply_param_modifiers(found, changed)

        residual = sysid.build_residual_fn(
            models_sequences=[self._sequence(spec, scene, run.time, positions - scene.body.position)],
            build_model=build_model,
            modify_residual=self._difference,
            n_threads=1,
        )
        with contextlib.redirect_stdout(io.StringIO()):  # SciPy reports each iteration
            _, result = sysid.optimize(
                unknowns, residual, "scipy", verbose=False, diff_step=_DIFFERENCE, x_scale="jac", max_iters=100
            )
        residuals = residual(result.x, unknowns)[0]
        _, half = sysid.calculate_intervals(residuals, np.asarray(result.jac))
        low, high = unknowns.get_bounds()
        ended = np.minimum(result.x - low, high - result.x) < 1e-6
        return Found(np.exp(result.x), np.where(ended, np.inf, half), rollouts)

    def _unknowns(self, task: Task) -> Any:
        """Build the parameters: the logarithm of each unknown, with its bounds."""
        found = self.sysid.ParameterDict()

        def add_unknown(name: str, value: float, write: Callable[[Any, float], None]) -> None:
            def modify(spec: Any, parameter: Any) -> None:
                write(spec, float(np.exp(parameter.value[0])))

            at, wide = float(np.log(value)), float(np.log(_WIDE))
            found.add(self.sysid.Parameter(name, at, at - wide, at + wide, modifier=modify))

        def stiffness_of(link: int) -> Callable[[Any, float], None]:
            return lambda spec, value: _set_stiffness(spec.actuators[link], value)

        def friction_of(contact: int) -> Callable[[Any, float], None]:
            return lambda spec, value: setattr(spec.joints[contact], "frictionloss", value)

        values = task.values(start=True)
        if _STIFFNESS in task.keys:
            for i, k in enumerate(values[_STIFFNESS]):
                add_unknown(f"k{i}", k, stiffness_of(i))
        for i, f in enumerate(values[_FRICTION]):
            add_unknown(f"f{i}", f, friction_of(i))
        return found

    def _sequence(self, spec: Any, scene: Scene, times: np.ndarray, displacement: np.ndarray) -> Any:
        """Pair the model with commands at the ends of its steps and with the recording."""
        sysid, model = self.sysid, spec.compile()
        ends = np.arange(round(_SECONDS * self.steps) + 1)
        commands = scene.drive.sample(np.rint((ends + 1) * (1e9 / self.steps)).astype(np.int64))[:, : model.nu]
        names = [(f"c{i}_qpos", sysid.SignalType.MjStateQPos) for i in range(model.nq)]
        return sysid.ModelSequences(
            scene.name,
            spec,
            "recording",
            sysid.create_initial_state(model, scene.start_displacement),
            sysid.TimeSeries.from_control_names(ends / self.steps, commands, model),
            sysid.TimeSeries.from_names(times, displacement, model, names),
        )

    def _difference(self, _1: Any, _2: Any, measured: Any, model: Any, _3: bool, state: Any = None, **_: Any) -> Any:
        """Subtract the measured from the simulated displacements [m], all with one weight as the noise is the same."""
        kind, later = self.sysid.TimeSeries, slice(1, None)  # MuJoCo returns states after its first step
        measured = dataclasses.replace(measured, times=measured.times[later], data=measured.data[later])
        simulated = kind(state[:, 0], state[:, 1 : 1 + model.nq], measured.signal_mapping).resample(measured.times)
        return simulated.data - measured.data, simulated, measured


def build_spec(scene: Scene, steps: int, tuning: Tuning) -> Any:
    """Build the tuned chain with its springs as actuators, whose controls are the changes of the rest lengths.

    Returns:
        MuJoCo's specification (`MjSpec`); positions of the joints are displacements [m].
    """
    mujoco: Any = importlib.import_module("mujoco")
    spec = mujoco.MjSpec.from_string(build_document(scene, steps, tuning))
    for tendon, stiffness in zip(spec.tendons, scene.body.stiffness, strict=True):
        tendon.stiffness = np.zeros_like(tendon.stiffness)
        actuator = spec.add_actuator(name=tendon.name, target=tendon.name, trntype=mujoco.mjtTrn.mjTRN_TENDON)
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        _set_stiffness(actuator, float(stiffness))
    for joint, friction in zip(spec.joints, scene.drive.forward[0], strict=True):
        joint.frictionloss = float(friction)
        spec.add_sensor(type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint.name)
    return spec


def _set_stiffness(actuator: Any, stiffness: float) -> None:
    gain, bias = np.zeros_like(actuator.gainprm), np.zeros_like(actuator.biasprm)
    gain[0], bias[1] = stiffness, -stiffness
    actuator.gainprm, actuator.biasprm = gain, bias
