from __future__ import annotations

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, Scene, load_scene
from crawler_ros.node.intake import commands as commands_module
from crawler_ros.node.intake.commanded_path import CommandedPath, Trajectory, Vertex
from crawler_ros.node.intake.commands import CommandQueue

NS = 1_000_000_000
TICK = NS // 100


def queue(contacts=3, lock_step=False) -> CommandQueue:
    links = {"stiffness": 1.0}
    body = {"contacts": list(range(contacts)), "links": links}
    scene = Scene.model_validate({"name": "q", "body": body, "friction": {"forward": 1.0, "backward": 2.0}})
    return CommandQueue(scene.columns, scene.drive.rows[0], lock_step)


def take(commands, tick=0, lasts_ns=TICK):
    """Take the vertices of one tick."""
    taken = commands.take_vertices(lasts_ns * np.arange(tick, tick + 2))
    return list(map(Vertex, taken.due_ns.tolist(), taken.rows))


def test_nothing_new_is_a_hold():
    assert take(queue()) == []


def test_an_actuation_array_is_one_vertex_at_the_ticks_end():
    commands = queue()
    commands.accept_actuation([0.1, 0.2])
    (vertex,) = take(commands)
    assert vertex.due_ns == TICK
    assert vertex.row.tolist() == [0.1, 0.2, 1, 1, 1, 2, 2, 2]
    assert take(commands, 1) == []


@pytest.mark.parametrize(
    ("values", "forward", "backward"),
    [([0.5], [0.5] * 3, [0.5] * 3), ([1, 2, 3], [1, 2, 3], [1, 2, 3]), ([1, 2, 3, 4, 5, 6], [1, 2, 3], [4, 5, 6])],
)
def test_friction_arrays_come_in_three_lengths(values, forward, backward):
    commands = queue()
    commands.accept_friction(values)
    (vertex,) = take(commands)
    assert vertex.row.tolist() == [0, 0, *forward, *backward]


