"""What `check` and `simulate` report of a body that turns: its gain in its own frame, its stability and its jumps."""

from __future__ import annotations

import math

import numpy as np
from rich.console import Console

from crawler_model import Trajectory
from crawler_pictures.numbers import error_of, write_length, write_stability

_MOST_JUMPS = 8
_TURN = 2.0 * math.pi


def print_turning(run: Trajectory, screen: Console) -> None:
    """Print how a body that turns moved; nothing for other bodies.

    Args:
        run: the run of the scene along its drive.
        screen: the console to print to.
    """
    if run.scene.body.turning is None:
        return
    size = float(abs(run.displacement).max()) + float(np.ptp(run.scene.body.position, axis=0).max())
    turned = float(run.yaw[-1] - run.yaw[0])
    screen.print(f"it turned by {write_length(turned, _TURN)} rad")
    if run.per_period.shape[0]:
        gain, screw = run.per_period[-1], run.screws[-1]
        along = write_length(gain[:2], size, error_of(run.scene))
        text = f"in the last period, along and across its heading: {along} m, and it turned by "
        circle = "" if screw.radius is None else f", on a circle of radius {screw.radius:.6g} m"
        screen.print(f"{text}{write_length(gain[2], _TURN)} rad{circle}")
    if run.stability_margin is not None and run.stability_time is not None:
        screen.print(write_stability(run.stability_margin, run.stability_time))
    for jump in run.jumps[:_MOST_JUMPS]:
        screen.print(
            f"[yellow]it jumped[/] at {jump.time:g} s: its point {jump.contact} moved {jump.distance:.4g} m at once, "
            f"{jump.loss:.4g} J were lost; where a jump ends is one choice of several"
        )
    if len(run.jumps) > _MOST_JUMPS:
        screen.print(f"({len(run.jumps) - _MOST_JUMPS} more jumps)")
