"""From the parts of a scene to the arrays of the model, each checked against the others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from . import drive as drives
from ._compiled import said_if_slow
from .body import Body, End, Interval, build_body, frozen, spread
from .columns import Columns, build_columns, build_planar_columns
from .drive import Drive
from .elements import MOST_UNMEASURED, average, count_elements
from .errors import SceneError
from .scene import DrivePart, FrictionRowsPart, Scene, SegmentPart, TablePart, WavePart

if TYPE_CHECKING:
    from collections.abc import Callable

_ROUNDING = 1e3 * 32.0 * np.finfo(np.float64).eps


def check_scene(scene: Scene) -> None:
    """Build all parts of a scene and check them against each other.

    Args:
        scene: the scene.

    Raises:
        SceneError: naming the part, contact, link, segment or row that does not fit.
    """
    if scene.dimension == 2:
        if scene.tolerance is not None and not 1e-9 <= scene.tolerance <= 0.5:
            raise SceneError(f"tolerance: {scene.tolerance:g}; it must be between 1e-9 and 0.5")
        _check_planar(scene)
    elif scene.tolerance is not None:
        raise SceneError("tolerance: only planar scenes take one; on a line the answer is exact")
    names = [s.name for s in scene.body.segments]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"body.segments: two segments are called {name!r}; names must differ")
    if scene.body.links is None and (scene.dimension == 2 or len(scene.body.contacts) + len(names) > 1):
        raise SceneError("body.links: missing; it gives the springs between contacts and segments, {stiffness: ...}")
    if scene.friction is None and scene.body.contacts:
        raise SceneError("friction: missing; it is that of the isolated contacts")
    check_start(scene)


def _check_planar(scene: Scene) -> None:
    from .planar_kernel import check_directions

    if scene.body.segments:
        raise SceneError("body.segments: segments lie on a line; leave them out of a planar scene")
    for i, contact in enumerate(scene.body.contacts):
        if not isinstance(contact, tuple) or len(contact) != 2:
            raise SceneError(f"body.contacts: contact {i} is {contact}; a planar scene gives [x, y] of each contact")
    friction, drive = scene.friction, scene.drive
    if friction is not None and friction.isotropic is None and friction.directions is None:
        raise SceneError(
            "friction: in the plane give `isotropic`, or `directions` and `value`, not forward and backward"
        )
    if drive is not None and drive.times is None:
        raise SceneError("drive: a planar scene takes `times` and `actuation`; waves and strategies are for a line")
    if drive is not None and isinstance(drive.friction, FrictionRowsPart) and drive.friction.isotropic is None:
        raise SceneError("drive.friction: a planar scene takes `isotropic` only")
    if friction is not None and friction.directions is not None:
        for row in _planar_friction(scene):
            check_directions(np.array(friction.directions), row)


def _field(part: float | TablePart) -> Callable[[np.ndarray], np.ndarray]:
    if isinstance(part, TablePart):
        at, value = np.array(part.at), np.array(part.value)
        return lambda x: np.interp(x, at, value)
    return lambda x: np.full(x.shape, part)


def _breaks(part: float | TablePart) -> np.ndarray:
    return np.array(part.at) if isinstance(part, TablePart) else np.zeros(0)


def _check_field(part: float | TablePart, field: str, unit: str, least: str) -> None:
    for value in part.value if isinstance(part, TablePart) else (part,):
        if value < 0.0 or (value == 0.0 and least == "> 0"):
            raise SceneError(f"{field}: {value:g} {unit}; it must be {least}")


def _interval(part: SegmentPart, place: int, elements: int) -> Interval:
    field = f"body.segments.{place}"
    _check_field(part.stiffness, f"{field}.stiffness", "N", "> 0")
    for side, value in zip(("forward", "backward"), part.friction.sides, strict=True):
        _check_field(value, f"{field}.friction.{side}", "N/m", ">= 0")
    for name, value in (("stiffness", part.stiffness), *zip(("forward", "backward"), part.friction.sides, strict=True)):
        if isinstance(value, TablePart) and not (value.at[0] <= part.stop and value.at[-1] >= part.start):
            raise SceneError(
                f"{field}: the table of {name} is given at {value.at[0]:g} .. {value.at[-1]:g} m, outside the "
                f"segment's {part.start:g} .. {part.stop:g} m"
            )
    nodes = np.linspace(part.start, part.stop, elements + 1)
    modulus = _field(part.stiffness)
    if isinstance(part.stiffness, TablePart):
        compliance = average(lambda x: 1.0 / modulus(x), nodes, _breaks(part.stiffness))
    else:
        compliance = np.full(elements, 1.0 / part.stiffness)
    return Interval(part.name, nodes, 1.0 / (compliance * (part.stop - part.start) / elements))


def _end(value: int | str, link: int) -> End:
    if isinstance(value, int):
        return value
    name, _, end = value.rpartition(".")
    if end == "from":
        return name, "from"
    if end == "to":
        return name, "to"
    raise SceneError(f"body.links.between: link {link} joins {value!r}; an end is a number, `name.from` or `name.to`")


def build_mesh(scene: Scene) -> Body:
    """Build a scene's body.

    Args:
        scene: the scene.

    Returns:
        The body, segments cut into as many elements as they ask for, or as their accuracy needs.

    Raises:
        SceneError: naming the contact, segment or link that does not fit.
    """
    given = scene.body
    for i, contact in enumerate(given.contacts):
        if isinstance(contact, tuple) and scene.dimension == 1:
            raise SceneError(
                f"body.contacts: contact {i} is {list(contact)}; on a line it is a number (or dimension: 2)"
            )
    counts = [s.elements or _count(scene, i) for i, s in enumerate(given.segments)]
    segments = [_interval(s, i, n) for i, (s, n) in enumerate(zip(given.segments, counts, strict=True))]
    links = given.links
    between = None
    if links is not None and links.between is not None:
        between = [(_end(a, i), _end(b, i)) for i, (a, b) in enumerate(links.between)]
    contacts = np.array(given.contacts, dtype=np.float64)
    if scene.dimension == 2:
        contacts = contacts.reshape(-1, 2)
    return build_body(contacts, 1.0 if links is None else links.stiffness, between, segments)


def _with_elements(scene: Scene, counts: list[int]) -> Scene:
    """Copy a scene with other numbers of elements, unchecked."""
    segments = tuple(s.model_copy(update={"elements": n}) for s, n in zip(scene.body.segments, counts, strict=True))
    fields = {name: getattr(scene, name) for name in Scene.model_fields}
    fields["body"] = scene.body.model_copy(update={"segments": segments})
    return Scene.model_construct(**fields)


_OTHERS = 31
"""Elements of the other segments while one is refined."""


def _count(scene: Scene, place: int) -> int:
    """Find how many elements a segment needs for its accuracy under the scene's drive."""
    from .simulate import simulate

    part = scene.body.segments[place]
    assert part.accuracy is not None
    asked = part.accuracy / len(scene.body.segments)
    counts = [s.elements or _OTHERS for s in scene.body.segments]

    def with_elements(n: int) -> Scene:
        counts[place] = n
        return _with_elements(scene, counts)

    def gains(n: int) -> np.ndarray:
        trial = with_elements(n)
        check_start(trial)
        period = trial.commands.period
        if period is None:
            duration = float(trial.commands.times[-1])
            return simulate(trial, rate=1.0 / duration).waypoint_net_translation
        return simulate(trial, duration=3.0 * period, rate=max(1.0 / period, 1e-9)).per_period[1:]

    coarse = with_elements(1)
    scale = _largest_change(coarse)
    if scene.drive is None or scale == 0.0:
        return min(int(np.ceil(1.0 / asked)), MOST_UNMEASURED)
    with said_if_slow():
        return count_elements(gains, scale, asked)


