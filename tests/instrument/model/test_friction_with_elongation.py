"""Friction that changes with elongations: closed forms, jumps, verdicts, limits of commanded friction, refusals."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from crawler_command.check import print_report
from crawler_model import Crawler, Scene, SceneError, load_scene, simulate

from .bodies import CHAIN, GRAPH, HYBRID, SEGMENT, SWELLING, SWELLS, Drawn

K, MU, A, STROKE = 20.0, 0.2, 5.0, 0.1


def two(entry: dict[str, Any], rows: list[float], mirrored: bool = False, **more: Any) -> Scene:
    """Two contacts, 0.5 m apart, on 20 N/m; the rear one slides forward on 0.2 N, the front one holds 50 N."""
    friction = {"forward": [MU, 50.0], "backward": [50.0, 50.0]}
    entry = {"link": 0, "contacts": [0]} | entry
    if mirrored:
        friction = {"forward": friction["backward"], "backward": friction["forward"][::-1]}
        turned = {"forward": "backward", "backward": "forward"}
        entry = {turned.get(key, key): value for key, value in entry.items()} | {"contacts": [1 - entry["contacts"][0]]}
    scene = {
        "name": "two",
        "body": {"contacts": [0.0, 0.5], "links": {"stiffness": K}},
        "friction": friction | {SWELLS: [entry]},
        "drive": {"times": list(range(len(rows))), "actuation": [[row] for row in rows]},
    }
    return Scene.model_validate(scene | more)


SHORTER = {"elongation": [-1.0, 0.0], "forward": [A, 0.0]}
"""5 N/m as the link shortens."""


def worm(between: list[list[int]] | None = None) -> Scene:
    """Three contacts in a tube, whose friction grows from 0.1 N by 5 N/m as their links shorten, up to 0.2 m."""
    entries = [{"link": j, "contacts": [j, j + 1], "elongation": [-0.2, 0.0], "added": [1.0, 0.0]} for j in (0, 1)]
    links = {"stiffness": K} if between is None else {"stiffness": K, "between": between}
    gait = [[0.0, 0.0], [-0.1, 0.0], [-0.1, -0.1], [0.0, -0.1], [0.0, 0.0]]
    scene = {
        "name": "worm",
        "body": {"contacts": [0.0, 0.5, 1.0], "links": links},
        "friction": {"isotropic": 0.1, SWELLS: entries},
        "drive": {"times": [0, 1, 2, 3, 4], "period": 4.0, "actuation": gait},
    }
    return Scene.model_validate(scene)


def test_a_worm_in_a_tube_moves_towards_the_segment_that_is_long_first():
    run = simulate(worm(), duration=40.0)
    assert run.per_period[1:] == pytest.approx(-0.008 / 3.0, abs=1e-14)
    assert run.unique
    assert not run.jumps
    assert abs(run.energy.residual) < 1e-14


@pytest.mark.parametrize("rate", [0.3, 7.0, 64.0])
def test_a_worm_in_a_tube_is_where_it_is_at_any_rate(rate):
    whole, found = simulate(worm(), duration=12.0), simulate(worm(), duration=12.0, rate=rate)
    assert found.waypoint_displacement == pytest.approx(whole.waypoint_displacement, abs=1e-15)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_foot_that_presses_more_as_its_link_shortens_slides_as_on_one_more_spring(mirrored):
    run = simulate(two(SHORTER, [0.0, -STROKE], mirrored))
    way = (K * STROKE - MU) / (K + A)
    assert run.displacement[-1] == pytest.approx([0.0, -way] if mirrored else [way, 0.0], abs=1e-15)
    assert run.energy.dissipation == pytest.approx(MU * way + 0.5 * A * way**2, abs=1e-15)
    assert abs(run.energy.residual) < 1e-15


def test_at_a_kink_the_slope_changes():
    """From 2 cm on, its friction grows no more."""
    run = simulate(two({"elongation": [-0.02, 0.0], "forward": [0.1, 0.0]}, [0.0, -0.01, -STROKE]))
    assert run.displacement[-1, 0] == pytest.approx(STROKE - (MU + 0.1) / K, abs=1e-15)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_foot_that_lets_go_faster_than_its_spring_jumps(mirrored):
    """It grows from 1 N to 0.2 N within 16 mm; the spring has 20 N/m, so it jumps 0.8 N / 20 N/m forward."""
    longer = {"contacts": [1], "elongation": [0.0, 0.016], "forward": [0.8, 0.0]}
    friction = {"forward": [50.0, MU], "backward": [50.0, 50.0], SWELLS: [{"link": 0} | longer]}
    if mirrored:
        entry = {"link": 0, "contacts": [0], "elongation": [0.0, 0.016], "backward": [0.8, 0.0]}
        friction = {"forward": [50.0, 50.0], "backward": [MU, 50.0], SWELLS: [entry]}
    run = simulate(two(longer, [0.0, STROKE], friction=friction))
    (jump,) = run.jumps
    assert jump.contact == (0 if mirrored else 1)
    assert jump.distance == pytest.approx(-0.04 if mirrored else 0.04, abs=1e-15)
    assert jump.time == pytest.approx(1.0 / K / STROKE, abs=1e-12)
    assert jump.loss == pytest.approx(0.0096, abs=1e-15)
    assert abs(run.displacement[-1]).max() == pytest.approx(STROKE - MU / K, abs=1e-15)
    assert run.unique
    assert abs(run.energy.residual) < 1e-15


def test_a_foot_that_lets_go_faster_than_its_spring_may_hold_or_go_as_the_spring_relaxes():
    """It is at its bound from the start: as the command pulls back, it rests, or its friction falls faster."""
    longer = {"contacts": [1], "elongation": [0.0, 0.016], "forward": [0.8, 0.0]}
    friction = {"forward": [50.0, MU], "backward": [50.0, 50.0], SWELLS: [{"link": 0} | longer]}
    run = simulate(two(longer, [0.05, 0.045], friction=friction))
    assert not run.unique
    assert not run.displacement[-1].any()  # the first contacts rest


def test_on_patches_walls_and_gradual_ground_frictions_add():
    """The rear slides forward on 0.2 c + 5 x, with c = 1 + 2 x, or on a patch from 3 cm on with c = 2, or c = 0.5."""
    profile = {"at": [0.0, 1.0], "friction": [1.0, 3.0]}
    run = simulate(two(SHORTER, [0.0, -STROKE], ground={"profile": profile}))
    assert run.displacement[-1, 0] == pytest.approx((K * STROKE - MU) / (K + A + 2.0 * MU), abs=1e-15)
    walls = [{"at": 0.05, "stops": "forward", "contacts": [0]}]
    run = simulate(two(SHORTER, [0.0, -STROKE], ground={"profile": profile, "walls": walls}))
    assert run.displacement[-1].tolist() == [0.05, 0.0]
    assert run.wall_push[-1].least == pytest.approx(K * (STROKE - 0.05) - (1.1 * MU + A * 0.05), abs=1e-14)
    patch = {"from": 0.03, "to": 0.2}
    run = simulate(two(SHORTER, [0.0, -STROKE], ground={"patches": [patch | {"friction": 2.0}]}))
    assert run.displacement[-1, 0] == pytest.approx((K * STROKE - 2.0 * MU) / (K + A), abs=1e-15)
    assert not run.jumps
    run = simulate(two(SHORTER, [0.0, -STROKE], ground={"patches": [patch | {"friction": 0.5}]}))
    (jump,) = run.jumps
    assert jump.distance == pytest.approx(0.5 * MU / (K + A), abs=1e-15)
    assert jump.loss == pytest.approx((0.5 * MU) ** 2 / 2.0 / (K + A), abs=1e-15)
    assert run.displacement[-1, 0] == pytest.approx((K * STROKE - 0.5 * MU) / (K + A), abs=1e-15)


def test_friction_is_commanded_beside_it():
    crawler = Crawler(two(SHORTER, [0.0, 0.0]))
    crawler.advance([-STROKE], forward=[0.6, 50.0])
    assert crawler.displacement[0] == pytest.approx((K * STROKE - 0.6) / (K + A), abs=1e-15)
    assert crawler.friction.tolist() == [0.6, 50.0, 50.0, 50.0]


def test_a_link_far_away_presses_a_contact():
    """The first contact of three slides forward against 0.2 N and 5 N/m of the second link, which follows the drive."""
    entry = {"link": 1, "contacts": [0], "elongation": [-1.0, 0.0], "forward": [A, 0.0]}
    friction = {"forward": [MU, 50.0, 0.0], "backward": [50.0, 50.0, 0.0], SWELLS: [entry]}
    scene = two(entry, [0.0, 0.0], friction=friction, body={"contacts": [0.0, 0.5, 1.0], "links": {"stiffness": K}},
                drive={"times": [0, 1], "actuation": [[0.0, 0.0], [-STROKE, -STROKE]]})  # fmt: skip
    run = simulate(scene)
    assert run.displacement[-1] == pytest.approx([STROKE - (MU + A * STROKE) / K, 0.0, -STROKE], abs=1e-15)


def test_a_segment_that_swells_slides_as_its_continuum():
    """T' = f + a (c - T/E) from T = 0 at its end, up to T = E c, beyond which it rests; u = integral of c - T/E."""
    modulus, f, a, c, wrong = 2.0, 0.5, 1.0, 0.2, []
    reach = -modulus / a * np.log(1.0 - a * c / (f + a * c))
    way = c * reach - (f + a * c) / a * (reach - modulus / a * (1.0 - np.exp(-a * reach / modulus)))
    for elements in (20, 80):
        part = {"name": "trunk", "from": 0.0, "to": 1.0, "stiffness": modulus, "elements": elements}
        part["friction"] = {"forward": f, "backward": 100.0}
        scene = {
            "name": "trunk",
            "body": {"segments": [part]},
            "friction": {SWELLS: [{"segment": "trunk", "strain": [-1.0, 0.0], "forward": [a, 0.0]}]},
            "drive": {"times": [0, 1], "actuation": [[0.0], [-c]]},
        }
        run = simulate(Scene.model_validate(scene))
        assert run.unique
        wrong.append(abs(run.displacement[-1, 0] - way))
    assert wrong[0] < 0.005 * way
    assert wrong[1] < 0.1 * wrong[0]


