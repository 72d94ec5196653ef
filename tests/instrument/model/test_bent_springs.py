"""Springs with curves, limits of tension, passive springs and stops: closed forms, rational numbers, OSQP, messages."""

from __future__ import annotations

import io
import json
import re
from typing import Any

import numpy as np
import osqp
import pytest
import scipy.sparse as sp

from crawler_command.check import choose_rate, print_report
from crawler_command.screen import Screen
from crawler_lab.sweep.many_runs import simulate_many
from crawler_model.crawler.crawler import Crawler
from crawler_model.errors import CommandError, SceneError
from crawler_model.run.simulate import simulate
from crawler_model.scene.file import load_scene, parse_scene
from crawler_model.scene.scene import Scene

from .bent_bodies import draw_body
from .rational_bends import NotUniqueError


def scene_of(document: dict[str, Any]) -> Scene:
    """A scene from plain data."""
    return parse_scene(json.dumps(document))


def two_contacts(link: dict[str, Any], stroke: float, friction: float = 0.5, **body: Any) -> Scene:
    """Two contacts that a link pulls, and that only slide forward."""
    return scene_of(
        {
            "name": "two",
            "body": {"contacts": [0.0, 1.0], "links": [link], **body},
            "friction": {"forward": friction, "backward": 100.0},
            "drive": {"times": [0, 1, 2], "period": 2, "actuation": [[0], [stroke], [0]]},
        }
    )


@pytest.mark.parametrize("method", ["exact", "catch_up"])
class TestClosedForms:
    """Displacement per period, after the first ([theory] section 14)."""

    def gain(self, link, stroke, method):
        run = simulate(two_contacts(link, stroke), method=method, duration=8.0)
        assert run.unique
        np.testing.assert_allclose(run.per_period[1:], run.per_period[1], rtol=1e-12, atol=1e-15)
        return run.per_period[1]

    def test_a_tendon_beside_a_return_spring(self, method):
        for tendon, spring, stroke in ((8.0, 2.0, 1.0), (3.0, 0.5, 2.0)):
            link = {"stiffness": tendon, "tension": {"least": 0.0}, "passive": {"stiffness": spring}}
            gain = (tendon * stroke - 0.5) / (spring + tendon) - 0.5 / spring
            assert self.gain(link, -stroke, method) == pytest.approx(max(gain, 0.0), abs=1e-14)

    @pytest.mark.parametrize(("most", "moves"), [(2.0, True), (0.51, True), (0.49, False), (0.1, False)])
    def test_a_motor_that_stalls(self, method, most, moves):
        link = {"stiffness": 8.0, "tension": {"least": -most, "most": most}}
        assert self.gain(link, 1.0, method) == pytest.approx((1.0 - 2.0 * 0.5 / 8.0) * moves, abs=1e-14)

    def test_stops(self, method):
        stops = {"shortest": -0.25, "longest": 0.1, "stiffness": 100.0}
        assert self.gain({"stiffness": 8.0, "passive": {"stops": stops}}, -1.0, method) == pytest.approx(103 / 432)

    def test_contacts_that_touch(self, method):
        stops = {"shortest": "contact", "stiffness": 100.0}
        link = {"stiffness": 8.0, "passive": {"stops": stops}}
        scene = two_contacts(link, -1.0, radius=[0.3, 0.45])  # they touch at z = -1/4
        stops["longest"] = -0.3
        with pytest.raises(SceneError, match=r"stops\.longest: -0\.3 m; the contacts touch at -0\.25 m already"):
            two_contacts(link, -1.0, radius=[0.3, 0.45])
        run = simulate(scene, method=method, duration=8.0)
        assert run.per_period[1] == pytest.approx((8.0 + 25.0 - 0.5) / 108.0 - 0.5 / 8.0)


def test_a_motor_that_is_as_strong_as_friction_may_move_or_not():
    link = {"stiffness": 8.0, "tension": {"least": -0.5, "most": 0.5}}
    crawler = Crawler(two_contacts(link, 1.0))
    step = crawler.advance([1.0])
    assert not step.unique
    least, most = step.translation_interval
    assert least == pytest.approx(0.0, abs=1e-12)
    assert most == pytest.approx((1.0 - 0.5 / 8.0) / 2.0)


