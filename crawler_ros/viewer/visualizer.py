"""The crawler in rerun: body, contacts over time, tensions in their bounds, commands, path in the stasis polygon.

Drawing happens in a process of its own (`python -m crawler_ros.viewer.visualizer`), fed through a pipe that never
blocks: a slow or stopped viewer costs frames, never a tick. A recording is drawn by the same code from the same frames.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from crawler_model import Scene
from crawler_model.body.drive import NS
from crawler_model.run.trajectory import TimedJump

from ..recording.recorded_robot import Robot
from .feed import is_free
from .frames import Frame, frames_of_recording, in_sequence, read_frames, thin

Extent = tuple[np.ndarray, np.ndarray]


class Drawing:
    """Logs frames of one crawler into a rerun recording."""

    def __init__(
        self,
        scene: Scene,
        open_sinks: Callable[[Any], Any],
        extent: Extent | None = None,
        rows: np.ndarray | None = None,
    ) -> None:
        """Open a rerun recording and send the blueprint and all that is constant.

        Args:
            scene: the scene to draw.
            open_sinks: function that connects the RecordingStream to its target.
            extent: in the plane, the smallest and the largest positions, each shape (2,) [m]; None where they are not
                known beforehand.
            rows: the command rows of all frames, shape (F, C); None where they are not known beforehand.
        """
        import rerun as rr  # here and in what draws: `main` reports where it is missing

        from .body import PlaneView, TrackView
        from .curves import Curves
        from .polygon import PolygonView

        self.stream = rr.RecordingStream(f"crawler: {scene.name}")
        open_sinks(self.stream)
        planar = scene.body.dimension == 2
        self._body = PlaneView(self.stream, scene, extent) if planar else TrackView(self.stream, scene)
        self._curves = Curves(self.stream, scene, rows)
        three = self._curves.bounded and scene.body.stations.size == 3
        self._polygon = PolygonView(self.stream, scene) if three else None
        self._send_blueprint(scene)

    def _send_blueprint(self, scene: Scene) -> None:
        """Arrange the views: the body on top, or to the left in the plane, panels over time, and the polygon."""
        import rerun.blueprint as rrb

        left, heights, right = self._curves.build_views()
        shares = [1.0] * len(right)
        if self._polygon is not None:
            right.append(self._polygon.build_view())
            shares.append(2.0)
        if scene.ground.track is not None:
            right.append(rrb.TextLogView(origin="jumps", name="Jumps onto ground that holds less"))
            shares.append(1.0)
        body = self._body.build_view()
        layout: Any
        if scene.body.dimension == 2:
            panels = rrb.Vertical(*left, *right, row_shares=heights + shares)
            layout = rrb.Horizontal(body, panels, column_shares=[1, 1])
        else:
            panels = rrb.Vertical(*left, row_shares=heights)
            below = rrb.Horizontal(panels, rrb.Vertical(*right, row_shares=shares), column_shares=[3, 2])
            layout = rrb.Vertical(body, below, row_shares=[4 if scene.parts.ground is not None else 2.4, 9])
        panel = rrb.TimePanel(state="collapsed", timeline="sim_time")
        self.stream.send_blueprint(rrb.Blueprint(layout, panel, collapse_panels=True))

    def draw(self, frame: Frame) -> None:
        """Log one frame at its simulated time.

        Args:
            frame: what to draw.
        """
        self.stream.set_time("sim_time", duration=frame.time_ns / NS)
        self._body.draw(frame)
        self._curves.draw(frame)
        if self._polygon is not None:
            self._polygon.draw(frame)

    def close(self) -> None:
        """Flush and close the stream."""
        self.stream.flush()
        self.stream.disconnect()


def _find_extent(scene: Scene, frames: Sequence[Frame]) -> Extent | None:
    """Find the least and largest positions of a body, each (2,) [m]; None on a line, or without frames."""
    if scene.body.dimension == 1 or not frames:
        return None
    rest = scene.body.position[scene.body.stations]
    places = rest + np.array([frame.displacement.reshape(rest.shape) for frame in frames])
    return places.min(axis=(0, 1)), places.max(axis=(0, 1))


def to_file(path: Path) -> Callable[[Any], None]:
    """Send a recording stream to an .rrd file."""

    def save(stream: Any) -> None:
        try:
            stream.save(str(path))
        except RuntimeError as error:  # as of a full disk
            raise OSError(str(error)) from None

    return save


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
        The number of frames drawn: at most fifty a simulated second, and the last one.

    Raises:
        BagError: when the recording cannot be read.
    """
    return draw_frames(*frames_of_recording(recording, scene, robot, jumps), rrd)


def draw_frames(scene: Scene, frames: Iterable[Frame], rrd: Path) -> int:
    """Draw frames into an .rrd file.

    Args:
        scene: the scene.
        frames: its frames, in sequence.
        rrd: the file to write.

    Returns:
        The number of frames drawn: at most fifty a simulated second, and the last one.
    """
    shown = list(thin(frames))
    rows = np.array([frame.row for frame in shown]) if shown else None
    drawing = Drawing(scene, to_file(rrd), _find_extent(scene, shown), rows)
    for frame in shown:
        drawing.draw(frame)
    drawing.close()
    return len(shown)


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
