from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Scene, SceneError, load_scene, simulate
from crawler_model.run.inertia import start_meter
from crawler_ros.node.inertia import add_ticks
from crawler_ros.node.intake.commanded_path import Vertices

STIFFNESS, FORWARD, BACKWARD, STROKE = 20.0, 0.1, 0.3, 0.1
MASS = 0.5 / 9.81
AT_ONE_SECOND = 2.0 * STROKE * np.sqrt(STIFFNESS * MASS) / (FORWARD + BACKWARD)


def two_contacts(period: float = 1.0, drive: dict | None = None, **body: object) -> Scene:
    """Build the crawler of two contacts whose front one slides with the velocity of the link."""
    table = {"times": [0, period / 2, period], "period": period, "actuation": [[0.0], [STROKE], [0.0]]}
    return Scene.model_validate(
        {
            "name": "two",
            "body": {"contacts": [0.0, 0.2], "links": {"stiffness": STIFFNESS}, **body},
            "friction": {"forward": FORWARD, "backward": BACKWARD},
            "drive": table if drive is None else drive,
        }
    )


@pytest.mark.parametrize("period", [0.5, 1.0, 2.0, 5.0, 20.0])
@pytest.mark.parametrize("given", [{"weights": 0.5}, {"masses": MASS}, {"masses": [0.0, MASS], "weights": 7.0}])
def test_the_number_of_two_contacts_is_proportional_to_the_speed(period, given):
    found = simulate(two_contacts(period, **given)).inertia
    assert found.number == pytest.approx(AT_ONE_SECOND / period, rel=1e-12)
    assert (found.contact, found.time) == (1, pytest.approx(period / 40))
    assert found.period_for_1_percent == pytest.approx(25.0 * AT_ONE_SECOND, rel=1e-12)
    if found.number > 0.3:
        assert found.deviation is None
        assert "not to be predicted" in found.describe(two_contacts().body)
    else:
        assert found.deviation == pytest.approx((found.number / 10.0, found.number / 4.0))
    # the same for a drive without a period, as the commands of a recording
    slower = f"where the drive takes at least {25.0 * AT_ONE_SECOND / period:.3g} times as long"
    assert slower in found.describe(two_contacts().body)


@pytest.mark.parametrize("rate", [7.0, 100.0, 1000.0])
@pytest.mark.parametrize("method", ["exact", "catch_up"])
def test_the_number_depends_on_neither_ticks_nor_method(rate, method):
    found = simulate(two_contacts(weights=0.5), 3.0, rate, method).inertia
    assert found.number == pytest.approx(AT_ONE_SECOND, rel=1e-9)


def test_a_drive_without_a_period_ends_in_a_stop():
    once = {"times": [0, 0.5], "actuation": [[0.0], [STROKE]]}
    found = simulate(two_contacts(drive=once, weights=0.5)).inertia
    assert found.number == pytest.approx(AT_ONE_SECOND, rel=1e-12)
    assert simulate(two_contacts(drive=once, weights=0.5), 0.45).inertia.number == pytest.approx(AT_ONE_SECOND)


@pytest.mark.parametrize("rate", [1.0, 7.0, 100.0])
def test_a_pause_within_a_drive_is_a_stop(rate):
    """The link grows faster from row to row, pauses, and goes on as it ended."""
    lengths = np.cumsum([0.0, 0.01, 0.02, 0.04, 0.0, 0.04, 0.02, 0.01])
    drive = {"times": np.arange(lengths.size).tolist(), "actuation": lengths[:, None].tolist()}
    found = simulate(two_contacts(drive=drive, masses=MASS), rate=rate).inertia
    assert found.number == pytest.approx(0.04 * np.sqrt(STIFFNESS * MASS) / (FORWARD + BACKWARD), rel=1e-9)
    assert found.time == 3.0


def test_friction_counts_as_commanded_at_the_event():
    """The front contact starts at 1/20 of the period, where its frictions have risen by half a tenth of the rise."""
    table = {
        "times": [0, 0.5, 1.0],
        "period": 1.0,
        "actuation": [[0.0], [STROKE], [0.0]],
        "friction": {"forward": [[0.1, 0.1], [0.2, 0.2], [0.1, 0.1]], "backward": [[0.9, 0.9]] * 3},
    }
    found = simulate(two_contacts(drive=table, masses=MASS), 0.2).inertia
    # tension k 0.2 s meets 0.1 + 0.2 s; then the front moves at 0.2 less the rate of the rising friction
    start = 0.1 / (STIFFNESS * 0.2 - 0.2)
    velocity = 0.2 - 0.2 / STIFFNESS
    assert found.time == pytest.approx(start)
    assert found.number == pytest.approx(velocity * np.sqrt(STIFFNESS * MASS) / (1.0 + 0.2 * start), rel=1e-12)


