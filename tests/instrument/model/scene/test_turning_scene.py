"""Scenes of bodies in the plane whose springs have lengths: keys, mistakes, columns, drive and start."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest

from crawler_model import Scene, SceneError, TrajectoryColumns, steepest_climb
from crawler_model.body.turning import find_forces, load_of_friction, measure_shape, wrap
from crawler_model.run.screw import find_screw

POINTS = [[0.0, 0.0], [0.1, 0.0], [0.2, 0.05], [0.3, 0.05]]
GOOD: dict[str, Any] = {
    "name": "snake",
    "dimension": 2,
    "body": {"points": POINTS, "springs": "length", "links": {"stiffness": 50}, "joints": {"stiffness": 2.0}},
    "friction": {"forward": 0.1, "backward": 1.0, "left": 0.5, "right": [0.5, 0.6, 0.5, 0.5]},
    "drive": {
        "times": [0, 1, 2],
        "period": 2,
        "actuation": [[0, 0, 0, 0, 0], [0.01, 0, 0, 0.3, -0.3], [0, 0, 0, 0, 0]],
    },
}


def change(*changes: tuple[str, Any]) -> dict[str, Any]:
    data = copy.deepcopy(GOOD)
    for path, value in changes:
        place: Any = data
        *parents, last = path.split("/")
        for key in parents:
            place = place.setdefault(key, {})
        if value is None:
            place.pop(last, None)
        else:
            place[last] = value
    return data


def scene(*changes: tuple[str, Any]) -> Scene:
    return Scene.model_validate(change(*changes))


def refusal(*changes: tuple[str, Any]) -> str:
    with pytest.raises(SceneError) as error:
        scene(*changes)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_a_body_has_points_links_joints_and_frames():
    body = scene(("friction/angle", 0.2), ("on_instability", "refuse"), ("heading", [1, 2])).body
    turning = body.turning
    assert body.dimension == 2
    assert body.position.tolist() == POINTS
    assert body.ends.tolist() == [[0, 1], [1, 2], [2, 3]]
    assert turning.joints.tolist() == [[0, 1, 2], [1, 2, 3]]
    assert turning.joint_stiffness.tolist() == [2.0, 2.0]
    assert turning.frame.tolist() == [[0, 1], [0, 1], [1, 2], [2, 3]]
    assert turning.offset.tolist() == [0.2] * 4
    assert turning.heading.tolist() == [1, 2]
    assert (turning.along_velocity, turning.jumps) == (False, False)
    assert body.describe() == "4 points, 3 links, 2 joints in the plane"
    for array in (turning.joints, turning.frame, turning.heading):
        assert array.dtype == np.int64
        assert not array.flags.writeable


def test_defaults():
    turning = scene().body.turning
    assert turning.heading.tolist() == [0, 3]
    assert turning.offset.tolist() == [0.0] * 4
    assert (turning.along_velocity, turning.jumps) == (False, True)
    assert scene(("body/joints", None), ("drive", None)).body.turning.joints.shape == (0, 3)
    assert scene(("friction/law", "along_velocity")).body.turning.along_velocity


def test_contacts_are_another_word_for_points():
    other = scene(("body/points", None), ("body/contacts", POINTS))
    assert np.array_equal(other.body.position, scene().body.position)


def test_links_may_be_a_list():
    links = [{"stiffness": 10.0 + i, "between": pair} for i, pair in enumerate([[1, 0], [1, 2], [3, 2]])]
    body = scene(("body/links", links)).body
    assert body.ends.tolist() == [[1, 0], [1, 2], [3, 2]]
    assert body.stiffness.tolist() == [10.0, 11.0, 12.0]
    assert body.turning.frame.tolist() == [[1, 0], [1, 0], [1, 2], [3, 2]]


def test_a_frame_is_that_of_a_link_in_either_direction():
    frame = [[1, 0], [1, 0], [2, 3], [3, 2]]
    assert scene(("friction/frame", frame)).body.turning.frame.tolist() == frame


def test_a_row_holds_links_joints_friction_by_point_and_loads():
    columns = scene(("loads", 0)).columns
    assert columns.names[:6] == ("link_0", "link_1", "link_2", "joint_0", "joint_1", "contact_0/forward")
    assert columns.names[6:10] == ("contact_0/backward", "contact_0/left", "contact_0/right", "contact_1/forward")
    assert columns.names[-2:] == ("contact_3/load_x", "contact_3/load_y")
    assert columns.count == 5 + 16 + 8
    assert scene().columns.count == 5 + 16


def test_the_target_is_the_row():
    drive = scene().drive
    assert np.array_equal(drive.targets, drive.rows)
    assert drive.actuation[1].tolist() == [0.01, 0.0, 0.0, 0.3, -0.3]
    assert drive.targets[0, 5:13].tolist() == [0.1, 1.0, 0.5, 0.5, 0.1, 1.0, 0.5, 0.6]


def test_a_slope_loads_the_points_downhill():
    tilted = scene(
        ("friction", {"coefficient": {"forward": 0.2, "backward": 0.8, "left": 0.9, "right": 0.9}}),
        ("body/weights", [1.0, 2.0, 1.0, 1.0]),
        ("ground", {"slope": 5.0, "direction": math.pi / 2}),
    )
    load = -math.sin(math.radians(5.0))
    assert np.allclose(tilted.drive.loads[0].reshape(-1, 2), [[0, load], [0, 2 * load], [0, load], [0, load]])
    held = 2.0 * math.cos(math.radians(5.0))
    assert np.allclose(tilted.drive.targets[0, 9:13], held * np.array([0.2, 0.8, 0.9, 0.9]))


def test_friction_may_be_commanded():
    rows = [[0.2, 0.3, 0.4, 0.5]] * 3
    drive = scene(("drive/friction", {"isotropic": rows})).drive
    assert drive.targets[0, 5:].tolist() == np.repeat(rows[0], 4).tolist()
    sides = {"forward": rows, "backward": 1.0, "left": 2.0, "right": 3.0}
    assert scene(("drive/friction", sides)).drive.targets[1, 9:13].tolist() == [0.3, 1.0, 2.0, 3.0]


def test_points_without_friction_do_not_count_in_the_net_translation():
    assert scene(("friction", {"isotropic": [0.1, 0, 0, 0.1]})).body.share.tolist() == [0.5, 0.0, 0.0, 0.5]


def test_a_scene_is_rebuilt_from_its_document():
    given = scene(("friction/frame", [[0, 1], [0, 1], [1, 2], [2, 3]]), ("heading", [1, 0]), ("loads", 0))
    assert Scene.model_validate(given.document()) == given
    assert pickle.loads(pickle.dumps(given)) == given


def test_the_shape_is_the_change_of_lengths_and_angles():
    body = scene().body
    assert body.elongation(np.zeros((4, 2))).tolist() == [0.0] * 5
    turned = np.array([[0.0, -1.0], [1.0, 0.0]])
    assert np.abs(body.elongation(body.position @ turned - body.position)).max() < 1e-15
    bent = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    shape = measure_shape(bent, np.array([[0, 1], [1, 2]]), np.array([[0, 1, 2], [2, 1, 0]]))
    assert np.allclose(shape, [1.0, 1.0, math.pi / 2, -math.pi / 2])


def test_whole_turns_do_not_count():
    assert wrap(np.array([0.25, 2.0 * math.pi + 0.25, -1.5 * math.pi])).tolist() == pytest.approx(
        [0.25, 0.25, 0.5 * math.pi]
    )


def test_the_forces_are_the_slopes_of_the_energy():
    body = scene().body
    rng = np.random.default_rng(1)
    x, actuation = 0.02 * rng.normal(size=(3, 4, 2)), np.array([0.01, 0.0, -0.02, 0.2, 0.1])

    def energy(x: np.ndarray) -> np.ndarray:
        return body.energy(body.tension(body.elongation(x), actuation), x, None)

    force = body.force_at(x, body.tension(body.elongation(x), actuation))
    step = 1e-6
    for i in range(4):
        for axis in range(2):
            ahead, behind = x.copy(), x.copy()
            ahead[:, i, axis] += step
            behind[:, i, axis] -= step
            slope = (energy(ahead) - energy(behind)) / (2.0 * step)
            assert np.allclose(force[:, i, axis], -slope, rtol=1e-6, atol=1e-7)
    assert np.abs(force.sum(axis=1)).max() < 1e-14
    assert np.array_equal(
        force[1],
        find_forces(
            body.position + x[1], body.ends, body.turning.joints, body.tension(body.elongation(x[1]), actuation)
        ),
    )


def test_friction_holds_forces_in_quarters_of_ellipses():
    friction = np.array([[1.0, 2.0, 3.0, 4.0]] * 5)
    force = np.array([[1.0, 0.0], [-2.0, 0.0], [0.0, 3.0], [0.0, -4.0], [0.6, -3.2]])
    assert np.allclose(load_of_friction(force, np.zeros(5), friction), 1.0)
    turned = force @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert np.allclose(load_of_friction(turned, np.full(5, math.pi / 2), friction), 1.0)
    bare = load_of_friction(np.array([[0.0, 0.0], [0.0, 1e-9]]), np.zeros(2), np.zeros((2, 4)))
    assert bare.tolist() == [0.0, math.inf]


def test_a_relaxed_start_has_no_tension():
    rows = [[0.03, 0.0, -0.02, 1.0, -2.0]] * 3
    start = scene(("drive/actuation", rows), ("start", "relaxed"), ("body/springs", "length"))
    body, x = start.body, start.start_displacement
    assert np.abs(body.tension(body.elongation(x), start.drive.actuation[0])).max() < 1e-12
    assert x[0].tolist() == [0.0, 0.0]
    place = body.position + x
    heading, before = place[3] - place[0], body.position[3] - body.position[0]
    assert abs(heading[0] * before[1] - heading[1] * before[0]) < 1e-15
    assert heading @ before > 0.0


def test_a_start_within_friction_is_accepted():
    moved = [[0.0, 0.0], [0.001, 0.0], [0.001, 0.0], [0.001, 0.0]]
    assert scene(("start", {"displacement": moved})).start_displacement.tolist() == moved


WRONG = [
    ([("dimension", 1)], "body.springs: length; on a line springs always have lengths: write `dimension: 2`"),
    ([("body/springs", "lengths")], "body.springs: 'lengths'; it must be 'vector' or 'length'"),
    ([("body/contacts", POINTS)], "body.points: both `points` and `contacts`; give one of them"),
    ([("body/points", None)], "body.points: neither `points` nor `contacts`; give one of them"),
    ([("body/points", [[0, 0]])], "body.points: 1 point(s); a body needs at least 2"),
    ([("body/points", [[0, 0], 1, [2, 0]])], "body.points: point 1 is 1.0; in a planar scene each point is [x, y]"),
    ([("body/points", [[0, 0], [0, 0], [1, 0], [2, 0]])], "link 0 has [0, 1], but points 0 and 1 are both at [0, 0] m"),
    (
        [("body/links/between", [[0, 1], [1, 2], [2, 4]])],
        "body.links.between: link 2 has [2, 4], but there are points 0",
    ),
    ([("body/links/between", [[0, 1], [1, 1], [2, 3]])], "link 1 has [1, 1], point 1 twice; a link needs a length > 0"),
    ([("body/links/between", [[0, 1], [2, 3]])], "no links lead from point 0 to point 2; the body must be connected"),
    ([("body/links/between", [["a.to", 1]])], "body.links.between: link 0 joins 'a.to'; with `springs: length` points"),
    ([("body/links/stiffness", [1, 0, 1])], "body.links.stiffness: link 1 has 0 N/m; it must be > 0"),
    ([("body/links/stiffness", math.nan)], "body.links.stiffness: nan is not finite"),
    (
        [("body/links/tension", 3.0)],
        "`curve`, `tension`, `passive`, `hysteresis` and `backlash` are for bodies on a line",
    ),
    ([("body/joints/stiffness", [1, 0])], "body.joints.stiffness: joint 1 has 0 N m/rad; it must be > 0"),
    ([("body/joints/stiffness", [1, 1, 1])], "body.joints.stiffness: 3 value(s) for 2 joint(s); give one number or 2"),
    ([("body/joints/stifness", 1)], "body.joints.stifness: unknown key; the nearest known key is 'stiffness'"),
    ([("body/joints/between", [[0, 1, 0]])], "joint 0 has [0, 1, 0], point 0 twice; an angle needs three places"),
    (
        [("body/joints/between", [[0, 1, -1]])],
        "body.joints.between: joint 0 has [0, 1, -1], but there are points 0 .. 3",
    ),
    ([("body/joints/between", [[0, 1]])], "body.joints.between.0.2: missing"),
    ([("friction/frame", [[0, 1], [0, 1], [0, 2], [2, 3]])], "friction.frame: point 2 has [0, 2], which no link joins"),
    ([("friction/frame", [[0, 1]])], "friction.frame: 1 pair(s) for 4 points; give one each"),
    ([("friction/frame", [[0, 9]] * 4)], "friction.frame: point 0 has [0, 9], but there are points 0 .. 3"),
    ([("friction/angle", [0.1, 0.2])], "friction.angle: 2 value(s) for 4 point(s); give one number or 4"),
    ([("friction/law", "viscous")], "friction.law: 'viscous'; it must be 'most_dissipative' or 'along_velocity'"),
    ([("friction/left", None)], "friction: give both `left` and `right`, or neither"),
    (
        [("friction/forward", None)],
        "friction: give `forward`, `backward`, `left` and `right` together, or only `isotropic`",
    ),
    (
        [("friction", {"forward": 1, "backward": 1})],
        "friction.left: missing; with `springs: length` give forward, back",
    ),
    ([("friction", {"directions": [0, 2, 4], "value": 1})], "friction.directions: they are fixed to the ground"),
    ([("friction/isotropic", 1)], "friction: give both `forward` and `backward`, or only `isotropic`"),
    (
        [("friction/left", [0.5, 0.5, 0, 0.5])],
        "friction: point 2 has forward 0.1, backward 1, left 0, right 0.5; all four",
    ),
    (
        [("friction/backward", [1, 1001, 1, 1])],
        "friction: point 1 has forward 0.1, backward 1001, left 0.5, right 0.6; the",
    ),
    ([("friction/left", -1)], "left -1, right 0.5; friction must be >= 0"),
    ([("friction", {"isotropic": 0})], "friction: 0 for all points; at least one needs friction"),
    ([("friction/left", math.inf)], "friction.left: inf is not finite"),
    ([("heading", [0, 0])], "heading: it has [0, 0], point 0 twice; a direction needs two places"),
    ([("heading", [0, 4])], "heading: it has [0, 4], but there are points 0 .. 3"),
    ([("on_instability", "stop")], "on_instability: 'stop'; it must be 'jump' or 'refuse'"),
    ([("tolerance", 1e-10)], "tolerance: 1e-10; it must be between 1e-09 and 0.5"),
    ([("drive/actuation", [[0, 0, 0]] * 3)], "drive.actuation: row 0: 3 value(s) for 5 link(s) and joint(s)"),
    ([("drive/actuation", [[[0, 0]] * 5] * 3)], "drive.actuation: row 0 holds lists"),
    ([("drive/friction", {"forward": 1, "backward": 1})], "drive.friction.left: missing; with `springs: length` give"),
    (
        [("drive/friction", {"isotropic": [[1, 1, 1]] * 3})],
        "drive.friction.isotropic: row 0: 3 value(s) for 4 point(s)",
    ),
    (
        [("drive/friction", {"forward": 1, "backward": 1, "left": 1, "right": 2e-5})],
        "drive.friction: row 0: point 0 has",
    ),
    ([("loads", [1, 0])], "the loads sum to [4, 0] N, 4 N long; it must be less than the sum of all friction, 4 N"),
    (
        [("start", {"displacement": [[0, 0], [0, 0], [0, 0], [0.1, 0]]})],
        "start.displacement: point 2 is pulled by [5, 0] N, 4.88875 N more than its friction; `start: relaxed` is a start",
    ),
    ([("start", {"displacement": [[0.1, 0], [0, 0], [0, 0], [0, 0]]})], "the two points of link 0 coincide"),
    ([("start", {"displacement": [0, 0]})], "start.displacement: in a planar scene it is [x, y] for each of 4"),
    (
        [("friction", {"isotropic": [1, 0, 1, 1]}), ("loads", [[0, 0], [0, 0.1], [0, 0], [0, 0]])],
        "start.displacement: point 1 is pulled by [0, 0.1] N, but has no friction; start where links carry its load",
    ),
]


@pytest.mark.parametrize(("changes", "message"), WRONG)
def test_a_mistake_is_one_line_that_names_it(changes, message):
    assert message in refusal(*changes)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("body/joints", {"stiffness": 1.0}, "body.joints: only for bodies that turn; write `springs: length`"),
        ("heading", [0, 1], "heading: only for bodies that turn"),
        ("on_instability", "jump", "on_instability: only for bodies that turn"),
        ("friction/frame", [[0, 1]] * 4, "friction.frame: only for bodies that turn"),
        ("friction/angle", 0.1, "friction.angle: only for bodies that turn"),
        ("friction/law", "along_velocity", "friction.law: only for bodies that turn"),
    ],
)
@pytest.mark.parametrize("dimension", [1, 2])
def test_bodies_that_do_not_turn_have_none_of_these_keys(path, value, message, dimension):
    points = POINTS if dimension == 2 else [0, 1, 2, 3]
    body = {"contacts": points, "links": {"stiffness": 50}}
    other = [("dimension", dimension), ("body", body), ("friction", {"isotropic": 1}), ("drive", None)]
    scene(*other)
    assert message in refusal(*other, (path, value))


def test_what_is_not_known_for_bodies_that_turn_is_refused():
    given = scene()
    with pytest.raises(ValueError, match="only for bodies on a line"):
        steepest_climb(given)


def test_the_table_has_torques_and_the_yaw():
    columns = TrajectoryColumns(scene())
    assert columns.units["command/joint_0"] == columns.units["yaw"] == "rad"
    assert columns.units["command/link_2"] == "m"
    assert columns.units["joint_1/torque"] == "N m"
    assert columns.units["contact_3/left"] == "N"


def test_a_screw_turns_about_its_centre():
    screw = find_screw(np.array([1.0, 1.0, math.pi / 2]))
    assert np.allclose(screw.centre, [0.0, 1.0])
    assert screw.radius == pytest.approx(1.0)
    assert find_screw(np.array([1.0, 1.0, 0.0])).radius is None
    assert np.allclose(find_screw(np.array([2.0, 0.0, math.pi])).centre, [1.0, 0.0])