@pytest.mark.parametrize("kind", [CHAIN, GRAPH])
def test_it_is_the_limit_of_friction_that_is_commanded_by_elongations(kind):
    driven = Drawn(f"swelling {kind}", 3).driven()
    scene, exact, wrong = driven.scene, driven.run("exact")[0], []
    plain = {key: value for key, value in driven.data["friction"].items() if key != SWELLS}
    track = scene.ground.track
    assert track is not None
    for parts in (160, 640):
        crawler = Crawler(Scene.model_validate(driven.data | {"friction": plain}))
        before, base = np.zeros(scene.body.springs), crawler.friction
        for row, *_ in driven.rows:
            for part in np.arange(1, parts + 1) / parts:
                zero = np.zeros(2 * scene.body.contacts)
                x = crawler.displacement
                more = np.concatenate(track.local_bounds(zero, scene.body.position, x)[:2])
                crawler.advance(before + part * (row - before), *np.split(base + more, 2))
            before = row
        wrong.append(np.abs(crawler.displacement - exact[-1]).max())
    assert wrong[0] < 0.01
    assert wrong[1] < 0.3 * wrong[0]


@pytest.mark.parametrize("kind", SWELLING)
@pytest.mark.parametrize("seed", range(6))
def test_what_adds_nothing_changes_nothing(kind, seed):
    driven = Drawn(kind, seed, bool(seed & 1)).driven()
    entries = [entry | dict.fromkeys(("forward", "backward"), [0.0] * 3) for entry in driven.data["friction"][SWELLS]]
    friction = {key: value for key, value in driven.data["friction"].items() if key != SWELLS}
    none = driven.data | {"friction": friction | {SWELLS: entries}}
    bare = dict(driven.data) | ({"friction": friction} if friction else {})
    if not friction:
        del bare["friction"]
    found, plain = (type(driven)(data, driven.rows).run("exact")[0] for data in (none, bare))
    assert found == pytest.approx(plain, abs=1e-13 * driven.extent)


