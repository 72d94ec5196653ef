"""The process between a node's log and its reader, here as a thread: what it reads, it writes at once."""

from __future__ import annotations

import os
import select
import threading

from crawler_ros.node.life.log_drain import Drain


def test_each_line_arrives_before_the_next_is_written():
    source, log = os.pipe()
    shown, sink = os.pipe()
    reading = threading.Thread(target=Drain(source, sink).read)
    reading.start()
    try:
        for k in range(20):  # the writing thread waits for each but perhaps the first
            os.write(log, f"line {k}\n".encode())
            assert select.select([shown], [], [], 60.0)[0], f"line {k} did not arrive"
            assert os.read(shown, 100) == f"line {k}\n".encode()
    finally:
        os.close(log)
        reading.join()
        for fd in (source, shown, sink):
            os.close(fd)
