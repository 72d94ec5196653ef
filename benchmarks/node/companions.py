"""Processes that run next to the simulator while the node is measured: a subscriber, a controller, and an empty loop.

python -m benchmarks.node.companions listen
python -m benchmarks.node.companions control LINKS TRIPS
python -m benchmarks.node.companions echo LINKS
python -m benchmarks.node.companions idle RATE_HZ SECONDS
"""

from __future__ import annotations

import itertools
import json
import signal
import sys
import time
from array import array
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from crawler_model.body.names import name_each
from crawler_ros.node.life.stop import StopFlag
from crawler_ros.node.tick_clock import TickClock
from crawler_ros.wire.definitions import find_ament_prefix
from crawler_ros.wire.messages import lay_out_joint_state
from crawler_ros.wire.topics import message_class, qos_profile, read_topics
from tests.processes import wait_until

NS = 10**9


def listen() -> None:
    """Subscribe to every topic of the simulator until SIGINT."""

    def open_topics(node: Any, _: StopFlag) -> None:
        for name, topic in read_topics().items():
            if topic.direction == "out":
                kind, qos = message_class(topic.type), qos_profile(topic)
                node.create_subscription(kind, name, lambda _: None, qos, raw=True)

    _spin("listener", open_topics)


def control(links: int, trips: int) -> None:
    """Control a simulator in lock-step: answer each state with a command; print the times of the round trips [us]."""
    times: list[int] = []

    def open_topics(node: Any, ended: StopFlag) -> None:
        topics = read_topics()
        commands, states = topics["actuation_controller/commands"], topics["joint_states"]
        command = message_class(commands.type)()
        publisher = node.create_publisher(type(command), commands.name, qos_profile(commands))
        last = [0.0]

        def answer(state: Any) -> None:
            stamp = state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec
            if stamp <= last[0] and times:  # state 0, which is repeated for newcomers
                return
            last[0] = stamp
            wait_until(lambda: publisher.get_subscription_count() > 0)
            times.append(time.perf_counter_ns())
            if len(times) > trips:
                ended.set()
                return
            # an eighth of the elongations that were seen, far too little to slide
            command.data = array("d", [1e-3 + 0.125 * z for z in state.position[1 : 1 + links]])
            publisher.publish(command)

        node.create_subscription(message_class(states.type), states.name, answer, qos_profile(states))

    _spin("controller", open_topics)
    print(json.dumps([(b - a) / 1e3 for a, b in itertools.pairwise(times)]))


def echo(links: int) -> None:
    """Answer each command of a controller with a state of constant numbers, without simulating it, until SIGINT."""

    def open_topics(node: Any, _: StopFlag) -> None:
        topics = read_topics()
        commands, states = topics["actuation_controller/commands"], topics["joint_states"]
        publisher = node.create_publisher(message_class(states.type), states.name, qos_profile(states))
        state, count = lay_out_joint_state(["contact_0", *name_each("link", links)]), itertools.count(1)
        numbers = [0.0] * 3 * (1 + links)

        def answer(_: bytes) -> None:
            publisher.publish(state.encode(next(count) * NS // 1000, numbers))

        def begin() -> None:  # state 0, repeated for newcomers
            publisher.publish(state.encode(0, numbers))

        node.create_timer(0.05, begin)
        node.create_subscription(message_class(commands.type), commands.name, answer, qos_profile(commands), raw=True)

    _spin("echo", open_topics)


def _spin(name: str, open_topics: Callable[[Any, StopFlag], None]) -> None:
    """Spin a node until SIGINT, or until it sets the flag that `open_topics` receives with it."""
    import rclpy
    from rclpy.experimental.events_executor import EventsExecutor
    from rclpy.signals import SignalHandlerOptions

    find_ament_prefix()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    ended = StopFlag()
    signal.signal(signal.SIGINT, lambda *_: ended.set())
    node = rclpy.create_node(name)
    open_topics(node, ended)
    executor = EventsExecutor()
    executor.add_node(node)
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.1)
    rclpy.try_shutdown()


def keep_rate(rate: float, seconds: float) -> None:
    """Run an empty loop at a rate, timed like the simulator; print the number of late ticks."""
    tick_clock = TickClock(Fraction(rate))
    while tick_clock.tick < seconds * rate:
        wait = tick_clock.wait_ns(time.monotonic_ns())
        assert wait is not None
        if wait > 0:
            time.sleep(wait / NS)
        else:
            tick_clock.begin(time.monotonic_ns())
            tick_clock.finish()
    print(tick_clock.late)


if __name__ == "__main__":
    if sys.argv[1] == "listen":
        listen()
    elif sys.argv[1] == "control":
        control(int(sys.argv[2]), int(sys.argv[3]))
    elif sys.argv[1] == "echo":
        echo(int(sys.argv[2]))
    else:
        keep_rate(float(sys.argv[2]), float(sys.argv[3]))
