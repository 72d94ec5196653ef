"""What a person keeps of a session: a scene that repeats it, a recording, a picture, a film."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from crawler_model import CommandError, Crawler, Scene, SceneError, Trajectory, parse_scene, simulate
from crawler_model.body.columns import Columns
from crawler_model.body.turning import SIDES
from crawler_model.crawler.readout import Readout
from crawler_model.run.account import tolerance_of
from crawler_model.run.ticks import tick_end_ns
from crawler_model.scene.parts import LARGEST_TOLERANCE

from .session import Session, Tick

if TYPE_CHECKING:
    from crawler_ros.recording.run_writer import RecordedTick

FILM_SECONDS = 10.0
"""Simulated time that a film shows: the last seconds of a session."""
_FPS = 25.0


def write_scene(session: Session) -> Scene:
    """Write the drive of a session as a scene.

    Args:
        session: the session.

    Returns:
        The scene, with a waypoint wherever the command changed. Simulated at the rate of the session it ends where the
        session is, on a line to the bit, in the plane within its tolerance, mostly up to rounding.

    Raises:
        CommandError: if nothing happened yet, or a drive cannot hold these commands.
    """
    scene, ticks = session.scene, session.ticks[1 : session.now + 1]
    if not ticks:
        raise CommandError("save: nothing has happened yet; play, or move a slider")
    times_ns, rows = _join(session, ticks)
    moves = (np.diff(rows, axis=0) != 0.0).any(axis=1)
    kept = np.concatenate(([True], moves[:-1] | moves[1:], [True]))
    document = scene.document()
    document["name"] = f"{scene.name}_by_hand"
    commanded = {"friction", "friction_wave", "loads"} & (document.get("drive") or {}).keys()
    document["drive"] = _write_drive(scene.columns, times_ns[kept] / 1e9, rows[kept], commanded)
    allowed = _find_tolerance(scene)
    try:
        found = Scene.model_validate(document)
        if allowed > 0.0:  # the tolerance of a scene is relative to its drive
            document["tolerance"] = min(tolerance_of(scene) * allowed / _find_tolerance(found), LARGEST_TOLERANCE)
            found = Scene.model_validate(document)
    except SceneError as error:
        raise CommandError(f"save: {error}; a recording can hold it") from None
    apart = np.abs(_run(session, found).displacement[-1] - session.crawler.displacement).max()
    if apart > allowed:
        why = "on this ground a drive that commands friction" if scene.ground.track is not None else "a drive"
        raise CommandError(f"save: {why} moves differently, by {apart:.1e} m; a recording can hold it")
    return found


def _find_tolerance(scene: Scene) -> float:
    """Find the largest error of a ramp of a scene [m]; 0 on a line."""
    if scene.dimension == 1:
        return 0.0
    from crawler_model.motion.plane.motion import build_plane_motion  # its kernels are not needed on a line

    return build_plane_motion(scene).tolerance


def _join(session: Session, ticks: Sequence[Tick]) -> tuple[np.ndarray, np.ndarray]:
    """Join the times [ns] and the rows of all ramps."""
    starts = [tick_end_ns(k, session.rate) for k in range(len(ticks))]
    times = [start + tick.ends_ns for start, tick in zip(starts, ticks, strict=True)]
    return np.concatenate([[0], *times]), np.vstack([session.ticks[0].rows, *(tick.rows for tick in ticks)])


def _write_drive(columns: Columns, times: np.ndarray, rows: np.ndarray, commanded: set[str]) -> dict[str, Any]:
    """Write waypoints as the keys of a drive; friction and loads if they change or the scene's drive commands them."""
    lengths, frictions, loads = np.split(rows, [columns.lengths, columns.lengths + columns.frictions], axis=1)
    drive: dict[str, Any] = {"times": times.tolist()}
    planar = columns.planar is not None
    if planar and columns.joints is None:
        drive["actuation"] = lengths.reshape(times.size, -1, 2).tolist()
    else:
        drive["actuation"] = _merge(columns, lengths, columns.actuation_sizes).tolist()
    if commanded - {"loads"} or (frictions != frictions[0]).any():
        drive["friction"] = _write_friction(columns, frictions)
    if "loads" in commanded or (loads != loads[:1]).any():
        drive["loads"] = (loads.reshape(times.size, -1, 2) if planar else loads).tolist()
    return drive


