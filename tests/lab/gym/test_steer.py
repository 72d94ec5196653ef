"""The task of bodies that turn: what Gymnasium expects, what the model says, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("gymnasium")
import gymnasium

import crawler_lab.gym
from crawler_model import CommandError, Crawler, CrawlerError, load_scene
from crawler_model.run.transport import supporting_force

INCHWORM = load_scene("steering_inchworm")


def make(scene="steering_inchworm", **settings):
    return gymnasium.make("crawler_lab/Crawler-v0", scene=scene, task="steer", **settings).unwrapped


@pytest.mark.parametrize("scene", ["steering_inchworm", "three_link_snake", "scissors"])
def test_random_actions_stay_in_the_spaces(scene):
    env = make(scene)
    env.action_space.seed(1)
    observation, _ = env.reset(seed=1)
    size = observation.size
    rewards = []
    for _ in range(40):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        assert not terminated
        assert not truncated
        assert reward == pytest.approx(info["gained"] - 0.1 * info["work"] / supporting_force(env.scene), abs=1e-12)
        rewards.append(reward)
    body = env.scene.body
    assert size == 2 * body.lengths + 2 * body.contacts + 3
    assert len(set(rewards)) > 30


def test_the_path_is_that_of_the_model():
    """The crawler that follows the same commands has the same lengths and forces, and is in the same place."""
    env = make(waypoints=[[5.0, 0.0]], rate=10.0)
    env.reset()
    assert env.action_names == ("link_0", "link_1")
    crawler, row = Crawler(INCHWORM), np.array(INCHWORM.drive.rows[0])
    start, yaw = np.array([0.3, 0.25]), crawler.yaw  # between points 0 and 2
    for step in range(30):
        action = np.array([1.0, 0.5]) * (1.0 if step % 6 < 3 else -1.0)
        observation, _, _, _, info = env.step(action)
        stroke = INCHWORM.drive.rows[:, :2].max(axis=0)
        row[:2] = np.clip(row[:2] + action * stroke / 2.5, 0.0, stroke)
        crawler.follow(np.array(INCHWORM.columns.target(row))[None])
        assert observation[:8] == pytest.approx(crawler.joint_elongation, abs=1e-12)
        assert observation[8:16] == pytest.approx(crawler.joint_tension, abs=1e-9)
        middle = (INCHWORM.body.position + crawler.displacement)[[0, 2]].mean(axis=0)
        assert (info["x"], info["y"]) == pytest.approx(tuple(middle - start), abs=1e-12)
        assert info["yaw"] == pytest.approx(crawler.yaw - yaw, abs=1e-12)
    assert info["x"] > 0.3
    assert info["yaw"] < -0.01
    cos, sin = math.cos(info["yaw"]), math.sin(info["yaw"])
    away = np.array([5.0 - info["x"], -info["y"]])
    assert observation[-2:] == pytest.approx([cos * away[0] + sin * away[1], cos * away[1] - sin * away[0]])


@pytest.mark.parametrize("turned", [0.0, 2.0])
def test_observations_are_those_of_the_body_wherever_it_lies(turned):
    document = INCHWORM.document()
    rotation = np.array([[math.cos(turned), -math.sin(turned)], [math.sin(turned), math.cos(turned)]])
    document["body"]["points"] = (np.array(document["body"]["points"]) @ rotation.T + [3.0, -1.0]).tolist()
    envs = [make(), make(type(INCHWORM).model_validate(document))]
    seen = [env.reset()[0] for env in envs]
    for step in range(20):
        assert seen[0] == pytest.approx(seen[1], abs=1e-4)
        seen = [env.step(np.array([1.0, -0.5]) * math.cos(step))[0] for env in envs]


def test_what_is_gained_adds_up_to_the_way():
    env = make(waypoints=[[0.5, 0.0], [1.0, 0.0]], tolerance=0.1)
    env.reset()
    total, infos = 0.0, []
    for step in range(400):
        _, _, terminated, _, info = env.step(np.full(2, 1.0 if step % 10 < 5 else -1.0))
        total += info["gained"]
        infos.append(info)
        if terminated:
            break
    assert terminated
    assert info["reached"] == 2
    assert {one["reached"] for one in infos} == {0, 1, 2}
    left = math.hypot(1.0 - info["x"], info["y"])
    assert left <= 0.1
    assert total == pytest.approx(1.0 - left, abs=1e-9)


def test_a_heading_is_reached_and_an_episode_has_an_end():
    env = make("scissors", heading=0.3, steps=200)
    env.reset()
    for step in range(200):
        observation, _, terminated, _, info = env.step(np.array([1.0 if step % 10 < 5 else -1.0]))
        if terminated:
            break
    assert terminated
    assert info["yaw"] == pytest.approx(0.3, abs=0.05)
    assert observation[-1] == pytest.approx(0.3 - info["yaw"])
    env = make(steps=3)
    env.reset()
    assert [env.step(np.zeros(2))[3] for _ in range(3)] == [False, False, True]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"scene": "two_anchor_a"}, "task: steer, but two_anchor_a does not turn"),
        ({"heading": 1.0, "waypoints": [[1.0, 0.0]]}, "heading: given together with waypoints"),
        ({"heading": math.nan}, "heading: nan; it must be a finite number"),
        ({"waypoints": [1.0, 2.0]}, "waypoints: "),
        ({"tolerance": 0.0}, "tolerance: 0.0; it must be a number > 0"),
        ({"speed": 1.0}, "speed: unknown setting of the task steer; the settings are scene, waypoints"),
        ({"stroke": {"link_9": (0.0, 0.1)}}, "stroke: 'link_9'; the links and joints are link_0"),
        ({"stroke": {}}, "stroke: {}; it must name at least one of link_0, link_1"),
        (
            {"stroke": {"link_0": (0.05, 0.1)}},
            "stroke: link_0 is 0 at the start; the bounds 0.05 .. 0.1 must include it",
        ),
        ({"steps": -1}, "steps: -1; it must be a whole number >= 0"),
    ],
)
def test_a_mistake_is_one_line(settings, message):
    with pytest.raises(CrawlerError) as error:
        make(**settings)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_other_tasks_name_this_one():
    with pytest.raises(CrawlerError, match="the task of bodies that turn is steer"):
        gymnasium.make("crawler_lab/Crawler-v0", scene="steering_inchworm")
    with pytest.raises(CrawlerError, match="task: steer; many at a time"):
        crawler_lab.gym.CrawlerVectorEnv(2, "steering_inchworm", "steer", heading=1.0)
    with pytest.raises(CrawlerError, match="headin: unknown setting; the settings are direction, speed, place"):
        crawler_lab.gym.CrawlerVectorEnv(2, headin=1.0)


def test_a_bad_action_changes_nothing():
    env = make()
    with pytest.raises(CrawlerError, match="no episode has begun"):
        env.step(np.zeros(2))
    env.reset()
    with pytest.raises(CommandError, match="link_1 is nan; it must be finite"):
        env.step(np.array([0.0, np.nan]))
    with pytest.raises(CrawlerError, match="the task steer takes none"):
        env.reset(options={"friction": 1.0})
