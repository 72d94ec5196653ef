"""What can go wrong with a value that someone handed in."""

from __future__ import annotations

LARGEST = 1e100
"""Greatest size of any length, force or stiffness that is taken: products of two must not overflow."""


class CrawlerError(ValueError):
    """The root of every error that this package raises on purpose: one line that names field, value and bound."""


class SceneError(CrawlerError):
    """A scene that cannot be used: unknown keys, wrong lengths, values out of bounds, an inadmissible start."""


class CommandError(CrawlerError):
    """A command that cannot be followed: wrong length, not finite, negative friction. The state is untouched."""
