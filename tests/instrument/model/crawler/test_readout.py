"""What a robot's sensors would say, against the crawler's own arrays."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Crawler, Scene, load_scene
from crawler_model.crawler.readout import Readout

from ..chains import coarse, scene


def read(crawler, shown, seconds):
    """Joints and contacts, each (3, ...): position, velocity, effort."""
    joints = 1 + crawler.joint_elongation.shape[0]
    dimension = crawler.body.dimension
    of_joints, of_contacts = np.zeros((3, joints * dimension)), np.zeros((3, len(shown) * dimension))
    Readout(crawler.body, np.array(shown)).read(crawler, seconds, of_joints, of_contacts)
    return of_joints, of_contacts


def test_a_chain_that_is_pulled_open():
    crawler = Crawler(scene(3, 2.0, 1.0, [1.0, 1.0, 4.0]))
    crawler.advance([2.0, 0.0])
    # link 0 pushes contact 0 back until the 1 N that its friction holds are left
    joints, contacts = read(crawler, [0, 2], 0.5)
    assert joints == pytest.approx(np.array([[-1.5, 1.5, 0.0], [-3.0, 3.0, 0.0], [1.0, -1.0, 0.0]]))
    assert contacts == pytest.approx(np.array([[-1.5, 2.0], [-3.0, 0.0], [1.0, 0.0]]))


def test_before_the_first_command_nothing_has_a_velocity():
    joints, contacts = read(Crawler(scene(2)), [0, 1], np.inf)
    assert not joints.any()
    assert contacts.tolist() == [[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]


def test_a_segment_is_one_joint_behind_the_links():
    crawler = Crawler(coarse("hybrid_body"))
    crawler.advance([0.3, 0.4])
    mesh, trunk = crawler.body, crawler.body.segments[0]
    shown = list(range(mesh.contacts))
    joints, contacts = read(crawler, shown, 2.0)
    x = crawler.displacement
    assert joints[0] == pytest.approx(
        [x[mesh.stations[0]], crawler.shape[mesh.link_springs[0]], x[trunk.last] - x[trunk.first]]
    )
    assert joints[1, 1:] == pytest.approx(joints[0, 1:] / 2.0)
    assert joints[2, 2] == pytest.approx(crawler.tension[trunk.springs].mean())
    assert contacts[0] == pytest.approx(mesh.position + x)
    assert contacts[1] == pytest.approx(crawler.gained / 2.0)
    assert contacts[2] == pytest.approx(-crawler.spring_force)
    assert contacts[2].sum() == pytest.approx(0.0, abs=1e-15)


def test_in_the_plane_every_number_is_two():
    crawler = Crawler(Scene.model_validate(load_scene("planar_three_points").document() | {"tolerance": 1e-6}))
    crawler.advance([[0.1, 0.0], [0.0, 0.2], [-0.1, 0.05]])
    joints, contacts = read(crawler, [1, 2], 0.25)
    x, moved = crawler.displacement, crawler.gained / 0.25
    a, b = crawler.body.ends.T
    assert joints[0] == pytest.approx(np.concatenate((x[:1], x[b] - x[a])).ravel())
    assert joints[1] == pytest.approx(np.concatenate((moved[:1], moved[b] - moved[a])).ravel())
    assert joints[2] == pytest.approx(np.concatenate((-crawler.spring_force[:1], crawler.tension)).ravel())
    assert contacts[0] == pytest.approx((crawler.body.position + x)[1:].ravel())
    assert contacts[1] == pytest.approx(moved[1:].ravel())
    assert contacts[2] == pytest.approx(-crawler.spring_force[1:].ravel())


@pytest.mark.parametrize("dimension", [1, 2])
def test_the_force_of_the_ground_carries_the_loads_too(dimension):
    place, loads = ([0.0, 1.0], [0.25, -0.5]) if dimension == 1 else ([[0, 0], [1, 0]], [[0.25, 0.1], [-0.5, 0.0]])
    body = {"contacts": place, "links": {"stiffness": 1.0}}
    document = {"name": "x", "dimension": dimension, "body": body, "friction": {"isotropic": 1.0}, "loads": loads}
    crawler = Crawler(Scene.model_validate(document))
    crawler.advance([0.5] if dimension == 1 else [[0.5, 0.0]])
    assert crawler.spring_force.any()
    joints, contacts = read(crawler, [0, 1], 1.0)
    assert contacts[2] == pytest.approx(-(crawler.spring_force + loads).ravel())
    assert joints[2, :dimension] == pytest.approx(contacts[2, :dimension])
