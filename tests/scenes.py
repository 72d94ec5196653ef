"""The scenes of the gallery by kind, because parts of the project refuse bodies that turn."""

from __future__ import annotations

from crawler_model import gallery, load_scene

TURNING = tuple(name for name in gallery() if load_scene(name).document()["body"].get("springs") == "length")
"""Scenes of bodies that turn."""
NOT_TURNING = tuple(name for name in gallery() if name not in TURNING)
"""All others."""