def test_friction_that_a_stalled_motor_overcomes_lets_the_body_jump_to_the_knot():
    """The motor pulls with its 1 N while L changes by 1 m; at last friction falls to what it holds."""
    document = {
        "name": "falls",
        "body": {"contacts": [0.0, 1.0], "links": [{"stiffness": 4.0, "tension": {"most": 1.0}}]},
        "friction": {"forward": 2.0, "backward": 100.0},
        "drive": {"times": [0, 1, 2], "actuation": [[0], [-1], [-1]], "friction": {"forward": 2.0, "backward": 100.0}},
    }
    document["drive"]["friction"]["forward"] = [[2.0, 2.0], [2.0, 2.0], [0.5, 2.0]]
    crawler = Crawler(scene_of(document))
    stuck = crawler.follow(crawler.scene.drive.targets[1:2].copy())
    assert not stuck.velocity.any()
    assert crawler.tension[0] == 1.0
    step = crawler.follow(crawler.scene.drive.targets[2:3].copy())
    assert crawler.displacement == pytest.approx([1.0 - 0.5 / 4.0, 0.0])  # past the knot at u = 1/4
    assert step.unsolved == 0
    assert abs(step.certificate.energy_residual) < 1e-14
    assert step.certificate.violation < 1e-14


@pytest.mark.parametrize(("extra", "first"), [(0, 0), (0, 1), (1, 0), (2, 1)])
def test_agrees_with_rational_numbers(extra, first):
    """Chains of 2 to 4 contacts, and graphs, with every kind of link mixed."""
    right = 0
    for seed in range(1000 * first, 1000 * first + 60):
        rng = np.random.default_rng([seed, extra])
        document, body, rows = draw_body(rng, int(rng.integers(2, 5)), extra)
        scene, links = scene_of(document), len(body.links)
        crawler = Crawler(scene)
        for row, target in zip(rows[1:], scene.drive.targets[1:], strict=True):
            step = crawler.follow(target[None].copy())
            assert step.unsolved == step.overspent == 0
            assert abs(step.certificate.energy_residual) < 1e-12
            assert step.certificate.violation < 1e-12
            try:
                body.follow(row[:links], row[links : links + body.n], row[links + body.n :])
            except NotUniqueError:
                break
            assert step.unique
            np.testing.assert_allclose(crawler.displacement, [float(x) for x in body.x], rtol=0, atol=1e-12)
            np.testing.assert_allclose(crawler.tension, [float(t) for t in body.tensions()], rtol=0, atol=1e-12)
        else:
            right += 1
    assert right > 40


@pytest.mark.parametrize("seed", [994, 1127, 29110])
def test_on_patches_a_spring_at_a_knot_goes_on(seed):
    """A tendon about to be slack next to a motor that stalls at its stop; a part at rest at the knot that it needs."""
    rng = np.random.default_rng(seed)
    contacts, extra = int(rng.integers(2, 8)), int(rng.integers(0, 3))
    document, body, rows = draw_body(rng, contacts, extra, patches=True, dyadic=bool(seed % 2))
    crawler, links, compared = Crawler(scene_of(document)), len(body.links), True
    for row, target in zip(rows[1:], crawler.scene.drive.targets[1:], strict=True):
        step = crawler.follow(target[None].copy())
        assert step.unsolved == step.overspent == 0
        assert step.events < 40
        assert abs(step.certificate.energy_residual) < 1e-12
        assert step.certificate.violation < 1e-12
        if not compared:
            continue
        try:
            body.follow(row[:links], row[links : links + body.n], row[links + body.n :])
        except NotUniqueError:
            compared = False
            assert not step.unique
        else:
            np.testing.assert_allclose(crawler.displacement, [float(x) for x in body.x], rtol=0, atol=1e-12)


