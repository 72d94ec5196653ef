"""Bodies besides the chain: graphs, segments, hybrids, the plane; each against something known."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, Scene, load_scene, simulate
from crawler_model.theory.regularity import check_regularity

from .chains import coarse
from .segments import segment


def test_a_mesh_that_is_critical_is_judged_as_the_continuum():
    """Four equal cells and mu_minus = 3 mu_plus: the mesh balances, the continuum does not."""
    run = simulate(segment(0.5, elements=3))
    assert run.unique
    assert run.uniqueness_margin == pytest.approx(0.25)
    critical = {"contacts": [1.5], "links": {"stiffness": 1.0}}
    document = segment(0.5, elements=3).document()
    document["body"] |= critical
    document["friction"] = {"forward": 0.3, "backward": 0.3}
    document["drive"]["actuation"] = [[0, 0], [0.5, 0.5], [0, 0]]
    assert simulate(Scene.model_validate(document)).uniqueness_margin == 0.0  # the trunk dragged back balances the foot


def test_a_segment_between_contacts_is_a_chain_and_in_a_ring_it_is_not():
    body = {
        "segments": [
            {"name": "a", "from": 1.0, "to": 2.0, "stiffness": 1.0, "friction": {"isotropic": 1}, "elements": 3}
        ],
        "contacts": [0.0, 3.0],
        "links": {"stiffness": 1.0},
    }
    scene = Scene.model_validate({"name": "x", "body": body, "friction": {"isotropic": 1.0}})
    assert scene.body.is_chain
    assert scene.body.isolated.tolist() == [0, 5]
    assert scene.body.share == pytest.approx([1 / 3, 1 / 18, 1 / 9, 1 / 9, 1 / 18, 1 / 3])
    assert scene.body.joints.tolist() == [[0, 2], [3, 1], [2, 3]]
    body["links"] |= {"between": [[0, "a.from"], ["a.to", 1], [0, 1]]}
    ring = Scene.model_validate({"name": "x", "body": body, "friction": {"isotropic": 1.0}})
    assert not ring.body.is_chain
    assert ring.body.link_springs.tolist() == [1, 5, 0]
    assert ring.body.ends[ring.body.segments[0].springs].tolist() == [[1, 2], [2, 3], [3, 4]]


def test_a_chain_written_as_a_graph_moves_the_same():
    rng = np.random.default_rng(5)
    n = 7
    stiffness = np.exp(rng.uniform(-1, 1, n - 1))
    data = {
        "name": "x",
        "body": {"contacts": list(range(n)), "links": {"stiffness": stiffness.tolist()}},
        "friction": {"forward": rng.uniform(0.1, 1, n).tolist(), "backward": rng.uniform(0.1, 1, n).tolist()},
        "drive": {"times": [0, 1, 2, 3], "actuation": [[0] * (n - 1), *rng.uniform(-2, 2, (3, n - 1)).tolist()]},
    }
    chain = simulate(Scene.model_validate(data))
    order = rng.permutation(n - 1)
    data["body"]["links"] = {
        "stiffness": stiffness[order].tolist(),
        "between": [[int(i) + 1, int(i)] if i % 2 else [int(i), int(i) + 1] for i in order],
    }
    data["drive"]["actuation"] = np.array(data["drive"]["actuation"])[:, order].tolist()
    graph = simulate(Scene.model_validate(data))
    assert not graph.scene.body.is_chain
    assert graph.displacement == pytest.approx(chain.displacement, abs=1e-13)
    assert graph.tension == pytest.approx(chain.tension[:, order], abs=1e-12)
    assert graph.events == chain.events


def test_a_redundant_spring_shares_its_load():
    """Two springs side by side are one of the sum of their stiffnesses."""
    one = {"name": "x", "body": {"contacts": [0, 1], "links": {"stiffness": 3.0}}, "friction": {"isotropic": 1.0}}
    drive = {"times": [0, 1, 2], "friction": {"forward": [0.5, 0.7, 0.2], "backward": 1.0}}
    two = {**one, "body": {"contacts": [0, 1], "links": {"stiffness": [1, 2], "between": [[0, 1], [0, 1]]}}}
    x = simulate(Scene.model_validate({**one, "drive": {**drive, "actuation": [[0], [2], [-3]]}})).displacement
    y = simulate(
        Scene.model_validate({**two, "drive": {**drive, "actuation": [[0, 0], [2, 2], [-3, -3]]}})
    ).displacement
    assert y == pytest.approx(x, abs=1e-14)


def test_three_springs_travel_as_rational_arithmetic_says():
    run = simulate(load_scene("three_springs"))
    assert run.per_period[0] == pytest.approx(float(Fraction(71, 600)), abs=1e-15)
    assert run.per_period[1:] == pytest.approx(float(Fraction(9, 80)), abs=1e-14)


def test_a_hybrid_counts_every_part_once():
    run = simulate(coarse("hybrid_body"), duration=2.0)
    mesh = run.scene.body
    x = run.displacement[-1]
    trunk = x[mesh.segments[0].contacts]
    mean = (trunk[:-1] + trunk[1:]).sum() / 2 / mesh.segments[0].elements
    assert run.net_translation[-1] == pytest.approx((mean + x[mesh.isolated[0]]) / 2, abs=1e-15)
    assert run.waypoint_displacement[-1] == pytest.approx([x[mesh.isolated[0]], trunk[0], trunk[-1]])
    assert mesh.station_share.tolist() == [0.5, 0.25, 0.25]
    assert run.energy.relative_residual < 1e-13


def test_a_relaxed_start_pulls_nobody():
    bent = Scene.model_validate(load_scene("three_springs").document() | {"start": "relaxed"})
    for one in (coarse("peristaltic_segment", 30), bent):
        crawler = Crawler(one)
        assert np.abs(crawler.spring_force).max() < 1e-13


def test_commands_of_a_segment_are_one_strain_and_one_friction():
    crawler = Crawler(coarse("hybrid_body"))
    crawler.advance([0.2, 0.1], forward=[0.5, 0.1], backward=[0.6, 0.2])
    mesh = crawler.body
    trunk = mesh.segments[0]
    assert crawler.actuation[trunk.springs] == pytest.approx(0.1 / trunk.elements)
    assert crawler.forward[trunk.contacts].sum() == pytest.approx(0.1)
    assert crawler.backward[mesh.isolated[0]] == 0.6
    assert crawler.row == pytest.approx([0.2, 0.1, 0.5, 0.1, 0.6, 0.2])
    columns = crawler.scene.columns
    assert columns.names == (
        *("link_0", "trunk"),
        *("contact_0/forward", "trunk/forward"),
        *("contact_0/backward", "trunk/backward"),
    )
    assert columns.aliases["trunk/friction"].tolist() == [3, 5]
    assert columns.aliases["contact_0/backward"].tolist() == [4]
    with pytest.raises(CommandError, match=r"actuation: shape \(3,\); it must be \(2,\)"):
        crawler.advance([0.0, 0.0, 0.0])


def test_commands_along_a_wave_have_a_name_each():
    columns = coarse("friction_wave_segment", 2).columns
    strains, contacts = [f"foot/element_{j}" for j in range(2)], [f"foot/contact_{j}" for j in range(3)]
    assert columns.names == (*strains, *(f"{c}/{side}" for side in ("forward", "backward") for c in contacts))
    assert columns.aliases["foot"].tolist() == [0, 1]
    assert columns.aliases["foot/forward"].tolist() == [2, 3, 4]
    assert columns.aliases["foot/friction"].tolist() == [2, 3, 4, 5, 6, 7]


def test_commands_in_the_plane_have_a_name_for_each_axis():
    columns = load_scene("planar_rectilinear").columns
    assert columns.names[:2] == ("link_0/x", "link_0/y")
    assert not any("direction" in name for name in columns.aliases)  # friction by directions is not commanded
    free = load_scene("planar_three_points").columns
    assert free.names[-3:] == ("contact_0/friction", "contact_1/friction", "contact_2/friction")
    assert {name: at.tolist() for name, at in free.aliases.items()} == {n: [i] for i, n in enumerate(free.names)}


def test_a_segment_is_as_compliant_as_its_table():
    scene = segment(0.2, elements=3, stiffness={"at": [0.0, 1.0], "value": [1.0, 3.0]})
    assert (1.0 / scene.body.stiffness).sum() == pytest.approx(np.log(3.0) / 2.0, rel=1e-6)  # of 1 / (1 + 2 xi)


def test_regularity_of_friction():
    regular = check_regularity(load_scene("two_anchor_a").drive)
    assert (regular.least, regular.greatest, regular.rate) == (0.5, 1.5, 2.0)
    assert regular.is_regular
    wave = check_regularity(coarse("friction_wave_segment", 20).drive)
    assert wave.least == pytest.approx(0.05, abs=1e-3)
    assert wave.rate == pytest.approx(2 * np.pi * 0.15, rel=0.01)  # c |mu'|, of a polygon inscribed in the sine
    document = load_scene("two_contacts_anisotropic").document()
    document["drive"] = {"times": [0, 1], "period": 1.25, "actuation": [0, 0], "friction": {"isotropic": [1, 2]}}
    back = check_regularity(Scene.model_validate(document).drive)
    assert back.rate == pytest.approx(4.0)  # from 2 N back to 1 N in a quarter of a second
    document = load_scene("two_contacts_anisotropic").document()
    document["friction"] = {"forward": [0.2, 0.0], "backward": 0.5}
    none = check_regularity(Scene.model_validate(document).drive)
    assert not none.is_regular
    assert none.where == "contact_1/forward"


def test_the_plane_contains_the_line():
    plane = simulate(load_scene("planar_rectilinear"))
    line = simulate(load_scene("two_contacts_anisotropic"))
    tolerance = 1e-4 * 0.1
    assert plane.displacement[..., 0] == pytest.approx(line.displacement, abs=tolerance)
    assert np.abs(plane.displacement[..., 1]).max() == 0.0
    assert plane.per_period[1:, 0] == pytest.approx(0.08, abs=tolerance)


def test_three_points_walk_in_the_plane():
    run = simulate(load_scene("planar_three_points"))
    way = np.array([0.06, 0.03])
    gained = (1.0 - 0.3 / 20 / np.linalg.norm(way)) * way
    assert run.per_period[1:] == pytest.approx(np.tile(gained, (9, 1)), abs=1e-6)
    assert run.unique


def test_exact_is_refused_in_the_plane_and_says_why():
    with pytest.raises(CommandError, match="in the plane they are curved"):
        simulate(load_scene("planar_rectilinear"), method="exact")
    assert simulate(load_scene("planar_rectilinear"), duration=0.1).method == "catch_up"


def test_a_finer_tolerance_is_followed_in_the_plane():
    document = load_scene("planar_three_points").document()
    document["drive"]["actuation"][2] = [[0.03, 0.05], [-0.06, -0.03], [0.03, -0.02]]  # now paths are curved
    runs = {}
    for tolerance in (1e-2, 1e-4, 1e-7):
        run = simulate(Scene.model_validate(document | {"tolerance": tolerance}), duration=3.0)
        runs[tolerance] = run.displacement[-1]
        assert run.violation < 1e-8
        assert run.energy.relative_residual < 30 * tolerance
    errors = [np.abs(runs[t] - runs[1e-7]).max() for t in (1e-2, 1e-4)]
    assert errors[0] < 20 * 1e-2 * 0.06
    assert errors[1] < 20 * 1e-4 * 0.06
    assert errors[0] > 0.0


def test_planar_commands_have_two_numbers_a_link():
    crawler = Crawler(load_scene("planar_three_points"))
    step = crawler.advance([[0.06, 0.0], [0.0, 0.0], [-0.06, 0.0]], forward=[0.3, 0.3, 0.1])
    assert step.velocity.shape == (3, 2)
    assert crawler.friction.tolist() == [0.3, 0.3, 0.1]
    assert crawler.shape == pytest.approx(crawler.body.elongation(crawler.displacement), abs=1e-13)
    assert crawler.copy() == crawler
    with pytest.raises(CommandError, match=r"actuation: shape \(6,\); it must be \(3, 2\)"):
        crawler.advance(np.zeros(6))
    with pytest.raises(CommandError, match="backward"):
        crawler.advance(np.zeros((3, 2)), backward=[1, 1, 1])


def test_friction_by_directions_must_stay_convex():
    document = load_scene("planar_rectilinear").document()
    document["friction"] = {"directions": [0.0, 1.0, 2.0, 4.0], "value": 0.4}
    crawler = Crawler(Scene.model_validate(document))
    crawler.advance([[0.1, 0.0]], forward=[[0.3, 0.3, 0.3, 0.3]] * 2)
    with pytest.raises(CommandError, match=r"forward: friction\.directions: not convex: contact 1"):
        crawler.advance([[0.0, 0.0]], forward=[[0.3, 0.3, 0.3, 0.3], [0.1, 9.0, 0.1, 0.1]])
    assert crawler.friction[0] == 0.3


def test_friction_commanded_to_a_balance_of_segments_is_seen():
    parts = [
        {"name": name, "from": at, "to": at + 1.0, "stiffness": 1000.0, "elements": 10}
        | {"friction": {"forward": 0.1, "backward": 0.35}}
        for name, at in (("a", 0.0), ("b", 2.0))
    ]
    body = {"segments": parts, "links": {"stiffness": 5.0}}
    crawler = Crawler(Scene.model_validate({"name": "balance", "body": body}))
    assert crawler.advance([0, 0, 0], forward=[1.0, 1.0], backward=[1.0, 1.0]).unique
    step = crawler.advance([3.0, 0.0, 0.0])
    assert not step.unique
    assert step.translation_interval == pytest.approx((-1.3995, 1.3995))


def test_a_stretch_without_friction_leaves_the_translation_open():
    table = {"at": [0, 0.3, 0.301, 0.699, 0.7, 1], "value": [1, 1, 0, 0, 1, 1]}
    scene = segment(2.0, elements=100, friction={"isotropic": table})
    run = simulate(scene, duration=0.5)
    assert run.uniqueness_margin is None
    assert not run.unique


def test_a_wave_keeps_its_own_samples_beside_another():
    def drive(**friction):
        document = load_scene("ten_contact_wave").document()
        document["drive"]["wave"] |= {"samples": 4}
        document["drive"] |= friction
        return Scene.model_validate(document | {"start": "relaxed"}).drive

    alone = drive()
    period = alone.period
    both = drive(friction_wave={"amplitude": 0.0, "mean": 1.0, "wavelength": 1.0, "period": period, "samples": 100})
    at = np.rint(np.array([0.03, 0.125, 0.4]) * period * 1e9).astype(np.int64)
    links = alone.actuation.shape[1]
    assert both.sample(at)[:, :links] == pytest.approx(alone.sample(at)[:, :links], abs=1e-9)


def test_an_account_that_gives_all_back_still_closes():
    document = load_scene("two_contacts_anisotropic").document()
    document["drive"]["actuation"] = [[0.0], [0.005], [0.0]]  # only stretches, and comes back
    run = simulate(Scene.model_validate(document))
    assert run.energy.relative_residual < 1e-14


def test_the_plane_gives_no_interval():
    assert Crawler(load_scene("planar_three_points")).advance(np.zeros((3, 2))).translation_interval is None


@pytest.mark.parametrize("tolerance", [1e-4, 1e-5, 1e-6, 1e-7])
def test_a_curved_path_in_the_plane_does_not_spend_its_steps(tolerance):
    document = load_scene("planar_three_points").document() | {"tolerance": tolerance}
    document["drive"]["actuation"][2] = [[0.03, 0.05], [-0.06, -0.03], [0.03, -0.02]]
    run = simulate(Scene.model_validate(document), duration=5.0, rate=1.0)
    assert run.overspent == 0


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5])
def test_the_tolerance_is_kept_with_friction_by_directions(tolerance):
    rng = np.random.default_rng(3)
    strokes = rng.uniform(-0.5, 0.5, (4, 4, 2))
    strokes[0] = strokes[-1] = 0.0
    scene = {
        "name": "p",
        "dimension": 2,
        "body": {
            "contacts": rng.uniform(0, 1, (4, 2)).tolist(),
            "links": {"stiffness": [1.0, 2.0, 0.5, 1.5], "between": [[0, 1], [1, 2], [2, 3], [3, 0]]},
        },
        "friction": {"directions": [0, 2.1, 4.2], "value": [[0.1] * 3, [0.2] * 3, [0.15] * 3, [0.25] * 3]},
        "drive": {"times": [0, 0.3, 0.6, 1.0], "period": 1.0, "actuation": strokes.tolist()},
    }
    rough, fine = (
        simulate(Scene.model_validate(scene | {"tolerance": t}), duration=2.0, rate=1.0) for t in (tolerance, 1e-7)
    )
    assert np.abs(rough.displacement - fine.displacement).max() < 6 * tolerance  # six ramps, about a stroke each
    assert rough.overspent == fine.overspent == 0
    assert np.abs(fine.displacement[-1]).max() > 0.01
