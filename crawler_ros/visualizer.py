"""The crawler in rerun: body on its track, tensions in their bounds, stick and slip, path in the stasis polygon.

Drawing happens in a process of its own (`python -m crawler_ros.visualizer`), fed through a pipe that never blocks: a
slow or stopped viewer costs frames, never a tick. A recording is drawn by the same code from the same frames.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import struct
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene
from crawler_model.body import Body
from crawler_model.drive import NS
from crawler_model.stasis import stasis_bounds, stasis_polygon

from .colors import BACK, FORWARD, rgb
from .states import StationReader, joint_names, station_names

FRAME_EVERY_NS = 20_000_000
LIVE_PORT = 9876
_PIPE_BYTES = 1 << 20
_STATE_NAMES = {-1: "slip back", 0: "stick", 1: "slip forward"}
_STATE_COLORS = {-1: rgb(BACK), 0: (80, 80, 80), 1: rgb(FORWARD)}
_LINK_COLORS = [(64, 110, 220), (230, 140, 30), (120, 80, 200), (20, 160, 160)]
_BOUND_COLOR = (200, 60, 60)
_SINGLE_PLOTS = 4
_TRAIL = 50
_PAGE = 1.6  # how far the body walks before the page turns, in body lengths


@dataclass(frozen=True, eq=False)
class Frame:
    """One instant to draw, of the stations and joints of a body (see `crawler_model.body.Body`).

    Shapes: displacement, in the plane x and y in turn, and state of each station, 1, 0 or -1 since the frame before;
    tension of each joint, in the plane its size; mu_plus and mu_minus of each station where a chain has no segments.
    """

    time_ns: int
    displacement: np.ndarray
    tension: np.ndarray
    state: np.ndarray
    forward: np.ndarray
    backward: np.ndarray

    def pack(self) -> bytes:
        """Lay the frame out as bytes: the time, then all numbers as doubles."""
        numbers = (self.displacement, self.tension, self.state, self.forward, self.backward)
        return struct.pack("<q", self.time_ns) + np.concatenate(numbers).astype("<f8").tobytes()

    @staticmethod
    def unpack(data: bytes, mesh: Body) -> Frame:
        """Undo `pack`."""
        (ns,) = struct.unpack_from("<q", data)
        cuts = np.cumsum(_frame_sizes(mesh))
        x, tension, state, forward, backward = np.split(np.frombuffer(data, "<f8", int(cuts[-1]), 8), cuts[:-1])
        return Frame(ns, x, tension, state.astype(np.int8), forward, backward)


def _frame_sizes(mesh: Body) -> list[int]:
    stations, joints = mesh.stations.size, mesh.joints.shape[0]
    friction = stations if has_stasis_bounds(mesh) else 0
    return [stations * mesh.dimension, joints, stations, friction, friction]


def has_stasis_bounds(mesh: Body) -> bool:
    """Tell whether each link's tension has bounds that follow from its neighbours'.

    Args:
        mesh: the body.

    Returns:
        True for a chain of isolated contacts.
    """
    return mesh.is_chain and not mesh.segments


def frame_of(crawler: Crawler, time_ns: int, state: np.ndarray) -> Frame:
    """Take a frame of a crawler.

    Args:
        crawler: the crawler.
        time_ns: simulated time [ns].
        state: what each of its contacts did since the frame before.

    Returns:
        The frame.
    """
    mesh = crawler.body
    at = mesh.stations
    tension = crawler.joint_tension
    if mesh.dimension == 2:
        tension = np.linalg.norm(tension, axis=1)
    none = np.zeros(0)
    bounded = has_stasis_bounds(mesh)
    forward, backward = (crawler.forward[at], crawler.backward[at]) if bounded else (none, none)
    return Frame(time_ns, crawler.displacement[at].ravel(), tension, state[at], forward, backward)


def check_view(view: str) -> None:
    """Check where a view goes.

    Args:
        view: "live", or the path of an .rrd file that is not there yet.

    Raises:
        FileExistsError: when the file exists.
        ValueError: when it is something else.
    """
    if view == "live":
        return
    if Path(view).suffix != ".rrd":
        raise ValueError(f"view: {view!r}; it must be off, live, or a path that ends in .rrd")
    if Path(view).exists():
        raise FileExistsError(f"view: {view} exists; give a path that does not")


class ViewerFeed:
    """The simulator's end of the pipe to a drawing process."""

    def __init__(self, scene: Scene, view: str, say: Callable[[str], Any]) -> None:
        """Start the drawing process.

        Args:
            scene: what is drawn.
            view: "live", or the path of an .rrd file.
            say: told where to look.

        Raises:
            FileExistsError: when the file exists: nothing is overwritten.
            ValueError: when `view` is something else.
        """
        check_view(view)
        if view != "live":
            Path(view).parent.mkdir(parents=True, exist_ok=True)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "crawler_ros.visualizer", view], stdin=subprocess.PIPE, start_new_session=True
        )
        assert self._process.stdin is not None
        self._pipe = self._process.stdin
        header = json.dumps(scene.document()).encode()
        self._pipe.write(struct.pack("<I", len(header)) + header)
        self._pipe.flush()
        with contextlib.suppress(OSError):  # a larger pipe is a comfort, not a need
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(self._pipe.fileno(), False)
        self._waiting = b""
        self._shown_ns: int | None = None
        self._moved: np.ndarray | None = None
        self.dropped = 0
        where = f"rerun+http://127.0.0.1:{LIVE_PORT}/proxy (open it with: rerun --connect)" if view == "live" else view
        say(f"drawing to {where}")

    def show(self, time_ns: int, crawler: Crawler) -> None:
        """Offer a frame; at most fifty a simulated second are taken, and none waits.

        Args:
            time_ns: simulated time.
            crawler: its state is drawn.
        """
        state = crawler.contact_state
        self._moved = state if self._moved is None else np.where(state != 0, state, self._moved)
        if self._shown_ns is not None and 0 <= time_ns - self._shown_ns < FRAME_EVERY_NS:
            return
        self._shown_ns = time_ns
        frame = frame_of(crawler, time_ns, self._moved)
        self._moved = None
        if not self._push():
            self.dropped += 1
            return
        self._waiting = frame.pack()
        self._push()

    @property
    def alive(self) -> bool:
        """Whether the drawing process still runs."""
        return self._process.poll() is None

    def _push(self) -> bool:
        """Write what is waiting as far as it goes; tell whether it all went."""
        try:
            while self._waiting:
                self._waiting = self._waiting[os.write(self._pipe.fileno(), self._waiting) :]
        except BlockingIOError:
            return False
        except BrokenPipeError:
            self._waiting = b""
            return False
        return True

    def close(self) -> None:
        """Let the drawing process finish its file; give a stuck one ten seconds."""
        deadline = time.monotonic() + 10.0
        while not self._push() and self.alive and time.monotonic() < deadline:
            time.sleep(0.02)
        self._pipe.close()
        try:
            self._process.wait(max(deadline - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            self._process.kill()


def frames_of_recording(
    path: Path, scene: Scene | None = None, robot: str | None = None
) -> tuple[Scene, Iterator[Frame]]:
    """Read frames from a recording.

    Args:
        path: a bag folder or an .mcap file, whole or torn.
        scene: the body, for a recording that does not hold its scene.
        robot: what its topics begin with, where several were recorded; None for all there are.

    Returns:
        The scene and its frames, one per joint_states message.

    Raises:
        BagError: when it cannot be read, or its scene is missing.
    """
    from . import bag

    head = bag.Bag({})
    records = bag.read(path, head)
    waiting = []
    for record in records:  # attachments stand before the first message
        waiting.append(record)
        break
    if scene is None:
        if "scene" not in head.attachments:
            raise bag.BagError(f"{path}: it does not hold its scene; give one with --scene")
        scene = Scene.model_validate(head.attachments["scene"])

    def all_records() -> Iterator[Any]:
        for part in (waiting, records):
            for record in part:
                if robot is None or record.topic.startswith(robot):
                    yield record

    return scene, in_sequence(_frames(all_records(), scene))


def in_sequence(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Put runs between resets one after another: a reset takes simulated time back to 0, a picture goes on."""
    offset = last = 0
    for frame in frames:
        if frame.time_ns + offset < last:
            offset = last
        last = frame.time_ns + offset
        yield replace(frame, time_ns=last)


def _frames(records: Iterable[Any], scene: Scene) -> Iterator[Frame]:
    from rosbags.typesys import Stores, get_typestore

    decode = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr
    mesh, columns = scene.mesh, scene.columns
    bounded = has_stasis_bounds(mesh)
    n = mesh.contacts if bounded else 0
    forward, backward = scene.commands.forward[0][:n], scene.commands.backward[0][:n]
    stations = StationReader(mesh)
    for record in records:
        name = record.topic.rsplit("/", 1)[-1]
        if name == "applied_commands":
            points = decode(record.data, record.type).points
            if points:
                friction = np.asarray(points[-1].positions)[columns.lengths :]
                forward, backward = friction[:n], friction[n : 2 * n]
        elif name == "joint_states":
            message = decode(record.data, record.type)
            stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec
            x, v = stations.read(message.position), stations.read(message.velocity)
            tension = message.effort[mesh.dimension :]
            if mesh.dimension == 2:
                v, tension = np.linalg.norm(v, axis=1), np.linalg.norm(tension.reshape(-1, 2), axis=1)
            moving = np.abs(v) > 1e-9 * np.abs(message.velocity).max(initial=0.0)
            yield Frame(stamp, x.ravel(), tension, (np.sign(v) * moving).astype(np.int8), forward, backward)


class Drawing:
    """Logs frames of one crawler into a rerun recording."""

    def __init__(self, scene: Scene, open_sinks: Callable[[Any], Any]) -> None:
        """Open a recording, send what never changes and the blueprint.

        Args:
            scene: what is drawn.
            open_sinks: is given the RecordingStream, to say where it goes.
        """
        import rerun as rr

        self._rr = rr
        self._scene = scene
        mesh = scene.mesh
        self._mesh = mesh
        self._xi = mesh.position[mesh.stations]
        self._joints = mesh.joints
        self._names = station_names(mesh)
        self._plotted = joint_names(mesh)[:_SINGLE_PLOTS]
        self._bounded = has_stasis_bounds(mesh)
        self._along = self._xi if mesh.dimension == 1 else self._xi[:, 0]
        self._middle = float(mesh.station_share @ self._along)
        self._length = float(np.ptp(self._xi)) if mesh.dimension == 1 else float(np.ptp(self._xi, axis=0).max())
        n = self._xi.shape[0]
        self._polygon = self._bounded and n == 3
        # links that pass over others are drawn as bows
        rank = np.argsort(np.argsort(self._along))
        spans = np.abs(np.diff(rank[self._joints], axis=1)[:, 0]) if mesh.dimension == 1 else 1.0
        self._bows = np.broadcast_to(0.06 * self._length * (spans - 1.0), self._joints.shape[0])
        self._last_state = np.full(n, 99)
        self._last_polygon = b""
        self._trail: deque[tuple[tuple[float, float], tuple[int, int, int]]] = deque(maxlen=_TRAIL)
        self._window = float(self._along.min()) + np.array([-0.6, 3.4]) * self._length
        self._tick = _round_step(self._length / (3.0 if mesh.dimension == 1 else 0.8))
        self._page: int | None = None
        self.stream = rr.RecordingStream(f"crawler: {scene.name}")
        open_sinks(self.stream)
        self._blueprint()
        self._constants()

    def _blueprint(self) -> None:
        import rerun.blueprint as rrb

        n, length = self._xi.shape[0], self._length
        depth = 0.25 * length if self._mesh.dimension == 1 else 1.2 * length
        page = rrb.VisualBounds2D(x_range=self._window.tolist(), y_range=[-depth, depth])
        tensions = [
            rrb.TimeSeriesView(
                origin=f"tension/{name}",
                name=f"Tension of {name.replace('_', ' ')} [N]" + (" in its stasis bounds" if self._bounded else ""),
            )
            for name in self._plotted
        ]
        lanes = rrb.StateTimelineView(origin="contacts", name="Stick / slip")
        left = rrb.Vertical(*tensions, lanes, row_shares=[1.0] * len(tensions) + [min(0.5 + 0.25 * n, 3.0)])
        about = (
            ", from the ends of segments" if self._mesh.segments else ", along x" if self._mesh.dimension == 2 else ""
        )
        right: list[Any] = [rrb.TimeSeriesView(origin="net_translation", name=f"Net translation{about} [m]")]
        if self._polygon:
            right.append(
                rrb.Spatial2DView(
                    origin="stasis",
                    name="Stasis polygon: T_0 right, T_1 up [N]",
                    background=[250, 250, 250],
                    visual_bounds=self._polygon_bounds(),
                )
            )
        body = rrb.Spatial2DView(
            origin="world", name="Crawler on its track", background=[250, 250, 250], visual_bounds=page
        )
        shares = [1, 3] if self._mesh.dimension == 1 else [2, 3]
        layout = rrb.Vertical(body, rrb.Horizontal(left, rrb.Vertical(*right), column_shares=[3, 2]), row_shares=shares)
        blueprint = rrb.Blueprint(layout, rrb.TimePanel(state="collapsed", timeline="sim_time"), collapse_panels=True)
        self.stream.send_blueprint(blueprint)

    def _polygon_bounds(self) -> Any:
        import rerun.blueprint as rrb

        drive = self._scene.commands
        reach = 1.3 * float(max(drive.forward.max(), drive.backward.max()))
        return rrb.VisualBounds2D(x_range=[-reach, reach], y_range=[-reach, reach])

    def _constants(self) -> None:
        rr, stream = self._rr, self.stream
        for i, name in enumerate(self._plotted):
            color = _LINK_COLORS[i % len(_LINK_COLORS)]
            count = 3 if self._bounded else 1
            lines = rr.SeriesLines(
                colors=[color, _BOUND_COLOR, _BOUND_COLOR][:count],
                names=[f"T of {name}", "upper bound", "lower bound"][:count],
                widths=[2.5, 1.0, 1.0][:count],
            )
            stream.log(f"tension/{name}", lines, static=True)
        stream.log("net_translation", rr.SeriesLines(colors=[(225, 225, 225)], names=["y"], widths=[2.0]), static=True)
        names = list(_STATE_NAMES.values())
        colors = [_STATE_COLORS[k] for k in _STATE_NAMES]
        for name in self._names:
            configuration = rr.StateConfiguration(values=names, labels=names, colors=colors)
            stream.log(f"contacts/{name}", configuration, static=True)
        if self._polygon:
            reach = 10.0 * float(max(self._scene.commands.forward.max(), self._scene.commands.backward.max()))
            cross = [[[-reach, 0], [reach, 0]], [[0, -reach], [0, reach]]]
            axes = rr.LineStrips2D(cross, colors=[(200, 200, 200)], radii=rr.Radius.ui_points(0.5))
            stream.log("stasis/axes", axes, static=True)

    def draw(self, frame: Frame) -> None:
        """Log one frame at its simulated time.

        Args:
            frame: what to draw.
        """
        rr, stream = self._rr, self.stream
        stream.set_time("sim_time", duration=frame.time_ns / NS)
        place = self._xi + frame.displacement.reshape(self._xi.shape)
        radius = 0.045 * self._length
        points = place * (1.0, -1.0) if place.ndim == 2 else np.column_stack((place, np.full(place.size, -radius)))
        y = float(self._mesh.station_share @ (place if place.ndim == 1 else place[:, 0]))
        points[:, 0] -= self._turn_page(y)
        colors = [_STATE_COLORS[int(s)] for s in frame.state]
        stream.log("world/contacts", rr.Points2D(points, colors=colors, radii=radius, draw_order=2.0))
        springs = [
            _spring(points[a], points[b], radius, bow) for (a, b), bow in zip(self._joints, self._bows, strict=True)
        ]
        stream.log(
            "world/links",
            rr.LineStrips2D(
                springs,
                colors=[_LINK_COLORS[i % len(_LINK_COLORS)] for i in range(len(springs))],
                radii=0.1 * radius,
                draw_order=1.0,
            ),
        )
        bounds = stasis_bounds(frame.tension, frame.forward, frame.backward) if self._bounded else ()
        for i, name in enumerate(self._plotted):
            stream.log(f"tension/{name}", rr.Scalars([frame.tension[i], *(b[i] for b in reversed(bounds))]))
        stream.log("net_translation", rr.Scalars([y - self._middle]))
        for i in np.flatnonzero(frame.state != self._last_state).tolist():
            stream.log(f"contacts/{self._names[i]}", rr.StateChange(state=_STATE_NAMES[int(frame.state[i])]))
        self._last_state = frame.state
        if self._polygon:
            self._draw_polygon(frame)

    def _turn_page(self, middle: float) -> float:
        """Draw the stretch of track that the body's middle is on; return where its origin lies [m].

        A view in two dimensions does not follow: the body walks across a page, then the page turns.
        """
        page = int(np.floor((middle - self._middle) / (_PAGE * self._length)))
        origin = page * _PAGE * self._length
        if page == self._page:
            return origin
        self._page = page
        left, right = (self._window + origin) / self._tick
        marks = np.arange(np.ceil(left), np.floor(right) + 1) * self._tick
        at, depth = marks - origin, 0.05 * self._length
        lines = [[[x, 0.0], [x, depth]] for x in at] + [[[self._window[0], 0.0], [self._window[1], 0.0]]]
        rr = self._rr
        self.stream.log("world/track", rr.LineStrips2D(lines, colors=[(150, 150, 150)], radii=rr.Radius.ui_points(1.0)))
        labels = rr.Points2D(
            np.column_stack((at, np.full(at.size, 2.6 * depth))),
            labels=[f"{m + 0.0:.6g} m" for m in marks],
            colors=[(235, 235, 235)],
            radii=rr.Radius.ui_points(0.0),
            show_labels=True,
        )
        self.stream.log("world/marks", labels)
        return origin

    def _draw_polygon(self, frame: Frame) -> None:
        rr = self._rr
        corners = stasis_polygon(frame.forward, frame.backward)
        if corners.tobytes() != self._last_polygon:
            self._last_polygon = corners.tobytes()
            outline = np.vstack((corners, corners[:1])) * (1.0, -1.0)  # y points down in rerun
            lines = rr.LineStrips2D([outline], colors=[_BOUND_COLOR], radii=rr.Radius.ui_points(1.5))
            self.stream.log("stasis/domain", lines)
        color = _STATE_COLORS[int(np.sign(int(frame.state.sum())))]
        self._trail.append(((frame.tension[0], -frame.tension[1]), color))
        points, colors = zip(*self._trail, strict=True)
        sizes = rr.Radius.ui_points([2.5] * (len(points) - 1) + [6.0])
        self.stream.log("stasis/path", rr.Points2D(points, colors=colors, radii=sizes, draw_order=30.0))

    def close(self) -> None:
        """Write out everything."""
        self.stream.flush()
        self.stream.disconnect()


def _round_step(size: float) -> float:
    """Round a distance to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(size))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(m * power - size)))


