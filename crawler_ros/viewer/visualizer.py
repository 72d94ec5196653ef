"""The crawler in rerun: body on its track, tensions in their bounds, stick and slip, path in the stasis polygon.

Drawing happens in a process of its own (`python -m crawler_ros.viewer.visualizer`), fed through a pipe that never
blocks: a slow or stopped viewer costs frames, never a tick. A recording is drawn by the same code from the same frames.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from crawler_model import Scene
from crawler_model.body.drive import NS
from crawler_model.run.simulate import TimedJump
from crawler_model.theory.stasis import stasis_bounds, stasis_polygon
from crawler_pictures.colors import BACK, FORWARD, JUMP, rgb

from ..recording.recorded_robot import Robot
from ..wire.states import joint_names, station_names
from .feed import is_free
from .frames import Frame, frames_of_recording, in_sequence, read_frames, thin
from .ground import JumpMarks, draw_ground

_STATE_NAMES = {-1: "slip back", 0: "stick", 1: "slip forward"}
_STATE_COLORS = {-1: rgb(BACK), 0: (80, 80, 80), 1: rgb(FORWARD)}
_LINK_COLORS = [(64, 110, 220), (230, 140, 30), (120, 80, 200), (20, 160, 160)]
_BOUND_COLOR = (200, 60, 60)
_SINGLE_PLOTS = 4
_TRAIL = 50
_PAGE = 1.6  # distance that the body walks before the page turns, in body lengths


class Drawing:
    """Logs frames of one crawler into a rerun recording."""

    def __init__(self, scene: Scene, open_sinks: Callable[[Any], Any]) -> None:
        """Open a rerun recording and send the blueprint and all that is constant.

        Args:
            scene: the scene to draw.
            open_sinks: function that connects the RecordingStream to its target.
        """
        import rerun as rr

        self._rr = rr
        self._scene = scene
        body = scene.body
        self._body = body
        self._xi = body.position[body.stations]
        self._joints = body.joints
        self._names = station_names(body)
        self._plotted = joint_names(body)[:_SINGLE_PLOTS]
        self._bounded = has_stasis_bounds(body)
        self._along = self._xi if body.dimension == 1 else self._xi[:, 0]
        self._middle = float(body.station_share @ self._along)
        self._length = float(np.ptp(self._xi)) if body.dimension == 1 else float(np.ptp(self._xi, axis=0).max())
        n = self._xi.shape[0]
        self._polygon = self._bounded and n == 3
        # links that cross over others are drawn as arcs
        rank = np.argsort(np.argsort(self._along))
        spans = np.abs(np.diff(rank[self._joints], axis=1)[:, 0]) if body.dimension == 1 else 1.0
        self._bows = np.broadcast_to(0.06 * self._length * (spans - 1.0), self._joints.shape[0])
        self._last_state = np.full(n, 99)
        self._last_polygon = b""
        self._trail: deque[tuple[tuple[float, float], tuple[int, int, int]]] = deque(maxlen=_TRAIL)
        self._window = float(self._along.min()) + np.array([-0.6, 3.4]) * self._length
        self._tick = _round_step(self._length / (3.0 if body.dimension == 1 else 0.8))
        self._page: int | None = None
        self.stream = rr.RecordingStream(f"crawler: {scene.name}")
        open_sinks(self.stream)
        self._marks = JumpMarks(rr, self.stream, scene, self._length)
        self._blueprint()
        self._constants()

    def _blueprint(self) -> None:
        import rerun.blueprint as rrb

        n, length = self._xi.shape[0], self._length
        depth = 0.25 * length if self._body.dimension == 1 else 1.2 * length
        ground = self._scene.parts.ground is not None and self._body.dimension == 1
        below = 0.42 * length if ground else depth
        page = rrb.VisualBounds2D(x_range=self._window.tolist(), y_range=[-depth, below])
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
            ", from the ends of segments" if self._body.segments else ", along x" if self._body.dimension == 2 else ""
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
        if self._scene.ground.track is not None:
            right.append(rrb.TextLogView(origin="jumps", name="Jumps onto ground that holds less"))
        body = rrb.Spatial2DView(
            origin="world", name="Crawler on its track", background=[250, 250, 250], visual_bounds=page
        )
        shares = [4 if ground else 3, 9] if self._body.dimension == 1 else [2, 3]
        layout = rrb.Vertical(body, rrb.Horizontal(left, rrb.Vertical(*right), column_shares=[3, 2]), row_shares=shares)
        blueprint = rrb.Blueprint(layout, rrb.TimePanel(state="collapsed", timeline="sim_time"), collapse_panels=True)
        self.stream.send_blueprint(blueprint)

    def _polygon_bounds(self) -> Any:
        import rerun.blueprint as rrb

        drive = self._scene.drive
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
            reach = 10.0 * float(max(self._scene.drive.forward.max(), self._scene.drive.backward.max()))
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
        y = float(self._body.station_share @ (place if place.ndim == 1 else place[:, 0]))
        if frame.jumps:
            self._marks.add(
                frame.jumps, self._turn_page(y) if self._page is None else self._page * _PAGE * self._length
            )
            stream.set_time("sim_time", duration=frame.time_ns / NS)
        origin = self._turn_page(y)
        self._marks.age(frame.time_ns, origin)
        points[:, 0] -= origin
        colors = [_STATE_COLORS[int(s)] for s in frame.state]
        for station in np.flatnonzero(np.isin(self._body.stations, self._marks.contacts)).tolist():
            colors[station] = rgb(JUMP)
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
        """Draw the page of track around the body's middle; return the position of its origin [m].

        A two-dimensional view does not follow the body: it walks across a page, then the page turns.
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
        draw_ground(rr, self.stream, self._scene, self._window + origin, origin, self._length)
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
        """Flush and close the stream."""
        self.stream.flush()
        self.stream.disconnect()


