"""Trajectories as controllers send them: each is followed, or refused in one line that names what is wrong."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rosbags")
from rosbags.typesys import Stores, get_typestore

from crawler_model import CommandError
from crawler_ros.node.intake.decode import read_trajectory

from .test_commands import NS, queue, take

STORE = get_typestore(Stores.ROS2_JAZZY)
KIND = "trajectory_msgs/msg/JointTrajectory"
BOTH = ("link_0", "link_1")
AT_ONCE = ((0, (0.1, 0.2)),)


def message(names=BOTH, points=AT_ONCE, stamp_ns=0, moving=(), nanosec=None) -> bytes:
    """The bytes of a trajectory; the points whose numbers are in `moving` have velocities, too."""
    types = STORE.types
    duration, time = types["builtin_interfaces/msg/Duration"], types["builtin_interfaces/msg/Time"]
    made = [
        types["trajectory_msgs/msg/JointTrajectoryPoint"](
            positions=np.array(row, float),
            velocities=np.array(row if k in moving else (), float),
            accelerations=np.zeros(0),
            effort=np.zeros(0),
            time_from_start=duration(sec=ns // NS, nanosec=ns % NS if nanosec is None else nanosec),
        )
        for k, (ns, row) in enumerate(points)
    ]
    stamp = time(sec=stamp_ns // NS, nanosec=stamp_ns % NS)
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    return bytes(STORE.serialize_cdr(types[KIND](header=header, joint_names=list(names), points=made), KIND))


def send(commands, data: bytes) -> bool:
    """Hand a message over as the node does; return whether it holds more than positions."""
    found = read_trajectory(data)
    commands.accept_trajectory(found.names, found.times_ns, found.positions, found.stamp_ns)
    return found.has_more


FORTY = tuple((k * NS // 100, (0.01 * k, 0.0)) for k in range(1, 41))
FOLLOWED = {
    "one point at once": (message(), (0.1, 0.2)),
    "names in another order": (message(BOTH[::-1]), (0.2, 0.1)),
    "one of the joints": (message(BOTH[1:], ((0, (0.3,)),)), (0.0, 0.3)),
    "two points at one time": (message(points=((5, (0.1, 0.1)), (5, (0.3, 0.4)))), (0.3, 0.4)),
    "velocities at one of forty points": (message(points=FORTY, moving=(17,)), (0.4, 0.0)),
    "a stamp in the past": (message(stamp_ns=1), (0.1, 0.2)),
    "a stamp in the near future": (message(stamp_ns=NS // 10), (0.1, 0.2)),
    "wholly in the past": (message(points=((0, (9.0, 9.0)), (1, (0.1, 0.2))), stamp_ns=1), (0.1, 0.2)),
}
REFUSED = {
    "a time that is negative": (message(points=((-NS, (0.1, 0.2)),)), "point 0 at -1000000000 ns comes before 0 ns"),
    "times that decrease": (
        message(points=((NS, (0.1, 0.2)), (NS // 2, (0.1, 0.2)))),
        "point 1 at 500000000 ns comes before 1000000000 ns; times must not decrease",
    ),
    "a time of 30 years": (message(points=((10**9 * NS, (0.1, 0.2)),)), "time_from_start of the last point is 1e+09 s"),
    "a nanosecond field of a second": (message(nanosec=NS), "nanosec"),
    "a NaN": (message(points=((0, (np.nan, 0.2)),)), "link_0 is nan; it must be finite"),
    "an infinity": (message(points=((0, (0.1, -np.inf)),)), "link_1 is -inf; it must be finite"),
    "a number beyond all use": (message(points=((0, (0.1, 1e200)),)), "link_1 is 1e+200; it must be at most 1e+100"),
    "a name twice": (message(("link_0", "link_0")), "a joint is named twice, at last by 'link_0'; name each one once"),
    "a side of a friction twice": (
        message(("contact_1/friction", "contact_1/forward"), AT_ONCE),
        "a joint is named twice, at last by 'contact_1/forward'",
    ),
    "a name that is not known": (message(("link_0", "link_7")), "no joint is called 'link_7'"),
    "a name in other letters": (message(("Link_0", "link_1")), "no joint is called 'Link_0'"),
    "no names": (message((), ((0, (0.1, 0.2)),)), "point 0 has 2 position(s)"),
    "no points": (message(points=()), "it has no points; it needs at least one"),
    "no positions": (message(points=((0, ()),)), "point 0 has 0 position(s)"),
    "too few positions": (message(points=((0, (0.1,)),)), "point 0 has 1 position(s)"),
    "too many positions at the second point": (message(points=(*AT_ONCE, (5, (1, 2, 3)))), "point 1 has 3 position(s)"),
    "a stamp of the wall clock": (message(stamp_ns=1_700_000_000 * NS), "s ahead of simulated time; at most"),
    "a stamp before time 0": (message(stamp_ns=-NS), "stamp -1000000000 ns; simulated time starts at 0"),
    "negative friction": (message(("contact_1/friction",), ((0, (-0.5,)),)), "is -0.5 N; friction must be >= 0"),
}


@pytest.mark.parametrize(("data", "end"), FOLLOWED.values(), ids=FOLLOWED)
def test_it_is_followed(data, end):
    commands = queue()
    take(commands)  # so that simulated time is beyond 0
    assert send(commands, data) is (data == FOLLOWED["velocities at one of forty points"][0])
    rows = [vertex.row for tick in range(1, 60) for vertex in take(commands, tick)]
    assert rows[-1][:2].tolist() == pytest.approx(end, abs=1e-15)
    assert commands.is_idle


@pytest.mark.parametrize(("data", "said"), REFUSED.values(), ids=REFUSED)
def test_it_is_refused_whole_in_one_line(data, said):
    commands = queue()
    with pytest.raises(CommandError) as refused:
        send(commands, data)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert take(commands) == []
