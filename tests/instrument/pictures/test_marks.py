"""Marks of links in films and in the viewer: the elements of a link yield where all of them pull with all their force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_model import Crawler, Scene, simulate
from crawler_model.body.drive import NS

pytest.importorskip("matplotlib")

from crawler_pictures.film.film import film_of_run
from crawler_pictures.film.panels import explain_yields
from crawler_pictures.film.stage import Stage
from crawler_pictures.marks import YIELDING, can_be_marked, can_yield
from crawler_ros.viewer.frames import frame_of

ELEMENTS = [{"stiffness": 40.0, "yield": 0.1}, {"stiffness": 10.0, "yield": 0.1}]
GAIT = [[0, 0], [0.08, 0], [0.08, 0.08], [0, 0.08], [0, 0]]


def worm(*links: dict[str, Any]) -> Scene:
    body = {
        "contacts": [0.1 * i for i in range(len(links) + 1)],
        "links": [{"stiffness": 20.0} | link for link in links],
    }
    drive = {"times": [0, 1, 2, 3, 4], "period": 4, "actuation": GAIT}
    return Scene.model_validate(
        {"name": "worm", "body": body, "friction": {"forward": 0.2, "backward": 0.8}, "drive": drive}
    )


def test_a_link_is_marked_while_all_its_elements_yield():
    scene = worm({"hysteresis": ELEMENTS}, {})
    run = simulate(scene, 8.0, 50.0)
    film = film_of_run(scene, run)
    crawler, begin, marks = Crawler(scene), 0, []
    for end in np.rint(run.time[1:] * NS).astype(np.int64):
        _, targets, *_ = scene.drive.ramps_between(begin, np.array([end]))
        crawler.follow(targets)
        begin = end
        yields = bool(
            (np.abs(crawler.hysteresis) >= 0.1 * (1.0 - 1e-12)).all() and abs(crawler.hysteresis.sum()) > 0.15
        )
        assert frame_of(crawler, int(end), crawler.contact_state).yields.tolist() == [YIELDING * yields, 0]
        marks.append(YIELDING * yields)
    assert film.yields[1:, 0].tolist() == marks
    assert not film.yields[:, 1].any()
    assert 0.1 < np.mean(film.yields[:, 0] == YIELDING) < 0.9
    assert explain_yields(film, 2) == "; links: violet yielding"


def test_a_link_that_yields_is_drawn_violet():
    scene = worm({"hysteresis": ELEMENTS}, {})
    film = film_of_run(scene, simulate(scene, 4.0, 25.0))
    stage, found = Stage(film), {}
    for mark in (0, YIELDING):
        body = stage.draw(int(np.flatnonzero(film.yields[:, 0] == mark)[0])).astype(int)
        found[mark] = int((np.abs(body - [0x5A, 0x2A, 0x6B]).max(axis=2) < 30).sum())
    assert found[YIELDING] > found[0] + 100


def test_links_without_elements_and_with_backlash_are_not_marked():
    """With backlash states do not tell the length of the actuator, and so not the force of the elements."""
    assert not can_be_marked(worm({}, {}).body)
    assert not can_yield(worm({"backlash": 0.01, "hysteresis": ELEMENTS}, {}).body)
    slack = worm({"tension": {"least": 0.0}, "passive": {"stiffness": 5.0}}, {})
    assert can_be_marked(slack.body)
    assert not can_yield(slack.body)
    both = worm({"backlash": 0.01, "hysteresis": ELEMENTS}, {"hysteresis": ELEMENTS})
    film = film_of_run(both, simulate(both, 8.0, 50.0))
    assert not film.yields[:, 0].any()
    assert (film.yields[:, 1] == YIELDING).any()
