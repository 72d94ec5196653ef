"""From a recording to knowledge: health, cycles, slips, energy, margins, and the recorded commands simulated again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene
from crawler_model.body.drive import NS

from ..recording.bag import BagError, recorded_scene
from ..recording.recorded_robot import Robot
from ..recording.versions import versions
from ..wire.states import contact_names, station_names
from .cycle_table import Cycle, Energy, account_of, tabulate_cycles
from .health import Survey, TopicHealth, check_topics, choose_robot, find_rate, survey_recording
from .margins import Margins, find_margins
from .midrun import fit_start
from .observe import observe
from .ramps import RampTable, Sink
from .resimulate import Comparison, Resimulation
from .slips import Slips, SlipSink
from .standstill import Standstill, find_standstill

_SURVEYED = 0.2
"""The part of the work that the first look is."""
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Replay:
    """What a recording tells.

    Attributes:
        path: the recording.
        survey: all stamps of it.
        robot: the crawler, with the names of its topics.
        scene: what ran; None when nobody knows.
        method: how it was integrated; None when nobody knows.
        topics: health of each topic.
        problems: what is not as it should be, a line each.
        comparison: with the simulation; None where there was none.
        explanation: why it is identical, or is not, or was not made.
        fitted_ns: where the simulation started, when it had to be read from the states [ns]; None at the scene's start.
        table: a row a ramp.
        contacts: names of the shown contacts.
        stations: names of what slips are told of: isolated contacts, then both ends of each segment.
        cycles: in order.
        cycle_source: "drive", "recurrence" or "none".
        slips: of the stations.
        energy: of the whole run; None when the scene is not known.
        margins: likewise.
        standstill: the rest in which it ended; None when it moved to the end.
    """

    path: Path
    survey: Survey
    robot: Robot
    scene: Scene | None
    method: str | None
    topics: dict[str, TopicHealth]
    problems: tuple[str, ...]
    comparison: Comparison | None
    explanation: str
    fitted_ns: int | None
    table: RampTable
    contacts: tuple[str, ...]
    stations: tuple[str, ...]
    cycles: tuple[Cycle, ...]
    cycle_source: str
    slips: Slips
    energy: Energy | None
    margins: Margins | None
    standstill: Standstill | None

    @property
    def healthy(self) -> bool:
        """Whether all is as it should be."""
        return not self.problems

    @property
    def seconds(self) -> float:
        """How much time was simulated, all runs together [s]."""
        return float((self.table.end_ns - self.table.start_ns).sum()) / NS

    def as_plain(self) -> dict[str, Any]:
        """Lay it out as `crawler replay --json` prints it.

        Returns:
            Plain numbers, lists and text, schema 1; lengths in m, times in s, energies in J, forces in N.
        """
        said = self.comparison
        return {
            "schema": 1,
            "recording": str(self.path),
            "scene": None if self.scene is None else self.scene.name,
            "method": self.method,
            "namespace": self.robot.namespace,
            "simulated_s": self.seconds,
            "healthy": self.healthy,
            "problems": list(self.problems),
            "health": {name: topic.as_plain() for name, topic in self.topics.items()},
            "complete": self.survey.complete,
            "cycles": [cycle.as_plain() for cycle in self.cycles],
            "cycle_source": self.cycle_source,
            "slips": self._plain_slips(),
            "energy": None if self.energy is None else self.energy.as_plain(),
            "margins": None if self.margins is None else self.margins.as_plain(),
            "standstill": None if self.standstill is None else self.standstill.as_plain(),
            "resimulation": {
                "ticks": 0 if said is None else said.ticks,
                "max_difference": None if said is None else said.max_difference,
                "identical": said is not None and said.identical,
                "first_difference": None if said is None else said.first_difference,
                "resets": 0 if said is None else said.resets,
                "from": None if said is None else (self.fitted_ns or 0) / NS,
                "explanation": self.explanation,
            },
        }

    def _plain_slips(self) -> list[dict[str, Any]]:
        slips = self.slips
        planar = self.table.net_translation.shape[1] == 2
        columns = (slips.contact, slips.direction, slips.run, slips.start_ns, slips.end_ns, slips.distance)
        return [
            {
                "contact": self.stations[contact],
                "direction": way if planar else int(way),
                "start": start / NS,
                "length": (end - start) / NS,
                "distance": distance,
                "run": run,
            }
            for contact, way, run, start, end, distance in zip(*(c.tolist() for c in columns), strict=True)
        ]


def analyse(
    path: Path,
    scene: Scene | None = None,
    namespace: str | None = None,
    sinks: Sequence[Sink] | Callable[[Survey, Scene | None], Sequence[Sink]] = (),
    progress: Callable[[float], None] | None = None,
) -> Replay:
    """Read a recording and find out what happened.

    Args:
        path: a bag folder or an .mcap file.
        scene: what ran, for a recording that does not hold it.
        namespace: which crawler, where several were recorded.
        sinks: take what every ramp did; or what makes them once the recording has been looked through.
        progress: called with the part done, in [0, 1].

    Returns:
        What was found.

    Raises:
        BagError: when it is no recording of a crawler.
    """
    tell, path = progress or (lambda part: None), Path(path)
    survey = survey_recording(path, lambda part: tell(_SURVEYED * part))
    robot = choose_robot(survey, namespace)
    rate = find_rate(survey, robot)
    recorded = recorded_scene(survey.path, survey.attachments)
    given, scene = scene is not None and recorded is not None and scene != recorded, scene or recorded
    table = RampTable()
    planar = (scene is not None and scene.dimension == 2) or (scene is None and _is_planar(survey, robot))
    finder = SlipSink()
    takers: list[Sink] = [finder, *(sinks(survey, scene) if callable(sinks) else sinks)]

    def rest(part: float) -> None:
        tell(_SURVEYED + (1.0 - _SURVEYED) * part)

    said, why, fitted, method = _follow(survey, robot, scene, rate, [table, *takers], rest)
    if said is None:
        shown, stations = observe(survey, robot, table, takers, rest)
        if planar:
            shown = shown[::2]
    else:
        assert scene is not None
        table.finish()
        shown, stations = tuple(contact_names(scene.body)[:: scene.dimension]), tuple(station_names(scene.body))
    known = said is not None
    cycles, source = tabulate_cycles(table, scene)
    topics = check_topics(survey, robot, rate)
    return Replay(
        path=path,
        survey=survey,
        robot=robot,
        scene=scene,
        method=method,
        topics=topics,
        problems=tuple(_problems(survey, robot, topics, said, why, fitted, scene, given)),
        comparison=said,
        explanation=why,
        fitted_ns=fitted,
        table=table,
        contacts=tuple(name.removesuffix("/x") for name in shown),
        stations=stations,
        cycles=cycles,
        cycle_source=source,
        slips=finder.finish(),
        energy=account_of(table) if known else None,
        margins=find_margins(table, scene) if known and scene is not None else None,
        standstill=find_standstill(table, survey, robot),
    )


def simulate_again(path: Path) -> Comparison:
    """Follow a recording's ledger from its start and compare every recorded state.

    Args:
        path: a bag folder or an .mcap file that holds its scene and `applied_commands`.

    Returns:
        The comparison.

    Raises:
        BagError: when it cannot be read, or holds no scene.
    """
    survey = survey_recording(path)
    robot = choose_robot(survey, None)
    scene = recorded_scene(survey.path, survey.attachments)
    if scene is None:
        raise BagError(f"{path}: it does not hold its scene, so it cannot be simulated again")
    said, why, _, _ = _follow(survey, robot, scene, find_rate(survey, robot), [], None)
    if said is None:
        raise BagError(why)
    return said


def _is_planar(survey: Survey, robot: Robot) -> bool:
    """Tell a recording of a planar body by the names of its joints."""
    from ..recording import bag

    for record in bag.read(survey.path):
        if record.topic in (robot.recorded("joint_states"), robot.recorded("contact_states")):
            return b"contact_0/x\0" in record.data
    return False


def _follow(
    survey: Survey,
    robot: Robot,
    scene: Scene | None,
    rate: Fraction | None,
    sinks: Sequence[Sink],
    progress: Callable[[float], None] | None,
) -> tuple[Comparison | None, str, int | None, str | None]:
    """Simulate again where that is possible; say why it is not, or what came of it."""
    if scene is None:
        return None, "not simulated again: the recording does not hold its scene; give it with --scene", None, None
    ledger = survey.topics.get(robot.recorded("applied_commands"))
    if ledger is None or ledger.stamp_ns.size == 0:
        return None, "not simulated again: applied_commands, what the ticks followed, was not recorded", None, None
    parameters = survey.attachments.get("parameters")
    given = parameters.get("method") if isinstance(parameters, dict) else None
    start = Crawler(scene, None if given == "auto" else given)
    fitted: int | None = None
    if int(ledger.stamp_ns[0]) > 0:
        try:
            start, fitted = fit_start(survey, robot, start, rate)
        except BagError as error:
            return None, f"not simulated again: {str(error).removeprefix(f'{survey.path}: ')}", None, start.method
    said = Resimulation(survey, robot, start, rate, sinks, fitted or 0).go(progress)
    return said, _explain(survey, said, start, fitted, given is not None), fitted, start.method


def _explain(survey: Survey, said: Comparison, start: Crawler, fitted: int | None, method_known: bool) -> str:
    """Say in a line why states are the same, or what can have made them differ."""
    if said.ticks == 0:
        return "no state was compared: joint_states was not recorded" + (f"; {said.stopped}" if said.stopped else "")
    if fitted is not None:
        text = f"begins in mid-run: the state at {fitted / NS:g} s was read from the recording, but for its rounding"
        if said.identical:
            return f"{text}; identical from there on"
    elif said.identical:
        return "identical to the bit" + (f", up to where {said.stopped}" if said.stopped else "")
    else:
        text = f"first difference at {said.first_difference:g} s, {said.first_where}"
    reasons = []
    if said.stopped:
        reasons.append(said.stopped)
    if said.missing:
        reasons.append(f"{said.missing} ledger message(s) missing from {said.missing_at:g} s on")
    recorded = survey.attachments.get("versions")
    if isinstance(recorded, dict):
        ours = versions()
        reasons += [
            f"recorded with {name} {recorded[name]}, here {ours[name]}"
            for name in ours
            if recorded.get(name, ours[name]) != ours[name]
        ]
    elif fitted is None:
        reasons.append("the recording does not say which versions made it")
    if not method_known:
        reasons.append(f"it does not say how it was made: {start.method} from the scene's start is assumed")
    if not reasons and fitted is None:
        reasons.append("ledger, versions and method are the recording's own: were its states changed?")
    return f"{text}; {'; '.join(reasons)}" if reasons else text


def _problems(
    survey: Survey,
    robot: Robot,
    topics: dict[str, TopicHealth],
    said: Comparison | None,
    why: str,
    fitted: int | None,
    scene: Scene | None,
    other_scene: bool,
) -> list[str]:
    """List what is wrong, the worst first."""
    found = []
    if survey.lost is None:
        found.append("its end is missing; crawler replay --recover writes what can be read")
    elif not survey.complete:
        found.append(
            f"damaged: {survey.damaged} chunk(s) cannot be read, {survey.lost} message(s) are lost; "
            "crawler replay --recover writes the others"
        )
    if other_scene:
        found.append("--scene is not the scene that the recording holds: what follows is about the former")
    for name, topic in topics.items():
        short = robot.meant(name)
        if topic.missing:
            after = topic.gaps[0][0]
            found.append(f"{short}: {topic.missing} tick(s) missing, the first behind {after:g} s")
        if topic.out_of_order and short in ("applied_commands", "joint_states", "contact_states", "pose"):
            found.append(f"{short}: {topic.out_of_order} stamp(s) go back without a reset")
        if topic.duplicates and short == "applied_commands":
            found.append(f"{short}: {topic.duplicates} tick(s) came twice")
    if scene is not None and said is None:
        found.append(why)
    if said is not None and not said.identical:
        size = 1.0 + abs(said.max_difference)
        rounding = fitted is not None and said.ticks > 0 and said.max_difference <= _SAME * size
        if not rounding:
            found.append(f"simulated again it is not identical: {why}")
    elif said is not None and said.stopped:
        found.append(said.stopped)
    return found


def size_of(table: RampTable) -> float:
    """Tell the size of the lengths in a run, for what rounding is.

    Args:
        table: all ramps of the run.

    Returns:
        The largest length in it [m].
    """
    return max(table.shape_size, float(np.abs(table.net_translation).max(initial=0.0)))
