"""Versions of installed packages, and those that determine the bits of a result."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

import crawler_ros


def installed_version(name: str) -> str | None:
    """Look up the version of an installed package.

    Args:
        name: name of its distribution.

    Returns:
        The version; None when the package is not installed.
    """
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def versions() -> dict[str, str]:
    """List the versions that determine the bits of a result."""
    found = {"crawler": crawler_ros.__version__, "python": platform.python_version()}
    found |= {name: installed_version(name) or "unknown" for name in ("numpy", "numba", "llvmlite")}
    found["machine"] = platform.machine()
    return found
