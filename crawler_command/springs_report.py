"""What `check` reports of tensions: the largest, where tendons go slack and motors stall, and what would avoid it."""

from __future__ import annotations

import numpy as np
from rich.console import Console

from crawler_model import Crawler, Trajectory
from crawler_model.body.body import Body
from crawler_model.body.curves import YIELD, Bend
from crawler_model.body.drive import NS
from crawler_model.body.names import name_every_spring
from crawler_pictures.numbers import write_length

_MOST_LINES = 8


def print_largest_force(run: Trajectory, screen: Console) -> None:
    """Print the largest force of an actuator along the drive: one that reaches more, either way, never stalls.

    Args:
        run: the run of the scene along its drive.
        screen: the console to print to.
    """
    body = run.scene.body
    tension = run.tension[:, : body.springs]
    force = np.linalg.norm(tension.reshape(*tension.shape[:2], -1), axis=2)
    z, lengths = _states(run) if body.bends else (force, force)
    for bend in body.bends:  # passive springs and stops carry the rest
        force[:, bend.spring] = np.abs(bend.actuator(z[:, bend.spring] - lengths[:, bend.spring]))
    most, names = force.max(axis=0), name_every_spring(body)
    screen.print(f"largest force of an actuator along the drive: {most.max():.6g} N, of {names[most.argmax()]}")
    torque = np.abs(run.tension[:, body.springs :]).max(axis=0)
    if torque.size:
        screen.print(f"largest torque: {torque.max():.6g} N m, of {names[body.springs + int(torque.argmax())]}")


def _states(run: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Compute the elongations z and the rest lengths L of a run, shape (T, S) each [m]."""
    ticks = np.rint(run.time * NS).astype(np.int64)
    ends, targets, *_ = run.scene.drive.ramps_between(-1, ticks)
    lengths = Crawler(run.scene, run.method).lengths_at(targets)
    return run.scene.body.elongation(run.displacement), lengths[np.searchsorted(ends, ticks)]


def print_limits_of_tension(run: Trajectory, screen: Console) -> None:
    """Print which actuators reach a limit along the drive, commands that avoid it, and friction that none overcomes.

    Args:
        run: the run of the scene along its drive.
        screen: the console to print to.
    """
    body, names = run.scene.body, name_every_spring(run.scene.body)
    bends = {bend.spring: bend for bend in body.bends}
    z, lengths = _states(run)
    states = body.limits.find_states(z, lengths)
    lines = []
    for k, spring in enumerate(body.limits.index.tolist()):
        lines += _describe(bends[spring], names[spring], states[:, k], z[:, spring], lengths[:, spring], run.rate)
    lines += _find_weak(body, run)
    for line in lines[:_MOST_LINES]:
        screen.print(line)
    if len(lines) > _MOST_LINES:
        screen.print(f"({len(lines) - _MOST_LINES} more lines on limits of tension)")


def _describe(bend: Bend, name: str, state: np.ndarray, z: np.ndarray, length: np.ndarray, rate: float) -> list[str]:
    """Describe when an actuator is beyond its limits at ticks; commands cut off there move the body in the same way."""
    words = [
        (word, (state == sign).mean()) for sign, word in ((-1, "goes slack"), (1, "stalls")) if (state == sign).any()
    ]
    if not words:
        least, most = (f"{limit:g} N" for limit in bend.limits)
        return [f"{name} stays within its limits of tension, {least} to {most}"]
    curve, size = bend.actuator, float(np.abs(length).max())
    low = z - (curve.at[-1] if np.isfinite(bend.limits[1]) else np.inf)
    high = z - (curve.at[0] if np.isfinite(bend.limits[0]) else -np.inf)
    followed = np.clip(length, low, high)
    span = f"{write_length(float(followed.min()), size)} .. {write_length(float(followed.max()), size)} m"
    return [
        f"{name} {' and '.join(f'{word} during {part:.0%} of the drive' for word, part in words)}; lengths between "
        f"{span}, as read every {1.0 / rate:g} s, would move it as far"
    ]


def _find_weak(body: Body, run: Trajectory) -> list[str]:
    """Find contacts at rest whose friction all their links together never overcome."""
    most, least = np.full(body.springs, np.inf), np.full(body.springs, -np.inf)
    for bend in body.bends:
        if bend.passive.slopes.max() == 0.0:
            more = sum(slider[YIELD] for slider in bend.sliders)
            least[bend.spring], most[bend.spring] = bend.limits[0] - more, bend.limits[1] + more
    lines = []
    for i in np.flatnonzero(~run.slid.any(axis=0)):
        ahead = most[body.ends[:, 0] == i].sum() - least[body.ends[:, 1] == i].sum()
        behind = most[body.ends[:, 1] == i].sum() - least[body.ends[:, 0] == i].sum()
        needed = (run.scene.drive.forward[:, i].min(), run.scene.drive.backward[:, i].min())
        if ahead < needed[0] and behind < needed[1]:
            lines.append(
                f"{body.name_of(int(i))} never slides: it takes {needed[0]:g} N forward or {needed[1]:g} N backward, "
                f"and its links reach {ahead:g} N and {behind:g} N"
            )
    return lines
