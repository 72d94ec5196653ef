"""The example controllers reach what the exact model says can be reached."""

from __future__ import annotations

import ast
import inspect
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from scipy.optimize import brentq, minimize_scalar

from crawler_model import Scene, load_scene, simulate
from crawler_ros.examples import path_control, periods, phase_control, speed_control

from ...processes import wait_until
from .graph import graph

SPEED, PHASE, PATH = (f"crawler_ros.examples.{name}_control" for name in ("speed", "phase", "path"))
PERIOD = re.compile(r"period (\d+): amplitude (\S+) m, gained (\S+) m")
TRIAL = re.compile(r"phase (\S+): gained (\S+) m")
LINE = re.compile(r"line (\d+): (\S+) m before its end, (\S+) m to the left")
BEST = re.compile(r"best phase (\S+) of a period, (\S+) m per period")


@pytest.mark.parametrize("module", [periods, speed_control, phase_control, path_control])
def test_they_are_plain_rclpy_with_standard_messages(module):
    """What they share is copied with them."""
    standard = {"builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "rcl_interfaces", "sensor_msgs"}
    standard |= {"trajectory_msgs", "rclpy"}
    imported = set()
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.ImportFrom):
            imported.add(node.module if node.module == periods.__name__ else node.module.split(".")[0])
        elif isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
    assert imported <= standard | {periods.__name__} | set(sys.stdlib_module_names)


@pytest.mark.parametrize("module", [speed_control, phase_control, path_control])
def test_help_is_their_docstring(module, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["control", "--help"])
    for arguments in (None, ["-h"]):
        module.main(arguments)
        assert capsys.readouterr().out == f"{module.__doc__}\n"


def test_rivals_are_named_once_and_withdrawn():
    count, logged, published = {"pose": 2, "joint_trajectory": 1}, [], []
    node = SimpleNamespace(
        rivals="",
        count_publishers=count.__getitem__,
        get_name=lambda: "control",
        get_logger=lambda: SimpleNamespace(warning=logged.append),
        get_clock=Clock,
        diagnostics=SimpleNamespace(publish=published.append),
    )
    for pose in (2, 2, 1, 1):
        count["pose"] = pose
        periods.PeriodController.look_for_rivals(node)
    assert logged == ["another node publishes pose too"]
    assert [m.status[0].message for m in published] == ["another node publishes pose too"] * 2 + ["alone"]
    assert [m.status[0].level for m in published] == [DiagnosticStatus.WARN] * 2 + [DiagnosticStatus.OK]


def test_no_tick_is_asked_for_while_a_simulator_may_still_be_discovered(ros):
    """A tick more or less at the start would shift all later ones: runs in lock-step differed."""
    ros.hear("joint_trajectory")
    process = ros.start(SPEED)
    wait_until(lambda: process.said.count("waiting for a simulator") == 2)  # 5 s after the first time
    assert ros.heard["joint_trajectory"] == []
    wait_until(lambda: ros.heard["joint_trajectory"])
    assert [list(p.positions) for p in ros.heard["joint_trajectory"][0].points] == [[]]


def test_the_silence_of_one_simulator_does_not_count_for_the_next():
    listeners, published = iter([1] * 20 + [0] + [1] * 21), []
    commands = SimpleNamespace(get_subscription_count=lambda: next(listeners), publish=published.append)
    node = SimpleNamespace(
        now=-1,
        silent=0,
        missed=0,
        problem="",
        commands=commands,
        get_logger=lambda: SimpleNamespace(info=lambda *_, **__: None),
        look_for_rivals=lambda: None,
        play_next=lambda: None,
    )
    for _ in range(41):
        periods.PeriodController.on_timer(node)
    assert published == []
    periods.PeriodController.on_timer(node)
    assert len(published) == 1


def play(folder, scene: str, controller: str, *parameters: str, simulator: tuple[str, ...] = ("lock_step:=true",)):
    """Run a simulator and a controller until the controller ends; return what it said."""
    folder.mkdir(exist_ok=True)
    with graph(folder) as ros:
        ros.start("crawler_ros.node.simulator", f"scene:={scene}", *simulator)
        process = ros.start(controller, *parameters)
        wait_until(lambda: process.process.poll() is not None, what="the end of the controller")
        assert process.process.returncode == 0, process.said
        return process.said


@pytest.mark.parametrize(
    ("controller", "parameter", "text"),
    [
        (SPEED, "joints:=arm.*", "joints: 'arm.*' matches none of contact_0/x, contact_0/y"),
        (PATH, "right:=link_7", "'link_7' is no joint of this body; its joints are contact_0/x, contact_0/y"),
    ],
)
def test_a_joint_that_the_body_does_not_have_ends_them_with_one_line(tmp_path, controller, parameter, text):
    with graph(tmp_path) as ros:
        ros.start("crawler_ros.node.simulator", "scene:=steering_inchworm", "lock_step:=true")
        process = ros.start(controller, parameter)
        wait_until(lambda: process.process.poll() is not None, what="the end of the controller")
        assert process.process.returncode == 1
        assert text in process.said.splitlines()[-1]


