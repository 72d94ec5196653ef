"""Analysis of a recording: health, cycles, slips, energy, margins, and a new simulation of the recorded commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from crawler_model import Crawler, Scene
from crawler_model.body.drive import NS
from crawler_model.body.names import name_every_contact

from ..recording.attachments import other_versions
from ..recording.bag import BagError, newest, recorded_scene
from ..recording.incidents import Incidents, find_incidents
from ..recording.recorded_robot import Robot
from ..wire.measured import MeasuredStates, find_sensors
from ..wire.states import contact_names, station_names
from .cycle_table import Cycle, EnergyBalance, account_of, tabulate_cycles
from .health import Survey, TopicHealth, check_topics, choose_robot, find_rate, survey_recording
from .margins import Margins, find_margins
from .midrun import fit_start
from .observe import observe
from .ramps import RampTable, Sink
from .resimulate import Comparison, Resimulation
from .rests import Rest, find_rests
from .slips import SlipFinder, Slips
from .yields import YieldSink

_SURVEYED = 0.2
"""Fraction of the work that the survey takes."""


@dataclass(frozen=True, eq=False)
class Replay:
    """The results of analysing a recording.

    Attributes:
        path: the recording.
        survey: all of its stamps.
        robot: the crawler, with the names of its topics.
        scene: the scene that ran; None when it is not known.
        method: the method of integration; None when it is not known.
        topics: health of each topic.
        problems: one line for each problem.
        comparison: comparison with the new simulation; None when there is none.
        explanation: why the states are identical, differ, or were not compared.
        fitted_ns: simulated time at which the new simulation started, if its start was read from the states [ns]; None
            if it started at the scene's start.
        table: one row per ramp.
        contacts: names of the shown contacts.
        whole: whether the motion of all contacts is known; `joint_states` shows only the first one.
        stations: names of the stations of the slips: isolated contacts, then both ends of each segment.
        cycles: the cycles in order.
        cycle_source: "drive", "recurrence" or "none".
        slips: slips of the stations.
        energy: energy account of the whole run; None when the scene is not known.
        margins: margins of the whole run; None when the scene is not known.
        rests: the rests that last at least a cycle of the commands, without cycles a second.
        incidents: refused commands and late ticks; None when /diagnostics was not recorded.
        at_limits: how long each link with limits of tension was `slack` and `stalled` [s]; None without a simulation.
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
    whole: bool
    stations: tuple[str, ...]
    cycles: tuple[Cycle, ...]
    cycle_source: str
    slips: Slips
    energy: EnergyBalance | None
    margins: Margins | None
    rests: tuple[Rest, ...]
    incidents: Incidents | None
    at_limits: dict[str, dict[str, float]] | None

    @property
    def healthy(self) -> bool:
        """Whether there are no problems."""
        return not self.problems

    @property
    def turns(self) -> bool:
        """Whether the body turns, as its scene or its recorded yaw tell."""
        return self.table.turns or (self.scene is not None and self.scene.body.turning is not None)

    @property
    def seconds(self) -> float:
        """Simulated time of all runs together [s]."""
        return float((self.table.end_ns - self.table.start_ns).sum()) / NS

    def as_plain(self) -> dict[str, Any]:
        """Convert to the values that `crawler replay --json` prints.

        Returns:
            Plain numbers, lists and text, schema 1; lengths in m, times in s, energies in J, forces in N.
        """
        compared, gained = self.comparison, self.table.gained
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
            "net_translation": (gained if gained.shape[1] > 1 else gained[:, 0]).tolist(),
            "cycles": [cycle.as_plain() for cycle in self.cycles],
            "cycle_source": self.cycle_source,
            "slips": self._plain_slips(),
            "jumps": self.plain_jumps(),
            "energy": None if self.energy is None else asdict(self.energy),
            "margins": None if self.margins is None else self.margins.as_plain(),
            "rests": [rest.as_plain() for rest in self.rests],
            "at_limits": self.at_limits,
            "incidents": None if self.incidents is None else asdict(self.incidents),
            "resimulation": {
                "ticks": 0 if compared is None else compared.ticks,
                "compared": 0 if compared is None else compared.compared,
                "left_out": 0 if compared is None else compared.left_out,
                "max_difference": None if compared is None else compared.max_difference,
                "identical": compared is not None and compared.identical,
                "first_difference": None if compared is None else compared.first_difference,
                "resets": 0 if compared is None else compared.resets,
                "from": None if compared is None else (self.fitted_ns or 0) / NS,
                "explanation": self.explanation,
            },
        }

    def plain_jumps(self) -> list[dict[str, Any]]:
        """List the jumps, on patches of ground or of a body that turns, as plain values.

        Returns:
            The run, and the attributes of `crawler_model.run.simulate.TimedJump`, with the name of the contact.
        """
        names = () if self.scene is None else name_every_contact(self.scene.body)
        return [{"run": run, **asdict(jump), "contact": names[jump.contact]} for run, jump in self.table.jumps]

    def _plain_slips(self) -> list[dict[str, Any]]:
        slips = self.slips
        planar = self.table.net_translation.shape[1] == 2
        columns = (slips.contact, slips.direction, slips.run, slips.start_ns, slips.end_ns, slips.distance)
        return [
            {
                "contact": self.stations[contact],
                "direction": direction if planar else int(direction),
                "start": start / NS,
                "length": (end - start) / NS,
                "distance": distance,
                "run": run,
            }
            for contact, direction, run, start, end, distance in zip(*(c.tolist() for c in columns), strict=True)
        ]