def _largest_change(scene: Scene) -> float:
    """Compute the largest change of length that a drive commands of a link, or of a segment's length by its strain."""
    drive, mesh = scene.commands, scene.mesh
    change = np.ptp(drive.rows, axis=0)
    sizes = [1.0] * mesh.link_springs.size + [s.length for s in mesh.segments]
    parts = np.split(change[: drive.columns.lengths], np.cumsum(drive.columns.actuation_sizes)[:-1])
    return max((size * float(part.max()) for size, part in zip(sizes, parts, strict=True)), default=0.0)


def build_scene_columns(scene: Scene) -> Columns:
    """Lay out what can be commanded of a scene's body.

    Args:
        scene: the scene.

    Returns:
        The columns. A segment has one for its strain unless a wave runs along it, and one a side for its friction
        unless that varies along it.
    """
    if scene.dimension == 2:
        return build_planar_columns(scene.mesh, scene.directions.shape[0])
    drive = scene.drive
    strain = drive is not None and drive.wave is not None
    wave = drive is not None and drive.friction_wave is not None
    fields = [(strain, wave or any(isinstance(v, TablePart) for v in s.friction.sides)) for s in scene.body.segments]
    return build_columns(scene.mesh, fields)


def _planar_friction(scene: Scene) -> np.ndarray:
    """Read the friction of a planar scene, shape (N, max(m, 1)) [N]."""
    friction, n = scene.friction, len(scene.body.contacts)
    assert friction is not None
    if friction.directions is None:
        return _not_negative(spread(friction.isotropic or 0.0, n, "friction.isotropic", "contact"), "isotropic")[
            :, None
        ]
    m = len(friction.directions)
    value = friction.value if isinstance(friction.value, tuple) else (friction.value,) * m
    if value and isinstance(value[0], tuple):
        if len(value) != n:
            raise SceneError(
                f"friction.value: {len(value)} row(s) for {n} contact(s); give one row, or one per contact"
            )
        return np.array([spread(row, m, f"friction.value: row {i}", "direction") for i, row in enumerate(value)])
    return np.tile(spread(value, m, "friction.value", "direction"), (n, 1))