def played_periods(said: str) -> np.ndarray:
    """Amplitude and distance of each period."""
    found = [m.groups() for m in PERIOD.finditer(said)]
    assert [int(count) for count, _, _ in found] == list(range(1, len(found) + 1))
    return np.array([[float(amplitude), float(gained)] for _, amplitude, gained in found])


FREE = ("real_time_factor:=20.0", "rate:=50.0")


def strokes(scene: str, amplitude: float) -> Scene:
    """Scale the strokes of a gallery scene, so that one is `amplitude` long."""
    found = load_scene(scene)
    document = found.document()
    rows = np.array(document["drive"]["actuation"])
    document["drive"]["actuation"] = (rows * amplitude / rows.max()).tolist()
    return Scene.model_validate(document)


def exact_amplitude(scene: str, target: float) -> float:
    """Find the amplitude whose gait, once settled, gains `target` a period."""
    return brentq(lambda a: simulate(strokes(scene, a), duration=4.0).per_period[-1] - target, 1e-3, 0.2, xtol=1e-13)


SCENES = [("three_contacts_one_way", 0.1, 0.08), ("two_contacts_anisotropic", 0.05, 0.07)]


@pytest.mark.parametrize(("scene", "target", "closed_form"), SCENES)
def test_the_speed_reaches_its_target(tmp_path, scene, target, closed_form):
    played = played_periods(play(tmp_path, scene, SPEED, f"target:={target}", "periods:=40"))
    amplitude = exact_amplitude(scene, target)
    assert amplitude == pytest.approx(closed_form, abs=1e-12)
    assert played[-1] == pytest.approx([amplitude, target], abs=1e-6)
    assert len(played) == 40


def test_a_target_out_of_reach_does_not_wind_it_up(tmp_path):
    """The limit is kept, and left as soon as it may be: the integral has not grown meanwhile."""
    said = play(tmp_path, SCENES[0][0], SPEED, "target:=0.5", "limit:=0.09", "periods:=30")
    played = played_periods(said)
    assert played[:, 0].max() == 0.09
    assert played[-1] == pytest.approx([0.09, 0.12], abs=1e-12)


def test_the_speed_is_reached_at_the_wall_clocks_pace_too(tmp_path):
    scene, target, amplitude = SCENES[0]
    with graph(tmp_path) as ros:
        ros.start("crawler_ros.node.simulator", f"scene:={scene}", *FREE)
        control = ros.start(SPEED, f"target:={target}")
        reached = pytest.approx([amplitude, target], abs=1e-6)  # later, where the machine delays a command
        wait_until(lambda: any(list(row) == reached for row in played_periods(control.said)), what="the speed")


def anchors(phase: float) -> Scene:
    """Two anchors whose friction is late by `phase`, laid out without the controller's own formulas."""
    document = load_scene("two_anchor_a").document()
    quarters = np.arange(5) / 4.0
    times = np.unique(np.concatenate((quarters, (quarters[:4] + phase) % 1.0)))
    document["start"] = "relaxed"
    friction = [np.interp((times - phase) % 1.0, quarters, row) for row in ([1, 1.5, 1, 0.5, 1], [1, 0.5, 1, 1.5, 1])]
    document["drive"] = {
        "times": times.tolist(),
        "period": 1.0,
        "actuation": np.interp(times, quarters, [0, 2, 4, 2, 0])[:, None].tolist(),
        "friction": {"isotropic": np.transpose(friction).tolist()},
    }
    return Scene.model_validate(document)


def exact_gain(phase: float) -> float:
    return float(simulate(anchors(phase), duration=3.0).per_period[-1])


def exact_optimum() -> tuple[float, float]:
    """Find the phase that gains most: a fine grid round the circle, then golden sections about its best point."""
    grid = np.arange(100) / 100.0
    best = float(grid[np.argmax([exact_gain(p) for p in grid])])
    found = minimize_scalar(lambda p: -exact_gain(p % 1.0), bracket=(best - 0.01, best, best + 0.01), tol=1e-9)
    return found.x % 1.0, -found.fun


def trials(said: str) -> tuple[np.ndarray, float, float]:
    """Phases and distances tried, and the best of them."""
    ((best, most),) = BEST.findall(said)
    return np.array([[float(phase), float(gained)] for phase, gained in TRIAL.findall(said)]), float(best), float(most)