@pytest.mark.parametrize(
    "name",
    ["three_contacts_two_ways", "hybrid_body", "tendon_worm", "ice", "three_springs", "tripedal_star", "scissors"],
)
def test_masses_change_no_bit_of_the_motion(name):
    scene = load_scene(name)
    document = scene.document()
    document["body"]["masses"] = 0.02
    bare, heavy = (simulate(s, 2.0) for s in (scene, Scene.model_validate(document)))
    assert bare.displacement.tobytes() == heavy.displacement.tobytes()
    assert bare.tension.tobytes() == heavy.tension.tobytes()
    assert (bare.energy, bare.events) == (heavy.energy, heavy.events)
    assert heavy.inertia.number > 0.0
    assert heavy.summary()["inertia"]["contact"] == heavy.inertia.contact


def test_scenes_without_masses_have_no_number():
    run = simulate(two_contacts())
    assert run.inertia is None
    assert run.summary()["inertia"] is None


def test_mean_velocities_of_ramps_find_the_events_of_pieces():
    """The fallback of bodies in the plane: two contacts along the x axis have the same number as on the line."""
    document = two_contacts(masses=MASS).document() | {"dimension": 2}
    document["body"]["contacts"] = [[0.0, 0.0], [0.2, 0.0]]
    document["friction"] = {"isotropic": 0.2}
    document["drive"]["actuation"] = [[[0.0, 0.0]], [[STROKE, 0.0]], [[0.0, 0.0]]]
    line = two_contacts(masses=MASS).document()
    line["friction"] = {"isotropic": 0.2}
    exact, sampled = (simulate(Scene.model_validate(d), 3.0, 1000.0).inertia for d in (line, document))
    assert sampled.number == pytest.approx(exact.number, rel=0.02)


@pytest.mark.parametrize("elements", [4, 40, 160])
def test_the_number_of_a_segment_does_not_depend_on_its_mesh(elements):
    trunk = {"name": "trunk", "from": 0.0, "to": 1.0, "stiffness": 4.0, "elements": elements}
    scene = {
        "name": "strip",
        "body": {"segments": [trunk | {"friction": {"forward": 0.1, "backward": 0.3}}], "masses": 0.1},
        "drive": {"times": [0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [0.4], [0.0]]},
    }
    numbers = simulate(Scene.model_validate(scene), 3.0).inertia.number
    speed = 0.4 * 2.0 * 0.75  # the front end moves with the strain rate times its distance from the point at rest
    assert numbers == pytest.approx(speed * np.sqrt(2.0 * 4.0 * 0.1) / 0.4, rel=0.6)


def test_ticks_of_a_node_have_the_number_of_the_run():
    """Commands that hold in between, and a trajectory whose points lie inside ticks."""
    scene = two_contacts(masses=MASS)
    meter = start_meter(scene)
    due = np.array([50, 150, 500, 1000]) * 1_000_000
    lengths = np.array([0.01, 0.03, 0.1, 0.0])
    rows = np.tile(scene.drive.rows[0], (4, 1))
    rows[:, 0] = lengths
    ends = np.arange(1, 11) * 100_000_000
    # a tick of 0.1 s takes the points due in it, and the point of the path at its end
    grid = np.union1d(due, ends)
    path = np.tile(scene.drive.rows[0], (grid.size, 1))
    path[:, 0] = np.interp(grid, np.append(0, due), np.append(0.0, lengths))
    first = np.concatenate(([0], np.searchsorted(grid, ends, side="right")))
    add_ticks(meter, scene.columns, Vertices(np.append(0, ends), grid, path, first, -1))
    assert meter.result().number == pytest.approx(AT_ONE_SECOND, rel=1e-9)
    assert meter.result().period_for_1_percent is not None


def test_ticks_that_hold_are_stops():
    scene = two_contacts(masses=MASS)
    meter = start_meter(scene)
    row = scene.drive.rows[0].copy()
    row[0] = 0.02
    taken = Vertices(100_000_000 * np.arange(3), np.array([100_000_000]), row[None], np.array([0, 1, 1]), 0)
    add_ticks(meter, scene.columns, taken)
    found = meter.result()
    assert (found.time, found.contact) == (pytest.approx(0.025), 1)
    assert found.number == pytest.approx(AT_ONE_SECOND, rel=1e-9)


@pytest.mark.parametrize(("masses", "message"), [(-1.0, "body.masses: entry 0 is -1"), ([1.0], "body.masses: 1 value")])
def test_wrong_masses_are_refused(masses, message):
    with pytest.raises(SceneError, match=message):
        two_contacts(masses=masses)