def _not_negative(mu: np.ndarray, side: str) -> np.ndarray:
    for i in np.flatnonzero(~(mu >= 0.0)):
        raise SceneError(f"friction.{side}: contact {i} has {mu[i]:g} N; friction must be >= 0")
    return mu


def friction_row(scene: Scene) -> np.ndarray:
    """Lay out a scene's own friction as the last columns of a command row.

    Args:
        scene: the scene.

    Returns:
        Shape (C - lengths,) [N, N/m].

    Raises:
        SceneError: naming the contact whose friction is negative, or the wrong length.
    """
    if scene.dimension == 2:
        return _planar_friction(scene).ravel()
    mesh, columns = scene.mesh, scene.columns
    sides = (0.0, 0.0) if scene.friction is None else scene.friction.sides
    if scene.friction is not None and scene.friction.directions is not None:
        raise SceneError("friction.directions: for planar scenes; on a line give `forward` and `backward`")
    values = []
    for side, name in enumerate(("forward", "backward")):
        values.append(_not_negative(spread(sides[side], mesh.isolated.size, f"friction.{name}", "contact"), name))
        for part, segment, (_, _, size) in zip(scene.body.segments, mesh.segments, columns.segments, strict=True):
            varies = size == segment.elements + 1
            field = part.friction.sides[side]
            if not varies:
                values.append(np.array([field]))
                continue
            nodes = mesh.position[segment.contacts]
            edges = np.concatenate((nodes[:1], 0.5 * (nodes[:-1] + nodes[1:]), nodes[-1:]))
            values.append(average(_field(field), edges, _breaks(field)))
    return np.concatenate(values)


def build_drive(scene: Scene) -> Drive:
    """Make waypoints of a scene's drive.

    Args:
        scene: the scene.

    Returns:
        The drive, with the scene's friction where it commands none.

    Raises:
        SceneError: naming the row or value that does not fit.
    """
    columns, part = scene.columns, scene.drive
    friction = friction_row(scene)
    if part is None:
        row = np.concatenate((np.zeros(columns.lengths), friction))
        return Drive(frozen([0.0]), None, frozen(row[None]), columns)
    if part.strategy is not None:
        return _build_strategy(scene, part)
    if part.times is None:
        return _build_waves(scene, part, friction)
    times = np.array(part.times)
    rows = np.zeros((times.size, columns.count))
    rows[:, columns.lengths :] = friction
    if scene.dimension == 2:
        rows[:, : columns.lengths] = _planar_rows(part.actuation, times.size, scene.mesh.springs)
    else:
        item = "link(s) and segment" if scene.mesh.segments else "link"
        given = _rows(part.actuation, times.size, columns.actuation_sizes.size, "drive.actuation", item)
        rows[:, : columns.lengths] = np.repeat(given, columns.actuation_sizes, axis=1)
    if isinstance(part.friction, FrictionRowsPart):
        if columns.planar:
            raise SceneError("drive.friction: friction given by directions is constant; leave it out")
        item = "contact(s) and segment" if scene.mesh.segments else "contact"
        names = ("isotropic", "isotropic") if part.friction.isotropic is not None else ("forward", "backward")
        both = [
            np.repeat(
                _rows(table, times.size, columns.friction_sizes.size, f"drive.friction.{name}", item),
                columns.friction_sizes,
                axis=1,
            )
            for name, table in zip(names, part.friction.sides, strict=True)
        ]
        rows[:, columns.lengths :] = np.hstack(both[: columns.sides])
    return drives.build_waypoints(times, part.period, rows, columns)


