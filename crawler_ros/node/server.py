"""The thread that serves topics and services."""

from __future__ import annotations

import os
import threading
import time
from typing import Any

from .life.stop import StopFlag

_POLL_NS = 300_000
"""Longest time for which the reply to an answer is polled for [ns]."""
_QUICK_NS = 500_000
"""Answers less than this apart are a quick exchange [ns]; otherwise polling would end before the reply."""
_IDLE_S = 0.1


class Server:
    """Serves the topics and services of a node in a thread of its own, until a flag is set.

    An idle processor takes long to wake, and continues with cold caches. During a quick exchange, where the next
    message is the reply to an answer just published, the thread therefore polls for a short time before it sleeps. A
    slow exchange and an idle node take no processor time for it.
    """

    def __init__(self, node: Any, stopping: StopFlag) -> None:
        """Store the node and the flag.

        Args:
            node: the rclpy node.
            stopping: flag that ends the thread; set when the thread fails.
        """
        self._node, self._stopping = node, stopping
        self._thread: threading.Thread | None = None
        self._alone = hasattr(os, "sched_getaffinity") and len(os.sched_getaffinity(0)) == 1
        self._answered_ns = self._poll_until_ns = 0

    def start(self, executor: Any) -> None:
        """Start to serve.

        Args:
            executor: an rclpy executor that the node was added to.
        """
        self._thread = threading.Thread(target=self._serve, args=(executor,), name="executor", daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Wait until the thread has ended, if it was started."""
        if self._thread is not None:
            self._thread.join()

    def expect_reply(self) -> None:
        """Poll for a reply to the answer that was just published, if there was another answer shortly before.

        A callback of the node calls this. On a single processor nothing is polled for: the peer needs it to reply.
        """
        now = time.monotonic_ns()
        if now - self._answered_ns < _QUICK_NS and not self._alone:
            self._poll_until_ns = now + _POLL_NS
        self._answered_ns = now

    def _serve(self, executor: Any) -> None:
        try:
            while not self._stopping.is_set():
                if time.monotonic_ns() < self._poll_until_ns:
                    executor.spin_once(timeout_sec=0.0)
                    os.sched_yield()  # to the threads of the middleware, which bring the message
                else:
                    executor.spin_once(timeout_sec=_IDLE_S)
        except Exception as error:  # without commands the simulation must not go on as if all were well
            self._node.get_logger().fatal(f"topics and services are no longer served: {error!r}")
            self._stopping.set()
        executor.remove_node(self._node)