def test_several_in_a_tick_take_equal_shares_and_pair_by_count():
    commands = queue(2)
    for k in (1.0, 2.0, 3.0):
        commands.accept_actuation([k])
    for mu in (5.0, 6.0):
        commands.accept_friction([mu])
    vertices = take(commands, 7)
    assert [v.row.tolist() for v in vertices] == [[1, 5, 5, 5, 5], [2, 6, 6, 6, 6], [3, 6, 6, 6, 6]]
    assert [v.due_ns for v in vertices] == [7 * TICK + TICK * k // 3 for k in (1, 2, 3)]


def test_joint_commands_hold_what_they_leave_out_and_mix_with_arrays():
    commands = queue()
    commands.accept_actuation([0.1, 0.2])
    commands.accept_joints(["link_1"], np.array([0.3]))
    commands.accept_joints(["link_1", "link_0"], np.array([np.nan, 0.4]))
    assert [(v.due_ns, v.row[:2].tolist()) for v in take(commands)] == [
        (TICK // 3, [0.1, 0.2]),
        (TICK * 2 // 3, [0.1, 0.3]),
        (TICK, [0.4, 0.3]),
    ]


def test_pairing_makes_strategy_a_come_out_right():
    """Four ticks a period: paired 2 m a period; only actuation first 2.5 m, only friction first 0.5 m."""
    gains = {}
    scene = load_scene("two_anchor_a")
    rows = scene.drive.rows
    for order in ("paired", "actuation first", "friction first"):
        crawler = Crawler(scene)
        commands = CommandQueue(scene.columns, rows[0])
        y = []
        for tick in range(12):
            row = rows[tick % 4 + 1]
            accept = [(commands.accept_actuation, row[:1]), (commands.accept_friction, row[1:3])]
            for k, (send, values) in enumerate(accept[::-1] if order == "friction first" else accept):
                send(values)
                if order != "paired":
                    for vertex in take(commands, 2 * tick + k, lasts_ns=1):
                        crawler.follow(vertex.row[None])
            for vertex in take(commands, tick):
                crawler.follow(vertex.row[None])
            if tick % 4 == 3:
                y.append(crawler.net_translation)
        gains[order] = y[2] - y[1]
    assert gains == pytest.approx({"paired": 2.0, "actuation first": 2.5, "friction first": 0.5}, abs=1e-12)


def test_a_trajectory_runs_in_straight_lines_through_its_points():
    commands = queue(2)
    commands.accept_trajectory(["link_0"], [0, 2 * TICK + TICK // 2, 3 * TICK], [[1.0], [6.0], [0.0]], 0)
    ticks = [[(v.due_ns / TICK, v.row[0]) for v in take(commands, k)] for k in range(4)]
    assert ticks[0] == [(0, 1.0), (1.0, 3.0)]
    assert ticks[1] == [(2.0, 5.0)]
    assert ticks[2] == [(2.5, 6.0), (3.0, 0.0)]
    assert ticks[3] == []


def test_a_point_that_is_past_and_followed_by_nothing_takes_the_tick():
    cases = (
        ([0], [1.0], [(1.0, 1.0)]),
        ([0, 0], [1.0, 2.0], [(0.0, 1.0), (1.0, 2.0)]),
        ([0, TICK], [1.0, 2.0], [(0.0, 1.0), (1.0, 2.0)]),
        ([0, 5 * TICK], [1.0, 1.0], [(0.0, 1.0)]),
    )
    for times, values, expected in cases:
        commands = queue(2)
        commands.accept_trajectory(["link_0"], times, [[value] for value in values], 0)
        assert [(v.due_ns / TICK, v.row[0]) for v in take(commands)] == expected


def test_names_left_out_hold_and_friction_names_both_sides():
    commands = queue()
    commands.accept_trajectory(["contact_1/friction", "link_1", "contact_0/backward"], [0], [[7.0, 0.3, 8.0]], 0)
    (vertex,) = take(commands)
    assert vertex.row.tolist() == [0, 0.3, 1, 7, 1, 8, 7, 2]


def test_a_stamp_in_the_future_waits_and_one_in_the_past_loses_nothing():
    commands = queue(2)
    commands.accept_trajectory(["link_0"], [0, TICK], [[1.0], [2.0]], 3 * TICK)
    assert [take(commands, k) for k in range(2)] == [[], []]
    assert [v.row[0] for v in take(commands, 2)] == [1.0]
    assert [v.row[0] for v in take(commands, 3)] == [2.0]
    commands.accept_trajectory(["link_0"], [0, TICK, 30 * TICK], [[5.0], [6.0], [0.0]], TICK)
    late = take(commands, 10)
    assert [v.row[0] for v in late][:2] == [5.0, 6.0]
    assert late[2].row[0] == pytest.approx(6.0 * 20 / 21)
    assert all(10 * TICK <= v.due_ns <= 11 * TICK for v in late)


def test_a_new_trajectory_replaces_what_runs_from_its_start():
    commands = queue(2)
    commands.accept_trajectory(["link_0"], [10 * TICK], [[10.0]], 0)
    for k in range(3):
        assert [v.row[0] for v in take(commands, k)] == pytest.approx([k + 1.0])
    commands.accept_trajectory(["link_0"], [2 * TICK], [[0.0]], 5 * TICK)
    values = [v.row[0] for k in range(3, 9) for v in take(commands, k)]
    assert values == pytest.approx([4.0, 5.0, 2.5, 0.0])


def test_trajectories_of_one_tick_are_followed_one_after_another():
    for first, second in ((0, 0), (2, 1)):
        commands = queue(2)
        commands.accept_trajectory(["link_0"], [TICK // 10], [[5.0]], first * TICK // 10)
        commands.accept_trajectory(["link_0"], [TICK // 10], [[0.0]], second * TICK // 10)
        assert [v.row[0] for v in take(commands)] == [5.0, 0.0]
    commands = queue(2)
    commands.accept_trajectory(["link_0"], [0], [[5.0]], 0)
    commands.accept_trajectory(["contact_0/friction"], [0], [[3.0]], 0)
    assert [v.row[:2].tolist() for v in take(commands)] == [[5.0, 1.0], [5.0, 3.0]]


def test_periods_sent_ahead_join_without_a_seam():
    commands = queue(2)
    period = 4 * TICK
    for n in range(3):
        commands.accept_trajectory(["link_0"], [0, period // 2, period], [[0.0], [2.0], [0.0]], (n + 1) * period)
    values = [[v.row[0] for v in take(commands, k)] for k in range(16)]
    assert values[:4] == [[]] * 4
    assert values[4:] == [[1.0], [2.0], [1.0], [0.0]] * 3


def test_a_trajectory_without_points_is_refused_and_changes_nothing():
    commands = queue(2)
    commands.accept_trajectory(["link_0"], [10 * TICK], [[10.0]], 0)
    take(commands, 0)
    with pytest.raises(CommandError, match="it has no points; it needs at least one"):
        commands.accept_trajectory(["link_0"], [], np.zeros((0, 1)), 0)
    assert [v.row[0] for v in take(commands, 1)] == [2.0]


def joined_by_definition(path, trajectory, now_ns, end_ns, fresh):
    """The vertices after `Path.join`, by its definition: a look at every vertex ahead."""
    start = now_ns if trajectory.start_ns is None else trajectory.start_ns
    cut = max(start, now_ns)
    old = len(path.ahead) - fresh
    stay = [v for v in path.ahead[:old] if v.due_ns <= cut]
    new = [v for v in path.ahead[old:] if v.due_ns <= max(cut, end_ns)]
    behind = [v for v in [path.anchor, *path.ahead] if v.due_ns <= cut] or [path.anchor]
    beyond = [v for v in path.ahead if v.due_ns > cut]
    row = behind[-1].row
    if beyond and behind[-1].due_ns < cut:
        part = (cut - behind[-1].due_ns) / (beyond[0].due_ns - behind[-1].due_ns)
        row = row + part * (beyond[0].row - row)
    if new and new[-1].due_ns > cut:
        row = new[-1].row
    vertices = [*stay, *new]
    due = max([cut, *(v.due_ns for v in vertices)])
    joined = [Vertex(due, row)]
    for time, values in zip(trajectory.times_ns.tolist(), trajectory.positions, strict=True):
        commanded = row.copy()
        for column, value in zip(trajectory.columns, values, strict=True):
            commanded[column] = value
        joined.append(Vertex(max(start + time, due), commanded))
    return vertices + joined, len(new) + len(joined)


def listed(vertices):
    return [(v.due_ns, v.row.tolist()) for v in vertices]


@pytest.mark.parametrize("seed", range(40))
def test_trajectories_join_the_path_as_defined(seed):
    rng = np.random.default_rng(seed)
    path = CommandedPath(Vertex(0, np.zeros(2)))
    for tick in range(20):
        fresh = 0
        for _ in range(rng.integers(0, 6)):
            times = np.sort(rng.integers(0, 4 * TICK, rng.integers(1, 8)))
            start = None if rng.random() < 0.3 else int(tick * TICK + rng.integers(-TICK, 3 * TICK))
            columns = [np.array([c]) for c in rng.permutation(2)[: rng.integers(1, 3)]]
            trajectory = Trajectory(start, columns, times, rng.normal(size=(times.size, len(columns))))
            expected, fresh_then = joined_by_definition(path, trajectory, tick * TICK, (tick + 1) * TICK, fresh)
            fresh = path.join(trajectory, tick * TICK, (tick + 1) * TICK, fresh)
            assert listed(path.ahead) == listed(expected)
            assert fresh == fresh_then
        path.pass_waypoints(TICK * np.arange(tick, tick + 2), np.zeros(2))


@pytest.mark.parametrize("due", [-TICK, 0, 1, TICK - 1, TICK])
@pytest.mark.parametrize("row", [[0.0, 1.0], [-0.0, 1.0], [0.0, 2.0]])
def test_a_single_waypoint_is_passed_as_the_kernel_passes_several(due, row):
    in_force, times = np.array([0.0, 1.0]), np.array([0, TICK])
    alone, followed = CommandedPath(Vertex(-TICK, in_force)), CommandedPath(Vertex(-TICK, in_force))
    alone.replace(-2 * TICK, [Vertex(due, np.array(row))])
    followed.replace(-2 * TICK, [Vertex(due, np.array(row)), Vertex(due, np.array(row))])  # the second one repeats it
    for found, expected in zip(
        alone.pass_waypoints(times, in_force), followed.pass_waypoints(times, in_force), strict=True
    ):
        assert np.array(found).tobytes() == np.array(expected).tobytes()
    assert alone.ahead == followed.ahead == []
    assert (alone.anchor.due_ns, alone.anchor.row.tolist()) == (followed.anchor.due_ns, followed.anchor.row.tolist())


def vertices_read(count):
    """How many times the due times of vertices are read while trajectories of ten points join in one tick."""
    read = 0

    class Read(Vertex):
        def __getattribute__(self, name):
            nonlocal read
            read += name == "due_ns"
            return super().__getattribute__(name)

    path = CommandedPath(Read(0, np.zeros(2)))
    trajectory = Trajectory(None, [np.array([0])], np.arange(10) * TICK, np.ones((10, 1)))
    fresh = 0
    for _ in range(count):
        fresh = path.join(trajectory, 0, TICK, fresh)
        path.ahead[-11:] = [Read(*v) for v in path.ahead[-11:]]
    return read


def test_joining_trajectories_costs_in_proportion_to_them():
    assert vertices_read(2000) < 2.5 * vertices_read(1000) < 100_000


def test_a_tick_joins_so_many_trajectories_and_the_rest_is_counted(monkeypatch):
    monkeypatch.setattr(commands_module, "MOST_TRAJECTORIES", 5)
    commands = queue(2)
    for _ in range(5):
        commands.accept_trajectory(["link_0"], [TICK], [[1.0]], 0)
    for _ in range(3):
        with pytest.raises(CommandError, match="5 trajectories are waiting for the next tick, the most it can join"):
            commands.accept_trajectory(["link_0"], [TICK], [[1.0]], 0)
    assert commands.full == 3
    take(commands)
    commands.accept_trajectory(["link_0"], [TICK], [[1.0]], 0)


def test_arrays_and_trajectories_replace_each_other():
    commands = queue(2)
    commands.accept_trajectory(["link_0"], [10 * TICK], [[10.0]], 0)
    take(commands, 0)
    commands.accept_actuation([0.5])
    assert [v.row[0] for v in take(commands, 1)] == [0.5]
    assert take(commands, 2) == []
    commands.accept_actuation([0.7])
    commands.accept_trajectory(["link_0"], [TICK], [[0.9]], 0)
    assert [v.row[0] for v in take(commands, 3)] == [0.7, 0.9]


def test_reset_drops_everything():
    commands = queue(2)
    commands.accept_actuation([1.0])
    commands.accept_trajectory(["link_0"], [TICK], [[1.0]], 0)
    commands.reset(np.zeros(5))
    assert take(commands) == []


NAMES = ["link_0"]
REFUSED = [
    ("accept_actuation", ([1.0],), "1 value(s); it needs 2, one per link"),
    ("accept_actuation", ([],), "0 value(s); it needs 2"),
    ("accept_actuation", ([1.0, float("nan")],), "entry 1 is nan"),
    ("accept_joints", (["contact_0"], np.zeros(1)), "joint command: no joint is called 'contact_0'; there are"),
    ("accept_joints", (["contact_0/forward"], np.zeros(1)), "'contact_0/forward' is a friction; this topic takes only"),
    ("accept_joints", (["link_1", "link_1"], np.zeros(2)), "a joint is named twice, at last by 'link_1'"),
    ("accept_joints", (["link_1", "link_0"], np.zeros(1)), "1 position(s) for 2 name(s); it needs one each"),
    ("accept_joints", (["link_1"], np.array([np.inf])), "link_1 is inf; it must be finite"),
    ("accept_friction", ([1.0, 1.0],), "2 value(s); it needs 1, 3 (one per contact) or 6"),
    ("accept_friction", ([1.0, -1.0, 1.0],), "entry 1 is -1 N; friction must be >= 0"),
    ("accept_friction", ([float("inf")],), "entry 0 is inf"),
    ("accept_friction", ([],), "0 value(s)"),
    ("accept_trajectory", (["link_9"], [0], [[1.0]], 0), "no joint is called 'link_9'"),
    ("accept_trajectory", (["link_0", "link_0"], [0], [[1.0, 1.0]], 0), "named twice"),
    ("accept_trajectory", (["contact_0/friction", "contact_0/forward"], [0], [[1.0, 1.0]], 0), "named twice"),
    ("accept_trajectory", (NAMES, [0], [[1.0, 2.0]], 0), "point 0 has 2 position(s) for 1 name(s)"),
    ("accept_trajectory", (NAMES, [5, 4], [[1.0], [2.0]], 0), "point 1 at 4 ns comes before 5 ns"),
    ("accept_trajectory", (NAMES, [-5], [[1.0]], 0), "point 0 at -5 ns comes before 0 ns"),
    ("accept_trajectory", (NAMES, [0], [[float("nan")]], 0), "point 0: link_0 is nan"),
    (
        "accept_trajectory",
        (["contact_2/forward"], [0], [[-1.0]], 0),
        "contact_2/forward is -1 N; friction must be >= 0",
    ),
    ("accept_trajectory", (NAMES, [0], [[1.0]], -1), "stamp -1 ns"),
]


@pytest.mark.parametrize(("method", "arguments", "said"), REFUSED)
def test_what_cannot_be_followed_is_refused_whole(method, arguments, said):
    commands = queue()
    with pytest.raises(CommandError) as error:
        getattr(commands, method)(*arguments)
    assert said in str(error.value)
    assert take(commands) == []


def loaded(lock_step=False) -> CommandQueue:
    scene = Scene.model_validate(
        {
            "name": "loaded",
            "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}},
            "friction": {"forward": 1.0, "backward": 2.0},
            "loads": 0.0,
        }
    )
    return CommandQueue(scene.columns, scene.drive.rows[0], lock_step)


def test_loads_pair_with_actuation_and_friction_by_count():
    commands = loaded()
    for k in (1.0, 2.0):
        commands.accept_actuation([k])
    commands.accept_friction([1.5])
    for load in ([0.25], [0.5, -0.5]):
        commands.accept_loads(load)
    vertices = take(commands)
    friction = [1.5] * 4
    assert [v.row.tolist() for v in vertices] == [[1, *friction, 0.25, 0.25], [2, *friction, 0.5, -0.5]]
    commands.accept_actuation([3.0])
    (vertex,) = take(commands, 1)
    assert vertex.row.tolist() == [3, *friction, 0.5, -0.5]


def test_loads_wait_for_actuation_in_lock_step():
    commands = loaded(lock_step=True)
    commands.accept_loads([0.25])
    assert take(commands) == []
    commands.accept_actuation([1.0])
    (vertex,) = take(commands)
    assert vertex.row.tolist() == [1, 1, 1, 2, 2, 0.25, 0.25]


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ([0.0] * 3, "load command has 3 value.s.; give 1 or 2"),
        ([], "load command has 0 value.s.; give 1 or 2"),
        ([np.nan], "load command: entry 0 is nan"),
        ([1.25], "loads sum to 2.5 N forward, but friction against sliding forward to 2 N: no equilibrium"),
        ([-4.5, 0.0], "loads sum to 4.5 N backward, but friction against sliding backward to 4 N"),
    ],
)
def test_loads_that_do_not_fit_change_nothing(values, text):
    commands = loaded()
    with pytest.raises(CommandError, match=text):
        commands.accept_loads(values)
    assert commands.waiting == 0
    assert take(commands) == []


def test_a_scene_without_loads_takes_none():
    with pytest.raises(CommandError, match="the scene has no loads; add `loads: 0` to the scene"):
        queue().accept_loads([0.0])


def test_friction_too_small_for_the_loads_is_refused():
    commands = loaded()
    commands.accept_loads([0.75])
    with pytest.raises(CommandError, match=r"friction command: the loads sum to 1\.5 N forward"):
        commands.accept_friction([0.5])
    with pytest.raises(CommandError, match="trajectory: point 1: the loads sum to 3 N forward"):
        commands.accept_trajectory(["contact_0/load"], [0, TICK], [[0.0], [3.0]], 0)


def test_a_row_without_equilibrium_is_dropped_and_counted_and_the_next_follows():
    """Either command is held by itself; a trajectory lowers the friction after the load was accepted."""
    commands = loaded()
    commands.accept_trajectory([f"contact_{i}/forward" for i in (0, 1)], [0], [[0.25, 0.25]], 0)
    commands.accept_loads([0.75])
    assert [v.row.tolist() for v in take(commands)] == [[0, 0.25, 0.25, 2, 2, 0, 0]]
    assert commands.unheld == 1
    commands.accept_actuation([1.0])
    (vertex,) = take(commands, 1)
    assert vertex.row.tolist() == [1, 0.25, 0.25, 2, 2, 0, 0]
    assert commands.unheld == 1


def test_loads_in_the_plane_are_a_pair_for_all_or_one_each():
    body = {"contacts": [[0.0, 0.0], [1.0, 0.0]], "links": {"stiffness": 1.0}}
    scene = Scene.model_validate(
        {"name": "plane", "dimension": 2, "body": body, "friction": {"isotropic": 1.0}, "loads": 0}
    )
    commands = CommandQueue(scene.columns, Crawler(scene).row)
    for values in ([0.25, 0.5], [0.25, 0.5, -0.5, 0.0]):
        commands.accept_loads(values)
    commands.accept_trajectory(["contact_1/load_y"], [0], [[0.125]], 0)
    for values in ([0.25], [0.25, 0.5, 0.75]):
        with pytest.raises(CommandError, match=r"value\(s\); give 2 or 4 \(x and y of each contact\)"):
            commands.accept_loads(values)
    with pytest.raises(CommandError, match=r"load command: the loads sum to \[3, 0\] N, 3 N long"):
        commands.accept_loads([1.5, 0.0])
    rows = [vertex.row[-4:].tolist() for vertex in take(commands, lasts_ns=1000)]
    assert [0.25, 0.5, 0.25, 0.5] in rows
    assert [0.25, 0.5, -0.5, 0.0] in rows


def test_after_a_refused_tick_waiting_messages_remain_and_a_running_trajectory_ends():
    scene = load_scene("three_contacts_one_way")
    commands = CommandQueue(scene.columns, scene.drive.rows[0], lock_step=True)
    before = commands.in_force
    for k in (1.0, 2.0):
        commands.accept_actuation([k, 0.0])
    commands.accept_trajectory(["link_1"], [TICK, 3 * TICK], [[1.0], [3.0]], 0)
    (refused,) = take(commands)
    commands.resume(before, TICK)
    (vertex,) = take(commands, 1)
    assert (refused.row[0], vertex.row[0]) == (1.0, 2.0)
    taken = take(commands, 2)
    assert taken[-1].row[:2].tolist() == [2.0, 1.0]
    commands.resume(vertex.row, 3 * TICK)
    assert commands.is_idle
    assert take(commands, 3) == []


@pytest.mark.parametrize("lock_step", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_vertices_taken_ahead_are_those_of_one_tick_after_another_to_the_bit(lock_step, seed):
    random = np.random.default_rng(seed)
    values = random.choice([-0.1, -0.0, 0.0, 0.3, 1 / 3], size=(30, 2))  # with repeats, and zeros of both signs
    times = np.sort(random.integers(0, 20, 30)) * (TICK // 2) + random.integers(0, 3)
    alone, ahead = queue(lock_step=lock_step), queue(lock_step=lock_step)
    for commands in (alone, ahead):
        commands.accept_trajectory(["link_0", "link_1"], times, values, 0)
        take(commands)  # the trajectory joins the path
    tick, ended = 1, False
    while not ended:
        taken = ahead.take_vertices(TICK * np.arange(tick, tick + 1 + random.integers(1, 6)))
        for k in range(taken.first.size - 1):
            one = alone.take_vertices(TICK * np.arange(tick + k, tick + k + 2))
            which = slice(*taken.first[k : k + 2])
            assert one.times_ns.tolist() == taken.times_ns[k : k + 2].tolist()
            assert one.due_ns.tolist() == taken.due_ns[which].tolist()
            assert one.rows.tobytes() == taken.rows[which].tobytes()
            ended = ended or one.ended == 0
            assert (taken.ended == k) == (one.ended == 0)
        assert ahead.now_ns == alone.now_ns
        assert ahead.in_force.tobytes() == alone.in_force.tobytes()
        tick += taken.first.size - 1


@pytest.mark.parametrize("lock_step", [False, True])
def test_trajectories_that_are_over_before_they_begin_are_counted(lock_step):
    """Not what sets a number at once, late as it may be, nor what still goes on."""
    commands = queue(lock_step=lock_step)
    commands.accept_actuation([0.0, 0.1])
    take(commands, 9)
    for stamp_ns, lasts_ns, counted in ((1, 0, 0), (TICK, 10 * TICK, 0), (TICK, 7 * TICK, 1), (0, TICK, 1)):
        commands.accept_trajectory(["link_0"], [lasts_ns], [[0.1]], stamp_ns)
        take(commands, 10)
        assert commands.overdue == counted
        commands.reset(commands.in_force)
