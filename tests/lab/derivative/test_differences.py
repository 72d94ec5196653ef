"""Derivatives of bodies with hysteresis or backlash: closed forms, and bodies that have exact derivatives as well."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_lab.derivative.sensitivities import sensitivities
from crawler_model.scene.scene import Scene

from ...instrument.model.segments import segment

GAIT = [[0.0, 0.0], [0.11, 0.0], [0.1, 0.12], [0.0, 0.1], [0.0, 0.0]]


def build(links: list[dict[str, Any]], rows: Any = GAIT, forward: Any = 0.2, backward: Any = 9.0, **more: Any) -> Scene:
    body = {"contacts": list(range(len(links) + 1)), "links": links} | more.pop("body", {})
    drive = {"times": list(range(len(rows))), "actuation": rows, "period": len(rows) - 1} | more.pop("drive", {})
    friction = {"forward": forward, "backward": backward}
    return Scene.model_validate({"name": "lossy", "body": body, "friction": friction, "drive": drive, **more})


def test_the_derivatives_of_a_stroke_that_is_lost():
    """The gain is D - b - 2 (mu + f)/k beside a stiff element of yield f."""
    link = {"stiffness": 20.0, "backlash": 0.02, "hysteresis": [{"stiffness": 1e6, "yield": 0.1}]}
    keys = {
        "drive.actuation[1][0]": 1.0,
        "body.links[0].backlash": -1.0,
        "body.links[0].hysteresis[0].yield": -2.0 / 20.0,
        "body.links[0].stiffness": 2.0 * 0.3 / 20.0**2,
        "friction.forward": -2.0 / 20.0,
        "drive.times[1]": 0.0,
    }
    found = sensitivities(build([link], [[0], [0.1], [0]]), list(keys), 8.0, rate=3.0)
    assert found.per_period[1:] == pytest.approx(np.tile(list(keys.values()), (3, 1)), abs=1e-5)
    assert found.net_translation[-1] == pytest.approx(found.per_period.sum(axis=0), abs=1e-8)
    assert found.period_work.sum(axis=0) == pytest.approx(found.work, abs=1e-9)
    assert found.one_sided.tolist() == [False] * 5 + [True]  # a tick is at that waypoint
    assert 0.0 < found.tolerance < 1e-3


KEYS = ("drive.actuation[1]", "drive.times[2]", "drive.period", "friction.backward", "body.links[0].stiffness")


@pytest.mark.parametrize("method", ["hysteresis", "backlash"])
def test_they_are_those_of_a_body_that_remembers_nothing(method):
    """An element that never yields is a passive spring, and a command that never turns round is only shifted."""
    links = [{"stiffness": 20.0}, {"stiffness": 31.0}]
    other = [dict(link) for link in links]
    if method == "hysteresis":
        links[1]["hysteresis"] = [{"stiffness": 7.0, "yield": 100.0}]
        other[1]["passive"] = {"stiffness": 7.0}
        lossy, plain, keys = build(links, backward=[0.5, 0.6, 0.7]), build(other, backward=[0.5, 0.6, 0.7]), list(KEYS)
    else:
        rows = [[0.0, 0.0], [0.11, 0.0], [0.21, 0.13], [0.33, 0.3]]
        once, start = {"drive": {"period": None}}, {"displacement": [0.0] * 3, "backlash": [-0.02, 0.0]}
        links[0]["backlash"] = 0.04  # taken up from the start
        moved = [[row[0] - 0.02, row[1]] for row in rows]
        start["displacement"] = [0.0, -0.02, -0.02]
        friction = {"backward": [0.5, 0.6, 0.7]}
        lossy = build(links, rows, start=start, **once, **friction)
        plain = build(other, moved, start={"displacement": [0.0, -0.02, -0.02]}, **once, **friction)
        keys = [key for key in KEYS if key != "drive.period"]
    one, two = (sensitivities(scene, keys, 3.7, rate=7.0) for scene in (lossy, plain))
    assert one.parameters == two.parameters
    sure = ~(one.one_sided | two.one_sided)
    assert sure.sum() >= 0.7 * sure.size
    for name in ("displacement", "net_translation", "work"):
        exact = getattr(two, name)[..., sure]
        assert getattr(one, name)[..., sure] == pytest.approx(exact, abs=1e-5 * max(np.abs(exact).max(), 1.0))


def test_a_kink_is_found_and_the_side_of_larger_values_is_taken():
    """An actuator begins to move just at the end of the stroke: with less of it, nothing moves."""
    scene = build([{"stiffness": 20.0, "backlash": 0.1}], [[0], [0.05], [0.05]], [9.0, 0.0], drive={"period": None})
    found = sensitivities(scene, ["drive.actuation[1][0]"], rate=1.0)
    assert found.one_sided.all()
    assert not found.differentiable
    assert found.displacement[1, 1, 0] == pytest.approx(1.0, abs=1e-6)
    assert [kink.time for kink in found.kinks] == [1.0]
    assert found.kinks[0].contacts == ("contact 1",)


def test_the_derivatives_of_a_segment_that_loses_a_stroke():
    """The gain is (D - b - mu L/E)(M - mu)/(M + mu) L with mu and M forward and backward friction."""
    scene = segment(0.4, elements=60, backlash=0.1)
    found = sensitivities(scene, ["body.segments[0].backlash", "body.segments[0].stiffness"], 2.0, 1.0)
    known = ~found.unresolved
    assert known.any()
    assert found.per_period[-1][known] == pytest.approx(np.array([-0.5, 0.05])[known], rel=0.05)
