"""Random bodies in the plane against a method that shares nothing with ours: integrated positions of sliding
contacts."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Crawler, Scene
from crawler_model.scene.parts import LEAST_TOLERANCE

from ..sliding import follow_sliding


@pytest.mark.parametrize("seed", range(6))
def test_both_methods_follow_random_bodies_alike(seed):
    rng = np.random.default_rng(seed)
    n, rows = 3 + seed % 3, 5
    scene = Scene.model_validate(
        {
            "name": f"random_{seed}",
            "dimension": 2,
            "start": "relaxed",
            "body": {
                "contacts": rng.uniform(0.0, 1.0, (n, 2)).tolist(),
                "links": {"stiffness": rng.uniform(5.0, 20.0, n - 1).tolist()},
            },
            "friction": {"isotropic": rng.uniform(0.2, 1.0, n).tolist()},
            "tolerance": LEAST_TOLERANCE,
            "drive": {"times": list(range(rows)), "actuation": rng.uniform(-0.3, 0.3, (rows, n - 1, 2)).tolist()},
        }
    )
    targets = [row[None] for row in scene.drive.targets[1:]]
    x, account = follow_sliding(scene, targets)
    crawler = Crawler(scene)
    size = np.ptp(x, axis=0).max()
    for target, expected in zip(targets, x, strict=True):
        crawler.follow(target)
        assert np.abs(crawler.displacement - expected).max() < 1e-6 * size
    assert abs(account.energy_residual) < 1e-12 * account.work
    assert account.violation < 1e-11