def minimise(scene: Scene, x: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The step as a quadratic program: a knot that stiffens is an excess length, one that softens one that is saved."""
    body = scene.body
    n, count = body.contacts, body.springs
    forward, backward = target[count : count + n], target[count + n :]
    rows, low, high = [], [], []
    quadratic, linear, width = [], [], n + 2 * n
    quadratic += [0.0] * width
    linear += [0.0] * n + forward.tolist() + backward.tolist()
    for i in range(n):  # v = ahead - behind
        rows.append({i: 1.0, n + i: -1.0, 2 * n + i: 1.0})
        low.append(x[i])
        high.append(x[i])
    for part in (n, 2 * n):
        for i in range(n):
            rows.append({part + i: 1.0})
            low.append(0.0)
            high.append(np.inf)
    bends = {bend.spring: bend for bend in body.bends}
    for j, (a, b) in enumerate(body.ends):
        length = target[j]
        curves = [(bends[j].actuator, length), (bends[j].passive, 0.0)] if j in bends else [(None, length)]
        for curve, rest in curves:
            pieces = np.array([[-np.inf, np.inf, body.stiffness[j], 0, 0, 0]]) if curve is None else curve.pieces
            # u = sum of the lengths on all pieces, each within its piece: convex, so the optimum fills them in order
            first = int(np.searchsorted(pieces[:, 1], 0.0))
            parts = {}
            for k, (begin, end, slope, at, value, _) in enumerate(pieces):
                near = 0.0 if k == first else (begin if k > first else end)
                parts[len(quadratic)] = 1.0
                quadratic.append(slope)
                linear.append(value + slope * (near - at))
                rows.append({len(quadratic) - 1: 1.0})
                low.append(min(begin - near, 0.0) if k <= first else 0.0)
                high.append(max(end - near, 0.0) if k >= first else 0.0)
            rows.append({b: 1.0, a: -1.0} | dict.fromkeys(parts, -1.0))
            low.append(rest)
            high.append(rest)
    matrix = sp.lil_matrix((len(rows), len(quadratic)))
    for r, row in enumerate(rows):
        for column, factor in row.items():
            matrix[r, column] += factor
    solver = osqp.OSQP()
    solver.setup(
        sp.diags(quadratic).tocsc(), np.array(linear), matrix.tocsc(), np.array(low), np.array(high),
        eps_abs=1e-12, eps_rel=1e-12, max_iter=400_000, verbose=False, polishing=True,
    )  # fmt: skip
    return np.asarray(solver.solve().x[:n])


@pytest.mark.parametrize("seed", range(25))
def test_a_step_agrees_with_osqp(seed):
    """Graphs of ten contacts: energies are compared, and the tensions, which are unique."""
    rng = np.random.default_rng(seed)
    document, _, _ = draw_body(rng, 10, extra=4)
    scene = scene_of(document)
    crawler = Crawler(scene, "catch_up")
    for target in scene.drive.targets[1:3]:
        x = minimise(scene, crawler.displacement, target)
        step = crawler.follow(target[None].copy())
        assert step.unsolved == 0
        expected = scene.body.tension(scene.body.elongation(x), target[: scene.body.springs])
        np.testing.assert_allclose(crawler.tension, expected, rtol=0, atol=1e-7)
        assert _cost(scene, crawler.displacement, x, target, crawler, step) < 1e-9


def _cost(scene, found, other, target, crawler, step) -> float:
    """How much more the step costs than another one."""
    body, n = scene.body, scene.body.contacts
    forward, backward = target[body.springs : body.springs + n], target[body.springs + n :]
    before = found - step.velocity
    costs = []
    for x in (found, other):
        energy = body.energy(body.tension(body.elongation(x), target[: body.springs]), x, target[: body.springs])
        moved = x - before
        costs.append(float(energy) + float(np.where(moved > 0, forward * moved, -backward * moved).sum()))
    return costs[0] - costs[1]


LINK = {"stiffness": 1.0}
BAD = [
    ({"curve": {"elongation": [0, 1, 2], "tension": [0, 2, 1]}}, "links.0.curve: tension: it falls from 2 N at 1 to 1 N at 2"),
    ({"curve": {"elongation": [0, 2, 1], "tension": [0, 1, 2]}}, "links.0.curve: elongation: 1 follows 2; knots must be sorted"),
    ({"curve": {"elongation": [0, 0, 1], "tension": [0, 1, 2]}}, "links.0.curve: elongation: 0 twice, with tensions of 0 N and 1 N"),
    ({"curve": {"elongation": [0, float("inf")], "tension": [0, 1]}}, "links.0.curve.elongation.1: inf is not finite"),
    ({"curve": {"elongation": [0, 1], "tension": [0, float("inf")]}}, "links.0.curve.tension.1: inf is not finite"),
    ({"curve": {"elongation": [0], "tension": [0]}}, "at least two"),
    ({"curve": {"elongation": [0, 1], "tension": [1, 1]}}, "links.0: its tension is the same at all lengths"),
    (LINK | {"tension": {"least": 2, "most": 1}}, "links.0.tension: least: 2 N; it must not be above `most`, 1 N"),
    (LINK | {"tension": {"most": float("inf")}}, "links.0.tension.most: inf is not finite"),
    (LINK | {"tension": {"lest": 0}}, "links.0.tension.lest: unknown key; the nearest known key is 'least'"),
    (LINK | {"curve": {"elongation": [0, 1], "tension": [0, 1]}}, "links.0: give `stiffness` or `curve`, not both"),
    ({"tension": {"most": 1}}, "links.0: stiffness: missing"),
    (LINK | {"passive": {"stops": {"stiffness": 1}}}, "links.0.passive.stops: give `shortest`, `longest` or both"),
    (LINK | {"passive": {"stops": {"shortest": 0.2, "longest": 0.1, "stiffness": 1}}}, "shortest: 0.2; it must not be above"),
    (LINK | {"passive": {"stops": {"shortest": "contact", "stiffness": 1}}}, "give `body.radius`"),
    (LINK | {"between": [0, 1], "passive": {"stiffness": -1}}, "links.0.passive: stiffness: -1; it must be >= 0"),
]  # fmt: skip


@pytest.mark.parametrize(("link", "message"), BAD)
def test_a_bad_link_is_one_line_that_names_it(link, message):
    document = {
        "name": "bad",
        "body": {"contacts": [0.0, 1.0], "links": [link]},
        "friction": {"forward": 1.0, "backward": 1.0},
    }
    with pytest.raises(SceneError) as caught:
        scene_of(document)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("unit", [1e-15, 1e15])
def test_the_unit_of_force_does_not_matter_beside_a_link_with_a_curve_alone(unit):
    links = [{"stiffness": 8.0 * unit}, {"curve": {"elongation": [-1, 0, 1], "tension": [-unit, 0, 4 * unit]}}]
    document = {
        "name": "units",
        "body": {"contacts": [0.0, 1.0, 2.0], "links": links},
        "friction": {"forward": 0.5 * unit, "backward": unit},
        "drive": {"times": [0, 1, 2], "period": 2, "actuation": [[0, 0], [1, -1], [0, 0]]},
    }
    assert simulate(scene_of(document), duration=4.0).net_translation[-1] > 0.1


def test_the_plane_refuses_bent_springs_with_the_reason():
    document = {
        "name": "plane",
        "dimension": 2,
        "body": {"contacts": [[0, 0], [1, 1]], "links": {"stiffness": 1.0, "tension": {"most": 1.0}}},
        "friction": {"isotropic": 1.0},
    }
    with pytest.raises(SceneError, match="for bodies on a line"):
        scene_of(document)


def test_a_list_of_links_is_the_same_as_a_mapping():
    like = {
        "name": "same",
        "body": {"contacts": [0.0, 1.0, 2.5], "links": {"stiffness": [1.0, 2.0], "between": [[0, 1], [0, 2]]}},
        "friction": {"forward": 1.0, "backward": 2.0},
        "drive": {"times": [0, 1, 2], "period": 2, "actuation": [[0, 0], [3, 2], [0, 0]]},
    }
    listed = json.loads(json.dumps(like))
    listed["body"]["links"] = [{"stiffness": 1.0, "between": [0, 1]}, {"stiffness": 2.0, "between": [0, 2]}]
    runs = [simulate(scene_of(document)) for document in (like, listed)]
    assert np.array_equal(runs[0].displacement, runs[1].displacement)


def test_keys_that_bend_nothing_change_nothing():
    """Limits that are never reached, and a passive spring of no stiffness."""
    link = {"stiffness": 2.0}
    bent = link | {"tension": {"least": -1e6, "most": 1e6}, "passive": {"stiffness": 0.0}}
    runs = [simulate(two_contacts(each, 3.0)) for each in (link, bent)]
    np.testing.assert_allclose(runs[0].displacement, runs[1].displacement, rtol=0, atol=1e-14)
    assert runs[0].energy.work == pytest.approx(runs[1].energy.work, rel=1e-13)


MOTOR = {"stiffness": 8.0, "tension": {"least": -1.5, "most": 1.5}, "passive": {"stiffness": 1.0}}


def test_tables_tell_when_actuators_are_slack_or_stalled():
    tendon = {"stiffness": 8.0, "tension": {"least": 0.0, "most": 7.5}, "passive": {"stiffness": 2.0}}
    for link, stroke, word, other in ((tendon, -1.0, "slack", "stalled"), (MOTOR, 2.0, "stalled", "slack")):
        run = simulate(two_contacts(link, stroke), duration=4.0)
        table = run.to_table()
        state = {name: np.asarray(table[f"link_0/{name}"]) for name in ("slack", "stalled")}
        z = np.asarray(table["contact_1"]) - np.asarray(table["contact_0"]) - 1.0
        actuator = np.asarray(table["link_0/tension"]) - link["passive"]["stiffness"] * z
        assert not state[other].any()
        assert 0.1 < state[word].mean() < 0.9
        np.testing.assert_allclose(actuator[state[word] == 1], 0.0 if word == "slack" else -1.5, atol=1e-12)
        assert (actuator[state[word] == 0] > (1e-12 if word == "slack" else -1.5)).mean() > 0.9


def report_of(scene: Scene) -> str:
    """What `crawler check` prints."""
    screen = Screen(file=io.StringIO(), width=300)
    print_report(simulate(scene), screen)
    return screen.file.getvalue()


def test_check_reports_stalls_and_commands_that_avoid_them():
    text = report_of(two_contacts(MOTOR, 2.0))
    assert "link_0 stalls during" in text
    span = re.search(r"lengths between (\S+) .. (\S+) m, as read every 0.01 s, would move it as far", text)
    gain = simulate(two_contacts(MOTOR, 2.0)).per_period[-1]
    assert simulate(two_contacts(MOTOR, float(span[2]))).per_period[-1] == pytest.approx(gain, rel=1e-6)
    assert simulate(two_contacts(MOTOR, 0.9 * float(span[2]))).per_period[-1] < gain
    assert "stays within its limits of tension, -1.5 N to 1.5 N" in report_of(two_contacts(MOTOR, 0.1))


@pytest.mark.parametrize(
    ("name", "force"), [("slope_climber", 0.37061), ("stalling_inchworm", 1.5), ("peristaltic_stops", 1.82)]
)
def test_check_reports_the_largest_force_of_an_actuator(name, force):
    """Without the force that stops in parallel carry: 100 N/m * (0.0118 - 0.03) m there."""
    assert f"largest force of an actuator along the drive: {force:g} N" in report_of(load_scene(name))


def test_check_meets_waypoints_between_the_usual_ticks():
    """100 N/m * 0.055 m at 0.045 s: the ends of ticks at 100 Hz are 0.005 s away from it."""
    drive = {"times": [0, 0.045, 0.1], "period": 0.1, "actuation": [[0], [0.055], [0]]}
    scene = Scene.model_validate(two_contacts({"stiffness": 100.0}, 0.1, 10.0).document() | {"drive": drive})
    assert choose_rate(scene) == 200.0
    assert choose_rate(load_scene("two_anchor_a")) == 100.0
    long = {"times": [0, 0.0002, 10], "actuation": [[0], [0], [0]]}  # 50 000 ticks are not too many
    assert choose_rate(Scene.model_validate(scene.document() | {"drive": long})) == 5000.0
    screen = Screen(file=io.StringIO(), width=300)
    print_report(simulate(scene, rate=choose_rate(scene)), screen)
    assert "largest force of an actuator along the drive: 5.5 N" in screen.file.getvalue()


@pytest.mark.parametrize("seed", range(30))
def test_a_limit_cuts_a_measured_curve_exactly(seed):
    """A cut that misses the limit by rounding would leave a slope of 1e-15 N/m behind it, which scenes refuse."""
    rng = np.random.default_rng([2028, seed])
    at = np.concatenate(([-1.0, 0.0], np.cumsum(rng.integers(1, 10, 4)) / 10))
    value = np.concatenate(([-2.0, 0.0], np.cumsum(rng.integers(1, 30, 4)) / 10))
    link = {"curve": {"elongation": at.tolist(), "tension": value.tolist()}}
    scene = two_contacts(link | {"tension": float(rng.uniform(0.05, 0.95) * min(2.0, value[-1]))}, 0.1)
    assert scene.body.bends[0].actuator.slopes[-1] == 0.0


def test_a_start_that_pretension_forbids_names_the_limits():
    document = two_contacts({"stiffness": 10.0}, 0.1).document()
    document["body"]["links"] = {"stiffness": 10.0, "tension": {"least": 9.0}}
    with pytest.raises(SceneError, match=r"limits of `tension` leave 0 N out, actuators pull at any start"):
        Scene.model_validate(document)


def test_check_names_the_contacts_that_never_slide():
    document = load_scene("two_anchor_a").document() | {"start": "relaxed"}
    document["body"] = {"contacts": [0.0, 1.0, 2.0], "links": {"stiffness": 1.0}}
    document["friction"] = {"forward": [0.2, 0.2, 50.0], "backward": [0.6, 0.6, 50.0]}
    document["drive"] = {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0, 0], [4, 1], [0, 0]]}
    assert "contacts that never slide: 2\n" in report_of(Scene.model_validate(document))


def test_check_reports_friction_that_a_motor_never_overcomes():
    weak = {"stiffness": 8.0, "tension": {"least": -0.4, "most": 0.4}}
    text = report_of(two_contacts(weak, 2.0))
    assert (
        "contact 1 never slides: it takes 0.5 N forward or 100 N backward, and its links reach 0.4 N and 0.4 N" in text
    )


# -- springs that go slack, beside friction that vanishes and loads ------------------------------------------------


def pulled(link: dict[str, Any], loads: list[float]) -> Scene:
    """Two contacts; the load on the second one changes, and friction holds 1 N at the first and 0.25 N there."""
    return scene_of(
        {
            "name": "pulled",
            "body": {"contacts": [0.0, 0.5], "links": [link]},
            "friction": {"isotropic": [1.0, 0.25]},
            "loads": 0.0,
            "drive": {"times": [0, 1], "actuation": [[0], [0]], "loads": [[0, load] for load in loads]},
        }
    )


TENDON = {"stiffness": 2.0, "tension": {"least": 0.0}}


@pytest.mark.parametrize("rate", [1.0, 7.0, 50.0, 100.0, 1000.0])
@pytest.mark.parametrize(
    ("link", "stroke", "place"),
    [
        ({"passive": {"stops": {"shortest": -0.25, "longest": 0.25, "stiffness": 16.0}}}, 2.0, -8.0 / 3.0),
        ({"stiffness": 4.0, "tension": {"least": 0.0}}, -2.0, 35.0 / 12.0),
    ],
)
def test_a_contact_whose_friction_vanishes_stays_where_a_slack_link_left_it(link, stroke, place, rate):
    """At the last instant nothing holds it; rounding must not let it slide through the slack."""
    scene = scene_of(
        {
            "name": "vanishes",
            "body": {"contacts": [0.0, 1.0, 2.0], "links": [link, {"stiffness": 3.0}]},
            "friction": {"isotropic": [0.5, 0.25, 1.0]},
            "drive": {
                "times": [0, 1, 2],
                "actuation": [[0, 0], [0, stroke], [0, 1.5 * stroke]],
                "friction": {"isotropic": [[0.5, 0.25, 1.0], [0.5, 0.25, 1.0], [0.0, 0.25, 1.0]]},
            },
        }
    )
    run = simulate(scene, rate=rate)
    assert run.displacement[-1][0] == pytest.approx(place, abs=1e-11)
    assert run.unsolved == 0


@pytest.mark.parametrize("patches", [[], [{"from": 5.0, "to": 6.0, "friction": 0.5}]])
def test_friction_that_vanishes_behind_a_slack_tendon_ends_the_ramp(patches):
    friction = {"forward": [[2, 1]] * 4, "backward": [[2, 1], [2, 1], [2, 0], [2, 1]]}
    scene = scene_of(
        {
            "name": "vanishes",
            "body": {"contacts": [0.0, 1.0], "links": [TENDON | {"stiffness": 8.0}]},
            "friction": {"forward": 1.0, "backward": 1.0},
            "ground": {"patches": patches},
            "drive": {"times": [0, 1, 2, 3], "actuation": [[0], [-0.2], [-0.2], [0]], "friction": friction},
        }
    )
    run = simulate(scene, rate=200.0)
    np.testing.assert_allclose(run.displacement[-1], [0.0, -0.2], atol=1e-15)
    assert run.unsolved == 0


def test_loads_that_nothing_holds_behind_a_slack_tendon_are_refused_and_change_nothing():
    scene = pulled(TENDON, [0.0, -0.5])
    crawler = Crawler(scene)
    message = (
        "no link that is taut holds contact 1 when it is pulled backward, and friction there is less than the loads"
    )
    with pytest.raises(CommandError, match=message):
        crawler.follow(scene.drive.targets[1:])
    assert crawler.loads.tolist() == [0.0, 0.0]
    assert crawler.displacement.tolist() == [0.0, 0.0]
    many = simulate_many([scene, pulled(TENDON, [0.0, 0.125])], duration=1.0)
    assert many.status.tolist() == ["invalid", "done"]
    assert re.search(message, many.reason[0])


@pytest.mark.parametrize(("limit", "sign"), [("least", 1.0), ("most", -1.0)])
@pytest.mark.parametrize(("load", "place"), [(0.3, 0.025), (0.5, 0.125), (1.1, 0.425)])
def test_a_load_tightens_a_tendon_from_the_bend_of_its_curve(load, place, limit, sign):
    """All lengths are 0 there, so that no rounding leads it beyond the bend."""
    run = simulate(pulled({"stiffness": 2.0, "tension": {limit: 0.0}}, [0.0, sign * load]), rate=1.0)
    assert run.displacement[-1][1] == pytest.approx(sign * place, abs=1e-15)
    assert run.unsolved == 0


@pytest.mark.parametrize("rate", [1.0, 2.0, 100.0])
def test_a_translation_that_tightens_a_slack_tendon_is_one_of_several(rate):
    """The first two contacts are joined by a tendon that would tighten before the ramp ends, whatever is chosen."""
    scene = scene_of(
        {
            "name": "several",
            "body": {"contacts": [0.0, 1.0, 2.0], "links": [TENDON | {"stiffness": 4.0}, {"stiffness": 4.0}]},
            "friction": {"isotropic": [1.0, 0.5, 0.5]},
            "drive": {"times": [0, 1, 2], "actuation": [[0, 0], [1.5, 0], [-0.25, -1]]},
        }
    )
    assert not simulate(scene, rate=rate).unique
    crawler = Crawler(scene)
    crawler.follow(scene.drive.targets[1:2])
    low, high = crawler.follow(scene.drive.targets[2:]).translation_interval
    net = simulate(scene, rate=rate).net_translation
    assert low - 1e-12 <= net[-1] - net[0] <= high + 1e-12


def test_a_contact_without_friction_in_the_slack_of_stops_is_free() -> None:
    """The friction of the first contact vanishes as it is at the end of its slack, 0.5 m wide."""
    stops = {"passive": {"stops": {"shortest": -0.25, "longest": 0.25, "stiffness": 16.0}}}
    friction = [[0.5, 0.25, 1.0], [0.5, 0.25, 1.0], [0.0, 0.25, 1.0], [0.0, 0.3, 1.0]]
    scene = scene_of(
        {
            "name": "free",
            "body": {"contacts": [0.0, 1.0, 2.0], "links": [stops, {"stiffness": 3.0}]},
            "friction": {"isotropic": [0.5, 0.25, 1.0]},
            "drive": {
                "times": [0, 1, 2, 3],
                "actuation": [[0, 0], [0, 2], [0, 3], [0, 3]],
                "friction": {"isotropic": friction},
            },
        }
    )
    crawler = Crawler(scene)
    assert crawler.follow(scene.drive.targets[1:3]).unique
    step = crawler.follow(scene.drive.targets[3:])
    assert not step.unique
    assert step.translation_interval == pytest.approx((-0.5 / 3.0, 0.0), abs=1e-12)
