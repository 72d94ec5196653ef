"""Processes that run beside the simulator while the node is measured: a subscriber to all topics, and an empty loop.

python -m crawler_bench.node.companions listen
python -m crawler_bench.node.companions idle RATE_HZ SECONDS
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from fractions import Fraction

from crawler_ros.node.stepper import Stepper
from crawler_ros.wire.definitions import find_ament_prefix
from crawler_ros.wire.topics import message_class, qos_profile, read_topics

NS = 10**9


def listen() -> None:
    """Subscribe to every topic of the simulator until SIGINT."""
    import rclpy
    from rclpy.experimental.events_executor import EventsExecutor
    from rclpy.signals import SignalHandlerOptions

    find_ament_prefix()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    ended = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: ended.set())
    node = rclpy.create_node("listener")
    for name, topic in read_topics().items():
        if topic.direction == "out":
            kind, qos = message_class(topic.type), qos_profile(topic)
            node.create_subscription(kind, name, lambda _: None, qos, raw=True)
    executor = EventsExecutor()
    executor.add_node(node)
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.1)
    rclpy.try_shutdown()


def keep_rate(rate: float, seconds: float) -> None:
    """Run an empty loop at a rate, timed like the simulator; print the number of late ticks."""
    stepper = Stepper(Fraction(rate))
    while stepper.tick < seconds * rate:
        wait = stepper.wait_ns(time.monotonic_ns())
        assert wait is not None
        if wait > 0:
            time.sleep(wait / NS)
        else:
            stepper.begin(time.monotonic_ns())
            stepper.finish()
    print(stepper.late)


if __name__ == "__main__":
    if sys.argv[1] == "listen":
        listen()
    else:
        keep_rate(float(sys.argv[2]), float(sys.argv[3]))
