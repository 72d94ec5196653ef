"""The part of the report of `crawler check` about loads: the limits of the body at rest, and of its gait."""

from __future__ import annotations

import math

import numpy as np
from rich.console import Console

from crawler_model import CommandError, Limit, Trajectory, largest_tow, steepest_climb
from crawler_model.body.plan import Plan
from crawler_model.body.planar_loads import split_target
from crawler_model.run.limits import SLOPES_TRIED
from crawler_model.theory.holding import Holding, Tilt, compute_holding, steepest_held
from crawler_pictures.numbers import write_size

from .screen import progress_bar

_BUDGET = 1_000_000
"""Periods times waypoints times contacts of each search: a second or two."""
_DIRECTIONS = {1: "forward", -1: "backward"}


def print_holding(run: Trajectory, screen: Console) -> None:
    """Print the limits of a body at rest, at the start of its run.

    Args:
        run: the run.
        screen: the console to print to.
    """
    scene, body = run.scene, run.scene.body
    if body.turning is not None:
        screen.print("largest tow and steepest slope that it holds at rest: not computed for bodies that turn")
        return
    wall = _find_wall_at_start(run)
    if wall is not None:
        contact, number = wall
        screen.print(
            f"largest tow and steepest slope that it holds at rest: not computed, as {body.name_of(contact)} stands at "
            f"wall {number}, which holds any force"
        )
        return
    if body.dimension == 2:
        _print_planar_holding(scene, screen)
    else:
        _print_holding_on_line(run, screen)
    if scene.ground.even_part:
        screen.print(
            "the limits at rest are the sums of the friction at the start: contacts that slide before the body gives "
            "way may change them"
        )


def _print_holding_on_line(run: Trajectory, screen: Console) -> None:
    scene, body = run.scene, run.scene.body
    drive, ground = scene.drive, scene.ground
    load = drive.loads[0] if scene.columns.loads else np.zeros(body.contacts)
    plus, minus = drive.forward[0], drive.backward[0]
    if ground.track is not None:
        plus, minus, load = ground.track.local_bounds(
            drive.targets[0, body.springs :], body.position, run.displacement[0]
        )
    holding = compute_holding(body, ground, run.tension[0], plus + load, minus - load, load)
    _print_tow(scene, holding, screen)
    if any(bend.is_limited for bend in body.bends):
        screen.print(
            "these are limits of friction, as are the slopes: where a link is slack or at the limit of its tension, "
            "less is held"
        )
    if not ground.has_one_slope:
        screen.print(
            "steepest slope that it holds at rest: not computed, as parts of the ground have slopes of their own"
        )
    for tilt, direction in ((holding.uphill, "uphill"), (holding.downhill, "downhill")):
        if tilt is not None:
            screen.print(_describe_tilt(scene, tilt, direction))


def _find_wall_at_start(run: Trajectory) -> tuple[int, int] | None:
    """Find a contact that stands at a wall at the start, and the number of the wall."""
    track = run.scene.ground.track
    if track is None or track.walls is None:
        return None
    at = np.argwhere(track.walls.find_rooms(run.scene.body.position, run.displacement[0]) == 0.0)
    return (int(at[0, 1]), int(track.walls.index[tuple(at[0])])) if len(at) else None


def _print_tow(scene: Plan, holding: Holding, screen: Console) -> None:
    body, size = scene.body, holding.tow_forward + holding.tow_backward
    whole = [write_size(most, size) for most in (holding.tow_forward, holding.tow_backward)]
    screen.print(f"largest tow that it holds at rest, on any contact: {whole[0]} N forward, {whole[1]} N backward")
    sides = (holding.slip_forward, holding.tow_forward), (holding.slip_backward, holding.tow_backward)
    for contact in dict.fromkeys((0, body.contacts - 1)):
        if contact not in body.isolated:
            screen.print(
                f"a tow on {body.name_of(contact)} alone moves it at once, however small: the friction of a segment is "
                "spread along it"
            )
            continue
        first = [write_size(min(float(side[contact]), most), size) for side, most in sides]
        screen.print(
            f"a tow on {body.name_of(contact)} alone moves it first, from {first[0]} N forward, {first[1]} N backward"
        )


def _print_planar_holding(scene: Plan, screen: Console) -> None:
    """Print what isotropic friction holds in the plane, the same in every direction."""
    if scene.directions.shape[0]:
        screen.print(
            "largest tow and steepest slope that it holds at rest: not computed in the plane for friction that depends "
            "on the direction, as they depend on it, too"
        )
        return
    ground, loaded = scene.ground, scene.columns.loads > 0
    _, friction, loads = split_target(scene.body, scene.directions, scene.drive.targets[0])
    friction = ground.scale_friction(friction, scene.body.position + scene.start_displacement)
    whole = float(friction.sum())
    tow = whole - (math.hypot(*loads.sum(axis=0)) if loaded else 0.0)
    screen.print(f"largest tow that it holds at rest, on any contact: {tow:.6g} N in every direction")
    if not ground.weight.any():
        return
    if loaded and not np.allclose(loads, ground.slope_load, rtol=0.0, atol=1e-12 * whole):
        screen.print("steepest slope that it holds at rest: not computed in the plane with other loads")
        return
    slope = steepest_held(ground, friction[:, 0], np.zeros(scene.body.contacts))
    screen.print(f"steepest slope that it holds at rest: {_degrees(slope)} degrees uphill in every direction")


