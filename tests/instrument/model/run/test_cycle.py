"""The periodic regime of a drive, and the transient before it."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import CommandError, Scene, largest_tow, limit_cycle, load_scene, simulate


@pytest.mark.parametrize("name", ["three_contacts_two_ways", "continuous_segment", "slope_climber", "three_springs"])
def test_a_gait_whose_tensions_repeat_settles_exactly(name: str) -> None:
    scene = load_scene(name)
    found = limit_cycle(scene)
    later = simulate(scene, 20.0 * (scene.drive.period or 1.0), 1.0).per_period[-1]
    assert found.settled
    assert found.ratio == 0.0
    assert abs(found.gain - later) <= found.transient_left
    assert found.gains.size == found.periods


def test_a_long_transient_is_estimated() -> None:
    scene = load_scene("ten_contact_wave")
    exact = limit_cycle(scene, tolerance=1e-15, most_periods=200).gain
    for tolerance in (1e-2, 1e-4, 1e-6):
        found = limit_cycle(scene, tolerance)
        assert found.settled
        assert abs(found.gain - exact) <= 2.0 * found.transient_left + 1e-15


def test_a_regime_that_has_not_settled_is_reported() -> None:
    found = limit_cycle(load_scene("ten_contact_wave"), tolerance=1e-14, most_periods=5)
    assert not found.settled
    assert found.periods == 5
    assert 0.0 < found.ratio < 1.0
    assert "not settled after 5 periods" in repr(found)
    assert "does not shrink yet" in repr(limit_cycle(load_scene("ten_contact_wave"), most_periods=2))


def tethered(anchor: float, tether: float = 0.1) -> Scene:
    """A walker of two contacts, tied to an anchor by a soft spring that it stretches as it walks."""
    return Scene.model_validate(
        {
            "name": "tethered",
            "body": {"contacts": [0.0, 1.0, 2.0], "links": {"stiffness": [tether, 8.0]}},
            "friction": {"forward": [anchor, 0.1, 0.1], "backward": [anchor, 0.3, 0.3]},
            "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0, 0.0], [0.0, 0.1], [0.0, 0.0]]},
        }
    )


@pytest.mark.parametrize("anchor", [1.0, 1e4, 1e12])
def test_a_strong_anchor_does_not_hide_what_a_soft_tether_does(anchor: float) -> None:
    """Whatever holds the anchor, the walker stops where the tether pulls as hard as it can: the gain is 0."""
    scene = tethered(anchor)
    found = limit_cycle(scene)
    assert found.settled
    assert found.periods > 10
    assert abs(found.gain) <= found.transient_left <= 1e-9
    few = limit_cycle(scene, most_periods=8)
    assert not few.settled or abs(few.gain) <= few.transient_left
    tow = largest_tow(scene)
    assert tow.cause == "no travel"


def test_progress_is_reported() -> None:
    parts: list[float] = []
    limit_cycle(load_scene("ten_contact_wave"), tolerance=1e-14, most_periods=5, progress=parts.append)
    assert parts == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])


def test_the_plane_has_a_periodic_regime() -> None:
    found = limit_cycle(load_scene("planar_three_points"))
    assert found.settled
    assert np.shape(found.gain) == (2,)


def test_what_has_no_periodic_regime_is_refused() -> None:
    scene = load_scene("two_contacts_critical")
    document = scene.document()
    once = {**document, "drive": {"times": [0.0, 1.0], "actuation": [[0.0], [0.1]]}}
    with pytest.raises(CommandError, match="no drive with a period"):
        limit_cycle(Scene.model_validate(once))
    with pytest.raises(CommandError, match="tolerance 0"):
        limit_cycle(scene, tolerance=0.0)
    for most in (0, float("nan")):
        with pytest.raises(CommandError, match=f"most_periods {most}"):
            limit_cycle(scene, most_periods=most)  # type: ignore[arg-type]


def walker(ground: dict[str, object], backward: float = 50.0) -> Scene:
    body = {"contacts": [0.0, 0.2], "links": {"stiffness": 20.0}}
    drive = {"times": [0.0, 1.0, 2.0], "period": 2.0, "actuation": [[0.0], [0.1], [0.0]]}
    friction = {"forward": 0.2, "backward": backward}
    return Scene.model_validate(
        {"name": "walker", "body": body, "friction": friction, "ground": ground, "drive": drive}
    )


def test_a_body_that_has_left_all_patches_behind_has_the_regime_of_the_ground_there() -> None:
    """D - 2 mu/k beyond 2 m; between the patches, too, two periods are equal, which is not the end."""
    ground = {"patches": [{"from": 0.3, "to": 0.5, "friction": 0.5}, {"from": 1.5, "to": 2.0, "friction": 2.0}]}
    found = limit_cycle(walker(ground))
    assert found.settled
    assert found.gain == pytest.approx(0.08, abs=1e-12)
    assert found.gains.sum() > 2.0
    assert np.abs(np.diff(found.gains[:20])).min() < 1e-12
    with pytest.raises(CommandError, match=r"ground\.patches, and after 15 periods it still comes to other ground"):
        limit_cycle(walker(ground), most_periods=15)


@pytest.mark.parametrize(
    ("sides", "patch", "factor", "rows", "gain"),
    [
        (([0.05, 0.36], [0.32, 0.45]), 0.17, 3.3, [[-0.02], [0.06], [0.09], [-0.02]], 0.0),
        (
            ([0.07, 0.28, 0.11], [0.35, 0.47, 0.57]),
            0.2,
            2.2,
            [[-0.1, 0.0], [-0.01, -0.04], [0.09, -0.01], [-0.1, 0.0]],
            0.036,
        ),
    ],
)
def test_a_period_that_still_met_other_ground_on_its_way_is_not_the_last(
    sides: tuple[list[float], list[float]], patch: float, factor: float, rows: list[list[float]], gain: float
) -> None:
    """At its end all contacts are beyond the patch; at its beginning the foremost slid back onto it."""
    forward, backward = sides
    scene = Scene.model_validate(
        {
            "name": "leaving",
            "body": {"contacts": [0.2 * i for i in range(len(forward))], "links": {"stiffness": 10.0}},
            "friction": {"forward": forward, "backward": backward},
            "ground": {"patches": [{"from": -9.0, "to": patch, "friction": factor}]},
            "start": "relaxed",
            "drive": {"times": [0, 1, 2, 3], "period": 3, "actuation": rows},
        }
    )
    found = limit_cycle(scene)
    later = simulate(scene, 3.0 * (found.periods + 5), 1.0).per_period[found.periods :]
    assert found.settled
    assert later == pytest.approx(gain, abs=1e-12)
    assert found.gain == pytest.approx(gain, abs=1e-12)
    assert largest_tow(scene).free_gain == pytest.approx(gain, abs=1e-12)


def test_a_body_that_stalls_on_ground_that_holds_more_and_more_gains_nothing() -> None:
    profile = {"at": [0.0, 10.0], "friction": {"forward": [1.0, 26.0], "backward": [1.0, 1.0]}}
    found = limit_cycle(walker({"profile": profile}))
    assert found.settled
    assert abs(found.gain) < 1e-10
    mu, a, k, stroke, length = 0.2, 0.5, 20.0, 0.1, 0.2
    q = 1.0 / (1.0 + a / k)
    stall = (q**2 * (length + stroke - mu / k) - q * (length + mu / k)) / (1.0 - q**2)
    later = simulate(walker({"profile": profile}), 2.0 * found.periods, 0.5)
    assert later.displacement[-1, 0] == pytest.approx(stall, abs=1e-8)


def test_a_body_that_a_wall_pushes_back_comes_to_rest() -> None:
    """Its foremost contact touches the wall in each period; the tensions repeat at once, the gains shrink."""
    rows = [[0.0, 0.0], [-0.05, 0.09], [-0.05, -0.07], [0.0, 0.0]]
    document = {
        "name": "pushed",
        "body": {"contacts": [0.0, 0.28, 0.41], "links": [{"stiffness": 8.3}, {"stiffness": 11.0}]},
        "friction": {"forward": [0.08, 0.12, 0.32], "backward": [0.17, 0.75, 0.18]},
        "ground": {"walls": [{"at": 0.43, "stops": "forward"}]},
        "drive": {"times": [0, 1, 2, 3], "period": 3, "actuation": rows},
    }
    scene = Scene.model_validate(document)
    gains = simulate(scene, 90.0, 1.0).per_period
    assert gains[1] < -1e-3
    assert gains[-1] == 0.0
    for tolerance in (1e-9, 1e-3):
        found = limit_cycle(scene, tolerance)
        assert found.settled
        assert abs(found.gain) <= found.transient_left < tolerance


def test_a_body_that_pushes_a_wall_gains_nothing() -> None:
    found = limit_cycle(load_scene("wall_pusher"))
    assert found.settled
    assert abs(found.gain) < 1e-15
    assert found.periods <= 7
