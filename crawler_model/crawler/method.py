"""The methods by which ramps are followed, and how much work one may take."""

from __future__ import annotations

from typing import Literal

from ..body.body import Body
from ..body.plan import Plan
from ..errors import CommandError
from ..motion.follow import build_motion

Method = Literal["exact", "catch_up"]
METHODS: tuple[Method, ...] = ("exact", "catch_up")


def default_budget(body: Body) -> int:
    """Compute the upper limit of work in one ramp unless another one is given, see `Crawler`.

    Args:
        body: the body.

    Returns:
        The limit.
    """
    return 200_000 * (body.contacts + 100) if body.dimension == 2 else 10_000 * (body.contacts + 1000)


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
