"""Scenes that wait for commands, and trajectories that drive them for longer than a measurement."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from crawler_model.body.names import name_each

from .domain import Domain, build_trajectory


def wave(domain: Domain, contacts: int) -> None:
    """Drive a chain by a travelling wave for the longest duration of a measurement."""
    domain.publisher("joint_trajectory").publish(_wave_trajectory(contacts))


@functools.cache
def _wave_trajectory(contacts: int) -> Any:
    # of 100 000 rows that a trajectory may have; a quick processor ends 2 000 s in a second
    samples, periods, period_s = (8, 12_000, 2.0) if contacts <= 100 else (16, 300, 1.0)
    time_in_period = np.arange(samples * periods)[:, None] / samples
    rows = 0.05 * np.sin(2.0 * np.pi * (time_in_period - np.arange(contacts - 1) / 5.0))
    return build_trajectory(name_each("link", contacts - 1), rows, period_s / samples)
