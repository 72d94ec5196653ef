from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from crawler_model import Crawler, Scene, load_scene, simulate
from crawler_model.theory.stasis import (
    Facet,
    StasisDomain,
    directions_of,
    domain_evolution,
    is_in_stasis,
    section_forces,
    spring_force,
    stasis_bounds,
    stasis_margins,
    tension_ranges,
)

from ..chains import rows, scene


@st.composite
def domains(draw: st.DrawFn, contacts: st.SearchStrategy[int]) -> StasisDomain:
    """Friction of one to two decades, half the time in quarters: balances and contacts without friction occur."""
    n = draw(contacts)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    if draw(st.booleans()):
        return StasisDomain(*rng.integers(0, 5, (2, n)) / 4.0)
    return StasisDomain(*np.exp(rng.uniform(-2, 1, (2, n))))


@st.composite
def loaded_domains(draw: st.DrawFn, contacts: st.SearchStrategy[int]) -> StasisDomain:
    """The same under loads that friction holds in total, though not at every contact."""
    bare = draw(domains(contacts))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    least, most = -bare.backward.sum(), bare.forward.sum()
    load = rng.normal(0.0, 1.0, bare.contacts)
    load += (rng.uniform(least, most) - load.sum()) / bare.contacts
    return StasisDomain(bare.forward - load, bare.backward + load)


def maximum(domain: StasisDomain, direction: np.ndarray) -> float:
    """The greatest value of direction . Q in the domain, by linear programming over the forces."""
    goal = np.append(np.cumsum(direction[::-1])[::-1], 0.0)  # Q_i = g_0 + ... + g_i
    bounds = list(zip(-domain.backward, domain.forward, strict=True))
    done = linprog(-goal, A_eq=np.ones((1, goal.size)), b_eq=[0.0], bounds=bounds)
    assert done.status == 0
    return -done.fun


def middle_of_facet(domain: StasisDomain, facet: Facet) -> tuple[float, np.ndarray]:
    """The state with the contact at its bound that is farthest from all other bounds: that distance, and Q."""
    n, i = domain.contacts, facet.contact
    at = domain.forward[i] if facet.side == "forward" else -domain.backward[i]
    others = [j for j in range(n) if j != i]
    below = np.hstack((np.eye(n)[others], np.ones((n - 1, 1))))
    above = np.hstack((-np.eye(n)[others], np.ones((n - 1, 1))))
    balance = np.vstack((np.append(np.ones(n), 0.0), np.append(np.eye(n)[i], 0.0)))
    done = linprog(
        np.append(np.zeros(n), -1.0),
        A_ub=np.vstack((below, above)),
        b_ub=np.concatenate((domain.forward[others], domain.backward[others])),
        A_eq=balance,
        b_eq=[0.0, at],
        bounds=[(None, None)] * n + [(None, None)],
    )
    return (-1.0, np.zeros(n - 1)) if done.status != 0 else (-done.fun, section_forces(done.x[:n]))


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
    corners = StasisDomain([forward] * 3, [backward] * 3).vertices()
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
    corners = StasisDomain(forward, backward).vertices()
    least, most = tension_ranges(forward, backward)
    assert corners.min(axis=0) == pytest.approx(least)
    assert corners.max(axis=0) == pytest.approx(most)


def test_bounds_of_a_link_given_the_others():
    least, most = stasis_bounds([0.1, -0.1], [0.2] * 3, [0.5] * 3)
    assert least == pytest.approx([-0.3, -0.2])
    assert most == pytest.approx([0.2, 0.3])
    assert stasis_margins([most[0], -0.1], [0.2] * 3, [0.5] * 3).min() == pytest.approx(0.0)


@given(domains(st.integers(2, 3)) | loaded_domains(st.integers(2, 3)))
def test_vertices_satisfy_every_bound_and_enough_of_them_as_equalities(domain):
    corners = domain.vertices()
    assert corners.shape[1] == domain.contacts - 1
    for corner in corners:
        g = spring_force(corner)
        assert domain.margins(corner).min() >= -1e-13
        slack = np.concatenate((domain.forward - g, g + domain.backward))
        assert (np.abs(slack) <= 1e-13).sum() >= domain.contacts - 1
    if domain.contacts == 3 and len(corners) > 2:
        edges = np.roll(corners, -1, axis=0) - corners
        turned = np.roll(edges, -1, axis=0)
        assert (edges[:, 0] * turned[:, 1] - edges[:, 1] * turned[:, 0] > 0).all()


@settings(max_examples=25)
@given(domains(st.integers(2, 5)) | loaded_domains(st.integers(2, 5)), st.data())
def test_vertices_and_projections_are_what_linear_programming_finds(domain, data):
    n = domain.contacts
    pair = sorted(data.draw(st.permutations(range(n - 1)))[:2])
    corners = domain.vertices() if n < 4 else domain.projection(*pair)
    angles = np.arange(16) * np.pi / 8
    looked = np.column_stack((np.cos(angles), np.sin(angles))) if n > 2 else np.array([[1.0], [-1.0]])
    for direction in looked:
        whole = np.zeros(n - 1)
        whole[pair] = direction
        assert (corners @ direction).max() == pytest.approx(maximum(domain, whole), abs=1e-9)


@settings(max_examples=40)
@given(domains(st.integers(2, 6)) | loaded_domains(st.integers(2, 6)))
def test_the_facets_are_those_that_linear_programming_finds(domain):
    found = {(f.contact, f.side) for f in domain.facets()}
    for i in range(domain.contacts):
        for side in ("forward", "backward"):
            inside, _ = middle_of_facet(domain, Facet(i, side, domain.contacts))
            assert ((i, side) in found) == (inside > 1e-9), (i, side, inside)


@given(domains(st.integers(2, 6)) | loaded_domains(st.integers(2, 6)))
def test_normals_support_the_domain(domain):
    for facet in domain.facets():
        bound = (domain.forward if facet.direction > 0 else domain.backward)[facet.contact]
        assert maximum(domain, facet.normal) == pytest.approx(bound, abs=1e-9)
        unit = np.eye(domain.contacts)[facet.contact] * facet.direction
        assert facet.normal @ np.arange(1.0, domain.contacts) == pytest.approx(
            unit @ spring_force(np.arange(1.0, domain.contacts))
        )


@settings(max_examples=25)
@given(domains(st.integers(2, 6)), st.integers(0, 2**32 - 1))
def test_past_a_facet_its_contact_slides_in_its_direction_and_nobody_else(domain, seed):
    stiffness = np.exp(np.random.default_rng(seed).uniform(-2, 3, domain.contacts - 1))
    for facet in domain.facets():
        inside, section = middle_of_facet(domain, facet)
        start = np.concatenate(([0.0], np.cumsum(section / stiffness)))
        ground = (domain.forward.tolist(), domain.backward.tolist())
        crawler = Crawler(scene(domain.contacts, stiffness.tolist(), *ground, start=start.tolist()))
        crawler.advance(-0.1 * min(inside, 1.0) * facet.normal / stiffness)
        moved = crawler.displacement - start
        assert np.sign(moved.sum()) == facet.direction
        assert np.flatnonzero(np.abs(moved) > 1e-12).tolist() == [facet.contact]


@pytest.mark.parametrize(
    ("load", "ways"), [(0.0, {1}), (-0.03, {1}), (-0.04, {1, -1}), (-0.26, {1, -1}), (-0.27, {-1})]
)
def test_a_slope_decides_which_way_a_body_can_go_at_all(load, ways):
    """Three contacts: forward while 0.2 + 0.5 < 3 (0.5 + f), backward while 0.2 + 0.5 < 3 (0.2 - f)."""
    assert directions_of([StasisDomain(np.full(3, 0.2 - load), np.full(3, 0.5 + load))]) == ways


@settings(max_examples=25)
@given(loaded_domains(st.integers(2, 5)), st.integers(0, 2**32 - 1))
def test_past_a_facet_of_a_loaded_domain_its_contact_slides_alone(domain, seed):
    stiffness = np.exp(np.random.default_rng(seed).uniform(-2, 3, domain.contacts - 1))
    half = (domain.forward + domain.backward) / 2.0
    for facet in domain.facets():
        inside, section = middle_of_facet(domain, facet)
        if inside < 1e-6:
            continue
        start = np.concatenate(([0.0], np.cumsum(section / stiffness)))
        document = scene(domain.contacts, stiffness.tolist(), half.tolist(), half.tolist()).document()
        loads = (half - domain.forward).tolist()
        document |= {"loads": loads, "start": {"displacement": start.tolist()}}
        crawler = Crawler(Scene.model_validate(document))
        crawler.advance(-0.1 * min(inside, 1.0) * facet.normal / stiffness)
        moved = crawler.displacement - start
        assert np.sign(moved.sum()) == facet.direction
        assert np.flatnonzero(np.abs(moved) > 1e-12).tolist() == [facet.contact]


