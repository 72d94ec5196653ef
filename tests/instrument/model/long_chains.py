"""Chains followed with sleeping clusters of contacts and without, to compare.

The rows of a drive are rest lengths, or rest lengths, forward and backward friction.
"""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Crawler, Scene, Step
from crawler_model.motion.line import build_records

from .chains import scene

NEVER = 10**9
Row = np.ndarray | tuple[np.ndarray, ...]


def chain(stiffness: np.ndarray, forward: np.ndarray, backward: np.ndarray, loads: np.ndarray | None = None) -> Scene:
    found = scene(forward.size, stiffness.tolist(), forward.tolist(), backward.tolist())
    return found if loads is None else Scene.model_validate(found.document() | {"loads": loads.tolist()})


def follow(
    scene: Scene,
    rows: list[Row],
    shortest: int,
    monkeypatch: pytest.MonkeyPatch,
    leaf_size: int = 3,
    **more: int,
):
    """Follow a drive with contacts that fall asleep in blocks of `shortest`, in leaves of `leaf_size`."""
    monkeypatch.setattr(build_records, "LONG", shortest)
    monkeypatch.setattr(build_records, "SHORTEST_BLOCK", shortest)
    monkeypatch.setattr(build_records, "LEAF_SIZE", leaf_size)
    crawler = Crawler(scene, **more)
    found: list[tuple[np.ndarray, np.ndarray, Step]] = []
    for row in rows:
        step = crawler.advance(*(row if isinstance(row, tuple) else (row,)))
        found.append((crawler.displacement.copy(), crawler.tension, step))
    return found


def assert_same(
    scene: Scene, rows: list[Row], monkeypatch: pytest.MonkeyPatch, near: float = 1e-12, leaf_size: int = 3
) -> int:
    """Compare both paths relative to the motion; return the number of pieces."""
    short = follow(scene, rows, NEVER, monkeypatch)
    long = follow(scene, rows, 8, monkeypatch, leaf_size)
    stiffness = Crawler(scene).body.stiffness
    pieces = 0
    for (x, tension, step), (x_long, tension_long, step_long) in zip(short, long, strict=True):
        size = max(np.abs(x).max(), max(np.abs(row[0] if isinstance(row, tuple) else row).max() for row in rows))
        assert np.abs(x_long - x).max() <= near * size
        assert np.abs(tension_long - tension).max() <= near * max(np.abs(tension).max(), 1.0)
        energy = abs(step.work) + step.dissipation + 0.5 * float(tension**2 @ (1.0 / stiffness))
        assert step_long.work == pytest.approx(step.work, rel=0, abs=near * energy)
        assert step_long.dissipation == pytest.approx(step.dissipation, rel=0, abs=near * energy)
        assert abs(step_long.certificate.energy_residual) <= near * energy
        assert step_long.certificate.violation <= near * max(np.abs(tension).max(), 1.0)
        assert step_long.certificate.complementarity <= near * energy
        pieces += step.events
    return pieces
