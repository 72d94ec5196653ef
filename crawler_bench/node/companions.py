"""Processes beside the simulator while the node is measured: one that listens to all, and one that does nothing.

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
from crawler_ros.wire import interface

NS = 10**9


def listen() -> None:
    """Subscribe to every topic of the simulator until SIGINT."""
    import rclpy
    from rclpy.experimental.events_executor import EventsExecutor
    from rclpy.signals import SignalHandlerOptions

    interface.find_ament_prefix()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    ended = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: ended.set())
    node = rclpy.create_node("listener")
    for name, topic in interface.topics().items():
        if topic.direction == "out":
            kind, qos = interface.message_class(topic.type), interface.qos_profile(topic)
            node.create_subscription(kind, name, lambda _: None, qos, raw=True)
    executor = EventsExecutor()
    executor.add_node(node)
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.1)
    rclpy.try_shutdown()


def keep_rate(rate: float, seconds: float) -> None:
    """Keep a rate with nothing to do, as the simulator keeps it; print how many ticks were late."""
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