def analyse(
    path: Path,
    scene: Scene | None = None,
    namespace: str | None = None,
    sinks: Sequence[Sink] | Callable[[Survey, Scene | None], Sequence[Sink]] = (),
    progress: Callable[[float], None] | None = None,
) -> Replay:
    """Read and analyse a recording.

    Args:
        path: a bag folder or an .mcap file; of a folder of bags, the newest is read.
        scene: the scene that ran, for a recording that does not hold it.
        namespace: namespace of the crawler, where several were recorded.
        sinks: callables that receive every ramp, or a function that builds them after the survey.
        progress: called with the fraction done, in [0, 1].

    Returns:
        The results.

    Raises:
        BagError: when the file is not a recording of a crawler.
    """
    report, path = progress or (lambda part: None), newest(Path(path))
    survey = survey_recording(path, lambda part: report(_SURVEYED * part))
    robot = choose_robot(survey, namespace)
    rate = find_rate(survey, robot)
    recorded = recorded_scene(survey.path, survey.attachments)
    other_scene, scene = scene is not None and recorded is not None and scene != recorded, scene or recorded
    table = RampTable()
    finder, yields = SlipFinder(), YieldSink(scene)
    receivers: list[Sink] = [finder, yields, *(sinks(survey, scene) if callable(sinks) else sinks)]

    def report_remaining(part: float) -> None:
        report(_SURVEYED + (1.0 - _SURVEYED) * part)

    compared, why, fitted, method = _follow(survey, robot, scene, rate, [table, *receivers], report_remaining)
    if compared is None:
        contacts, stations = observe(survey, robot, table, receivers, report_remaining)
    else:
        assert scene is not None
        table.finish()
        shown = contact_names(scene.body)[:: scene.dimension]
        contacts, stations = tuple(name.removesuffix("/x") for name in shown), tuple(station_names(scene.body))
    known = compared is not None
    cycles, source = tabulate_cycles(table, scene)
    topics = check_topics(survey, robot, rate)
    whole = known or robot.recorded("contact_states") in survey.topics
    return Replay(
        path=path,
        survey=survey,
        robot=robot,
        scene=scene,
        method=method,
        topics=topics,
        problems=tuple(_problems(survey, robot, topics, compared, why, fitted, scene, other_scene)),
        comparison=compared,
        explanation=why,
        fitted_ns=fitted,
        table=table,
        contacts=contacts,
        whole=whole,
        stations=stations,
        cycles=cycles,
        cycle_source=source,
        slips=finder.finish(),
        energy=account_of(table) if known else None,
        margins=find_margins(table, scene) if known and scene is not None else None,
        rests=find_rests(table, cycles) if whole else (),
        incidents=find_incidents(survey.diagnostics, robot.namespace),
        at_limits=yields.list_seconds() if known else None,
    )


def simulate_again(path: Path) -> Comparison:
    """Simulate a recording's ledger from its start and compare every recorded state.

    Args:
        path: a bag folder or an .mcap file that holds its scene and `applied_commands`; of a folder of bags, the newest
            is read.

    Returns:
        The comparison.

    Raises:
        BagError: when it cannot be read, or holds no scene.
    """
    path = newest(path)
    survey = survey_recording(path)
    robot = choose_robot(survey, None)
    scene = recorded_scene(survey.path, survey.attachments)
    if scene is None:
        raise BagError(f"{path}: the recording does not hold its scene, so it cannot be simulated again")
    compared, why, _, _ = _follow(survey, robot, scene, find_rate(survey, robot), [], None)
    if compared is None:
        raise BagError(why)
    return compared


