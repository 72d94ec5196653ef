"""Many environments in one call: equal to single ones to the bit, in all modes of Gymnasium."""

from __future__ import annotations

import copy

import numpy as np
import pytest

pytest.importorskip("gymnasium")
import gymnasium
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import crawler_lab.gym
from crawler_model import CommandError, CrawlerError

from .scenes import EACH_KIND, KINDS, act, varied

RANGES = {"friction": [0.9, 1.1], "stiffness": [0.5, 2.0], "delay": [0, 2], "noise": 0.01}


def make(count: int, **settings):
    return gymnasium.make_vec(
        "crawler_lab/Crawler-v0", num_envs=count, vectorization_mode="vector_entry_point", **settings
    )


def beside(count: int, mode: AutoresetMode, **settings):
    """Ours, and Gymnasium's vector of single environments."""
    single = [lambda: crawler_lab.gym.CrawlerEnv(**settings)] * count
    return make(count, autoreset_mode=mode, **settings), SyncVectorEnv(single, autoreset_mode=mode)


def actions_for(observations: np.ndarray, size: int, step: int) -> np.ndarray:
    return np.stack([act(one, size, step + 3 * m) for m, one in enumerate(observations)])


def same(ours, theirs) -> None:
    """Compare what `reset` or `step` returned, info included."""
    assert len(ours) == len(theirs)
    for one, other in zip(ours[:-1], theirs[:-1], strict=True):
        assert np.array_equal(one, other)
        assert np.asarray(one).dtype == np.asarray(other).dtype
    _same_info(ours[-1], theirs[-1])


def _same_info(one, other) -> None:
    assert set(one) == set(other)
    for key, value in one.items():
        if isinstance(value, dict):
            _same_info(value, other[key])
        elif np.asarray(value).dtype == object:
            assert all(np.array_equal(a, b) for a, b in zip(value, other[key], strict=True))
        else:
            assert np.array_equal(value, other[key]), key


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_it_does_what_gymnasiums_vector_of_single_environments_does(mode):
    settings = {"scene": varied(), "task": "reach", "place": 0.02, "tolerance": 0.002, "steps": 30, "randomise": RANGES}
    ours, theirs = beside(5, mode, **settings)
    assert ours.metadata["autoreset_mode"] is mode
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    first = ours.reset(seed=3), theirs.reset(seed=3)
    same(*first)
    observations, ends = first[0][0], 0
    for step in range(100):
        actions = actions_for(observations, 2, step)
        stepped = ours.step(actions), theirs.step(actions)
        same(*stepped)
        observations = stepped[0][0]
        ends += int((stepped[0][2] | stepped[0][3]).sum())
    assert ends > 10
    ours.close()
    theirs.close()


def test_without_automatic_resets_a_mask_says_which_begin_anew():
    settings = {"scene": varied(), "steps": 4, "randomise": RANGES}
    ours, theirs = beside(3, AutoresetMode.DISABLED, **settings)
    same(ours.reset(seed=1), theirs.reset(seed=1))
    for _ in range(4):
        same(ours.step(np.full((3, 2), 0.3)), theirs.step(np.full((3, 2), 0.3)))
    with pytest.raises(CrawlerError, match="the episode of environment 0 has ended; reset it with reset_mask"):
        ours.step(np.zeros((3, 2)))
    for mask in ([True, False, True], [False, True, False]):
        same(*(one.reset(options={"reset_mask": np.array(mask)}) for one in (ours, theirs)))
    same(ours.step(np.full((3, 2), 0.3)), theirs.step(np.full((3, 2), 0.3)))


@pytest.mark.parametrize("kind", EACH_KIND)
def test_every_kind_of_body_equals_the_single_environment(kind):
    build, needed = KINDS[kind]
    settings = {"scene": build(), "randomise": {"stiffness": [0.8, 1.0], "noise": 0.01}, **needed}
    ours = make(3, **settings)
    singles = [crawler_lab.gym.CrawlerEnv(**settings) for _ in range(3)]
    observations, _ = ours.reset(seed=7)
    for m, env in enumerate(singles):
        assert np.array_equal(env.reset(seed=7 + m)[0], observations[m])
    size = ours.single_action_space.shape[0]
    for step in range(12):
        actions = actions_for(observations, size, step)
        observations, rewards, *_ = ours.step(actions)
        for m, env in enumerate(singles):
            one, reward, *_ = env.step(actions[m])
            assert np.array_equal(one, observations[m])
            assert reward == rewards[m]


def test_the_number_of_threads_changes_nothing():
    runs = []
    for threads in (1, 2, 5):
        env = make(11, randomise=RANGES, threads=threads)
        observations, _ = env.reset(seed=0)
        for step in range(20):
            observations, *_ = env.step(actions_for(observations, 2, step))
        runs.append(observations)
        env.close()
    assert np.array_equal(runs[0], runs[1])
    assert np.array_equal(runs[0], runs[2])


