"""The page of a replay: the analysed recording as the arrays of `crawler_pictures.run.run_page`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.body.names import name_each, name_joints
from crawler_pictures.marks import mark_joints, own_tensions
from crawler_pictures.run.arrays import Commands, Gains, RunArrays, planar_forces, sort_commands
from crawler_pictures.run.run_page import draw_run

from ...wire.states import shown_contacts

if TYPE_CHECKING:
    from ..analysis import Replay
    from .samples import Samples


def draw_replay(replay: Replay, samples: Samples, png: Path, two_columns: bool = False) -> None:
    """Draw the page.

    Args:
        replay: the analysed recording.
        samples: samples of the run.
        png: the file to write.
        two_columns: whether the panels over time stand in two columns.

    Raises:
        CrawlerError: when there is no state to draw.
    """
    draw_run(read_replay(replay, samples), png, two_columns)


def read_replay(replay: Replay, samples: Samples) -> RunArrays:
    """Convert an analysed recording to the arrays of its page.

    Args:
        replay: the analysed recording.
        samples: samples of the run.

    Returns:
        The arrays; cycles and rests belong to the first run between resets.
    """
    scene, positions, tension = replay.scene, samples.get("position"), samples.get("tension")
    energy = {}
    if replay.energy is not None:
        names = {"work": "work of the actuators", "dissipation": "dissipation", "stored": "stored"}
        rare = {
            "loads_work": "work of the loads",
            "jump_loss": "lost in jumps",
            "internal_dissipation": "lost in springs",
        }
        names |= {name: text for name, text in rare.items() if samples.get(name).any()}
        energy = {text: samples.get(name) for name, text in names.items()}
    y, turns = samples.get("net_translation"), replay.turns
    links = tuple(name_each("link", tension.shape[1]) if scene is None else name_joints(scene.body))
    if scene is not None and turns:
        tension, links = tension[:, : scene.body.springs], links[: scene.body.springs]
    place = positions[0] if scene is None else scene.body.position[shown_contacts(scene.body)]
    marks, own = np.zeros((0, 0), np.int8), np.zeros((0, 0))
    if scene is not None and scene.body.bends and samples.get("command").shape[1]:
        body, z = scene.body, samples.get("elongation")
        length = body.joint_sum(scene.columns.target(samples.get("command"))[:, : body.springs].T).T
        own, marks = own_tensions(body, z, length), mark_joints(body, z, length, tension)
    return RunArrays(
        title=f"{'scene not known' if scene is None else scene.name}, {replay.path.name}",
        notes=(*_notes(replay), *_describe_turning(replay)),
        time=samples.get("end_ns") / NS,
        positions=positions,
        state=samples.get("state"),
        net_translation=y,
        tension=tension,
        least=samples.get("least"),
        most=samples.get("most"),
        contacts=replay.contacts,
        links=links,
        place=place,
        ends=np.zeros((0, 2), np.int64) if scene is None else scene.body.ends,
        commands=_commands(replay, samples),
        energy=energy,
        cycles=np.array([cycle.start for cycle in replay.cycles if cycle.run == 0]),
        gains=None if turns else _gains(replay),
        rests=[(rest.since, rest.until) for rest in replay.rests if rest.run == 0],
        jumps=samples.jumps,
        scene=scene,
        force=None if scene is None or turns else planar_forces(scene, tension, samples.get("command")),
        share=None if scene is None else scene.body.share[shown_contacts(scene.body)],
        marks=marks,
        own=own,
    )


def _notes(replay: Replay) -> tuple[str, ...]:
    """Write what is to be known of the recording as a whole."""
    notes = ["as recorded, not simulated" if replay.comparison is None else f"simulated again: {replay.explanation}"]
    notes += [] if replay.incidents is None else replay.incidents.explain()
    if replay.table.resets:
        notes.append("runs between resets one after another")
    return tuple(notes)


def _describe_turning(replay: Replay) -> list[str]:
    """Describe how a body that turns turned, and its gain in the last cycle."""
    table, cycles = replay.table, replay.cycles
    if table.turned is None:
        return []
    shown = "" if replay.comparison is None else "; tensions belong to the links"
    found = [f"turned by {table.turned:.6g} rad{shown}"]
    if cycles and cycles[-1].turned is not None:
        dx, dy = np.atleast_1d(cycles[-1].translation)
        turned = f"turned by {cycles[-1].turned:.6g} rad"
        found.append(f"last cycle: {dx:.6g} m along its heading, {dy:.6g} m to the left, {turned}")
    return found


def _commands(replay: Replay, samples: Samples) -> tuple[Commands, ...]:
    rows = samples.get("command")
    if rows.shape[1] == 0:
        return ()
    if replay.scene is None:
        return (Commands("commands", "1", tuple(f"column {k}" for k in range(rows.shape[1])), rows),)
    return sort_commands(replay.scene.columns, rows)


def _gains(replay: Replay) -> Gains | None:
    if not replay.cycles:
        return None
    gained = np.array([np.atleast_1d(cycle.translation)[0] for cycle in replay.cycles])
    transient = np.array([cycle.transient for cycle in replay.cycles])
    last, body = replay.cycles[-1], None if replay.scene is None else replay.scene.body
    parts = None if body is None or body.dimension == 2 else body.isolated.size + len(body.segments)
    return Gains(gained, transient, (last.slip_forward, last.slip_backward), parts)
