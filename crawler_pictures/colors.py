"""Colours of all pictures, in matplotlib and in rerun; colour-blind readers can distinguish forward from back."""

from __future__ import annotations

FORWARD, BACK = "#009e73", "#c8400f"
"""Slips forward and back, and facets of the stasis domain that allow motion in that direction."""
STICK, GREY = "#c8c8c8", "#8a8a8a"
TENSION, ACTUATION = "#2f5fc4", "#e08a1e"
JUMP = "#9b2fae"
"""Jumps of contacts onto ground that holds less."""
CONTACTS = ("#1f3fbf", "#1fa8c8")
"""The two contacts of a body, where both are drawn as lines."""


def rgb(color: str) -> tuple[int, int, int]:
    """Split a colour into its components.

    Args:
        color: as "#rrggbb".

    Returns:
        Red, green and blue, 0 .. 255.
    """
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue
