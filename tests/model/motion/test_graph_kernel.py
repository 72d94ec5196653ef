"""The active set of graphs, on its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from crawler_model import Crawler, Scene, SceneError, load_scene
from crawler_model.motion.graph import active_set as graph_kernel
from crawler_model.motion.graph.active_set import Network, build_network, move, workspace
from crawler_model.motion.graph.elimination import WIDE, eliminate

from ..hard_cases import complete, grid, ladder, net


def velocities(network: Network, load, bound, rounds):
    """The verdict and the velocities, in the order of the contacts."""
    order = network.order
    n = order.size
    v, side = np.zeros(n), np.zeros(n, np.int8)
    given = load[order], -bound[order], bound[order], np.zeros(n)
    springs = (network.conductances, *network.layout[5:])
    verdict, _ = move(springs, *given, rounds, *workspace(network), v, side, np.arange(n))
    found = np.empty(n)
    found[order] = v
    return verdict, found


@pytest.mark.parametrize("between", [ladder(24), complete(7), grid(9)], ids=["ladder", "complete", "grid"])
def test_however_many_rounds_it_has_it_gives_the_answer_or_gives_up(between):
    n = 1 + max(map(max, between))
    body = net(n, between, "exact").body
    laplacian = np.zeros((n, n))
    for (a, b), k in zip(body.ends, body.stiffness, strict=True):
        laplacian[[a, b, a, b], [a, b, b, a]] += [k, k, -k, -k]
    rng = np.random.default_rng(1)
    for _ in range(20):
        load, bound = rng.normal(size=n) * 3.0, rng.uniform(0.5, 1.5, n)
        load -= load.mean()
        network = build_network(body)
        verdict, v = velocities(network, load, bound, 1000)
        assert verdict == 0
        force = load - laplacian @ v
        assert (np.abs(force) <= bound * (1.0 + 1e-13)).all()
        assert force[v != 0.0] == pytest.approx((np.sign(v) * bound)[v != 0.0], rel=1e-13)
        for rounds in range(40):
            verdict, again = velocities(network, load, bound, rounds)
            assert verdict in (-1, 0)
            if verdict == 0:
                assert again == pytest.approx(v, abs=1e-13)
        assert velocities(network, load, bound, 1)[0] == -1
        assert verdict == 0


@pytest.mark.parametrize(("between", "wide"), [(ladder(60), False), (grid(20), True)], ids=["narrow", "wide"])
def test_elimination_solves_each_group_of_sliding_contacts(between, wide):
    n = 1 + max(map(max, between))
    rng = np.random.default_rng(3)
    network = build_network(replace(net(n, between, "exact").body, stiffness=10.0 ** rng.uniform(-2, 2, len(between))))
    heads, near = network.layout.heads, network.layout.near
    joined = csr_array((network.conductances, near, heads), shape=(n, n)).toarray()
    assert (joined == joined.T).all()
    assert (network.width > WIDE) == wide
    work, floats, ints, sliding, velocity = *workspace(network), np.zeros(n)
    for part in (0.0, 0.1, 0.3, 0.5, 0.6, 0.7, 0.9, 1.0 - 1.0 / n, 1.0):
        sliding[:] = 0
        sliding[rng.permutation(n)[: round(part * n)]] = 1
        load, places, free = rng.normal(size=n), np.arange(n), np.flatnonzero(sliding)
        springs = network.conductances, heads, near
        assert eliminate(springs, work, floats[0], ints, load, sliding, velocity, places) == (free.size < n)
        assert (velocity[sliding == 0] == 0.0).all()
        laplacian = (np.diag(joined.sum(axis=1)) - joined)[np.ix_(free, free)]
        if free.size == n:  # the last contact is held; it takes what is left of the loads
            assert velocity[-1] == 0.0
            free, laplacian = free[:-1], laplacian[:-1, :-1]
        scale = np.abs(laplacian) @ np.abs(velocity[free]) + np.abs(load[free])
        assert (np.abs(laplacian @ velocity[free] - load[free]) <= 1e-13 * scale.max(initial=1.0)).all()
        _, names = connected_components(joined * np.outer(sliding, sliding))
        last = {name: p for p, name in enumerate(names)}
        assert [last[name] for name in names] == ints[1].tolist()


@pytest.mark.parametrize("between", [[(i, (i + 1) % 400) for i in range(400)], ladder(400)], ids=["ring", "ladder"])
def test_long_rows_of_contacts_start_to_slide_together(between):
    """Smooth loads of both signs make long blocks slide, of which only the middle is beyond its bounds at rest."""
    n = 1 + max(map(max, between))
    network = build_network(net(n, between, "exact").body)
    laplacian = np.zeros((n, n))
    for a, b in between:
        laplacian[[a, b, a, b], [a, b, b, a]] += [1.0, 1.0, -1.0, -1.0]
    rng = np.random.default_rng(2)
    for waves in (1, 3, 8, 20):
        angle = 2.0 * np.pi * (waves * np.arange(n) / n + rng.uniform())
        load, bound = 2.0 * np.sin(angle), rng.uniform(0.9, 1.1, n) + 0.9 * np.abs(np.cos(angle))
        load -= load.mean()
        verdict, v = velocities(network, load, bound, graph_kernel.most_rounds(n))
        assert verdict == 0
        force, close = load - laplacian @ v, 1e-14 * (np.abs(laplacian) @ np.abs(v)).max()
        assert (np.abs(force) <= bound + close).all()
        assert force[v != 0.0] == pytest.approx((np.sign(v) * bound)[v != 0.0], abs=close)
        assert 10 < np.count_nonzero(v) < n


def test_a_command_that_is_in_force_changes_nothing():
    crawler = Crawler(load_scene("three_springs"))
    crawler.advance([0.3, 0.0, -0.2])
    before = crawler.copy()
    step = crawler.advance([0.3, 0.0, -0.2])
    assert (crawler.displacement == before.displacement).all()
    assert (crawler.tension == before.tension).all()
    assert not crawler.gained.any()
    assert (step.events, step.work, step.dissipation) == (0, 0.0, 0.0)


@pytest.mark.parametrize("method", ["exact", "catch_up"])
def test_a_search_that_gives_up_is_said_to_be_no_matter_of_the_budget(method, monkeypatch):
    crawler = net(4, complete(4), method)
    monkeypatch.setattr(graph_kernel, "most_rounds", lambda contacts: 0)
    step = crawler.advance([30.0, 0.0, -20.0, 0.0, 0.0, 0.0])
    assert (step.unsolved, step.overspent) == (1, 0)
    assert step.certificate.violation > 1.0
    assert not crawler.gained.any()
    monkeypatch.undo()
    step = crawler.advance([31.0, 0.0, -20.0, 0.0, 0.0, 0.0])
    assert (step.unsolved, step.overspent) == (0, 0)


def test_contacts_that_are_joined_too_widely_are_refused(monkeypatch):
    monkeypatch.setattr(graph_kernel, "_MOST_NUMBERS", 8)
    body = {"contacts": [0, 1, 2], "links": {"stiffness": 1.0, "between": [[0, 1], [1, 2], [0, 2]]}}
    triangle = {"name": "t", "body": body, "friction": {"isotropic": 1.0}}
    assert Crawler(Scene.model_validate(triangle)).advance([0.0] * 3).unique
    monkeypatch.setattr(graph_kernel, "_MOST_NUMBERS", 5)
    with pytest.raises(SceneError, match=r"the links of 3 contacts need a band matrix with 6.0e\+00 entries"):
        Crawler(Scene.model_validate(triangle | {"name": "other"}))