def _round_step(size: float) -> float:
    """Round a distance to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(size))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(m * power - size)))


def _spring(start: np.ndarray, end: np.ndarray, radius: float, bow: float, teeth: int = 4) -> np.ndarray:
    """Draw a spring between two points as a zigzag, arched upwards by `bow`, shape (2 teeth + 3, 2) [m]."""
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


def to_viewer(url: str) -> Callable[[Any], None]:
    """Serve a recording stream on 127.0.0.1, and open a viewer on it where there is a display."""
    port = urlsplit(url).port or 0

    def serve(stream: Any) -> None:
        import rerun as rr

        if not is_free(port):  # rerun would fail without an error
            raise OSError(f"port {port} of 127.0.0.1 is taken")
        stream.set_sinks(rr.GrpcServerSink(bind_ip="127.0.0.1", port=port))
        if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
            subprocess.Popen([sys.executable, "-m", "rerun", "--connect", url], start_new_session=True)

    return serve


def draw_recording(
    recording: Path,
    rrd: Path,
    scene: Scene | None = None,
    robot: Robot | None = None,
    jumps: Sequence[tuple[int, TimedJump]] = (),
) -> int:
    """Draw a recording into an .rrd file.

    Args:
        recording: a bag folder or an .mcap file.
        rrd: the file to write.
        scene: the body, for a recording that does not hold its scene.
        robot: the crawler to draw, where several were recorded.
        jumps: numbers of runs and jumps to mark, as `crawler_ros.replay.analyse` finds them.

    Returns:
        The number of frames drawn: at most fifty a simulated second.

    Raises:
        BagError: when the recording cannot be read.
    """
    scene, frames = frames_of_recording(recording, scene, robot, jumps)
    drawing = Drawing(scene, to_file(rrd))
    count = 0
    for frame in thin(frames):
        drawing.draw(frame)
        count += 1
    drawing.close()
    return count


def main() -> int:
    """Draw the frames that arrive on standard input until it ends."""
    view = sys.argv[1]
    source = sys.stdin.buffer
    (size,) = struct.unpack("<I", source.read(4))
    scene = Scene.model_validate(json.loads(source.read(size)))
    try:
        drawing = Drawing(scene, to_viewer(view) if view.startswith("rerun+http://") else to_file(Path(view)))
    except Exception as error:  # a port in use, a folder that cannot be written: rerun's errors have no common type
        print(f"viewer: {' '.join(str(error).split())[:300]}", file=sys.stderr)
        return 1
    for frame in in_sequence(read_frames(source, scene)):
        drawing.draw(frame)
    drawing.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
