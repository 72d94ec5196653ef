"""The attachments of a recording: all that is needed to simulate it again, to the bit in the same versions."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import crawler_model

if TYPE_CHECKING:
    from crawler_model import Crawler, Scene


def describe_run(scene: Scene, crawler: Crawler, parameters: dict[str, Any], node: str) -> dict[str, Any]:
    """Describe a run at its start.

    Args:
        scene: the scene that runs.
        crawler: the crawler at its start.
        parameters: parameters of the node.
        node: full name of the node.

    Returns:
        Plain data by name: scene, parameters, versions, node, start.
    """
    return {
        "scene": scene.document(),
        "parameters": parameters | {"method": crawler.method},
        "versions": versions(),
        "node": node,
        "start": {
            "displacement": crawler.displacement.tolist(),
            "tension": crawler.tension.tolist(),
            "actuation": crawler.actuation.tolist(),
            "friction": crawler.friction.tolist(),
        },
    }


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
    found = {"crawler": crawler_model.__version__, "python": platform.python_version()}
    found |= {name: installed_version(name) or "unknown" for name in ("numpy", "numba", "llvmlite")}
    found["machine"] = platform.machine()
    return found


def other_versions(recorded: object) -> list[str]:
    """List the programs whose versions were others when a recording was made.

    Args:
        recorded: its attachment `versions`; None if it has none.

    Returns:
        A phrase for each.
    """
    ours = versions()
    if not isinstance(recorded, dict):
        return []
    return [
        f"recorded with {name} {recorded[name]}, here {ours[name]}"
        for name in ours
        if recorded.get(name, ours[name]) != ours[name]
    ]
