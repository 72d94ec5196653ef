"""The scenes of the gallery by kind, because parts of the project refuse bodies that turn.

Only their text is read: to load them would compile kernels in every worker before the first test.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np
import yaml

from crawler_model import Scene, gallery

FOLDER = resources.files("msgs_config") / "scenes"
TURNING = tuple(
    n for n in gallery() if yaml.safe_load((FOLDER / f"{n}.yaml").read_text("utf-8"))["body"].get("springs")
)
"""Scenes of bodies that turn."""
NOT_TURNING = tuple(name for name in gallery() if name not in TURNING)
"""All others."""


def wave_scene(contacts: int, wavelength: float, ground: float = 1.0) -> Scene:
    """Build a wave of lengthening on contacts that slide more easily forwards.

    Args:
        contacts: number of contacts N.
        wavelength: wavelength [m]; links are 1 m long.
        ground: factor of the friction of a contact.

    Returns:
        The scene.
    """
    middle = np.arange(contacts - 1) + 0.5
    start = np.concatenate(([0.0], np.cumsum(np.sin(-2 * np.pi * middle / wavelength))))
    return Scene.model_validate(
        {
            "name": f"wave_{contacts}",
            "body": {"contacts": list(range(contacts)), "links": {"stiffness": 1.0}},
            "friction": {"forward": 0.1 * ground, "backward": 0.3 * ground},
            "start": {"displacement": start.tolist()},
            "drive": {"wave": {"amplitude": 1.0, "wavelength": wavelength, "period": 1.0}},
        }
    )


def write_chain(folder: Path, contacts: int) -> Path:
    """Write the scene of a chain that waits for commands.

    Args:
        folder: folder of the file.
        contacts: number of contacts N.

    Returns:
        The file.
    """
    scene = {
        "name": f"chain_{contacts}",
        "body": {"contacts": [round(0.1 * i, 6) for i in range(contacts)], "links": {"stiffness": 10.0}},
        "friction": {"forward": 0.2, "backward": 0.5},
    }
    path = folder / f"chain_{contacts}.yaml"
    path.write_text(yaml.safe_dump(scene), encoding="utf-8")
    return path
