"""The node `crawler`: it takes parameters and commands and publishes states at a fixed rate."""

from __future__ import annotations

import gc
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.experimental.events_executor import EventsExecutor

from crawler_model import CommandError, Crawler, CrawlerError, Scene, load_scene, prepare
from crawler_model.body.drive import NS
from crawler_model.run.ticks import rational_rate
from crawler_model.theory.regularity import check_regularity
from crawler_model.theory.uniqueness import commanded_margin

from ..wire.facts import LogText
from ..wire.measured import MEASURED, MeasuredStates, find_sensors
from ..wire.messages import encode_diagnostics, encode_string
from ..wire.topics import message_class, open_publisher, qos_in_use, read_services, read_topics
from .actuators import Actuators
from .diagnostics import CommandCounts, TickCounts, diagnose
from .encoder import STATES
from .intake.commands import CommandQueue
from .intake.intake import Intake
from .intake.limits import command_limits
from .intake.peers import TRIGGERS
from .life.fair_lock import FairLock
from .life.quiet_node import QuietNode
from .life.run import run_node
from .life.scheduling import check_priority, raise_priority, reduce_delays
from .life.stop import StopFlag, end_on_signals
from .measured import MeasuredTopics
from .outgoing import Outgoing, Outlet
from .parameters import declare_parameters, expand_home, read_parameters, warn_of_unused_qos
from .server import Server
from .simulation_services import open_simulation_services
from .tick_clock import TickClock
from .ticks import Ticks, compile_ticks

if TYPE_CHECKING:
    from ..recording.recorder import Recorder
    from ..viewer.feed import ViewerFeed


_SILENCE_NS = 5 * NS
"""Time without a command, since states are heard, after which the log reports it."""
_REFUSES_NS = 20 * NS
"""Time without a tick behind a refused command after which the log reports it."""


