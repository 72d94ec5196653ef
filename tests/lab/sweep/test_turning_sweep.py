"""Variations of bodies that turn."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from crawler_lab import simulate_many, vary
from crawler_model import Scene, SceneError, load_scene, simulate

SCISSORS = load_scene("scissors")
INCHWORM = load_scene("steering_inchworm")


def test_the_turn_follows_its_closed_form():
    """A - 2 r mu_min/c over the stiffness of the joint and the friction of one blade to the left; the other is kept."""
    stiffness = np.array([4.0, 5.0, 8.0])
    runs = simulate_many(vary(SCISSORS, {"body.joints.stiffness": stiffness}), duration=3.0, rate=20.0)
    assert runs.dyaw == pytest.approx(0.5 - 2.0 * 0.1 / stiffness, abs=1e-5)


def test_a_row_is_the_run_of_that_scene():
    keys = {"friction.left": [0.4, 0.6], "drive.actuation[1][1]": [0.1, 0.15]}
    variations = vary(INCHWORM, keys)
    runs = simulate_many(variations, duration=2.5, rate=10.0)
    assert runs.status.tolist() == ["done"] * 4
    for scene, row in zip(variations, runs, strict=True):
        run = simulate(scene, 2.5, rate=10.0)
        assert (row.dx, row.dy, row.dyaw) == pytest.approx(run.per_period[-1].tolist(), abs=1e-12)
        assert row.net_translation == pytest.approx(run.net_translation[-1], abs=1e-12)
        assert row.work == pytest.approx(run.energy.work)
        assert row.periods == 2
    assert np.ptp(runs.dyaw) > 1e-3


def test_bodies_that_do_not_turn_have_none():
    runs = simulate_many([load_scene("two_anchor_a"), SCISSORS], duration=2.0, rate=10.0)
    assert np.isnan(runs[0].dyaw)
    assert np.isfinite(runs[1].dyaw)
    assert np.isnan(simulate_many([SCISSORS], duration=0.5).dyaw).all()


def test_the_table_names_them():
    pytest.importorskip("pyarrow")
    turning = simulate_many([SCISSORS], duration=2.0, rate=10.0).to_table()
    assert [turning.schema.field(name).metadata[b"unit"] for name in ("dx", "dy", "dyaw")] == [b"m", b"m", b"rad"]
    line = simulate_many([load_scene("two_anchor_a")], duration=2.0).to_table()
    assert "dyaw" not in line.column_names


@pytest.mark.parametrize(
    "key",
    [
        *("friction.left", "friction.right[2]", "friction.angle", "body.joints.stiffness", "body.joints.stiffness[3]"),
        *("body.links.stiffness[1]", "body.points[2][0]", "drive.actuation[1][4]"),
    ],
)
def test_a_key_changes_the_number_it_names(key):
    """The scene equals the document with this number, frames and bare points included."""
    (varied,) = vary(INCHWORM, {key: [0.3]})
    steps = key.replace("[", ".").replace("]", "").split(".")
    document = INCHWORM.document()
    node = document
    for step, following in itertools.pairwise(steps):
        if isinstance(node, dict) and following.isdecimal() and not isinstance(node[step], list):
            node[step] = [node[step]] * 4
        node = node[int(step) if isinstance(node, list) else step]
    node[int(steps[-1]) if isinstance(node, list) else steps[-1]] = 0.3
    expected = Scene.model_validate(document)
    for ours, theirs in (
        (varied.drive.rows, expected.drive.rows),
        (varied.body.position, expected.body.position),
        (varied.body.stiffnesses, expected.body.stiffnesses),
        (varied.body.turning.offset, expected.body.turning.offset),
    ):
        assert np.array_equal(ours, theirs)
    assert not all(
        np.array_equal(ours, theirs)
        for ours, theirs in (
            (varied.drive.rows, INCHWORM.drive.rows),
            (varied.body.position, INCHWORM.body.position),
            (varied.body.stiffnesses, INCHWORM.body.stiffnesses),
            (varied.body.turning.offset, INCHWORM.body.turning.offset),
        )
    )


def test_isotropic_friction_becomes_four_sides():
    document = INCHWORM.document()
    document["friction"] = {"isotropic": 0.5}
    isotropic = Scene.model_validate(document)
    (varied,) = vary(isotropic, {"friction.left": [0.3]})
    assert varied.document()["friction"] == {"forward": 0.5, "backward": 0.5, "left": 0.3, "right": 0.5}
    (back,) = vary(INCHWORM, {"friction.isotropic": [0.3]})
    assert back.document()["friction"] == {"isotropic": 0.3}


def test_a_mistake_is_one_line():
    with pytest.raises(SceneError, match=r"friction\.lft: unknown key; the nearest known key is 'friction\.left'"):
        vary(INCHWORM, {"friction.lft": [0.3]})
    runs = simulate_many(vary(INCHWORM, {"friction.left": [-0.3, 0.5]}), duration=1.0, rate=10.0)
    assert runs.status.tolist() == ["invalid", "done"]
    assert "left -0.3, right 0.5; friction must be >= 0" in runs.reason[0]