def _spring(start: np.ndarray, end: np.ndarray, radius: float, bow: float, teeth: int = 4) -> np.ndarray:
    """Draw a spring between two points as a zigzag, bowed upwards by `bow`, shape (2 teeth + 3, 2) [m]."""
    length = max(float(np.hypot(*(end - start))), 1e-9 * radius)
    along = (end - start) / length
    across = np.array([along[1], -along[0]])
    x = np.concatenate(([0.0], np.linspace(radius, length - radius, 2 * teeth + 1), [length]))
    y = 4.0 * bow * (x / length) * (1.0 - x / length)
    y[2:-2:2] += 0.9 * radius
    y[3:-2:2] -= 0.9 * radius
    return start + x[:, None] * along + y[:, None] * across


def to_file(path: Path) -> Callable[[Any], None]:
    """Send a recording stream to an .rrd file."""
    return lambda stream: stream.save(str(path))


def to_viewer(stream: Any) -> None:
    """Serve a recording stream on 127.0.0.1, and open a viewer on it where there is a display."""
    import rerun as rr

    stream.set_sinks(rr.GrpcServerSink(bind_ip="127.0.0.1", port=LIVE_PORT))
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        url = f"rerun+http://127.0.0.1:{LIVE_PORT}/proxy"
        subprocess.Popen([sys.executable, "-m", "rerun", "--connect", url], start_new_session=True)