@given(st.floats(0.05, 20.0))
def test_three_equal_contacts_go_one_way_when_one_friction_is_twice_the_other(ratio):
    domain = StasisDomain([1.0] * 3, [ratio] * 3)
    if abs(ratio - 2.0) > 1e-9 and abs(ratio - 0.5) > 1e-9:
        assert domain.one_way == (max(ratio, 1.0 / ratio) > 2.0)
        assert len(domain.facets()) == len(domain.vertices()) == (3 if domain.one_way else 6)
        assert {f.direction for f in domain.facets()} == ({1, -1} if not domain.one_way else {1 if ratio > 1 else -1})


@pytest.mark.parametrize("excess", [0.0, 1e-15, 1e-13, -1e-13])
def test_a_side_as_thin_as_rounding_is_no_facet(excess):
    domain = StasisDomain([0.1] * 3, [0.2 * (1.0 + excess)] * 3)
    assert domain.one_way
    assert [f.direction for f in domain.facets()] == [1, 1, 1]


def test_many_equal_contacts_go_one_way_only_when_one_friction_exceeds_all_others_together():
    assert StasisDomain([1.0] * 10, [9.5] * 10).one_way
    assert not StasisDomain([1.0] * 10, [8.5] * 10).one_way
    assert len(StasisDomain(np.full(20_000, 1.0), np.full(20_000, 3.0)).facets()) == 40_000


@pytest.mark.parametrize(
    ("forward", "backward", "corners", "facets"),
    [
        ([0, 0, 0], [0, 0, 0], 1, []),
        ([1, 0, 1], [1, 0, 1], 2, [(1, 1), (1, -1)]),  # the domain is a segment, the free contact slides either way
        ([1, 1, 1], [0, 0, 0], 1, []),
        ([0, 1, 1], [0, 1, 1], 2, [(0, 1), (0, -1)]),
        ([0, 1, 1], [1, 1, 1], 4, [(0, 1), (0, -1), (1, 1), (2, 1)]),
    ],
)
def test_domains_without_friction_here_and_there(forward, backward, corners, facets):
    domain = StasisDomain(forward, backward)
    found = domain.vertices()
    assert len(found) == corners
    assert [(f.contact, f.direction) for f in domain.facets()] == facets
    assert not domain.one_way
    assert all(domain.margins(corner).min() >= 0.0 for corner in found)


def test_two_contacts_make_an_interval():
    domain = StasisDomain([0.2, 0.2], [0.5, 0.5])
    assert domain.vertices().tolist() == [[-0.2], [0.2]]
    assert [(f.contact, f.side, f.direction, f.normal.tolist()) for f in domain.facets()] == [
        (0, "forward", 1, [1.0]),
        (1, "forward", 1, [-1.0]),
    ]
    assert domain.one_way
    assert StasisDomain([1, 1], [1, 1]).facets() == ()  # critical: both contacts reach their bounds together


@pytest.mark.parametrize("scale", [1e-15, 1e-9, 1.0, 1e9 / 3.0])
@pytest.mark.parametrize(("backward", "sides"), [([0.2, 0.3, 0.25], 5), ([1.7, 1.9, 2.1], 3)])
def test_units_scale_the_polygon_and_nothing_else(scale, backward, sides):
    forward, backward = np.array([0.1, 0.3, 0.7]), np.array(backward)
    scaled = StasisDomain(scale * forward, scale * backward)
    assert len(scaled.vertices()) == len(scaled.facets()) == sides
    assert scaled.vertices() / scale == pytest.approx(StasisDomain(forward, backward).vertices(), rel=1e-12)