def _write_friction(columns: Columns, frictions: np.ndarray) -> dict[str, Any]:
    if columns.joints is not None:
        return {side: frictions[:, k :: len(SIDES)].tolist() for k, side in enumerate(SIDES)}
    names = ("forward", "backward")[: columns.sides] if columns.planar is None else ("isotropic",)
    sides = np.split(frictions, len(names), axis=1)
    return {
        name: _merge(columns, side, columns.friction_sizes).tolist() for name, side in zip(names, sides, strict=True)
    }


def _merge(columns: Columns, table: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Merge columns that a drive commands together, and refuse those that differ, as in a wave along a segment."""
    firsts = np.concatenate(([0], np.cumsum(sizes)[:-1]))
    merged = table[:, firsts]
    if not np.array_equal(np.repeat(merged, sizes, axis=1), table):
        raise CommandError("save: the commands vary along a segment, which waypoints cannot; a recording can hold it")
    return merged


def _run(session: Session, scene: Scene) -> Trajectory:
    return simulate(scene, session.time_ns / 1e9, float(session.rate), session.crawler.method)


def _save_scene(session: Session, file: Path) -> None:
    """Save the drive as a scene file; the text of a long one is JSON, which is YAML that is read sooner."""
    document = write_scene(session).document()
    text = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, allow_unicode=True)
    text = f"# Made by hand with crawler play; simulate it at {float(session.rate):g} Hz.\n{text}"
    try:
        parse_scene(text)
    except SceneError:  # so many values are read as JSON only
        text = json.dumps(document)
    file.write_text(text, encoding="utf-8")


def _save_picture(session: Session, file: Path) -> None:
    """Save a page about a session, as `crawler simulate --png` draws it."""
    from crawler_pictures.run.run_page import draw_run
    from crawler_pictures.run.trajectory import read_trajectory

    draw_run(read_trajectory(_run(session, write_scene(session))), file)


def _save_film(session: Session, file: Path) -> None:
    """Save a film of the last seconds of a session, of two frames at least."""
    from crawler_pictures.film.film import film_of_run, frame_times
    from crawler_pictures.film.player import write_html

    scene, end = write_scene(session), session.time_ns / 1e9
    if end * _FPS < 1.0:
        raise CommandError(f"save: {end:g} s are too short for a film; play {1.0 / _FPS:g} s or more")
    times = frame_times(max(end - FILM_SECONDS, 0.0), end, _FPS, 1.0)
    write_html(film_of_run(scene, _run(session, scene)).sample(times), file, _FPS, lambda _: None)


def _save_recording(session: Session, file: Path) -> None:
    """Save a session as a recording, which replays to the bit."""
    from crawler_ros.recording.run_writer import write_run

    with tempfile.TemporaryDirectory(dir=file.parent) as parent:
        folder = write_run(Path(parent) / file.stem, session.scene, session.rate, _follow(session))
        next(folder.glob("*.mcap")).replace(file)


def _follow(session: Session) -> Iterator[RecordedTick]:
    """Follow a session again and read what a simulator would have recorded."""
    from crawler_ros.recording.run_writer import RecordedTick
    from crawler_ros.wire.states import contact_names, joint_state_names, shown_contacts

    scene, body = session.scene, session.scene.body
    crawler, readout = Crawler(scene), Readout(body, shown_contacts(body))
    before = session.ticks[0].rows[-1]
    for k, tick in enumerate(session.ticks[: session.now + 1]):
        moved = (tick.rows != before).any()
        if k:
            crawler.follow(np.array(scene.columns.target(tick.rows)))
        joints, contacts = np.zeros((3, len(joint_state_names(body)))), np.zeros((3, len(contact_names(body))))
        seconds = (tick_end_ns(k, session.rate) - tick_end_ns(k - 1, session.rate)) / 1e9 if k else np.inf
        readout.read(crawler, seconds, joints, contacts)
        pose = (*np.atleast_1d(crawler.net_translation).tolist(), crawler.yaw)
        pose = pose if body.dimension == 2 else (*pose[:-1], 0.0, 0.0)
        ends, rows = (tick.ends_ns.tolist(), list(tick.rows)) if moved else ([], [])
        yield RecordedTick(ends, rows, joints, contacts, pose)
        before = tick.rows[-1]


KEPT = {
    "scene.yaml": _save_scene,
    "recording.mcap": _save_recording,
    "picture.png": _save_picture,
    "film.html": _save_film,
}
"""How what can be kept is written."""
