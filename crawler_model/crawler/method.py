"""The methods by which ramps are followed."""

from __future__ import annotations

from typing import Literal

from ..body.plan import Plan
from ..errors import CommandError
from ..motion.follow import build_motion

Method = Literal["exact", "catch_up"]
METHODS: tuple[Method, ...] = ("exact", "catch_up")


def choose_method(scene: Plan, method: str | None) -> Method:
    """Check a method against a scene.

    Args:
        scene: the scene.
        method: "exact", "catch_up", or None for the best one available.

    Returns:
        The method.

    Raises:
        CommandError: if the method is unknown or not available for this body.
    """
    offered = build_motion(scene).methods
    if method is None:
        return offered[0]  # type: ignore[return-value]
    if method not in METHODS:
        raise CommandError(f"method: {method!r}; it must be one of {', '.join(METHODS)}")
    if method not in offered and method == "catch_up":
        passed = {
            "ground.patches": "over the borders of ground.patches instead of meeting",
            "ground.walls": "through ground.walls instead of stopping at",
        }["ground.walls" if scene.ground.track is None else scene.ground.track.leaps]
        raise CommandError(f"method: catch_up steps {passed} them; use exact")
    if method not in offered:
        raise CommandError(
            "method: exact is for bodies on a line, where paths are straight from event to event; in the plane "
            "they are curved: use catch_up, whose steps are refined to the scene's tolerance"
        )
    return method  # type: ignore[return-value]