def _rows(table: Any, rows: int, columns: int, field: str, item: str) -> np.ndarray:
    if isinstance(table, float):
        return np.full((rows, columns), table)
    if len(table) != rows:
        raise SceneError(f"{field}: {len(table)} row(s) for {rows} time(s); give one row per time")
    for i, row in enumerate(table):
        if isinstance(row, tuple) and any(isinstance(v, tuple) for v in row):
            raise SceneError(f"{field}: row {i} holds lists; on a line each entry is a number (or dimension: 2)")
    return np.array([spread(row, columns, f"{field}: row {i}", item) for i, row in enumerate(table)])


def _planar_rows(table: Any, rows: int, links: int) -> np.ndarray:
    if not isinstance(table, tuple) or len(table) != rows:
        count = len(table) if isinstance(table, tuple) else 1
        raise SceneError(f"drive.actuation: {count} row(s) for {rows} time(s); give one row per time")
    for i, row in enumerate(table):
        entries = row if isinstance(row, tuple) else (row,)
        wrong = [k for k, e in enumerate(entries) if not isinstance(e, tuple) or len(e) != 2]
        if len(entries) != links or wrong:
            found = f"entry {wrong[0]} is {entries[wrong[0]]}" if wrong else f"{len(entries)} entries"
            raise SceneError(
                f"drive.actuation: row {i}: {found}; a planar scene gives [x, y] for each of {links} link(s)"
            )
    return np.array(table).reshape(rows, 2 * links)


def _build_strategy(scene: Scene, part: DrivePart) -> Drive:
    columns = scene.columns
    mesh = scene.mesh
    if (mesh.isolated.size, mesh.springs, len(mesh.segments)) != (2, 1, 0):
        raise SceneError(f"drive.strategy: strategies drive 2 contacts on 1 link, this body has {mesh.describe()}")
    assert part.strategy is not None
    assert part.length is not None
    assert isinstance(part.friction, float)
    period = 1.0 if part.period is None else part.period
    times, actuation, mu = drives.strategy_waypoints(part.strategy, part.length, part.friction, period)
    return drives.build_waypoints(times, period, np.hstack((actuation, mu, mu)), columns)


def _build_waves(scene: Scene, part: DrivePart, friction: np.ndarray) -> Drive:
    mesh, columns = scene.mesh, scene.columns
    waves = [w for w in (part.wave, part.friction_wave) if w is not None]
    period = waves[0].period
    if any(w.period != period for w in waves):
        raise SceneError("drive.friction_wave.period: it must be that of drive.wave")
    times = drives.merge_times(*(np.arange(w.samples + 1) * (period / w.samples) for w in waves))
    times[-1] = period
    rows = np.zeros((times.size, columns.count))
    rows[:, columns.lengths :] = friction
    if part.wave is not None:
        middle = 0.5 * (mesh.position[mesh.ends[:, 0]] + mesh.position[mesh.ends[:, 1]])
        places = np.concatenate([middle[mesh.link_springs], *(middle[s.springs] for s in mesh.segments)])
        rows[:, : columns.lengths] = _sampled(part.wave, times, places)
    if part.friction_wave is not None:
        w = part.friction_wave
        if w.mean < abs(w.amplitude):
            raise SceneError(
                f"drive.friction_wave: mean {w.mean:g} N is less than the amplitude {abs(w.amplitude):g} N; "
                "friction must be >= 0 all the time"
            )
        places = np.concatenate([mesh.position[mesh.isolated], *(mesh.position[s.contacts] for s in mesh.segments)])
        mu = np.maximum(_sampled(w, times, places), 0.0)
        rows[:, columns.lengths :] = np.hstack((mu, mu))
    return drives.build_waypoints(times, period, rows, columns)


