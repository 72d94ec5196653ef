"""The scenes of the gallery by kind, because parts of the project refuse bodies that turn.

Only their text is read: to load them would compile kernels in every worker before the first test.
"""

from __future__ import annotations

from importlib import resources

import yaml

from crawler_model import gallery

FOLDER = resources.files("msgs_config") / "scenes"
TURNING = tuple(
    n for n in gallery() if yaml.safe_load((FOLDER / f"{n}.yaml").read_text("utf-8"))["body"].get("springs")
)
"""Scenes of bodies that turn."""
NOT_TURNING = tuple(name for name in gallery() if name not in TURNING)
"""All others."""
