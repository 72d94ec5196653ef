"""Episodes as recordings: `crawler replay` simulates them again, to the bit."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("mcap")

from crawler_lab.gym import CrawlerEnv
from crawler_model import CrawlerError
from crawler_ros.replay import simulate_again

from .scenes import EACH_KIND, KINDS, act

RANGES = {"stiffness": [0.8, 1.0], "delay": [0, 2], "noise": 0.01}


@pytest.mark.parametrize("kind", EACH_KIND)
def test_replay_finds_an_episode_identical(kind, tmp_path):
    build, needed = KINDS[kind]
    env = CrawlerEnv(build(), **{"randomise": RANGES, "rate": 30.0, **needed})
    observation, _ = env.reset(seed=2)
    for step in range(25):
        observation, *_ = env.step(act(observation, env.action_space.shape[0], step))
    folder = env.save(tmp_path / "episode")
    replayed = simulate_again(folder)
    assert replayed.identical
    assert replayed.ticks == 26
    assert (folder / "metadata.yaml").is_file()


def test_what_cannot_be_saved_is_one_clear_line(tmp_path):
    env = CrawlerEnv(steps=0)
    with pytest.raises(CrawlerError, match="save: no episode has begun; call reset first"):
        env.save(tmp_path / "early")
    env.reset(seed=0)
    for _ in range(10_001):
        env.step(np.zeros(2))
    with pytest.raises(CrawlerError, match="save: 10001 steps are more than are remembered, 10000; set `steps`"):
        env.save(tmp_path / "long")
