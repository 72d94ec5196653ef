"""How much work a ramp may take."""

from __future__ import annotations

from ..body.body import Body


def default_budget(body: Body) -> int:
    """Compute the upper limit of work in one ramp unless another one is given, see `Crawler`.

    Args:
        body: the body.

    Returns:
        The limit.
    """
    return 200_000 * (body.contacts + 100) if body.dimension == 2 else 10_000 * (body.contacts + 1000)
