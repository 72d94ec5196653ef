from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crawler_model import Crawler
from crawler_model.stasis import (
    is_in_stasis,
    spring_force,
    stasis_bounds,
    stasis_margins,
    stasis_polygon,
    tension_ranges,
)

from .chains import rows, scene


@given(rows(commanded=False), st.floats(0.0, 0.999))
def test_nothing_moves_strictly_inside(driven, part):
    stiffness, actuation, forward, backward = driven
    n = stiffness.size + 1
    crawler = Crawler(scene(n, stiffness.tolist(), forward[0].tolist(), backward[0].tolist()))
    direction = -actuation[-1] * stiffness
    force = spring_force(direction)
    reach = min((np.where(force > 0, forward[0], backward[0]) / np.maximum(np.abs(force), 1e-300)).min(), 1e300)
    step = crawler.advance(part * reach * actuation[-1])
    assert not crawler.displacement.any()
    assert not step.velocity.any()
    assert step.dissipation == 0.0
    assert is_in_stasis(crawler.tension, forward[0], backward[0])


def test_something_moves_as_soon_as_the_boundary_is_passed():
    crawler = Crawler(scene(3, 20.0, 0.2, 0.5))
    crawler.advance([-0.0100001, 0.0])
    assert crawler.displacement.any()


@given(rows())
def test_the_tension_never_leaves_the_domain(driven):
    stiffness, actuation, forward, backward = driven
    crawler = Crawler(scene(stiffness.size + 1, stiffness.tolist(), forward[0].tolist(), backward[0].tolist()))
    for row in zip(actuation, forward, backward, strict=True):
        crawler.advance(*row)
        assert stasis_margins(crawler.tension, crawler.forward, crawler.backward).min() > -1e-13 * stiffness.max()


@pytest.mark.parametrize(
    ("forward", "backward", "sides"), [(1.0, 1.0, 6), (1.0, 1.9, 6), (1.0, 2.1, 3), (2.1, 1.0, 3), (0.2, 0.5, 3)]
)
def test_three_equal_contacts_make_a_triangle_or_a_hexagon(forward, backward, sides):
    corners = stasis_polygon([forward] * 3, [backward] * 3)
    assert len(corners) == sides
    for corner in corners:
        assert stasis_margins(corner, [forward] * 3, [backward] * 3).min() == pytest.approx(0.0, abs=1e-12)
    edges = np.roll(corners, -1, axis=0) - corners
    turned = np.roll(edges, -1, axis=0)
    assert (edges[:, 0] * turned[:, 1] - edges[:, 1] * turned[:, 0] > 0).all()


def test_in_a_triangle_only_one_direction_is_possible_and_in_a_hexagon_both():
    rng = np.random.default_rng(0)
    seen = {}
    for name, backward in (("triangle", 2.5), ("hexagon", 1.5)):
        crawler = Crawler(scene(3, 1.0, 1.0, backward))
        states = set()
        for _ in range(300):
            crawler.advance(rng.uniform(-9, 9, 2))
            states |= set(crawler.contact_state.tolist())
        seen[name] = states
    assert seen == {"triangle": {0, 1}, "hexagon": {-1, 0, 1}}


@given(st.integers(0, 2**32 - 1))
def test_ranges_are_the_projection_of_the_polygon(seed):
    forward, backward = np.random.default_rng(seed).uniform(0.1, 3, (2, 3))
    corners = stasis_polygon(forward, backward)
    least, most = tension_ranges(forward, backward)
    assert corners.min(axis=0) == pytest.approx(least)
    assert corners.max(axis=0) == pytest.approx(most)


def test_bounds_of_a_link_given_the_others():
    least, most = stasis_bounds([0.1, -0.1], [0.2] * 3, [0.5] * 3)
    assert least == pytest.approx([-0.3, -0.2])
    assert most == pytest.approx([0.2, 0.3])
    assert stasis_margins([most[0], -0.1], [0.2] * 3, [0.5] * 3).min() == pytest.approx(0.0)


def test_the_polygon_wants_three_contacts():
    with pytest.raises(ValueError, match="three contacts"):
        stasis_polygon([1, 1], [1, 1])
