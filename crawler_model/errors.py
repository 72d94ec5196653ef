"""Errors for invalid input."""

from __future__ import annotations

LARGEST = 1e100
"""Largest absolute value accepted for a length, force or stiffness, so that products of two do not overflow."""


class CrawlerError(ValueError):
    """Base class of all deliberate errors of this package: one line that names the field, the value and the bound."""


class SceneError(CrawlerError):
    """A scene that cannot be used: unknown keys, wrong lengths, values out of bounds, an inadmissible start."""


class CommandError(CrawlerError):
    """A command that cannot be followed: wrong length, not finite, negative friction. The state does not change."""
