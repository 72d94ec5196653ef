"""Scenes that wait for commands, and trajectories that drive them for longer than a measurement."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from crawler_model.body.names import name_each, name_joints

from ..cases import snake_scene
from .domain import Domain, build_trajectory


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
    return _write(folder / f"chain_{contacts}.yaml", scene)


def _write(path: Path, document: dict[str, Any]) -> Path:
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def write_segment(folder: Path, accuracy: float) -> Path:
    """Write the gallery's continuous segment with another accuracy.

    Args:
        folder: folder of the file.
        accuracy: accuracy of the scene's segment.

    Returns:
        The file.
    """
    from crawler_model import load_scene

    scene = load_scene("continuous_segment").document()
    scene["body"]["segments"][0]["accuracy"] = accuracy
    return _write(folder / f"segment_{accuracy:g}.yaml", scene)


def write_snake(folder: Path, contacts: int) -> Path:
    """Write the scene of a snake that turns.

    Args:
        folder: folder of the file.
        contacts: number of contacts N.

    Returns:
        The file.
    """
    return _write(folder / f"snake_{contacts}.yaml", snake_scene(contacts).document())


def swim(domain: Domain, contacts: int) -> None:
    """Drive a snake by the waves of its scene, with a period of 1 s, for the longest duration of a measurement."""
    scene = snake_scene(contacts)
    rows = np.tile(scene.drive.actuation[:-1], (300, 1))
    trajectory = build_trajectory(name_joints(scene.body), rows, float(scene.drive.times[1]))
    domain.publisher("joint_trajectory").publish(trajectory)


def wave(domain: Domain, contacts: int) -> None:
    """Drive a chain by a travelling wave with a period of 1 s for the longest duration of a measurement."""
    domain.publisher("joint_trajectory").publish(_wave_trajectory(contacts))


@functools.cache
def _wave_trajectory(contacts: int) -> Any:
    samples, periods = 16, (6000 if contacts <= 100 else 120)  # a quick processor ends 3 000 periods in 3 s
    time_in_period = np.arange(samples * periods)[:, None] / samples
    rows = 0.05 * np.sin(2.0 * np.pi * (time_in_period - np.arange(contacts - 1) / 5.0))
    return build_trajectory(name_each("link", contacts - 1), rows, 1.0 / samples)


def strokes(domain: Domain) -> None:
    """Stretch the segment of `write_segment` back and forth for the longest duration of a measurement."""
    rows = np.tile([[0.0], [0.2]], (300, 1))
    domain.publisher("joint_trajectory").publish(build_trajectory(["trunk"], rows, 0.5))