def _degrees(slope: float) -> str:
    return "any, up to 90" if slope == math.pi / 2.0 else f"{math.degrees(slope):.6g}"


def _describe_tilt(scene: Plan, tilt: Tilt, direction: str) -> str:
    steepest = _degrees(tilt.steepest)
    if tilt.gives_way == math.pi / 2.0:
        return f"steepest slope that it holds at rest, {direction}: {steepest} degrees"
    return (
        f"steepest slope that it holds at rest, {direction}: {steepest} degrees; "
        f"{scene.body.name_of(tilt.contact)} gives way first, at {math.degrees(tilt.gives_way):.6g} degrees"
    )


def print_pushes(run: Trajectory, screen: Console) -> None:
    """Print how hard the drive pushes contacts against each wall, at its waypoints.

    Args:
        run: the run of the scene along its drive; nothing is printed without walls.
        screen: the console to print to.
    """
    track = run.scene.ground.track
    if track is None or track.walls is None:
        return
    walls = np.unique(track.walls.index[track.walls.index >= 0])
    for wall in walls.tolist():
        pushes = [push for push in run.wall_push if push.wall == wall]
        at = float(track.walls.place[track.walls.index == wall][0])
        if not pushes:
            screen.print(f"wall {wall} at {at:g} m: no contact stands at it at a waypoint of the drive")
            continue
        hardest = max(pushes, key=lambda push: (push.least, push.most))
        screen.print(
            f"wall {wall} at {at:g} m: {run.scene.body.name_of(hardest.contact)} pushes it hardest at "
            f"{hardest.time:g} s, by {hardest.least:.6g} to {hardest.most:.6g} N; what friction holds is not determined"
        )


def print_limits(scene: Plan, screen: Console) -> None:
    """Print the steepest slope and the largest tow on the last contact against which a period gains.

    Args:
        scene: the scene; nothing is printed without a drive that has a period, and for bodies that turn.
        screen: the console to print to.
    """
    if scene.drive.holds or scene.drive.period is None or scene.body.turning is not None:
        return
    if scene.ground.track is not None and scene.ground.track.walls is not None:
        screen.print(
            "steepest slope and largest tow at which a period still gains: not searched for, because walls make what a "
            "period gains depend on the place"
        )
        return
    if scene.body.dimension == 2:
        screen.print(
            "steepest slope and largest tow at which a period still gains: only on a line; in the plane a load turns "
            "the body, so that its direction against the travel changes"
        )
        return
    on = f"on {scene.body.name_of(scene.body.contacts - 1)}"
    if scene.ground.weight.any():
        try:
            with progress_bar("searching for the steepest slope") as progress:
                slope = steepest_climb(scene, _BUDGET, progress)
            screen.print(_describe_climb(slope))
        except CommandError as error:
            why = str(error).removeprefix("steepest_climb: ")
            screen.print(f"steepest slope at which a period still gains: not searched for: {why}")
    with progress_bar("searching for the largest tow") as progress:
        tow = largest_tow(scene, -1, _BUDGET, progress)
    screen.print(_describe_tow(tow, on))


def _describe_climb(limit: Limit) -> str:
    """Describe the steepest slope in a line."""
    if limit.cause == "no travel":
        return (
            "steepest slope at which a period still gains: none, as the drive does not carry the body on level ground"
        )
    value, beyond = (f"{math.degrees(angle):.8g} degrees" for angle in (limit.value, limit.beyond))
    direction = "uphill" if limit.direction > 0 else "uphill towards -x, in the direction of travel"
    none = f"no steeper one of {SLOPES_TRIED} slopes tried does"
    return f"steepest slope at which a period still gains: {_describe(limit, value, beyond, direction, none)}"


def _describe_tow(limit: Limit, on: str) -> str:
    """Describe the largest tow on a contact in a line."""
    if limit.cause == "no travel":
        return f"largest tow {on} at which a period still gains: none, as the drive does not carry the body without it"
    value, beyond = (f"{force:.8g} N" for force in (limit.value, limit.beyond))
    direction = _DIRECTIONS.get(-limit.direction, "")
    return f"largest tow {on} at which a period still gains: {_describe(limit, value, beyond, direction)}"


def _describe(limit: Limit, value: str, beyond: str, direction: str, none: str = "none beyond") -> str:
    """Describe value, direction and cause."""
    if limit.cause == "budget":
        if limit.direction == 0:
            return "not searched for, because a period takes too long here; Python searches longer (see the page Loads)"
        return f"between {value} and {beyond} {direction}; the search was cut short"
    unsettled = "" if limit.settled else "; some runs did not become periodic"
    gain = limit.direction * limit.gain
    size = abs(limit.free_gain)
    if limit.cause == "equilibrium":
        return (
            f"{value} {direction}, where the equilibrium ends: it gains {gain:.6g} m there, and beyond it "
            f"the body runs away whatever the drive does{unsettled}"
        )
    faded = limit.gain < 1e-6 * size
    end = "where the gain has fallen to 0" if faded else f"where it still gains {gain:.6g} m, {none}"
    return f"{value} {direction}, {end}{unsettled}"
