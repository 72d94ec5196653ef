"""The process of a controller that `crawler run` starts: its file, run as Python runs it, but for the end.

A stop that the verb asks for raises KeyboardInterrupt, or an error of rclpy, whose context ends with the signal.
Neither is an error of the controller, and neither is printed.
"""

from __future__ import annotations

import os
import runpy
import signal
import sys
import threading
from types import TracebackType
from typing import Any

_LATER_S = 0.5
"""rclpy ends its context in the signal handler, which threads may see this long before Python knows of the signal."""
_OWN = (__file__, runpy.run_path.__code__.co_filename)


def main() -> None:
    """Run the file that the first argument names, with the others as its arguments."""
    del sys.argv[0]
    sys.path[0] = os.path.dirname(os.path.realpath(sys.argv[0]))
    asked = threading.Event()

    def stop(number: int, frame: Any) -> None:
        asked.set()
        signal.default_int_handler(number, frame)

    def is_stop(kind: type[BaseException], traceback: TracebackType | None) -> bool:
        while traceback is not None and traceback.tb_next is not None:
            traceback = traceback.tb_next
        raised_in = "" if traceback is None else traceback.tb_frame.f_globals.get("__name__", "")
        if kind is not KeyboardInterrupt and "rclpy" not in kind.__module__ and raised_in.split(".")[0] != "rclpy":
            return False
        try:
            return asked.wait(_LATER_S)
        except KeyboardInterrupt:
            return True

    def report(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
        while traceback is not None and traceback.tb_frame.f_code.co_filename in _OWN:
            traceback = traceback.tb_next
        if not is_stop(kind, traceback):
            sys.__excepthook__(kind, error.with_traceback(traceback), traceback)

    def report_from_thread(found: threading.ExceptHookArgs) -> None:
        if not is_stop(found.exc_type, found.exc_traceback):
            threading.__excepthook__(found)

    sys.excepthook, threading.excepthook = report, report_from_thread
    signal.signal(signal.SIGINT, stop)
    runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    main()
