"""Colours of all pictures, in matplotlib and in rerun; colour-blind readers can distinguish forward from back."""

from __future__ import annotations

FORWARD, BACK = "#009e73", "#c8400f"
"""Slips forward and back, and facets of the stasis domain that allow motion in that direction."""
BOTH = "#22303a"
"""Slips forward and back that a picture cannot separate."""
STICK, GREY = "#c8c8c8", "#8a8a8a"
TEXT = "#5a5a5a"
BAND, BOUND = "#f1efe9", "#8f8878"
"""The range between two bounds, and the bounds."""
TENSION, ACTUATION = "#2f5fc4", "#e08a1e"
JUMP = "#9b2fae"
"""Jumps of contacts onto ground that holds less."""
WALL = "#5b4636"
"""Walls on the track."""
STALLED = "#e6007e"
"""Links whose actuator stalls; slack links are grey and sag."""
YIELDING = "#5a2a6b"
"""Links whose elements of hysteresis yield."""
CONTACTS = ("#1f3fbf", "#1fa8c8")
"""The two contacts of a body, where both are drawn as lines."""
LINES = ("#2f5fc4", "#e08a1e", "#1b1b1b", "#56b4e9", "#665c00", "#e07ab8", "#5a2a6b", "#8a8a8a")
"""Up to eight curves of one kind; none is the colour of a slip."""


def rgb(color: str) -> tuple[int, int, int]:
    """Split a colour into its components.

    Args:
        color: as "#rrggbb".

    Returns:
        Red, green and blue, 0 .. 255.
    """
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue
