"""The verb `check`: validation of a scene, its stasis domain, possible directions of motion, and warnings."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from crawler_model import CrawlerError, Scene, Trajectory
from crawler_model.body.body import Body
from crawler_model.body.drive import Drive
from crawler_model.body.names import name_every_spring
from crawler_model.body.plan import Plan
from crawler_model.body.turning import SIDES
from crawler_model.run.simulate import default_duration
from crawler_model.run.ticks import DEFAULT_RATE
from crawler_model.theory.regularity import check_regularity
from crawler_model.theory.stasis import directions_of, domain_evolution, holds_loads
from crawler_model.theory.uniqueness import Undecided, commanded_margin
from crawler_pictures.numbers import error_of, write_length

from .loads_report import print_holding, print_limits, print_pushes
from .screen import Screen
from .springs_report import print_largest_force, print_limits_of_tension
from .turning_report import print_turning

_MOST_ROWS = 20
_MOST_TICKS, _MOST_NUMBERS = 5e4, 2e7
"""Ticks and positions of contacts that a run for the report may have beyond the usual rate."""
_TOO_STIFF = 1e9
_TOO_LONG = 10.0  # lengths of the body
_LONGEST = 20.0  # m: longer than any robot of the literature
_SLOWEST = 200.0  # s
_DIRECTIONS = {1: "forward", -1: "backward"}
_TOO_BENT = 2.0 * np.pi  # a whole turn
_TOO_ROUGH, _TOO_LATE = 0.2, 2.0  # lengths of the body; s
_TOO_FLAT = 0.8  # degrees: in radians the slope of a steep hill


def choose_rate(scene: Scene) -> float:
    """Choose ticks at whose ends all waypoints lie, where forces are largest and contacts turn round.

    Args:
        scene: the scene.

    Returns:
        The lowest rate that does, up to 100 times the usual one; less if the run would take long [Hz].
    """
    most = min(_MOST_TICKS, _MOST_NUMBERS / scene.body.contacts) / max(default_duration(scene.drive), 1e-9)
    rates = [DEFAULT_RATE * factor for factor in (1, 2, 5, 10, 20, 50, 100) if DEFAULT_RATE * factor <= most]
    met = [rate for rate in rates if _meets_waypoints(scene.drive, rate)]
    return (met or rates[-1:] or [DEFAULT_RATE])[0]


def _meets_waypoints(drive: Drive, rate: float) -> bool:
    """Determine whether all waypoints of a drive lie at the ends of ticks."""
    ticks = np.append(drive.times, drive.period or 0.0) * rate
    ends = np.rint(ticks)
    return bool(np.abs(ticks - ends).max() < 1e-6) and np.unique(ends[:-1]).size == drive.times.size


def with_mass(scene: Scene, mass: float) -> Scene:
    """Give all contacts of a scene a mass, in segments per length.

    Args:
        scene: the scene.
        mass: of each isolated contact [kg], of segments [kg/m].

    Returns:
        The scene with these masses.

    Raises:
        CrawlerError: if the mass is negative or not finite.
    """
    if not 0.0 <= mass < np.inf:
        raise CrawlerError(f"--mass: {mass:g} kg; it must be a finite number >= 0")
    document = scene.document()
    document["body"]["masses"] = mass
    return Scene.model_validate(document)


def print_report(run: Trajectory, screen: Console) -> None:
    """Print the report.

    Args:
        run: the run of the scene along its drive.
        screen: the console to print to.
    """
    screen.print(f"{run.scene.name}: {run.scene.body.describe()}; valid")
    screen.print(_contacts(run))
    _print_findings(run, screen)


def _print_findings(run: Trajectory, screen: Console) -> None:
    scene, body = run.scene, run.scene.body
    if scene.ground.even_part:
        what = (
            "stasis domain, directions and uniqueness margin" if body.dimension == 1 else "stasis domain and directions"
        )
        screen.print(f"{what} hold {scene.ground.even_part}")
    if body.dimension == 1:
        screen.print(_direction(run))
    _print_conditions(run, screen)
    _print_units(run.scene, screen)
    print_holding(run, screen)
    if isinstance(scene, Scene) and scene.drive.holds:
        screen.print(f"{scene.unmoving_drive}: the crawler waits for commands")
    else:
        _print_motion(run, screen)
        print_largest_force(run, screen)
        if body.bends:
            print_limits_of_tension(run, screen)
        if not _meets_waypoints(scene.drive, run.rate):
            screen.print(
                f"forces, and the limits that they reach, are those at ticks of {1.0 / run.rate:g} s: "
                "at waypoints between ticks they may be larger"
            )
        print_pushes(run, screen)
        print_limits(scene, screen)
        if run.inertia is not None:
            screen.print(run.inertia.describe(body))


def summarise(run: Trajectory) -> dict[str, Any]:
    """Build what `crawler check --json` prints.

    Args:
        run: the run of the scene along its drive.

    Returns:
        Plain numbers, lists and text, schema 1: where directions or margins are not determined, None; positions in m.
        `findings` holds the lines that are printed for people below the table.
    """
    scene, body = run.scene, run.scene.body
    directions = _find_directions(scene)
    slides = np.logical_or(*run.slid)
    printed = io.StringIO()
    _print_findings(run, Screen(file=printed, soft_wrap=True))
    return {
        "schema": 1,
        "scene": scene.name,
        "body": body.describe(),
        "dimension": body.dimension,
        "contacts": [
            {"name": body.name_of(i), "position": body.position[i].tolist(), "slides": bool(slides[i])}
            for i in range(body.contacts)
        ],
        "directions": None if directions is None else [_DIRECTIONS[sign] for sign in sorted(directions, reverse=True)],
        "uniqueness_margin": run.uniqueness_margin,
        "visited_margin": run.visited_margin,
        "unique": run.unique,
        "per_period": run.per_period.tolist(),
        "inertia": None if run.inertia is None else run.inertia.summary(),
        "findings": printed.getvalue().splitlines(),
    }


def _contacts(run: Trajectory) -> Table:
    """Build the table of contacts, their friction and their motion."""
    scene, body = run.scene, run.scene.body
    planar = body.dimension == 2
    table = Table(
        title="stasis domain: nothing moves while each contact's spring force is strictly between", title_justify="left"
    )
    loaded = scene.columns.loads > 0
    turns, width = body.turning is not None, scene.columns.frictions // body.contacts
    friction = ["friction [N]"] if planar else ["-backward [N]", "forward [N]"]
    if turns:
        friction = [f"{side} [N]" for side in SIDES]
    if loaded and not planar:
        friction = ["load [N]", "-backward - load [N]", "forward - load [N]"]
    for column in ("contact", "at [m]", *friction, "force at the start [N]", "slides"):
        table.add_column(column, justify="right")
    force = body.force_at(run.displacement[0], run.tension[0])
    drive = scene.drive
    if planar and scene.columns.loads:
        force = force + drive.loads[0].reshape(-1, 2)
    size = 100.0 * float(np.abs(run.tension).max(initial=0.0))
    last = -1
    for i in _shown(body):
        if i != last + 1:
            table.add_row(f"({i - last - 1} more)", *[""] * (len(table.columns) - 1))
        last = i
        slides = [name for slid, name in zip(run.slid[:, i], ("forward", "back"), strict=True) if slid]
        if planar:
            each = drive.targets[:, body.lengths :][:, : scene.columns.frictions].reshape(-1, body.contacts, width)
            bounds = [_span(side) for side in each[:, i].T] if turns else [_span(each[:, i])]
            slides = ["yes"] if slides else []
        else:
            bounds = [_span(-drive.backward[:, i]), _span(drive.forward[:, i])]
            bounds = [_span(drive.loads[:, i]), *bounds] if loaded else bounds
        name = body.name_of(i).removeprefix("contact ")
        table.add_row(
            name, _numbers(body.position[i]), *bounds, write_length(force[i], size), " and ".join(slides) or "never"
        )
    return table


def _shown(body: Body) -> list[int]:
    """Choose the contacts that have a row: isolated ones and a few of each segment, both ends among them."""
    if body.contacts <= _MOST_ROWS:
        return list(range(body.contacts))
    isolated = body.isolated.tolist()
    if len(isolated) > _MOST_ROWS:
        isolated = isolated[: _MOST_ROWS // 2] + isolated[-_MOST_ROWS // 2 :]
    inner = [np.linspace(s.first, s.last, 5).round().astype(int).tolist() for s in body.segments]
    return sorted({*isolated, *(i for part in inner for i in part)})


def _direction(run: Trajectory) -> str:
    """Describe the directions of motion that the stasis domain allows."""
    drive = run.scene.drive
    directions = _find_directions(run.scene)
    if directions is None:
        return "friction on even ground does not hold the loads: the directions of motion are not determined"
    names = {frozenset({1}): "forward only", frozenset({-1}): "backward only", frozenset({1, -1}): "in both directions"}
    if not directions:
        return "no side of the stasis domain moves a single contact: the directions of motion are not determined"
    text = names[frozenset(directions)]
    same = all((bounds == bounds[0]).all() for bounds in (drive.forward, drive.backward))
    return f"the stasis domain allows motion {text}{'' if same else ', at different times'}"


def _find_directions(scene: Scene | Plan) -> set[int] | None:
    """Find the directions of motion that the stasis domains allow; None in the plane and where they may be empty."""
    drive = scene.drive
    if scene.body.dimension == 2 or not holds_loads(drive.forward, drive.backward):
        return None
    return directions_of(domain_evolution(drive)[1])


def _print_conditions(run: Trajectory, screen: Console) -> None:
    """Print the conditions of the theory: regular friction, a determined translation, stiffnesses of one order."""
    scene = run.scene
    regularity = check_regularity(scene.drive)
    if not regularity.is_regular:
        screen.print(
            f"friction: {regularity.where} falls to 0; existence and uniqueness are proved only for positive bounds"
        )
    elif regularity.rate > 0.0:
        screen.print(
            f"friction: between {regularity.least:g} and {regularity.greatest:g}, changing by at most "
            f"{regularity.rate:g} per second; regular"
        )
    margin = run.uniqueness_margin
    if margin is None:
        undecided = commanded_margin(scene.body, scene.drive)
        assert isinstance(undecided, Undecided)
        screen.print(f"uniqueness margin: not decided, as {undecided.value}; see below whether the run was unique")
    elif margin == 0.0:
        screen.print(
            "uniqueness margin: 0, critical: at some waypoint the forward friction of some contacts balances the "
            f"backward friction of the others{' and the loads' if scene.columns.loads else ''} (it matters only while "
            "all of them slide)"
        )
    else:
        screen.print(f"uniqueness margin: {margin:.4g} of the sum of all friction (0 would be critical)")
    k = scene.body.stiffness
    if k.max() > _TOO_STIFF * k.min():
        screen.print(
            f"too stiff: spring {int(k.argmax())} is {k.max() / k.min():.1e} times stiffer than spring "
            f"{int(k.argmin())}"
            + ("" if scene.body.is_chain else "; its tension has few correct digits, while a chain would lose none")
        )
    for coupling in scene.ground.track.couplings if scene.ground.track is not None else ():
        slope = float(np.abs(np.diff(coupling.added) / np.diff(coupling.at)).max(initial=0.0))
        if slope > k[coupling.spring]:
            screen.print(
                f"steep: {name_every_spring(scene.body)[coupling.spring]} changes the friction of "
                f"{scene.body.name_of(coupling.contact)} by {slope:g} N/m, more than its stiffness of "
                f"{k[coupling.spring]:g} N/m: the contact may lock itself as the friction grows, and jump as it falls"
            )
            break


def _list_slopes(scene: Plan) -> dict[str, float]:
    """List the slopes of the ground by their keys, of a profile the steepest one [degrees]."""
    ground = scene.parts.ground if isinstance(scene, Scene) else None
    if ground is None:
        return {}
    found = {"ground.slope": ground.slope}
    found |= {f"ground.patches[{i}].slope": patch.slope or 0.0 for i, patch in enumerate(ground.patches)}
    if ground.profile is not None:
        found["ground.profile.slope"] = max(ground.profile.slope or (0.0,), key=abs)
    return found


def _print_units(scene: Plan, screen: Console) -> None:
    """Warn about lengths far beyond the body's and slopes that are nearly none: most are due to wrong units."""
    body, drive = scene.body, scene.drive
    length = float(np.linalg.norm(np.ptp(body.position, axis=0)))
    if length > _LONGEST:
        screen.print(f"[yellow]millimetres for metres?[/] the body is {length:g} m long; lengths are in metres")
    if drive.period is not None and drive.period > _SLOWEST:
        screen.print(
            f"[yellow]milliseconds for seconds?[/] the drive's period is {drive.period:g} s; times are in seconds"
        )
    actuation = drive.actuation if body.turning is None else drive.actuation[:, : body.springs]
    commanded = body.joint_sum(np.abs(actuation).T.reshape(body.springs, -1)).max(axis=1)
    longest = int(commanded.argmax())
    if commanded[longest] >= _TOO_LONG * length:
        names = [f"link {i}" for i in range(body.link_springs.size)] + [f"segment {s.name}" for s in body.segments]
        screen.print(
            f"[yellow]millimetres for metres?[/] the drive changes the length of {names[longest]} by "
            f"{commanded[longest]:g} m, but the body is {length:g} m long; lengths are in metres, strains are ratios"
        )
    bent = float(np.abs(drive.actuation[:, body.springs :]).max(initial=0.0)) if body.turning is not None else 0.0
    if bent > _TOO_BENT:
        screen.print(f"[yellow]degrees for radians?[/] the drive turns a joint by {bent:g} rad; angles are in rad")
    sensors = scene.parts.sensors if isinstance(scene, Scene) else None
    if sensors is not None and (rough := max(sensors.noise, sensors.drift, sensors.pixel)) > _TOO_ROUGH * length > 0.0:
        screen.print(
            f"[yellow]millimetres for metres?[/] sensors measure lengths to {rough:g} m, but the body is {length:g} m "
            "long"
        )
    if sensors is not None and sensors.delay > _TOO_LATE:
        screen.print(f"[yellow]milliseconds for seconds?[/] sensors.delay is {sensors.delay:g} s; times are in seconds")
    for name, slope in _list_slopes(scene).items():
        if 0.0 < abs(slope) < _TOO_FLAT:
            screen.print(
                f"[yellow]radians for degrees?[/] {name} is {slope:g} degrees; {slope:g} rad would be "
                f"{np.degrees(slope):.3g} degrees"
            )
    if body.dimension == 2:
        bounds = drive.targets[:, drive.actuation.shape[1] :]
        friction = bounds[:, : bounds.shape[1] - drive.loads.shape[1]].max(axis=0)
        most = friction.reshape(body.contacts, -1).max(axis=1)
    else:
        most = np.maximum(drive.forward, drive.backward).max(axis=0)
    stiffest = np.zeros(body.contacts)
    np.maximum.at(stiffest, body.ends, body.stiffness[:, None])
    reach = most / stiffest
    stickiest = int(reach.argmax())
    if reach[stickiest] >= _TOO_LONG * length:
        screen.print(
            f"[yellow]too soft or too rough:[/] a spring must change by {reach[stickiest]:g} m before "
            f"{body.name_of(stickiest)} slides, but the body is {length:g} m long; stiffness is in N/m, friction in N"
        )


def _print_motion(run: Trajectory, screen: Console) -> None:
    """Print the motion along the drive."""
    scene, body = run.scene, run.scene.body
    of = " (of the elements; the whole segment's is larger)" if body.segments else ""
    unique = "no" if not run.unique else "yes" if run.visited_margin > 0.0 else "yes (0 only at instants)"
    screen.print(f"visited margin: {run.visited_margin:.4g}{of}; unique along the drive: {unique}")
    _print_crossings(run, screen)
    still = np.flatnonzero(~run.slid.any(axis=0)).tolist()
    if len(still) == body.contacts:
        screen.print("too weak: the drive never leaves the stasis domain, so nothing moves")
    elif still:
        names = ", ".join(body.name_of(i).removeprefix("contact ") for i in still[:10])
        screen.print(f"contacts that never slide: {names}{' ...' if len(still) > 10 else ''}")
    print_turning(run, screen)
    if run.per_period.shape[0] and body.turning is None:
        size = float(abs(run.displacement).max()) + float(abs(scene.drive.actuation).max())
        gained = write_length(run.per_period[-1], size, error_of(scene))
        travels = np.abs(run.per_period[-1]).max() > 1e-13 * size
        screen.print(f"net translation in the last period: {gained} m{'' if travels else ' (it does not travel)'}")


def _print_crossings(run: Trajectory, screen: Console) -> None:
    """Warn when contacts pass through each other, which the model does not forbid."""
    body = run.scene.body
    if body.dimension == 2:
        return
    gaps = np.diff(body.position + run.displacement, axis=1).min(axis=0)
    nearest = int(gaps.argmin())
    if gaps[nearest] <= 0.0:
        screen.print(
            f"[yellow]impossible in silicone:[/] {body.name_of(nearest + 1)} gets {-gaps[nearest] + 0.0:.3g} m past "
            f"{body.name_of(nearest)}; the model lets contacts pass through each other"
        )


def _numbers(value: Any) -> str:
    return ", ".join(f"{v + 0.0:g}" for v in np.atleast_1d(value))


def _span(values: np.ndarray) -> str:
    low, high = float(values.min()) + 0.0, float(values.max()) + 0.0
    return f"{low:g}" if low == high else f"{low:g} .. {high:g}"