def test_the_best_phase_is_found(tmp_path):
    tried, best, most = trials(play(tmp_path, "two_anchor_a", PHASE, "tolerance:=1.0e-6"))
    phase, gain = exact_optimum()
    assert (phase, gain) == pytest.approx((0.2, 2.8), abs=1e-6)  # 40 % more than strategy A, which is phase 0
    assert best == pytest.approx(phase, abs=1e-6)
    assert most == pytest.approx(gain, abs=20e-6)  # the hill falls by 16 m a period on its steeper side
    for tried_phase, gained in tried:
        assert gained == pytest.approx(exact_gain(tried_phase), abs=1e-8)  # waypoints are whole nanoseconds
    assert len(tried) < 50


@pytest.mark.slow
def test_the_best_phase_is_found_at_the_wall_clocks_pace_too(tmp_path):
    patient = "lead:=20.0"  # a second for a command to arrive
    _, best, most = trials(play(tmp_path, "two_anchor_a", PHASE, "tolerance:=1.0e-3", patient, simulator=FREE))
    assert (best, most) == pytest.approx((0.2, 2.8), abs=0.02)
    assert best == pytest.approx(0.2, abs=1e-3)


WAYPOINTS = np.array([[5.0, 0.0], [9.0, 4.0], [9.0, 10.0]])


def inchworm(folder, left: float) -> str:
    """The gallery's, whose points on the left have other friction forward."""
    document = load_scene("steering_inchworm").document()
    document["friction"]["forward"] = [left, 0.1, left, 0.1]
    (folder / "inchworm.yaml").write_text(yaml.safe_dump(document))
    return str(folder / "inchworm.yaml")


def places(ros) -> np.ndarray:
    """x and y of every pose heard so far."""
    return np.array([(pose.pose.position.x, pose.pose.position.y) for pose in list(ros.heard["pose"])])


def drive(folder, left: float, waypoints: np.ndarray = WAYPOINTS, parameters: tuple[str, ...] = ()):
    """Drive along waypoints; return the positions on the way, and how far along and beside each line ended."""
    with graph(folder) as ros:
        ros.simulator(f"scene:={inchworm(folder, left)}", "lock_step:=true", "rate:=25.0", hear=("pose",))
        process = ros.start(PATH, f"waypoints:={waypoints.ravel().tolist()}", *parameters)
        wait_until(lambda: process.process.poll() is not None, what="the last waypoint")
        assert process.process.returncode == 0, process.said
        found = np.array([[float(word) for word in m.groups()] for m in LINE.finditer(process.said)])
        assert found[:, 0].tolist() == list(range(1, len(waypoints) + 1))
        last = pytest.approx(np.hypot(*found[-1, 1:]), abs=1e-9)  # in lock-step nothing moves after the controller
        wait_until(lambda: np.hypot(*(places(ros)[-1] - waypoints[-1])) == last, what="the last pose")
        place = places(ros)
    return place, found[:, 1:]


@pytest.mark.parametrize("left", [pytest.param(0.1, marks=pytest.mark.slow, id="even"), pytest.param(0.3, id="uneven")])
def test_a_path_is_followed_whatever_the_friction(tmp_path, left):
    """It stays within the width of the body, except where it cuts a corner, and passes the last waypoint closely."""
    place, lines = drive(tmp_path, left)
    ahead, step = 2.0, 0.4  # m a period at most
    assert (lines[:2, 0] <= ahead).all()
    assert (lines[:2, 0] > ahead - step).all()
    assert lines[2, 0] == pytest.approx(0.0, abs=step)
    a, b = np.vstack(([0.0, 0.0], WAYPOINTS[:-1])), WAYPOINTS
    unit = (b - a) / np.hypot(*(b - a).T)[:, None]
    along = np.clip(np.einsum("tij,ij->ti", place[:, None] - a, unit), 0.0, np.hypot(*(b - a).T))
    off = np.hypot(*np.moveaxis(place[:, None] - a - along[..., None] * unit, 2, 0)).min(axis=1)
    assert off.max() < 0.75
    assert off[-1] < 0.25


def test_without_feedback_uneven_friction_leads_it_astray(tmp_path):
    straight = np.array([[9.0, 0.0]])
    place, ((_, beside),) = drive(tmp_path, 0.3, straight, ("kp:=0.0",))
    assert beside == pytest.approx(place[-1, 1], abs=1e-9)
    assert beside > 0.25


@pytest.mark.parametrize(
    ("scene", "controller", "parameters", "pattern"),
    [
        (SCENES[0][0], SPEED, ("periods:=12",), PERIOD),
        pytest.param("two_anchor_a", PHASE, ("tolerance:=0.01",), TRIAL, marks=pytest.mark.slow),
        ("steering_inchworm", PATH, ("waypoints:=[3.0, 1.0]",), LINE),
    ],
    ids=["speed", "phase", "path"],
)
def test_two_runs_in_lock_step_are_the_same_to_the_bit(tmp_path, scene, controller, parameters, pattern):
    first, second = (pattern.findall(play(tmp_path / name, scene, controller, *parameters)) for name in "ab")
    assert first
    assert first == second  # all digits, as text
