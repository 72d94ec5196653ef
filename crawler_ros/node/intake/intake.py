"""The path of a command message from its bytes to the queue of commands, including refusals."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from crawler_model import CommandError
from crawler_model.body.drive import NS

from ...wire.topics import Topic, open_subscription
from .commands import CommandQueue
from .decode import read_array, read_joints, read_trajectory
from .peers import RIVAL_TOPICS, Arrivals, Turns, publishers_of, publishers_of_other_types
from .refusals import Refusals, Throttle

if TYPE_CHECKING:
    from ...recording.recorder import Recorder

_OVERHEAD_BYTES = 1 << 16  # header, labels of dimensions
_LARGEST_BYTES = 1 << 26
_LONGEST_NAME = 256


class Intake:
    """The command topics of a node."""

    def __init__(
        self,
        commands: CommandQueue,
        throttle: Throttle,
        recorder: Recorder | None,
        columns: int,
        accepted: Callable[[], None],
    ) -> None:
        """Store the queue, the log and the recorder.

        Args:
            commands: the queue of commands.
            throttle: the logger of refusals and losses.
            recorder: the recorder, if there is one.
            columns: number of columns of a command row.
            accepted: called after each message that was accepted.
        """
        self.refusals = Refusals(throttle)
        self.arrivals: dict[str, Arrivals] = {}
        self._types: dict[str, str] = {}
        self._turns = {names: Turns() for names in RIVAL_TOPICS}
        self._commands, self._throttle, self._recorder = commands, throttle, recorder
        self._accepted = accepted
        self._overdue = 0  # of the queue's, those that were logged
        self._lock = threading.Lock()
        array = _OVERHEAD_BYTES + 16 * columns
        points = min((4 * 8 * columns + 64) * commands.most_waiting, _LARGEST_BYTES)
        self._handlers: dict[str, tuple[Callable[[bytes], None], int]] = {
            "joint_trajectory": (self._accept_trajectory, array + points),
            "actuation_controller/joint_trajectory": (self._accept_lengths, array + points),
            "joint_commands": (self._accept_joints, 2 * array + _LONGEST_NAME * columns),
            "actuation_controller/commands": (lambda data: commands.accept_actuation(read_array(data)), array),
            "friction_controller/commands": (lambda data: commands.accept_friction(read_array(data)), array),
            "load_controller/commands": (lambda data: commands.accept_loads(read_array(data)), array),
        }

    def open(self, node: Any, topic: Topic, channel: int | None) -> None:
        """Subscribe to a topic.

        Args:
            node: an rclpy node.
            topic: its row in the table of topics.
            channel: channel of the recording; None to record nothing.
        """
        accept, most = self._handlers[topic.name]
        arrivals = self.arrivals[topic.name] = Arrivals()
        self._types[topic.name] = topic.type
        name, recorder = topic.name, self._recorder
        (turns,) = (turns for names, turns in self._turns.items() if name in names)

        def receive(*arguments: Any) -> None:
            data, information = arguments if len(arguments) == 2 else arguments[0]
            with self._lock:
                turns.note_message(name, arrivals.count_message(information["publication_sequence_number"]))
            if len(data) > most:  # too large to be passed on or recorded
                text = f"{len(data)} bytes; a command of this scene has at most {most}"
                self.refusals.count_refusal(name, text, self._commands.now_ns)
                return
            if recorder is not None and channel is not None:
                now = recorder.now_ns()
                recorder.record(channel, now, now, bytes(data))
            try:
                accept(data)
            except CommandError as error:
                self.refusals.count_refusal(name, str(error), self._commands.now_ns)
            except Exception as error:  # a message must not end the node
                self.refusals.count_refusal(name, f"not a message of this type: {error!r}", self._commands.now_ns)
            else:
                self._accepted()

        # rclpy reads the signature to decide whether to pass the information; its EventsExecutor of 2025 passes message
        # and information as one tuple, later versions as two arguments
        receive.__signature__ = inspect.signature(lambda message, information: None)  # type: ignore[attr-defined]
        open_subscription(node, topic, receive)

    def find_publishers(self, node: Any) -> dict[str, list[tuple[bytes, str]]]:
        """List the present publishers of commands, and log those of other types and the messages lost since last time.

        Args:
            node: an rclpy node.

        Returns:
            The publishers of each command topic.
        """
        found = {name: publishers_of(node, name) for name in self.arrivals}
        for name, arrivals in self.arrivals.items():
            if found[name]:
                for text in publishers_of_other_types(node, name, self._types[name]):
                    node.warn_once(text)
            with self._lock:
                lost = arrivals.count_losses(gid for gid, _ in found[name])
            if lost:
                text = f"lost {lost} message(s) on {name}: they arrived faster than they could be read"
                self._throttle.warn(f"lost {name}", text)
        return found

    def find_rivals(self, publishers: Mapping[str, Sequence[tuple[bytes, str]]]) -> str:
        """Describe publishers that replace each other's commands.

        Args:
            publishers: from `find_publishers`.

        Returns:
            A line; empty when there are none.
        """
        with self._lock:
            found = [turns.find({name: publishers[name] for name in names}) for names, turns in self._turns.items()]
        return "; ".join(filter(None, found))

    def warn_of_refused_tick(self, error: CommandError) -> None:
        """Log that nothing would hold the body on the ground that the commands of a tick lead to."""
        self._throttle.warn("ground", f"the commands of a tick are refused: {error}")

    def warn_of_overdue(self, now_ns: int) -> None:
        """Log the trajectories that were over before they began, since the last call.

        Args:
            now_ns: simulated time at which they began [ns].
        """
        count, self._overdue = self._commands.overdue - self._overdue, self._commands.overdue
        if count:
            text = (
                f"{count} trajectory message(s) wholly in the past at simulated time {now_ns / NS:.9g} s, followed "
                "within one tick: stamp trajectories with simulated time, or with 0 to begin at once"
            )
            self._throttle.warn("overdue", text)

    @property
    def received(self) -> int:
        """Number of messages that arrived."""
        return sum(a.received for a in self.arrivals.values())

    @property
    def lost(self) -> int:
        """Number of messages that did not arrive."""
        return sum(a.lost for a in self.arrivals.values())

    def _accept_joints(self, data: bytes) -> None:
        names, positions, has_more = read_joints(data)
        if has_more:
            self._throttle.warn("efforts", "velocities and efforts of joint commands are not followed, only positions")
        self._commands.accept_joints(names, positions)

    def _accept_lengths(self, data: bytes) -> None:
        self._accept_trajectory(data, only_lengths=True)

    def _accept_trajectory(self, data: bytes, only_lengths: bool = False) -> None:
        message = read_trajectory(data)
        if message.has_more:
            text = "velocities, accelerations and efforts of a trajectory are not followed, only its positions"
            self._throttle.warn("velocities", text)
        self._commands.accept_trajectory(
            message.names, message.times_ns, message.positions, message.stamp_ns, only_lengths
        )