@pytest.mark.parametrize("kind", [CHAIN, HYBRID, SEGMENT])
def test_a_scene_survives_a_round_trip(kind):
    scene = Drawn(f"swelling {kind}", 1).driven().scene
    assert Scene.model_validate(json.loads(json.dumps(scene.document()))) == scene


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"link": 3}, r"friction.with_elongation: entry 0: link: 3; the links are 0 \.\. 0"),
        ({"contacts": [2]}, r"friction.with_elongation: entry 0: contacts: 2; the isolated contacts are 0 \.\. 1"),
        (
            {"elongation": [0.0, 0.0]},
            "friction.with_elongation.0: elongation: 0 m follows 0 m; values must be strictly",
        ),
        ({"elongation": [0.0]}, r"friction.with_elongation.0: forward: 2 value\(s\) for 1 in `elongation`"),
        ({"elongation": [], "forward": []}, "friction.with_elongation.0: elongation: no values"),
        ({"forward": [-1.0, 0.0]}, "friction.with_elongation.0: forward: -1; added friction must be >= 0"),
        ({"added": [1.0, 0.0]}, "friction.with_elongation.0: give `added`, or `forward` and `backward`, not both"),
        ({"strain": [0.0, 1.0]}, "friction.with_elongation.0: strain: given with `link`"),
        ({"elongation": None}, "friction.with_elongation.0: elongation: missing with `link`"),
        ({"segment": "trunk"}, "friction.with_elongation.0: give `link`, `contacts` and `elongation`, or `segment`"),
        ({"elongtion": [0.0]}, "friction.with_elongation.0.elongtion: unknown key; the nearest known key is"),
    ],
)
def test_mistakes_are_named_in_one_line(change, message):
    with pytest.raises(SceneError, match=message) as error:
        two(SHORTER | change, [0.0, 0.1])
    assert "\n" not in str(error.value)


