"""The versions that decide the bits of a result."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

import crawler_ros


def versions() -> dict[str, str]:
    """List the versions that decide the bits of a result."""
    found = {"crawler": crawler_ros.__version__, "python": platform.python_version()}
    for name in ("numpy", "numba", "llvmlite"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    found["machine"] = platform.machine()
    return found