def _sampled(part: WavePart, times: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Read a wave, straight between its own samples, at the waypoints, shape (W, places)."""
    phase = np.arange(part.samples + 1) / part.samples
    values = drives.wave(part.mean, part.amplitude, part.wavelength, phase, places)
    at = times / part.period * part.samples
    before = np.minimum(np.floor(at + 1e-9).astype(np.int64), part.samples)
    after = np.minimum(before + 1, part.samples)
    rest = np.clip(at - before, 0.0, 1.0)
    rest[rest < 1e-8] = 0.0  # on a sample, to the bit
    return values[before] + rest[:, None] * (values[after] - values[before])


def build_start(scene: Scene) -> np.ndarray:
    """Place the contacts at the start.

    Args:
        scene: the scene.

    Returns:
        Displacement, shape (N,), in the plane (N, 2) [m]. A scene gives it for the isolated contacts and both ends of
        each segment, straight between; `relaxed` is a start without spring forces.

    Raises:
        SceneError: on a wrong length.
    """
    mesh = scene.mesh
    if scene.start is None:
        return np.zeros(mesh.position.shape)
    if scene.start == "relaxed":
        return mesh.relaxed(scene.commands.actuation[0])
    given = scene.start.displacement
    if mesh.dimension == 2:
        rows = given if isinstance(given, tuple) else (given,) * mesh.contacts
        if len(rows) != mesh.contacts or any(isinstance(r, tuple) and len(r) != 2 for r in rows):
            raise SceneError(f"start.displacement: a planar scene gives [x, y] for each of {mesh.contacts} contacts")
        return np.array([spread(row, 2, "start.displacement", "coordinate") for row in rows])
    if isinstance(given, tuple) and any(isinstance(v, tuple) for v in given):
        raise SceneError("start.displacement: on a line each entry is a number (or dimension: 2)")
    stations = mesh.stations
    item = "contact(s) and segment end" if mesh.segments else "contact"
    values = spread(given, stations.size, "start.displacement", item)
    x = np.empty(mesh.contacts)
    x[stations] = values
    for k, segment in enumerate(mesh.segments):
        first, last = values[mesh.isolated.size + 2 * k :][:2]
        x[segment.contacts] = np.linspace(first, last, segment.elements + 1)
    return x


def check_start(scene: Scene) -> None:
    """Check that the springs' forces at the start are within the friction at the start.

    Args:
        scene: the scene; its parts are built and so checked on the way.

    Raises:
        SceneError: naming the contact and by how much its bound is exceeded.
    """
    mesh, drive, x = scene.mesh, scene.commands, scene.start_displacement
    if mesh.dimension == 2:
        _check_planar_start(scene)
        return
    tension = mesh.stiffness * (mesh.elongation(x) - drive.actuation[0])
    force, forward, backward = mesh.spring_force(tension), drive.forward[0], drive.backward[0]
    margins = np.minimum(forward - force, force + backward)
    excess = margins + _ROUNDING * (mesh.force_size(tension) + forward + backward)
    worst = int(np.argmin(excess))
    if excess[worst] >= 0.0:
        return
    g = force[worst]
    bound, side = (forward[worst], "forward") if g > 0.0 else (backward[worst], "backward")
    proposal = "write `start: relaxed`"
    if not mesh.segments:
        relaxed = x[0] + mesh.relaxed(drive.actuation[0])
        text = ", ".join(f"{v:.6g}" for v in relaxed[:12]) + (", ..." if relaxed.size > 12 else "")
        proposal = f"a start without tension is [{text}], or {proposal}"
    raise SceneError(
        f"start.displacement: {mesh.name_of(worst)} is pulled by {abs(g):g} N, {-margins[worst]:g} N more than its "
        f"{side} friction {bound:g} N; {proposal}"
    )


def _check_planar_start(scene: Scene) -> None:
    mesh, drive, x = scene.mesh, scene.commands, scene.start_displacement
    tension = mesh.stiffness[:, None] * (mesh.elongation(x) - drive.actuation[0].reshape(-1, 2))
    force = mesh.spring_force(tension)
    friction = drive.targets[0, 2 * mesh.springs :].reshape(mesh.contacts, -1)
    normals = scene.directions
    load = np.linalg.norm(force, axis=1)[:, None] if normals.size == 0 else force @ normals.T
    excess = (load - friction).max(axis=1) - _ROUNDING * (np.abs(tension).sum() + friction.max(axis=1))
    worst = int(np.argmax(excess))
    if excess[worst] > 0.0:
        raise SceneError(
            f"start.displacement: contact {worst} is pulled by [{force[worst, 0]:g}, {force[worst, 1]:g}] N, "
            f"{excess[worst]:g} N more than its friction; `start: relaxed` is a start without tension"
        )