def test_an_unknown_segment_is_named():
    entry = {"segment": "trunk", "strain": [-1.0, 0.0], "added": [1.0, 0.0]}
    friction = {"isotropic": 1.0, SWELLS: [entry]}
    with pytest.raises(SceneError, match=r"entry 0: segment: 'trunk'; there are none"):
        two(SHORTER, [0.0, 0.1], friction=friction)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"friction": {SWELLS: [{"link": 0, "contacts": [0]} | SHORTER]}},
            "friction: missing; isolated contacts need it",
        ),
        (
            {"body": {"contacts": [0.0, 0.5], "links": {"stiffness": 1.0, "tension": 2.0}}},
            "friction.with_elongation: with links or segments whose tension can stay constant",
        ),
        (
            {
                "body": {"contacts": [0.0, 0.5], "links": {"stiffness": 1.0}, "weights": 1.0},
                "friction": {"coefficient": {"isotropic": 1}, SWELLS: [{"link": 0, "contacts": [0]} | SHORTER]},
            },
            "friction.with_elongation: not supported with coefficients of friction",
        ),
        (
            {
                "dimension": 2,
                "body": {"contacts": [[0, 0], [1, 0]], "links": {"stiffness": 1}},
                "friction": {"isotropic": 1.0, SWELLS: [{"link": 0, "contacts": [0]} | SHORTER]},
                "drive": None,
            },
            "friction.with_elongation: only on a line",
        ),
    ],
)
def test_what_is_not_followed_exactly_is_refused(change, message):
    with pytest.raises(SceneError, match=message):
        two(SHORTER, [0.0, 0.1], **change)


