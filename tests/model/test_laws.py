"""What holds for every crawler, over random chains."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crawler_model import Crawler, Scene, simulate

from .chains import from_rows, rows

METHODS = ("exact", "catch_up")


def states(driven, **options):
    return simulate(from_rows(*driven), **options).waypoint_displacement


def size(*arrays) -> float:
    return max(1.0, *(float(np.abs(a).max()) for a in arrays))


@given(rows(), st.floats(0.1, 500.0))
def test_the_path_matters_and_the_speed_does_not(driven, rate):
    one, other = (simulate(from_rows(*driven), rate=r) for r in (1.0, rate))
    assert other.waypoint_displacement == pytest.approx(one.waypoint_displacement, abs=1e-11)
    assert other.unique == one.unique
    assert other.visited_margin == pytest.approx(one.visited_margin, abs=1e-12)


@given(rows(), st.integers(0, 2**32 - 1))
def test_a_detour_in_time_changes_nothing(driven, seed):
    crawler, other = Crawler(from_rows(*driven)), Crawler(from_rows(*driven))
    rng = np.random.default_rng(seed)
    before = [row[0] for row in driven[1:]]
    for row in zip(*driven[1:], strict=True):
        crawler.advance(*row)
        for part in (*np.sort(rng.random(3)), 1.0):
            other.advance(*(b + part * (r - b) for b, r in zip(before, row, strict=True)))
        before = row
        assert other.displacement == pytest.approx(crawler.displacement, abs=1e-11)


@given(rows())
def test_the_energy_account_closes(driven):
    run = simulate(from_rows(*driven), rate=10.0)
    energy = run.energy
    whole = size(energy.work, energy.dissipation, energy.stored)
    assert abs(energy.stored + energy.dissipation - energy.work) < 1e-12 * whole
    assert energy.dissipation >= 0.0
    assert run.violation < 1e-12


@given(rows())
def test_the_certificate_of_an_exact_ramp_is_rounding(driven):
    crawler = Crawler(from_rows(*driven))
    whole = size(*driven) ** 2 * driven[0].size
    for row in zip(*driven[1:], strict=True):
        certificate = crawler.advance(*row).certificate
        assert abs(certificate.energy_residual) < 1e-12 * whole
        assert certificate.violation < 1e-12 * whole
        assert certificate.complementarity < 1e-12 * whole


@given(rows())
def test_the_certificate_of_catch_up_shows_its_error(driven):
    for method in METHODS:
        crawler = Crawler(from_rows(*driven), method)
        residual = sum(abs(crawler.advance(*row).certificate.energy_residual) for row in zip(*driven[1:], strict=True))
        if method == "exact":
            exact, x = residual, crawler.displacement
    if np.abs(crawler.displacement - x).max() > 1e-6:
        assert residual > exact


@pytest.mark.parametrize("method", METHODS)
@given(driven=rows())
def test_the_mirror_image(method, driven):
    stiffness, actuation, forward, backward = driven
    mirrored = (stiffness[::-1], actuation[:, ::-1], backward[:, ::-1], forward[:, ::-1])
    here, there = (states(d, method=method, rate=3.0) for d in (driven, mirrored))
    assert there[:, ::-1] == pytest.approx(-here, abs=1e-11 * size(here))


@pytest.mark.parametrize("method", METHODS)
@given(driven=rows(), lengths=st.sampled_from([1e-9, 1e-3, 7.0, 1e9]), forces=st.sampled_from([1e-9, 1e-3, 7.0, 1e9]))
def test_units_do_not_matter(method, driven, lengths, forces):
    stiffness, actuation, forward, backward = driven
    scaled = (stiffness * forces / lengths, actuation * lengths, forward * forces, backward * forces)
    here, there = (simulate(from_rows(*d), method=method, rate=3.0) for d in (driven, scaled))
    assert there.waypoint_displacement / lengths == pytest.approx(here.waypoint_displacement, abs=1e-11)
    assert there.energy.work / (lengths * forces) == pytest.approx(here.energy.work, abs=1e-10, rel=1e-10)
    assert there.unique == here.unique


@pytest.mark.parametrize("method", METHODS)
@given(driven=rows())
def test_same_input_same_bits(method, driven):
    one, two = (simulate(from_rows(*driven), method=method, rate=9.0) for _ in range(2))
    for name in ("displacement", "tension", "net_translation", "contact_state", "waypoint_displacement"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


@given(rows())
def test_a_copy_goes_its_own_way(driven):
    crawler = Crawler(from_rows(*driven))
    commands = list(zip(*driven[1:], strict=True))
    crawler.advance(*commands[0])
    fork = crawler.copy()
    assert fork == crawler
    for row in commands[1:]:
        fork.advance(*row)
    if fork.displacement.any():
        assert fork != crawler
    for row in commands[1:]:
        crawler.advance(*row)
    assert fork == crawler


@given(rows())
def test_moving_contacts_are_at_the_bound_that_opposes_them(driven):
    crawler = Crawler(from_rows(*driven))
    before = crawler.displacement
    for row in zip(*driven[1:], strict=True):
        step = crawler.advance(*row)
        assert crawler.displacement - before == pytest.approx(step.velocity, abs=1e-12)
        assert (np.sign(step.velocity) == crawler.contact_state).all()
        assert crawler.shape == pytest.approx(np.diff(crawler.displacement), abs=1e-11)
        assert crawler.tension == pytest.approx(driven[0] * (crawler.shape - row[0]), abs=1e-11 * size(driven[0]) * 9)
        before = crawler.displacement


@given(rows())
def test_a_hold_changes_nothing(driven):
    crawler = Crawler(from_rows(*driven))
    crawler.advance(*(row[1] for row in driven[1:]))
    held = crawler.copy()
    step = held.advance(*(row[1] for row in driven[1:]))
    for name in ("displacement", "shape", "tension", "net_translation", "actuation", "forward"):
        assert np.array_equal(getattr(held, name), getattr(crawler, name))
    assert not held.contact_state.any()
    assert step.events == 0
    assert step.work == 0.0


def test_a_scene_of_the_oracle_survives_a_round_trip():
    scene = from_rows(*(np.ones(2), np.zeros((2, 2)), np.ones((2, 3)), np.ones((2, 3))))
    assert Scene.model_validate(scene.document()) == scene