def _follow(
    survey: Survey,
    robot: Robot,
    scene: Scene | None,
    rate: Fraction | None,
    sinks: Sequence[Sink],
    progress: Callable[[float], None] | None,
) -> tuple[Comparison | None, str, int | None, str | None]:
    """Simulate again where possible; return the comparison, an explanation, the fitted start and the method."""
    if scene is None:
        return None, "not simulated again: the recording does not hold its scene; name it with --scene", None, None
    ledger = survey.topics.get(robot.recorded("applied_commands"))
    parameters = survey.attachments.get("parameters")
    parameters = parameters if isinstance(parameters, dict) else {}
    if ledger is None or ledger.stamp_ns.size == 0:
        why = "applied_commands, the ledger of the ticks, was not recorded"
        if parameters.get("lock_step") is True:  # a simulator records its ledger always
            why = "no tick was run, as no command was accepted: in lock-step each command triggers its ticks"
        return None, f"not simulated again: {why}", None, None
    recorded = parameters.get("method")
    start = Crawler(scene, None if recorded == "auto" else recorded)
    begin, fitted = start, None
    if int(ledger.stamp_ns[0]) > 0:
        try:
            begin, fitted = fit_start(survey, robot, start, rate)
        except BagError as error:
            return None, f"not simulated again: {str(error).removeprefix(f'{survey.path}: ')}", None, start.method
    sensors = find_sensors(scene.parts.sensors, parameters)
    measured = None if sensors is None else MeasuredStates(scene, sensors)
    compared = Resimulation(survey, robot, start, rate, sinks, (begin, fitted or 0), measured).run(progress)
    return compared, _explain(survey, compared, start, fitted, recorded is not None), fitted, start.method


def _explain(survey: Survey, compared: Comparison, start: Crawler, fitted: int | None, method_known: bool) -> str:
    """Explain in one line why the states are identical, or what may have made them differ."""
    if compared.ticks == 0:
        why = "no tick of the ledger leads to any" if compared.unmatched else "none was recorded"
        return f"no state was compared: {why}" + (f"; {compared.stopped}" if compared.stopped else "")
    counted = f"all {compared.ticks} recorded states compared"
    if fitted is not None:
        text = f"begins in mid-run: the state at {fitted / NS:g} s was read from the recording, up to rounding"
        if compared.identical:
            return f"{text}; identical from there on ({counted})"
    elif compared.identical:
        return f"identical to the bit ({counted})"
    elif compared.first_difference is None:
        text = f"the {compared.ticks} states compared are the same"
    else:
        text = f"first difference at {compared.first_difference:g} s, {compared.first_where}"
        if compared.equal:
            lengths, forces = compared.max_difference, compared.max_force_difference
            text = f"equal up to rounding, at most {lengths:.1g} m and {forces:.1g} N apart; {text}"
    reasons = []
    if compared.left_out:
        reasons.append(f"{compared.left_out} recorded states not compared: no tick of the ledger leads to them")
    if compared.stopped:
        reasons.append(compared.stopped)
    if compared.missing:
        reasons.append(f"{compared.missing} ledger message(s) missing from {compared.missing_at:g} s on")
    reasons += other_versions(survey.attachments.get("versions"))
    if fitted is None and not isinstance(survey.attachments.get("versions"), dict):
        reasons.append("the recording does not name the versions that made it")
    if not method_known:
        reasons.append(f"it does not name its method: {start.method} from the scene's start is assumed")
    if not reasons and fitted is None:
        reasons.append("ledger, versions and method are the recording's own: were its states changed?")
    return f"{text}; {'; '.join(reasons)}" if reasons else text


def _problems(
    survey: Survey,
    robot: Robot,
    topics: dict[str, TopicHealth],
    compared: Comparison | None,
    why: str,
    fitted: int | None,
    scene: Scene | None,
    other_scene: bool,
) -> list[str]:
    """List the problems, the worst first."""
    found = list(survey.missing)
    if not survey.ended:
        found.append("its end is missing; crawler replay --recover writes what can be read")
    elif survey.lost != 0:
        lost = "an unknown number of messages is" if survey.lost is None else f"{survey.lost} message(s) are"
        found.append(
            f"damaged: {survey.damaged} chunk(s) cannot be read, {lost} lost; "
            "crawler replay --recover writes the others"
        )
    if other_scene:
        found.append("--scene is not the scene that the recording holds; the results are for --scene")
    for name, topic in topics.items():
        short = robot.meant(name)
        if topic.missing:
            after = topic.gaps[0][0]
            found.append(f"{short}: {topic.missing} tick(s) missing, the first after {after:g} s")
        if topic.out_of_order and short in ("applied_commands", "joint_states", "contact_states", "pose"):
            found.append(f"{short}: {topic.out_of_order} stamp(s) decrease without a reset")
        if topic.duplicates and short == "applied_commands":
            found.append(f"{short}: {topic.duplicates} tick(s) occur twice")
    if scene is not None and compared is None:
        found.append(why)
    if compared is not None and not compared.identical:
        may_differ = fitted is not None or bool(other_versions(survey.attachments.get("versions")))
        if not (may_differ and compared.equal):
            found.append(f"not identical when simulated again: {why}")
    elif compared is not None and compared.stopped:
        found.append(compared.stopped)
    return found