class Simulator(QuietNode):
    """Connects a `Crawler` to topics. `spin` runs it; all access to its state is under one lock."""

    def __init__(self, scene: Scene | None = None, **options: Any) -> None:
        """Declare parameters, load the scene, open topics, services, recording and viewer.

        Args:
            scene: the scene to simulate; None to load the one that the parameter names.
            **options: for rclpy's Node.

        Raises:
            CrawlerError: when a parameter or the scene is invalid.
            OSError: when the recording cannot be opened.
        """
        super().__init__("crawler", **options)
        self.values = declare_parameters(self)
        for name in ("scene", "record", "view"):
            self.values[name] = expand_home(self.values[name])
        self.scene = load_scene(self.values["scene"]) if scene is None else scene
        rate, catches_up = rational_rate(self.values["rate"]), self.values["late"] == "catch_up"
        prepare(self.scene)
        method = str(self.values["method"])
        crawler = Crawler(self.scene, None if method == "auto" else method)  # type: ignore[arg-type]
        self.tick_clock = TickClock(rate, self.values["real_time_factor"], catches_up, self.values["duration"])
        self.columns = self.scene.columns
        self.lock_step = bool(self.values["lock_step"])
        limits = command_limits(self.scene, self.values["limit.length"], self.values["limit.friction"])
        self.commands = CommandQueue(self.columns, crawler.row, self.lock_step, limits)
        self._sensors = find_sensors(self.scene.parts.sensors, self.values)
        self.reported, self.reported_commands = TickCounts(), CommandCounts()
        self.margin = commanded_margin(self.scene.body, self.scene.drive)
        self.regularity = check_regularity(self.scene.drive)
        self.lock = FairLock()
        self.stopping = StopFlag()
        self._arrived = threading.Event()  # messages wait that trigger ticks in lock-step
        self._server = Server(self, self.stopping)
        self.recorder: Recorder | None = None
        self.feed: ViewerFeed | None = None
        self._outlets: dict[str, Outlet] = {}
        view = str(self.values["view"])
        if view != "off":
            from ..viewer.feed import ViewerFeed, check_view

            check_view(view)  # before anything is opened
        if self.values["record"]:
            from ..recording.attachments import describe_run
            from ..recording.recorder import Recorder

            run = describe_run(self.scene, crawler, self.values, self.get_fully_qualified_name())
            self.recorder = Recorder(Path(self.values["record"]), "crawler", run)
        self._open_topics()
        if self.recorder is not None:
            self.recorder.start()
            self.get_logger().info(f"recording to {self.recorder.folder}")
        self._open_services()
        self.add_on_set_parameters_callback(self._on_parameters)
        if view != "off":
            self.feed = ViewerFeed(self.scene, view, self.get_logger().info)
        self.ticks = Ticks(
            self.scene,
            crawler,
            self.tick_clock,
            self.commands,
            self.intake,
            self.outgoing,
            self.feed,
            int(self.values["publish.every"]),
            Actuators(self.scene, self.values),
            self._measured,
        )
        self._next_diagnostics_ns = self._logged_lag_ns = self._silent_ns = self._refuses_ns = 0
        name, topics = self.get_fully_qualified_name(), map(self.resolve_topic_name, self.intake.arrivals)
        self.get_logger().info(
            f"{self.scene.name}: {self.scene.body.describe()}, {crawler.method} at {float(rate):g} Hz; "
            f"{LogText.WAITING.value} {', '.join(topics)}; services {name}/pause, {name}/step, {name}/reset"
        )

    def _open_topics(self) -> None:
        wanted = {
            "joint_states": True,
            "contact_states": self.values["publish.contact_states"],
            "pose": self.values["publish.pose"],
            "applied_commands": self.values["publish.applied_commands"],
            "odom": self.values["publish.odom"],
            "robot_description": self.values["publish.robot_description"],
            "/diagnostics": self.values["publish.diagnostics"],
            **dict.fromkeys(MEASURED, self._sensors is not None),
            "/clock": self.values["publish_clock"],
        }
        self.intake = Intake(self.commands, self.throttle, self.recorder, self.columns.count, self._on_accepted)
        self.states = [n for n in (*STATES, "applied_commands") if wanted[n]]
        for name, topic in read_topics().items():
            full = self.resolve_topic_name(name)
            if topic.direction == "out":
                publisher = open_publisher(self, topic) if wanted[name] else None
                channel = None
                if self.recorder is not None and (publisher is not None or name == "applied_commands"):
                    used = topic if publisher is None else qos_in_use(topic, publisher)
                    channel = self.recorder.add_topic(used, full)
                self._outlets[name] = Outlet(publisher, self.recorder, channel)
            else:
                channel = None if self.recorder is None else self.recorder.add_topic(topic, full)
                self.intake.open(self, topic, channel)
        self.outgoing = Outgoing(self.scene, self.values, self._outlets, self.recorder)
        self._measured = None
        if self._sensors is not None:
            states = MeasuredStates(self.scene, self._sensors)
            self._measured = MeasuredTopics(self.scene, states, self._outlets, self.values["frame_id"], self.lock_step)
        warn_of_unused_qos(self)

    def _open_services(self) -> None:
        handlers = {"reset": self._on_reset, "step": self._on_step, "pause": self._on_pause}
        for name, kind in read_services().items():
            self.create_service(message_class(kind), f"~/{name}", handlers[name])
        open_simulation_services(self)

    # -- services and parameters ------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Return to the start of the scene and to simulated time 0."""
        with self.lock:
            self.tick_clock.reset(time.monotonic_ns())
            self.reported = TickCounts(late=self.reported.late)
            self.reported_commands = self.reported_commands._replace(ticks=0)
            self.ticks.reset()
            self.intake.refusals.restart()

    def pause(self, paused: bool) -> None:
        """Pause simulated time, or let it go on.

        Args:
            paused: whether to pause.
        """
        with self.lock:
            self.tick_clock.pause(paused, time.monotonic_ns())

    def step(self) -> bool:
        """Run one tick while paused.

        Returns:
            Whether it was paused.
        """
        with self.lock:
            if self.tick_clock.paused:
                self.ticks.run(shown=True)
            return self.tick_clock.paused

    def _on_reset(self, _: Any, response: Any) -> Any:
        self.reset()
        response.success, response.message = True, "at the scene's start, simulated time 0"
        return response

    def _on_step(self, _: Any, response: Any) -> Any:
        response.success = self.step()
        text = f"at simulated time {self.tick_clock.now_ns / NS:.9f} s"
        response.message = text if response.success else "not paused: call ~/pause with data true first"
        return response

    def _on_pause(self, request: Any, response: Any) -> Any:
        self.pause(bool(request.data))
        response.success, response.message = True, "paused" if request.data else "playing"
        return response

    def _on_parameters(self, changes: list[Any]) -> Any:
        from rcl_interfaces.msg import SetParametersResult

        for change in changes:
            if change.name == "real_time_factor":
                try:
                    check_priority(self.values | {change.name: change.value})
                except CommandError as error:
                    return SetParametersResult(successful=False, reason=str(error))
                with self.lock:
                    self.tick_clock.real_time_factor = float(change.value)
            if change.name == "actuators.frozen":
                try:
                    with self.lock:
                        self.ticks.freeze(str(change.value))
                except CommandError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    # -- the loop ---------------------------------------------------------------------------------------------------

    def spin(self) -> None:
        """Tick until `stopping` is set or the duration is over; topics and services are served by a second thread."""
        executor = EventsExecutor()
        executor.add_node(self)
        gc.collect()
        raise_priority(self.values["thread_priority"])
        gc.freeze()  # objects loaded so far stay: collecting them again and again would make ticks late
        with self.lock:
            if self._outlets["robot_description"].wanted:
                from .robot_description import describe_robot

                topics = self.resolve_topic_name("joint_commands"), self.resolve_topic_name("joint_states")
                text = describe_robot(self.scene, self.values["frame_id"], topics)
                self._outlets["robot_description"].send(encode_string(text))
            self.ticks.send_start()
        self._server.start(executor)  # in lock-step, a command that is served runs a tick: only after the start is sent
        try:
            while not (self.stopping.is_set() or self.tick_clock.is_over):
                wall_ns = time.monotonic_ns()
                with self.lock:
                    wait = self._wait_ns(wall_ns)
                if wait is None:
                    self._wait_for_commands()
                elif wait > 0:
                    time.sleep(min(wait / NS, 0.1))
                else:
                    with self.lock:
                        self._run_ticks()
                self._push_recording(wall_ns)
                self._report(wall_ns)
        finally:
            self.stopping.set()
            self.tick_clock.end_stretch(time.monotonic_ns())
            self._server.join()
            self.close()

    def _wait_ns(self, wall_ns: int) -> int | None:
        """Compute the time to the next tick [ns]: 0 when it is due; None while paused or waiting for a command."""
        if self.lock_step:
            return None if self.tick_clock.paused or self.commands.is_idle else 0
        return self.tick_clock.wait_ns(wall_ns)

    def _wait_for_commands(self) -> None:
        """Wait a little, in lock-step for a command; before the first one, send the state to new subscribers."""
        if self.tick_clock.paused or not self.lock_step:
            time.sleep(0.01)
            return
        self._arrived.wait(0.01)
        self._arrived.clear()
        with self.lock:
            if self.tick_clock.tick == 0 and self.commands.is_idle:
                self.outgoing.resend()
                if self._measured is not None:
                    self._measured.resend()

    def _on_accepted(self) -> None:
        """In lock-step, run the tick of a message in the thread that received it; leave all else to the loop.

        To wake the loop would take as long as the tick.
        """
        if not self.lock_step:
            return
        behind = self.recorder is not None and self.recorder.is_behind
        if not behind and self.lock.acquire(blocking=False):
            try:
                if not (self.tick_clock.rests or self.commands.is_running or self.commands.is_idle):
                    self.ticks.run()
                    self._server.expect_reply()
            finally:
                self.lock.release()
        if not self.commands.is_idle:
            self._arrived.set()

    def _push_recording(self, wall_ns: int) -> None:
        if self.recorder is not None and self.recorder.error is None:
            before = self.recorder.problem
            self.recorder.push(wall_ns)
            if self.recorder.problem not in ("", before):
                self.get_logger().error(self.recorder.problem)

    def _run_ticks(self) -> None:
        """Run a tick that is due, or many at once if no clock sets a pace."""
        if self.tick_clock.rests:
            return
        if self.lock_step or self.tick_clock.real_time_factor == 0.0:
            self.ticks.run_ahead()
        else:
            self.tick_clock.begin(time.monotonic_ns())
            self.ticks.run()

    # -- reports ----------------------------------------------------------------------------------------------------

    def _report(self, wall_ns: int) -> None:
        if wall_ns < self._next_diagnostics_ns:
            return
        self._next_diagnostics_ns = wall_ns + NS
        self._warn_of_lag(wall_ns)
        self._warn_of_silence(wall_ns)
        self.throttle.flush()
        outlet = self._outlets["/diagnostics"]
        if outlet.wanted:
            outlet.send(encode_diagnostics(time.time_ns(), diagnose(self)))

    def _warn_of_lag(self, wall_ns: int) -> None:
        """Log the lag of simulated time when it exceeds a tenth of a second, and each time that it has doubled."""
        lag_ns = self.tick_clock.lag_ns(wall_ns)
        if lag_ns > max(2 * self._logged_lag_ns, NS // 10) and not self.lock_step:
            self._logged_lag_ns = lag_ns
            self.throttle.warn("lag", self.tick_clock.describe_lag(wall_ns))

    def _warn_of_silence(self, wall_ns: int) -> None:
        """Log once that nothing moves in lock-step although another node hears the states: a topic may be misspelt."""
        if not self.lock_step:
            return
        if self.intake.received:
            self._warn_of_standstill(wall_ns)
            return
        if not self._silent_ns and any(self._outlets[name].is_heard() for name in STATES[:2]):
            self._silent_ns = wall_ns
        if not self._silent_ns or wall_ns - self._silent_ns < _SILENCE_NS:
            return
        self._silent_ns = sys.maxsize  # once
        topics = ", ".join(map(self.resolve_topic_name, self.intake.arrivals))
        text = f"no command has arrived yet, and in lock-step nothing moves without one; they are expected on {topics}"
        self.throttle.warn("silence", text)

    def _warn_of_standstill(self, wall_ns: int) -> None:
        """Log that a command was refused and none followed: a controller that waits for its state waits for ever."""
        received, refusals = self.intake.received, self.intake.refusals
        all_refused = received == refusals.total
        is_idle = self.commands.is_idle and not self.tick_clock.rests
        if not (all_refused or (is_idle and refusals.has_refused_at(self.commands.now_ns, TRIGGERS))):
            self._refuses_ns = 0
            return
        self._refuses_ns = self._refuses_ns or wall_ns
        if wall_ns - self._refuses_ns > _REFUSES_NS:
            self._refuses_ns = sys.maxsize  # once
            which = f"all {received} command(s) so far were" if all_refused else "the last command was"
            self.throttle.warn("silence", f"{which} {LogText.STANDS_STILL.value}")

    def close(self) -> None:
        """Report for the last time, close the recording and the viewer, and remove the node from the graph."""
        wall_ns = self._next_diagnostics_ns = time.monotonic_ns()
        self._report(wall_ns)
        if self.recorder is not None:
            self.recorder.close()
            if self.recorder.error is None:
                self.get_logger().info(f"{LogText.RECORDED.value}{self.recorder.folder}")
        if self.feed is not None:
            self.feed.close()
        refused = self.intake.refusals.total
        more = f"; {refused} message(s) were refused" if refused else ""
        more = more if self.intake.received else f"; {LogText.UNCOMMANDED.value}"
        self.get_logger().info(f"{LogText.STOPPED.value}{self.tick_clock.describe(wall_ns)}{more}")
        self.leave()


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM.

    Args:
        args: command line, for ROS arguments; None for the process's own.

    Returns:
        The exit status: 0, or 1 when the scene or a parameter was invalid or the recording failed.
    """
    reduce_delays()
    return run_node("simulator", _build, _spin, args, " ".join(read_parameters()))


def _build() -> Simulator:
    """Build the node after its kernels are compiled, so that a node in the graph always answers."""
    scout = QuietNode("crawler", start_parameter_services=False, enable_rosout=False)
    try:
        values = declare_parameters(scout)
    finally:
        scout.destroy_node()
    scene = load_scene(expand_home(values["scene"]))
    rational_rate(values["rate"])
    if values["record"]:
        from ..recording.bag_folder import check_parent

        check_parent(Path(expand_home(values["record"])))
    compile_ticks(scene)
    return Simulator(scene)


def _spin(node: Simulator) -> None:
    end_on_signals(node.stopping)
    node.spin()
    if node.recorder is not None and node.recorder.error is not None:
        raise CrawlerError(node.recorder.error)


if __name__ == "__main__":
    sys.exit(main())
