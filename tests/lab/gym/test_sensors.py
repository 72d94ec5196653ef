"""Environments whose scene has sensors: observations are what these measure, and the motion is not changed."""

from __future__ import annotations

import copy

import numpy as np
import pytest

pytest.importorskip("gymnasium")
import gymnasium

import crawler_lab.gym  # noqa: F401  it registers the environment
from crawler_model import Scene, load_scene

from .scenes import chain

ENV, RATE = "crawler_lab/Crawler-v0", 20.0


def play(env, seed: int, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Observations and net translations of random actions."""
    random = np.random.default_rng(0)
    observation, info = env.reset(seed=seed)
    found, places = [observation], [info["net_translation"]]
    for _ in range(count):
        observation, *_, info = env.step(random.uniform(-1.0, 1.0, env.action_space.shape))
        found.append(observation)
        places.append(info["net_translation"])
    return np.array(found), np.array(places)


def make(scene, **settings):
    return gymnasium.make(ENV, scene=scene, steps=0, rate=RATE, **settings).unwrapped


def test_observations_are_measured_and_the_motion_is_exact():
    true, places = play(make(chain()), 1)
    noisy, same = play(make(chain(sensors={"noise": 1e-4, "force_noise": 1e-3, "delay": 0.1})), 1)
    assert places.tobytes() == same.tobytes()
    spread = (noisy[2:] - true[:-2]).std(axis=0)  # two steps late
    forward = np.sqrt(2.0) * 1e-4 * RATE  # the difference of two places
    assert spread == pytest.approx([1e-4] * 2 + [1e-3] * 2 + [forward] * 3 + [1e-4], rel=0.15)


def test_pixels_and_lost_measurements_are_seen():
    found, _ = play(make(chain(sensors={"pixel": 1e-3, "rate": 5.0, "dropped": 0.3})), 1)
    lengths = found[:, :2] / 1e-3
    assert lengths == pytest.approx(np.rint(lengths), abs=1e-9)
    changes = (np.diff(found, axis=0) != 0.0).any(axis=1).mean()
    assert changes == pytest.approx(0.7 / 4.0, abs=0.04)  # a quarter of the steps is measured


def test_a_seed_repeats_the_noise_and_another_one_does_not():
    scene = chain(sensors={"noise": 1e-3, "drift": 1e-3})
    one, again, other = (play(make(scene), seed, 20)[0] for seed in (1, 1, 2))
    assert one.tobytes() == again.tobytes()
    assert one.tobytes() != other.tobytes()
    seeded, _ = play(make(chain(sensors={"noise": 1e-3, "drift": 1e-3, "seed": 5})), 1, 20)
    assert seeded.tobytes() != one.tobytes()


def test_what_was_drawn_repeats_the_episode():
    env = make(chain(sensors={"noise": 1e-3}))
    first, info = env.reset(seed=3)
    again, _ = env.reset(seed=4, options=info["drawn"])
    assert again.tobytes() == first.tobytes()


@pytest.mark.parametrize("scene", [chain(sensors={"noise": 1e-3}), load_scene("ice").document()])
def test_many_environments_observe_as_single_ones(scene):
    """On the kernel of chains and without one."""
    if isinstance(scene, dict):
        scene = Scene.model_validate(scene | {"sensors": {"noise": 1e-3, "delay": 0.05}})
    many = gymnasium.make_vec(ENV, num_envs=2, scene=scene, steps=0, rate=RATE)
    observations, _ = many.reset(seed=1)
    singles = [make(scene) for _ in range(2)]
    alone = [single.reset(seed=1 + m)[0] for m, single in enumerate(singles)]
    assert observations.tobytes() == np.array(alone).tobytes()
    action = np.full(singles[0].action_space.shape, 0.5)
    for _ in range(5):
        observations = many.step(np.array([action] * 2))[0]
        alone = [single.step(action)[0] for single in singles]
        assert observations.tobytes() == np.array(alone).tobytes()


def test_a_copy_goes_on_as_the_original():
    env = make(chain(sensors={"noise": 1e-3, "drift": 1e-3}))
    env.reset(seed=1)
    other = copy.deepcopy(env)
    action = np.full(env.action_space.shape, 0.3)
    for _ in range(5):
        assert env.step(action)[0].tobytes() == other.step(action)[0].tobytes()