@given(domains(st.integers(2, 6)), st.integers(0, 2**32 - 1))
def test_the_object_and_the_functions_agree(domain, seed):
    section = np.random.default_rng(seed).normal(0, 0.5, domain.contacts - 1)
    assert domain.contains(section) == is_in_stasis(section, domain.forward, domain.backward)
    assert np.array_equal(domain.margins(section), stasis_margins(section, domain.forward, domain.backward))
    assert np.array_equal(domain.ranges(), tension_ranges(domain.forward, domain.backward))
    assert section_forces(spring_force(section)) == pytest.approx(section)
    assert domain.contains(np.zeros(domain.contacts - 1))


def test_a_domain_answers_what_it_cannot_do():
    with pytest.raises(ValueError, match="projection"):
        StasisDomain([1] * 4, [1] * 4).vertices()
    with pytest.raises(ValueError, match="sections 1 and 1"):
        StasisDomain([1] * 4, [1] * 4).projection(1, 1)
    with pytest.raises(ValueError, match=r"shapes \(2,\) and \(3,\)"):
        StasisDomain([1] * 2, [1] * 3)
    with pytest.raises(ValueError, match="contact 1 has 1 and -2 N; their sum, the friction of both directions"):
        StasisDomain([1, 1], [1, -2])
    with pytest.raises(ValueError, match="forward: the bounds sum to -1 N; the sum must be >= 0"):
        StasisDomain([1, -2], [1, 3])
    with pytest.raises(ValueError, match="backward: contact 1 has nan N"):
        StasisDomain([1, 1], [1, np.nan])
    with pytest.raises(ValueError, match="read-only"):
        StasisDomain([1, 1], [1, 1]).forward[0] = 2.0


@pytest.mark.parametrize(
    ("name", "ends", "directions"),
    [  # at t = 0, 1/4, 1/2, 3/4, 1: the lesser of both frictions, and where the upper and the lower end let the body go
        ("two_anchor_a", [1.0, 0.5, 1.0, 0.5, 1.0], [(), (-1, 1), (), (1, -1), ()]),
        ("two_anchor_b", [0.5, 1.0, 0.5, 1.0, 0.5], [(1, -1), (), (-1, 1), (), (1, -1)]),
        ("two_anchor_c", [0.5, 0.5, 1.5, 0.5, 0.5], [(), (-1, 1), (), (1, -1), ()]),
    ],
)
def test_the_domains_of_the_friction_strategies(name, ends, directions):
    times, evolution = domain_evolution(load_scene(name).drive)
    assert times.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert [domain.vertices()[:, 0].tolist() for domain in evolution] == [[-end, end] for end in ends]
    for domain, (*expected,) in zip(evolution, directions, strict=True):
        facets = sorted(domain.facets(), key=lambda f: -f.normal[0])
        assert [f.direction for f in facets] == expected


def test_an_evolution_asks_only_for_times_and_friction():
    drive = SimpleNamespace(times=[0.0, 2.0], forward=np.ones((2, 3)), backward=np.full((2, 3), 2.5))
    times, evolution = domain_evolution(drive)
    assert times.tolist() == [0.0, 2.0]
    assert all(domain.one_way for domain in evolution)


def test_section_forces_stay_in_the_domain_whatever_graph_the_springs_make():
    between = [[0, 1], [1, 2], [2, 3], [3, 4], [0, 4], [1, 3]]
    rows = np.random.default_rng(3).uniform(-2, 2, (8, len(between)))
    rows[0] = 0.0
    graph = {
        "name": "graph",
        "body": {"contacts": [0, 1, 2, 3, 4], "links": {"stiffness": [1, 2, 3, 1, 2, 3], "between": between}},
        "friction": {"forward": [0.1, 0.2, 0.3, 0.2, 0.1], "backward": 0.4},
        "drive": {"times": list(range(8)), "actuation": rows.tolist()},
    }
    run = simulate(Scene.model_validate(graph))
    section = section_forces(run.scene.body.spring_force(run.tension))
    times, (domain, *_) = domain_evolution(run.scene.drive)
    margins = domain.margins(section)
    assert times.size == 8
    assert margins.min() > -1e-9
    before, after = run.contact_state[1:-1], run.contact_state[2:]
    sliding = (before == after) & (before != 0)
    assert sliding.any(axis=0).all()
    assert np.abs(margins[1:-1][sliding]).max() < 1e-9