def test_an_implicit_step_is_exact_where_contacts_only_slide_or_rest():
    """Whatever kinks their links pass; far away, too, where ramps are followed from event to event."""
    far = {"link": 1, "contacts": [0], "elongation": [-1.0, 0.0], "forward": [A, 0.0]}
    friction = {"forward": [MU, 50.0, 0.0], "backward": [50.0, 50.0, 0.0], SWELLS: [far]}
    body = {"contacts": [0.0, 0.5, 1.0], "links": {"stiffness": K}}
    drive = {"times": [0, 1], "actuation": [[0.0, 0.0], [-STROKE, -STROKE]]}
    kinks = {"elongation": [-0.05, -0.02, 0.0], "forward": [0.5, 0.1, 0.0]}
    for scene in (
        worm(),
        worm([[0, 1], [1, 2]]),
        two(kinks, [0.0, -0.01, -STROKE, 0.0]),
        two(far, [0.0, 0.0], friction=friction, body=body, drive=drive),
    ):
        exact, found = (simulate(scene, duration=3.0, rate=1.0, method=method) for method in ("exact", "catch_up"))
        assert found.waypoint_displacement == pytest.approx(exact.waypoint_displacement, abs=1e-15)
        assert found.unique
        assert found.violation < 1e-15


def test_where_friction_lets_go_faster_than_its_spring_no_implicit_step_is_taken():
    longer = {"contacts": [1], "elongation": [0.0, 0.016], "forward": [0.8, 0.0]}
    friction = {"forward": [50.0, MU], "backward": [50.0, 50.0], SWELLS: [{"link": 0} | longer]}
    scene = two(longer, [0.0, STROKE], friction=friction)
    exact, stepped = (simulate(scene, rate=1.0, method=method) for method in ("exact", "catch_up"))
    assert stepped.jumps == exact.jumps
    assert len(exact.jumps) == 1
    assert abs(stepped.energy.residual) < 1e-15


def test_the_gallery_crawls_as_its_comments_say():
    scene = load_scene("worm_in_a_tube")
    run = simulate(scene, duration=5.0)
    assert run.per_period[1:] == pytest.approx(0.0414, abs=5e-5)
    assert run.unique
    plain = {key: value for key, value in scene.document().items() if key != "friction"}
    assert simulate(Scene.model_validate(plain), duration=5.0).per_period[1:] == pytest.approx(-0.0072, abs=5e-5)


def steep(seed: int) -> Scene:
    """A chain whose links change the friction of some contacts by up to 6 N/m, on a profile."""
    rng = np.random.default_rng(seed)

    def eighths(low: float, high: float, *shape: int) -> Any:
        return (np.round(8.0 * rng.uniform(low, high, shape)) / 8.0).tolist()

    n, entries = int(rng.integers(2, 5)), []
    for _ in range(int(rng.integers(1, 5))):
        at = np.sort(rng.choice(33, 3, replace=False) - 16) / 8.0
        slopes, i = np.round(8.0 * rng.uniform(-6.0, 6.0, 2)) / 8.0, int(rng.integers(n))
        rows = np.append(0.0, np.cumsum(slopes * np.diff(at)))
        entry = {"link": int(rng.integers(n - 1)), "contacts": [i], "elongation": at.tolist()}
        entries.append(entry | {"added": (rows - rows.min()).tolist()})
    friction = {"forward": eighths(0.25, 1.0, n), "backward": eighths(0.25, 3.0, n), SWELLS: entries}
    profile = {"at": np.sort(rng.choice(16 * n, 3, replace=False) / 8.0).tolist(), "friction": eighths(0.5, 1.5, 3)}
    rows = [[0.0] * (n - 1), *eighths(-1.5, 1.5, 5, n - 1)]
    scene = {
        "name": "steep",
        "body": {"contacts": [2.0 * i for i in range(n)], "links": {"stiffness": eighths(1.0, 2.0, n - 1)}},
        "friction": friction,
        "ground": {"profile": profile},
        "drive": {"times": list(range(6)), "actuation": rows},
    }
    return Scene.model_validate(scene)


