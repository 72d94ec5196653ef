"""What actuators make of commands: closed forms of rates, lags, steps and actuators that are stuck."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")

from crawler_model import CommandError, Scene, load_scene
from crawler_ros.node.actuators import Actuators
from crawler_ros.node.intake.commanded_path import Vertices, hold

TICK = 10**7
IDEAL = {"actuators.rate": 0.0, "actuators.lag": 0.0, "actuators.step": 0.0, "actuators.frozen": ""}


def make(scene: Scene | str = "three_contacts_two_ways", **given) -> Actuators:
    scene = load_scene(scene) if isinstance(scene, str) else scene
    return Actuators(scene, IDEAL | {f"actuators.{name}": value for name, value in given.items()})


def command(row, lengths=(), tick: int = 0, due_ns: int | None = None) -> Vertices:
    """One tick with a vertex, at its end unless told."""
    row = np.array(row)
    row[: len(lengths)] = lengths
    due = (tick + 1) * TICK if due_ns is None else due_ns
    times = TICK * np.arange(tick, tick + 2)
    return Vertices(times, np.array([due]), row[None], np.array([0, 1]), 0)


def follow(actuators: Actuators, ticks: int, first: int = 1) -> np.ndarray:
    """The lengths at the ends of ticks without a command."""
    found = []
    for tick in range(first, first + ticks):
        actuators.move(hold(TICK * np.arange(tick, tick + 2), actuators.row.size))
        found.append(actuators.row[:2].copy())
    return np.array(found)


def test_ideal_ones_are_not_asked():
    actuators = make()
    assert actuators.are_ideal
    taken = actuators.move(command(actuators.row, (0.1, -0.2)))
    assert taken.rows[0][:2].tolist() == [0.1, -0.2]


def test_a_rate_limits_each_link_and_arrives_exactly():
    actuators = make(rate=2.0)
    actuators.move(command(actuators.row, (0.1, -0.03)))
    assert actuators.row[:2] == pytest.approx([0.02, -0.02])
    assert follow(actuators, 4) == pytest.approx(np.array([[0.04, -0.03], [0.06, -0.03], [0.08, -0.03], [0.1, -0.03]]))
    assert actuators.row[:2].tolist() == [0.1, -0.03]
    assert actuators.move(hold(TICK * np.arange(9, 11), actuators.row.size)).due_ns.size == 0


def test_a_lag_approaches_by_its_exponential_and_ends():
    actuators = make(lag=0.05)
    actuators.move(command(actuators.row, (0.1, 0.0)))
    lengths = np.append(actuators.row[0], follow(actuators, 150)[:, 0])
    t = 0.01 * np.arange(1, 152)
    near = lengths != 0.1
    assert lengths[near] == pytest.approx(0.1 * (1.0 - np.exp(-t / 0.05))[near], abs=1e-12)
    assert lengths[-1] == 0.1
    assert 80 < near.sum() < 110  # a nanometre is left after 0.05 ln(1e8) s


def test_steps_round_and_lose_nothing():
    """A hundred small commands that a step swallows one by one arrive together."""
    actuators = make(step=0.003)
    for k in range(100):
        actuators.move(command(actuators.row, (0.001 * (k + 1), 0.0), tick=k))
    assert actuators.row[0] == pytest.approx(0.099)
    assert actuators.row[0] / 0.003 == pytest.approx(round(actuators.row[0] / 0.003))


def test_a_stuck_actuator_stays_and_goes_on_when_it_is_free():
    actuators = make(rate=1.0)
    actuators.move(command(actuators.row, (0.1, 0.1)))
    actuators.freeze("link_1", actuators.row)
    assert follow(actuators, 3)[-1] == pytest.approx([0.04, 0.01])
    actuators.freeze("", actuators.row)
    assert follow(actuators, 30, 4)[-1] == pytest.approx([0.1, 0.1])


def test_ideal_ones_stick_where_the_commands_are():
    actuators = make()
    row = actuators.row.copy()
    row[:2] = 0.07, 0.02  # commanded while they were not asked
    actuators.freeze("link_0", row)
    taken = actuators.move(command(row, (0.3, 0.3)))
    assert taken.rows[-1][:2].tolist() == [0.07, 0.3]


def test_friction_is_followed_when_it_is_commanded():
    """It is no actuator; and each of two vertices of a tick has its share of the rate."""
    actuators = make(rate=1.0)
    first, second = actuators.row.copy(), actuators.row.copy()
    first[0], first[2] = 0.1, 7.0
    second[0], second[2] = 0.1, 9.0
    due, rows = np.array([TICK // 4, TICK // 2]), np.array([first, second])
    taken = actuators.move(Vertices(TICK * np.arange(2), due, rows, np.array([0, 2]), 0))
    assert taken.due_ns.tolist() == [TICK // 4, TICK // 2, TICK]
    assert taken.rows[:, 0] == pytest.approx([0.0025, 0.005, 0.01])
    assert taken.rows[:, 2].tolist() == [7.0, 9.0, 9.0]
    assert taken.first.tolist() == [0, 3]


def test_many_ticks_at_once_are_one_after_another():
    many, single = make(rate=1.0, lag=0.02), make(rate=1.0, lag=0.02)
    row = many.row.copy()
    row[:2] = 0.05, -0.02
    times = TICK * np.arange(11)
    taken = many.move(Vertices(times, np.array([TICK]), row[None], np.array([0, *[1] * 10]), 0))
    one = [single.move(command(row, tick=0)).rows]
    one += [single.move(hold(times[k : k + 2], row.size)).rows for k in range(1, 10)]
    assert taken.rows.tobytes() == np.concatenate(one).tobytes()


def test_a_strain_counts_with_the_length_of_its_segment():
    scene = load_scene("segment_climber")
    (segment,) = scene.body.segments
    length = scene.body.position[segment.last] - scene.body.position[segment.first]
    actuators = make(scene, rate=0.1)
    row = actuators.row.copy()
    row[: scene.columns.lengths] += 10.0
    before = actuators.row.copy()
    actuators.move(command(row))
    assert actuators.row[0] - before[0] == pytest.approx(0.1 * 0.01 / length)


def test_an_unknown_name_is_refused():
    with pytest.raises(CommandError, match=r"actuators\.frozen: 'link_7'; the actuators are link_0, link_1"):
        make(frozen="link_0, link_7")