def draw_recording(recording: Path, rrd: Path, scene: Scene | None = None, robot: str | None = None) -> int:
    """Draw a recording into an .rrd file.

    Args:
        recording: a bag folder or an .mcap file.
        rrd: the file to write.
        scene: the body, for a recording that does not hold its scene.
        robot: what its topics begin with, where several were recorded.

    Returns:
        The number of frames drawn: at most fifty a simulated second.

    Raises:
        BagError: when the recording cannot be read.
    """
    scene, frames = frames_of_recording(recording, scene, robot)
    drawing = Drawing(scene, to_file(rrd))
    count = 0
    for frame in thin(frames):
        drawing.draw(frame)
        count += 1
    drawing.close()
    return count


def thin(frames: Iterable[Frame], every_ns: int = FRAME_EVERY_NS) -> Iterator[Frame]:
    """Keep frames at least `every_ns` apart; a slip between two of them shows in the later one."""
    shown: int | None = None
    moved: np.ndarray | None = None
    for frame in frames:
        moved = frame.state if moved is None else np.where(frame.state != 0, frame.state, moved)
        if shown is not None and 0 <= frame.time_ns - shown < every_ns:
            continue
        shown = frame.time_ns
        yield Frame(frame.time_ns, frame.displacement, frame.tension, moved, frame.forward, frame.backward)
        moved = None


def main() -> int:
    """Draw the frames that arrive on standard input until it ends."""
    view = sys.argv[1]
    source = sys.stdin.buffer
    (size,) = struct.unpack("<I", source.read(4))
    scene = Scene.model_validate(json.loads(source.read(size)))
    try:
        drawing = Drawing(scene, to_viewer if view == "live" else to_file(Path(view)))
    except Exception as error:  # a port in use, a folder that cannot be written: rerun's errors have no common type
        print(f"viewer: {' '.join(str(error).split())[:300]}", file=sys.stderr)
        return 1
    mesh = scene.mesh
    size = 8 + 8 * sum(_frame_sizes(mesh))
    for frame in in_sequence(
        Frame.unpack(data, mesh) for data in iter(lambda: source.read(size), b"") if len(data) == size
    ):
        drawing.draw(frame)
    drawing.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