def test_where_friction_is_steep_ticks_lead_where_ramps_lead():
    jumped = several = 0
    for seed in range(120):
        whole, parts = (simulate(steep(seed), rate=rate) for rate in (1.0, 40.0))
        for run in (whole, parts):
            assert abs(run.energy.residual) < 1e-12, seed
        if not (whole.unique and parts.unique):
            several += 1
            continue
        assert parts.waypoint_displacement == pytest.approx(whole.waypoint_displacement, abs=1e-12), seed
        assert [jump.contact for jump in parts.jumps] == [jump.contact for jump in whole.jumps], seed
        assert sum(jump.loss for jump in whole.jumps) == pytest.approx(whole.energy.jump_loss, abs=1e-13)
        jumped += bool(whole.jumps)
    assert jumped > 5
    assert several < 10


def test_a_check_tells_where_friction_is_steeper_than_its_link():
    for steepness, told in ((0.5, False), (2.0, True)):
        entry = {"contacts": [0], "elongation": [-1.0, 0.0], "forward": [steepness * K, 0.0]}
        printed = io.StringIO()
        print_report(simulate(two(entry, [0.0, -STROKE])), Console(file=printed, width=1000))
        assert ("steep: link_0 changes the friction of contact 0 by 40 N/m, more than" in printed.getvalue()) == told


def test_a_jump_within_which_the_other_contact_lets_go_is_not_unique():
    """As the rear slides back at 1.7 s, less and less friction holds the front, too: which is faster decides the end."""
    entry = {"link": 0, "contacts": [0, 1], "elongation": [-0.24, 0.04, 0.9], "added": [2.0, 0.6, 2.8]}
    scene = {
        "name": "both",
        "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 2.06}},
        "friction": {"forward": [0.75, 0.37], "backward": [0.3, 2.84], SWELLS: [entry]},
        "drive": {"times": [0, 1, 2], "actuation": [[0.0], [-0.8], [1.1]]},
    }
    run = simulate(Scene.model_validate(scene), rate=1.0)
    assert run.jumps
    assert not run.unique


def test_a_contact_whose_bound_has_fallen_may_rest_within_it():
    """In the jump at 1.8 s the middle contact lets go, but rests until the front is at the wall."""
    scene = {
        "name": "steep",
        "body": {"contacts": [0.0, 1.0, 2.0], "links": {"stiffness": [2.311935807422267, 3.674022066198596]}},
        "friction": {
            "forward": [0.7753259779338014, 0.7963891675025075, 0.8836509528585758],
            "backward": [2.1785356068204615, 0.8836509528585758, 0.6649949849548646],
            SWELLS: [
                {
                    "link": 0,
                    "contacts": [2],
                    "elongation": [-0.600802407221665, 0.13440320962888666],
                    "added": [0.5496489468405216, 1.7873620862587762],
                },
                {
                    "link": 1,
                    "contacts": [1, 2],
                    "elongation": [-0.5486459378134403, -0.38415245737211634, 0.27883650952858574],
                    "added": [2.1003009027081245, 0.7883650952858575, 1.205616850551655],
                },
            ],
        },
        "ground": {
            "profile": {
                "at": [-1.58876629889669, -1.0972918756268806, 2.9769307923771313],
                "friction": [0.3741223671013039, 2.5817452357071216, 0.728184553660983],
            },
            "walls": [
                {"at": 2.4302908726178534, "stops": "forward"},
                {"at": -0.08625877632898696, "stops": "backward"},
            ],
        },
        "drive": {
            "times": [0, 1, 2, 3, 4, 5],
            "actuation": [
                [0.0, 0.0],
                [1.2457372116349048, -1.3731193580742227],
                [1.3861584754262788, 1.2968906720160482],
                [-1.3671013039117352, 1.1614844533600803],
                [-1.391173520561685, -1.4623871614844535],
                [-0.18054162487462388, -0.31293881644934807],
            ],
        },
    }
    run = simulate(Scene.model_validate(scene), rate=1.0)
    assert run.unsolved == 0
    assert not run.unique
    assert abs(run.energy.residual) < 1e-12


