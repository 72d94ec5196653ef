"""The command in force, found from the states of a robot."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Crawler, Scene, load_scene
from crawler_model.crawler.readout import Readout
from crawler_ros.wire.states import find_command, joint_state_names, shown_contacts

CURVED = Scene.model_validate(
    {
        "name": "curved",
        "body": {
            "contacts": [0.0, 0.1, 0.2],
            "links": [
                {"between": [0, 1], "curve": {"elongation": [-0.05, 0.0, 0.05], "tension": [-1.0, 0.0, 3.0]}},
                {"between": [1, 2], "stiffness": 20.0, "passive": {"stiffness": 5.0}, "tension": {"least": 0.0}},
            ],
        },
        "friction": {"forward": 0.3, "backward": 0.6},
        "start": "relaxed",
    }
)


def found_after(scene: Scene, command: list[float]) -> np.ndarray:
    """Command each actuator, and find the lengths in force from the states that follow."""
    columns, crawler, shown = scene.columns, Crawler(scene), shown_contacts(scene.body)
    count = columns.lengths
    row = scene.drive.rows[0].copy()
    row[:count] = np.repeat(command, count // len(command))
    crawler.follow(columns.target(row)[None])
    joints, contacts = np.zeros((3, len(joint_state_names(scene.body)))), np.zeros((3, shown.size * scene.dimension))
    Readout(scene.body, shown).read(crawler, 0.1, joints, contacts)
    found = find_command(scene, joints, scene.drive.rows[0])
    assert (found[count:] == row[count:]).all()  # friction and loads
    return found[:count]


@pytest.mark.parametrize(
    ("scene", "command"),
    [
        ("three_contacts_two_ways", [0.1, -0.05]),
        ("planar_three_points", [0.01, 0.02, -0.01, 0.03, 0.0, 0.01]),
        ("scissors", [0.02, 0.01, 0.3]),
        ("silicone_chain", [0.02, -0.01, 0.03]),
        ("continuous_segment", [0.05]),
        ("hybrid_body", [0.1, -0.05]),
        (CURVED, [0.03, -0.2]),
    ],
)
def test_lengths_and_strains_follow_from_states(scene, command):
    scene = load_scene(scene) if isinstance(scene, str) else scene
    expected = np.repeat(command, scene.columns.lengths // len(command))
    assert found_after(scene, command) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    "name", ["peristaltic_segment", "friction_wave_segment", "ten_contact_wave", "stalling_inchworm"]
)
def test_a_command_that_is_known_is_not_changed(name):
    scene = load_scene(name)
    row = scene.drive.rows[0]
    joints, shown = np.zeros((3, len(joint_state_names(scene.body)))), shown_contacts(scene.body)
    Readout(scene.body, shown).read(Crawler(scene), np.inf, joints, np.zeros((3, shown.size)))
    assert find_command(scene, joints, row) == pytest.approx(row, abs=1e-9)


def test_a_length_on_the_flat_part_of_a_curve_is_not_invented():
    curve = {"elongation": [-0.02, 0.0, 0.01, 0.03], "tension": [-1.0, 0.0, 0.0, 1.0]}
    document = CURVED.document() | {"body": {"contacts": [0.0, 0.1], "links": {"curve": curve}}}
    assert found_after(Scene.model_validate(document), [0.0]).tolist() == [0.0]


def test_what_states_do_not_show_stays_as_it_is_taken_to_be():
    assert found_after(CURVED, [0.01, 0.3]) == pytest.approx([0.01, 0.0], abs=1e-12)  # the tendon is slack
    uneven = load_scene("heterogeneous_segment")
    assert (found_after(uneven, [0.05]) == uneven.drive.rows[0][: uneven.columns.lengths]).all()
