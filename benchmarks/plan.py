"""How well controllers keep a robot on a path at constant speed, while it differs from its model."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.optimize import brentq

from crawler_model import Scene, load_scene, simulate
from crawler_ros.replay import analyse

from .node.domain import NS, Domain
from .node.rows import Row

SPEED = 0.05
"""Speed of the path [m/s]."""
SCENES = ("three_contacts_one_way", "two_contacts_anisotropic")
QUICK: dict[str, Any] = {"seconds": 3, "scenes": SCENES[:1], "disturbances": ("friction x 0.7",)}
_DELAY, _LEAD = 0.05, 0.1
_DISTURBANCES: dict[str, tuple[float, float, float]] = {
    "none": (1.0, 0.0, 0.0),
    "friction x 0.7": (0.7, 0.0, 0.0),
    "friction x 1.3": (1.3, 0.0, 0.0),
    "load of -0.05 N": (1.0, -0.05, 0.0),
    "delay of 0.05 s": (1.0, 0.0, _DELAY),
}
"""Factor of friction, load on the first contact [N], delay of the sensors [s]."""
_PHASE = {"length": 0.0741, "friction": 0.35, "depth": 0.43, "tolerance": 1e-3}
"""Parameters with which the best phase of the body of two contacts gains 0.05 m per period without disturbance."""


def measure_plan(
    seconds: int = 30,
    scenes: tuple[str, ...] = SCENES,
    disturbances: tuple[str, ...] = tuple(_DISTURBANCES),
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Run each controller against a disturbed simulator, in lock-step where it can be.

    Returns:
        A row for each scene, controller and disturbance: the error in the second half of the run [mm], as it is and
        without its mean, and how far actuators move for a metre [m].
    """
    rows: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="benchmarks_") as folder:
        domain = Domain(Path(folder))
        try:
            for scene in scenes:
                for controller in ("plan", "speed_control", "open_loop", "phase_control"):
                    if controller == "phase_control" and scene != SCENES[1]:
                        continue  # it commands one link and the friction of two contacts
                    for name in disturbances:
                        if progress is not None:
                            progress(f"{controller}, {name}")
                        found = _run(domain, scene, controller, _DISTURBANCES[name], seconds)
                        rows.append({"case": scene, "controller": controller, "disturbance": name} | found)
        finally:
            domain.close()
    return rows


def _run(domain: Domain, scene: str, controller: str, disturbance: tuple[float, float, float], seconds: int) -> Row:
    friction, load, delay = disturbance
    parent = Path(tempfile.mkdtemp(dir=domain.folder))
    robot = parent / "robot.yaml"
    document = load_scene(scene).document()
    document["friction"] = {side: friction * value for side, value in document["friction"].items()}
    if load:
        document["loads"] = [load, *[0.0] * (len(document["body"]["contacts"]) - 1)]
    if controller == "open_loop":
        driven = Scene.model_validate(document | {"drive": find_gait(scene, SPEED).document()["drive"]})
        run = simulate(driven, seconds)
        rows = driven.drive.sample_rows(np.rint(run.time * NS).astype(np.int64))
        return _judge(run.time, run.net_translation, rows[:, : driven.columns.lengths])
    robot.write_text(yaml.safe_dump(document))
    by_periods = controller in ("speed_control", "phase_control")
    lead = _LEAD if delay else 0.0
    of_simulator: dict[str, Any] = {"scene": robot, "record": parent / "bags", "sensors.delay": delay or -1.0}
    of_simulator |= {"real_time_factor": 2.0} if by_periods and delay else {"lock_step": True}
    given: dict[str, dict[str, Any]] = {
        "plan": {"scene": scene, "speed": SPEED, "duration": float(seconds), "lock_step": True, "delay": delay}
        | {"measured": delay > 0.0},
        "speed_control": {"target": SPEED * (1.0 + lead), "lead": lead, "periods": round(seconds / (1.0 + lead))},
        "phase_control": _PHASE | {"friction": 0.35 * friction, "lead": lead},
    }
    remaps = ("-r", "pose:=measured/pose", "-r", "joint_states:=measured/joint_states") if by_periods and delay else ()
    module = "crawler_lab.plan.plan_node" if controller == "plan" else f"crawler_ros.examples.{controller}"
    with (
        domain.process("crawler_ros.node.simulator", "--ros-args", *_words(of_simulator)),
        domain.process(module, "--ros-args", *remaps, *_words(given[controller])) as (process, log),
    ):
        if process.wait() != 0:
            raise RuntimeError(f"{controller} ended: {log.read_text()}")
    return _judge(*_read(parent / "bags", load_scene(scene).body.springs))


def _words(parameters: dict[str, Any]) -> list[str]:
    return [
        word
        for name, value in parameters.items()
        for word in ("-p", f"{name}:={str(value).lower() if isinstance(value, bool) else value}")
    ]


def find_gait(scene: str, speed: float) -> Scene:
    """Scale the strokes of a scene whose period is 1 s, so that its gait has a speed [m/s] if nothing disturbs it."""

    def scale(factor: float) -> Scene:
        document = load_scene(scene).document()
        document["drive"]["actuation"] = (factor * np.array(document["drive"]["actuation"])).tolist()
        return Scene.model_validate(document)

    return scale(brentq(lambda f: float(simulate(scale(f), 4.0).per_period[-1]) - speed, 0.1, 1.5, xtol=1e-9))


def _read(bags: Path, links: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read time [s], net translation [m] and rest lengths [m] of a recorded run, up to the last command."""
    pieces: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    (bag,) = bags.iterdir()
    analyse(bag, sinks=[lambda p: pieces.append((p.end_ns, p.net_translation.ravel(), p.command[:, :links].copy()))])
    ns, y, command = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    last = int(np.flatnonzero(np.abs(np.diff(command, axis=0)).any(axis=1))[-1]) + 2
    return ns[:last] / NS, y[:last], command[:last]


def _judge(time: np.ndarray, y: np.ndarray, command: np.ndarray) -> Row:
    half = time > 0.5 * time[-1]
    error = 1e3 * (y - SPEED * time)[half]
    way, gained = float(np.abs(np.diff(command[half], axis=0)).sum()), float(np.ptp(y[half]))
    return {
        "error_mm": float(np.sqrt(np.mean(np.square(error)))),
        "without_mean_mm": float(error.std()),
        "way_m_per_m": way / gained if gained > 0.0 else None,
    }