def test_all_contacts_of_a_segment_may_slide_on_ground_that_holds_less():
    """As all would slide, the slopes under those that slide back outweigh the others: one contact rests."""
    trunk = {"name": "trunk", "from": 0.0, "to": 0.7, "stiffness": 3.0, "elements": 19}
    swelling = {"segment": "trunk", "strain": [-0.7, 0.07, 0.9], "added": [2.0, 1.0, 0.0]}
    scene = {
        "name": "all",
        "body": {"segments": [trunk | {"friction": {"forward": 1.0, "backward": 0.7}}]},
        "friction": {SWELLS: [swelling]},
        "ground": {"profile": {"at": [0.4, 3.0], "friction": [2.0, 3.0]}},
        "drive": {"times": [0, 1, 2, 3, 4], "actuation": [[0.0], [0.9], [-1.0], [0.9], [0.4]]},
        "start": "relaxed",
    }
    run = simulate(Scene.model_validate(scene), rate=10.0)
    assert run.unsolved == 0
    assert abs(run.energy.residual) < 1e-12


def test_a_ramp_without_any_friction_is_solved():
    """Its energies are squares of rounding, and do not balance."""
    scene = {
        "name": "free",
        "body": {"contacts": [0.0, 1.0], "links": [{"between": [0, 1], "stiffness": 3.0, "backlash": 0.5}]},
        "friction": {"forward": [1.5, 0.75], "backward": [2.125, 2.625]},
        "ground": {
            "profile": {"at": [1.0, 1.75], "friction": [0.0, 0.5]},
            "walls": [{"at": 1.625, "stops": "forward"}],
        },
        "drive": {"times": list(range(6)), "actuation": [[0.0], [0.375], [-0.125], [0.25], [-0.5], [1.125]]},
    }
    assert simulate(Scene.model_validate(scene), rate=1.0).unsolved == 0


def test_where_no_motion_is_found_none_is_unique():
    """In the ninth ramp no combination of sides that is tried fulfils all conditions."""
    steep = [
        {"link": 0, "contacts": [0, 1], "elongation": [-0.56, 0.32, 0.35], "added": [0.38, 0.14, 0.36]},
        {"link": 1, "contacts": [2], "elongation": [0.42, 0.8, 0.93], "added": [0.44, 0.04, 0.15]},
    ]
    to_and_fro = [[0.0, 0.0], [-0.64, 1.34], [1.33, 0.91], [0.43, 1.37], [-1.45, -0.53], [0.24, -0.63]]
    scene = {
        "name": "steep",
        "body": {"contacts": [0.0, 1.0, 2.0], "links": {"stiffness": [3.86, 1.39]}},
        "friction": {"forward": [0.31, 0.26, 0.37], "backward": [0.59, 1.2, 0.32], SWELLS: steep},
        "ground": {"walls": [{"at": 2.46, "stops": "forward"}]},
        "drive": {"times": list(range(10)), "actuation": [*to_and_fro, *to_and_fro[4:0:-1]]},
    }
    run = simulate(Scene.model_validate(scene), rate=1.0)
    assert run.unsolved > 0
    assert not run.unique
