"""Parameters that a command line or a file gives to a node which has none of that name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

_OF_ROS = ("qos_overrides", "use_sim_time", "start_type_description_service")
"""Beginnings of the names of parameters that ROS itself declares, some of them with a topic."""


def refuse_unknown(node: Any, known: Iterable[str]) -> None:
    """Refuse a parameter that the node does not have: what was meant would have no effect.

    Args:
        node: an rclpy node.
        known: names of its parameters.

    Raises:
        ValueError: when there is one; the message names the nearest parameter, or all.
    """
    own = [name for name in known if not name.startswith(_OF_ROS)]
    for name in getattr(node, "_parameter_overrides", {}):
        if name not in own and not name.startswith(_OF_ROS):
            raise ValueError(describe_unknown(name, own))


def describe_unknown(name: str, known: Iterable[str]) -> str:
    """Name an unknown parameter and what may have been meant.

    Args:
        name: the unknown name.
        known: names of the parameters that there are.

    Returns:
        The line.
    """
    known = list(known)
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f"unknown parameter {name!r}; " + (
        f"the nearest is {near[0]!r}" if near else f"the parameters are {', '.join(known)}"
    )
