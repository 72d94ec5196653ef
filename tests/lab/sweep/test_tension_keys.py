"""How strong a motor must be: `tension` as one number, and its keys in variations."""

from __future__ import annotations

import math
import pickle
import re

import numpy as np
import pytest

from crawler_command.units import unit_of
from crawler_lab import sensitivities, simulate_many, vary
from crawler_model import Scene, SceneError, load_scene, simulate


def chain(links, stroke=2.0):
    """Three contacts that slide forward only, and two links that lengthen and shorten together."""
    return Scene.model_validate(
        {
            "name": "chain",
            "body": {"contacts": [0.0, 1.0, 2.0], "links": links},
            "friction": {"forward": 0.5, "backward": 5.0},
            "drive": {"times": [0, 1, 2], "period": 2, "actuation": [[0, 0], [stroke, stroke], [0, 0]]},
        }
    )


ALIKE = chain({"stiffness": 8.0, "tension": 1.5})
LISTED = chain([{"stiffness": 8.0, "tension": 1.5}, {"stiffness": 8.0}])


def test_one_number_limits_a_tension_in_both_directions():
    both = chain({"stiffness": 8.0, "tension": {"least": -1.5, "most": 1.5}})
    assert np.array_equal(simulate(ALIKE).displacement, simulate(both).displacement)
    assert ALIKE.document()["body"]["links"]["tension"] == 1.5


@pytest.mark.parametrize(
    ("tension", "said"),
    [
        (-1.0, "tension: -1 N; it must be >= 0"),
        ("strong", "tension: 'strong' is not a number"),
        (0.0, "its tension is the same at all lengths"),
        ({"lest": 0.0}, "tension.lest: unknown key; the nearest known key is 'least'"),
    ],
)
def test_a_wrong_limit_is_one_clear_line(tension, said):
    with pytest.raises(SceneError, match=re.escape(said)):
        chain({"stiffness": 8.0, "tension": tension})


@pytest.mark.parametrize("degrees", [0.0, 5.0, 10.0, 16.0, 17.5, 20.0])
def test_the_gain_jumps_where_the_stall_force_reaches_the_smaller_bound(degrees):
    """D - 2 min(a, b)/k with a = c_plus cos + sin, b = c_minus cos - sin, if F >= min(a, b), or else 0."""
    theta = math.radians(degrees)
    a, b = 0.2 * math.cos(theta) + math.sin(theta), 0.8 * math.cos(theta) - math.sin(theta)
    force = min(a, b) + np.array([-0.1, -1e-9, 1e-9, 0.1, 10.0])
    runs = simulate_many(vary(load_scene("slope_climber"), {"ground.slope": [degrees], "body.links.tension": force}))
    gain = math.copysign(0.1 - 2.0 * min(a, b) / 20.0, b - a)
    assert runs.per_period == pytest.approx([0.0, 0.0, gain, gain, gain], abs=1e-12)
    assert runs.unique.all()


def test_a_key_without_a_number_stands_for_all_links_of_a_list():
    force = [0.9, 1.1, 4.0]
    every = vary(LISTED, {"body.links.tension": force})
    alike = vary(ALIKE, {"body.links.tension": force})
    assert simulate_many(every).per_period.tolist() == simulate_many(alike).per_period.tolist()
    assert [link["tension"] for link in pickle.loads(pickle.dumps(every))[1].document()["body"]["links"]] == [1.1, 1.1]
    assert len(set(simulate_many(vary(LISTED, {"body.links[1].tension": force})).per_period)) > 1
    stiff = vary(LISTED, {"body.links.stiffness": [4.0]})
    assert [link["stiffness"] for link in stiff[0].document()["body"]["links"]] == [4.0, 4.0]


@pytest.mark.parametrize("key", ["body.links.tension.most", "body.links[0].tension.most"])
def test_a_key_of_one_limit_keeps_the_other(key):
    (scene,) = vary(LISTED, {key: [0.75]})
    assert scene.document()["body"]["links"][0]["tension"] == {"least": -1.5, "most": 0.75}
    (scene,) = vary(chain({"stiffness": 8.0}), {"body.links.tension.most": [0.75]})
    assert scene.document()["body"]["links"]["tension"] == {"most": 0.75}


@pytest.mark.parametrize(
    ("scene", "keys", "said"),
    [
        (
            LISTED,
            ["body.links.tensoin"],
            "vary: body.links.0.tensoin: unknown key; the nearest known key is 'body.links",
        ),
        (LISTED, ["body.links[2].tension"], "vary: body.links[2].tension: body.links has 2 entries"),
        (ALIKE, ["body.links[0].tension"], "vary: body.links[0].tension: unknown key; the nearest known key is"),
        (LISTED, ["body.links.tension", "body.links[1].tension.most"], "set the same number"),
        (LISTED, ["body.links.stiffness", "body.links[1].stiffness"], "set the same number"),
    ],
)
def test_a_wrong_key_is_one_clear_line(scene, keys, said):
    with pytest.raises(SceneError, match=re.escape(said)):
        vary(scene, {key: [1.0] for key in keys})


def test_the_derivative_by_a_number_of_all_links_needs_links_that_are_alike():
    alike = sensitivities(chain([{"stiffness": 8.0}, {"stiffness": 8.0}]), ["body.links.stiffness"])
    assert alike.per_period[-1] == pytest.approx(
        sensitivities(chain({"stiffness": 8.0}), alike.parameters).per_period[-1]
    )
    with pytest.raises(SceneError, match=re.escape("the links differ, so no one number stands for all: [8.0, 4.0]")):
        sensitivities(chain([{"stiffness": 8.0}, {"stiffness": 4.0}]), ["body.links.stiffness"])


def test_the_unit_of_a_tension():
    over = load_scene("snake_over_two_grounds")
    assert (unit_of(over, "ground.regions[0].friction"), unit_of(over, "ground.regions[0].left_of[0][1]")) == ("1", "m")
    assert unit_of(ALIKE, "body.links.tension") == unit_of(LISTED, "body.links[0].tension.most") == "N"
