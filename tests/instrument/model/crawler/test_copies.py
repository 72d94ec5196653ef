"""Copies of crawlers: equal to the bit, and independent."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from crawler_model import Crawler, load_scene


@pytest.mark.parametrize("scene", ["two_contacts_critical", "ice", "planar_three_points", "steering_inchworm"])
def test_copies_go_on_by_themselves(scene):
    crawler = Crawler(load_scene(scene), budget=1000)
    targets = crawler.scene.drive.targets
    crawler.follow(targets[1][None])
    copies = [crawler.copy(), copy.deepcopy(crawler), pickle.loads(pickle.dumps(crawler))]
    before = crawler.displacement
    crawler.follow(targets[0][None])
    for other in copies:
        assert np.array_equal(other.displacement, before)
        other.follow(targets[0][None])
        assert other == crawler