def test_options_of_a_reset_hold_for_the_episodes_that_follow():
    env = make(4, steps=3)
    _, info = env.reset(seed=0, options={"friction": [0.5, 0.9]})
    before = info["drawn"]["friction"].copy()
    assert ((before >= 0.5) & (before <= 0.9)).all()
    for _ in range(4):
        *_, info = env.step(np.zeros((4, 2)))
    after = info["drawn"]["friction"]
    assert ((after >= 0.5) & (after <= 0.9)).all()
    assert (after != before).all()


def test_wrong_actions_leave_all_states_untouched():
    env, other = make(3), make(3)
    for one in (env, other):
        one.reset(seed=0)
        one.step(np.full((3, 2), 0.5))
    wrong = np.zeros((3, 2))
    wrong[2, 0] = np.nan
    with pytest.raises(CommandError, match="action: link_0 of environment 2 is nan; it must be finite"):
        env.step(wrong)
    with pytest.raises(CommandError, match=r"action: shape \(2,\); it must be \(3, 2\)"):
        env.step(np.zeros(2))
    assert np.array_equal(env.step(np.full((3, 2), 0.2))[0], other.step(np.full((3, 2), 0.2))[0])


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"num_envs": 0}, "num_envs: 0; it must be a whole number >= 1"),
        ({"threads": 0}, "threads: 0; it must be a whole number >= 1"),
        ({"autoreset_mode": "Never"}, "autoreset_mode: 'Never'; it must be one of NextStep, SameStep, Disabled"),
        ({"render_mode": "human"}, "render_mode: 'human'; many environments offer rgb_array, or None"),
    ],
)
def test_wrong_settings_are_one_clear_line(settings, said):
    with pytest.raises(CrawlerError) as error:
        crawler_lab.gym.CrawlerVectorEnv(**settings)
    assert str(error.value) == said


def test_wrong_seeds_and_masks_are_one_clear_line():
    env = make(3)
    with pytest.raises(CrawlerError, match="seed: 2 seeds for 3 environments; give one, or one for each"):
        env.reset(seed=[1, 2])
    for wrong in ([1, 2, "x"], [1, 2, -3], "abc"):
        with pytest.raises(CrawlerError, match=r"seed: .*; it must be an integer from 0 on, or None to go on"):
            env.reset(seed=wrong)
    with pytest.raises(CrawlerError, match="reset_mask before any episode has begun"):
        env.reset(options={"reset_mask": np.array([True, False, False])})
    env.reset(seed=[1, 2, 3])
    with pytest.raises(CrawlerError, match="an array of 3 bool, at least one of them True"):
        env.reset(options={"reset_mask": np.zeros(3, bool)})
    with pytest.raises(CrawlerError, match="reset all environments with them once"):
        env.reset(options={"reset_mask": np.array([True, False, False]), "delay": 3})


@pytest.mark.parametrize("threads", [1, 2])
def test_a_step_after_the_end_is_one_clear_line(threads):
    env = make(2, threads=threads)
    env.reset(seed=0)
    env.close()
    with pytest.raises(CrawlerError, match="step: the environments are closed"):
        env.step(np.zeros((2, 2)))


@pytest.mark.parametrize("mask", [None, np.array([False, True, True])])
def test_wrong_options_leave_all_episodes_untouched(mask):
    env, other = make(3, randomise={"loads": 0.0}), make(3, randomise={"loads": 0.0})
    for one in (env, other):
        one.reset(seed=0)
        one.step(np.full((3, 2), 0.5))
    options = {"loads": 1.0} | ({} if mask is None else {"reset_mask": mask})
    with pytest.raises(CrawlerError, match="options: with loads 1 the scene is invalid"):
        env.reset(options=options)
    assert np.array_equal(env.step(np.full((3, 2), 0.2))[0], other.step(np.full((3, 2), 0.2))[0])


def test_pictures_of_all():
    pytest.importorskip("matplotlib")
    env = make(2, render_mode="rgb_array")
    env.reset(seed=0)
    assert [picture.shape for picture in env.render()] == [(192, 512, 3)] * 2
    env.close()


@pytest.mark.parametrize("kind", ["chain", "segment", "plane"])
def test_copies_go_on_by_themselves(kind):
    """Also where a partial reset made delays shorter, which needs less memory, and with threads."""
    build, settings = KINDS[kind]
    ours = make(4, scene=build(), randomise={"delay": [2, 3], "noise": 0.01}, steps=9, threads=2, **settings)
    ours.reset(seed=1)
    mask = np.array([True, False, False, False])
    observations, _ = ours.reset(options={"reset_mask": mask, "delay": 1})
    other = copy.deepcopy(ours)
    for step in range(12):
        actions = actions_for(observations, ours.single_action_space.shape[0], step)
        mine = ours.step(actions)
        same(mine, other.step(actions))
        observations = mine[0]
