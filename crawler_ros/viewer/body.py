"""The body in the rerun view: on its track, or in the plane from above."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr

from crawler_model import Scene
from crawler_model.body.drive import NS
from crawler_pictures.colors import FORWARD, JUMP, rgb
from crawler_pictures.film.camera import mark_ticks, round_step
from crawler_pictures.film.panels import MOST_ARROWS, bows
from crawler_pictures.friction_marks import WORDS, friction_strokes
from crawler_pictures.marks import SLACK, STALLED, YIELDING, can_yield

from .frames import Frame
from .ground import JumpMarks, draw_areas, draw_ground
from .style import (
    FAINT,
    MOVING,
    STATES,
    TEXT,
    YIELDS,
    bounds_of_grid,
    build_flat_view,
    color_of,
    draw_grid,
    line_radius,
)

MOST_CONTACTS = 400
"""Contacts that are drawn; for larger bodies evenly spaced ones."""
_YIELDS = {-1: "thin grey slack", 1: "thick magenta stalled", 2: "thick violet yielding"}
_MOST_WAYPOINTS = 32
_PAGE = 1.6  # distance that the body walks before the page turns, in body lengths
_JUMP_SHOWN_NS = 500_000_000
_PATH_POINTS, _PATH_STEP = 2000, 0.01
"""Points of all paths in the plane, and the motion in body lengths between two of them."""


def _find_length(scene: Scene) -> float:
    """Find the largest length of a body at rest, at its start and at waypoints of its drive without friction [m]."""
    body, drive = scene.body, scene.drive
    some = np.unique(np.linspace(0, drive.times.size - 1, _MOST_WAYPOINTS).astype(np.int64))
    shapes = [np.zeros(body.position.shape), scene.start_displacement, *map(body.relaxed, drive.actuation[some])]
    return max(float(np.ptp(body.position + shape, axis=0).max()) for shape in shapes)


class _View:
    """What both views draw: contacts and springs, and an arrow at each contact that slides."""

    def __init__(self, stream: Any, scene: Scene) -> None:
        """Choose the contacts and springs that are drawn.

        Args:
            stream: the recording to log to.
            scene: the scene.
        """
        self._stream, self._scene, body = stream, scene, scene.body
        n = body.stations.size
        self._rest, self._share = body.position[body.stations], body.station_share
        self._chosen = np.arange(n) if n <= MOST_CONTACTS else np.linspace(0, n - 1, MOST_CONTACTS).astype(np.int64)
        neighbours = np.column_stack((np.arange(self._chosen.size - 1), np.arange(1, self._chosen.size)))
        self._joints = body.joints if n <= MOST_CONTACTS else neighbours
        self._length = _find_length(scene)
        self._planar = body.dimension == 2
        self._note = "" if n <= MOST_CONTACTS else f", {MOST_CONTACTS} of {n} contacts"
        self._note += ", of segments the ends" if body.segments else ""
        limits = body.joint_limits
        may = {state: limits.can_be(state).any() for state in (SLACK, STALLED)} | {YIELDING: can_yield(body)}
        words = [word for state, word in _YIELDS.items() if may[state] and n <= MOST_CONTACTS]
        self._yields = f"; links: {', '.join(words)}" if words else ""
        self._many = self._chosen.size > MOST_ARROWS
        self._radius = self._length * min(0.045, 0.045 if self._planar else 0.35 / self._chosen.size)
        flat = np.zeros(len(self._joints))
        self._bows = flat if self._planar else 0.06 * self._length * bows(self._rest, self._joints)

    def _place(self, frame: Frame) -> np.ndarray:
        """Compute the positions of the chosen contacts, shape (K,), in the plane (K, 2) [m]."""
        return np.asarray((self._rest + frame.displacement.reshape(self._rest.shape))[self._chosen])

    def _log_body(self, points: np.ndarray, colors: list[Any], yields: np.ndarray) -> None:
        """Log contacts at points of the view, (K, 2) [m], and springs with the marks of their yields, (J,) or empty."""
        radii = rr.Radius.ui_points(2.5) if self._many else self._radius
        self._stream.log("world/contacts", rr.Points2D(points, colors=colors, radii=radii, draw_order=2.0))
        springs: Any = points[self._joints]
        thickness: Any = rr.Radius.ui_points(0.5)
        states = yields if yields.size == len(springs) else np.zeros(len(springs), np.int8)
        if not self._many:
            parts = zip(springs, self._bows, states < 0, strict=True)
            springs = [
                _rope(start, end, self._radius, bow) if slack else _spring(start, end, self._radius, bow)
                for (start, end), bow, slack in parts
            ]
            thickness = line_radius(0.1 * self._radius, self._length)
            if states.any():
                thickness = thickness * np.array([0.5, 1.0, 2.0, 2.0])[1 + states]
        colors = [YIELDS.get(state, color_of(i)) for i, state in enumerate(states.tolist())]
        drawn = rr.LineStrips2D(springs, colors=colors, radii=thickness, draw_order=1.0)
        self._stream.log("world/links", drawn)

    def _log_slips(self, points: np.ndarray, ways: np.ndarray, colors: list[Any]) -> None:
        """Log an arrow at each point, (K, 2) [m], that slides in a direction, (K, 2), where there is room."""
        if points.shape[0] > MOST_ARROWS:
            return
        reach = 0.14 * self._length if self._planar else 2.6 * self._radius
        slides = np.flatnonzero(np.abs(ways).max(axis=1) > 0.0)
        start = points[slides] - (0.0 if self._planar else 0.5 * reach * ways[slides])
        arrows = rr.Arrows2D(
            origins=start,
            vectors=reach * ways[slides],
            colors=[rgb(FORWARD) if self._planar else colors[k] for k in slides.tolist()] or None,
            radii=line_radius(0.2 * self._radius, self._length),
            draw_order=5.0,
        )
        self._stream.log("world/slips", arrows)


class TrackView(_View):
    """The body on its track: it walks across a page of track, then the page turns."""

    def __init__(self, stream: Any, scene: Scene) -> None:
        """Prepare the first page.

        Args:
            stream: the recording to log to.
            scene: the scene.
        """
        super().__init__(stream, scene)
        self._middle = float(self._share @ self._rest)
        self._window = float(self._rest.min()) + np.array([-0.6, 3.4]) * self._length
        self._page: int | None = None
        self._marks = JumpMarks(stream, scene, self._length)
        self._paved = scene.parts.ground is not None

    def build_view(self) -> Any:
        """Build the view."""
        below = 0.42 if self._paved else 0.22
        name = f"Crawler on its track{self._note}: green slips forward, red slips back, grey sticks"
        bounds = np.array([self._window, [-0.25 * self._length, below * self._length]])
        return build_flat_view(self._stream, "world", name + self._yields, bounds)

    def draw(self, frame: Frame) -> None:
        """Log a frame at its time, which is set.

        Args:
            frame: the frame.
        """
        y = float(self._share @ (self._rest + frame.displacement))
        if frame.jumps:
            self._marks.mark_jumps(
                frame.jumps, self._turn(y) if self._page is None else self._page * _PAGE * self._length
            )
            self._stream.set_time("sim_time", duration=frame.time_ns / NS)
        origin = self._turn(y)
        self._marks.age(frame.time_ns, origin)
        place, state = self._place(frame) - origin, frame.state[self._chosen]
        points = np.column_stack((place, np.full(place.size, -self._radius)))
        colors = [STATES[int(s)] for s in state]
        jumping = np.isin(self._scene.body.stations[self._chosen], self._marks.contacts)
        for k in np.flatnonzero(jumping).tolist():
            colors[k] = rgb(JUMP)
        self._log_body(points, colors, frame.yields)
        above, ways = points - np.array([0.0, 2.2 * self._radius]), np.column_stack((state, 0 * state))
        self._log_slips(above, ways, colors)

    def _turn(self, middle: float) -> float:
        """Draw the page of track around the body's middle; return the position of its origin [m]."""
        page = int(np.floor((middle - self._middle) / (_PAGE * self._length)))
        origin = page * _PAGE * self._length
        if page == self._page:
            return origin
        self._page = page
        depth = 0.05 * self._length
        left, right = self._window + origin
        marks = mark_ticks(left, right, round_step(self._length / 3.0))
        at = marks - origin
        lines = [[[x, 0.0], [x, depth]] for x in at] + [[[self._window[0], 0.0], [self._window[1], 0.0]]]
        track = rr.LineStrips2D(lines, colors=[(150, 150, 150)], radii=rr.Radius.ui_points(1.0))
        self._stream.log("world/track", track)
        labels = rr.Points2D(
            np.column_stack((at, np.full(at.size, 2.4 * depth))),
            labels=[f"{m + 0.0:.6g} m" for m in marks],
            colors=[TEXT],
            radii=rr.Radius.ui_points(0.0),
            show_labels=True,
        )
        self._stream.log("world/marks", labels)
        draw_ground(self._stream, self._scene, self._window + origin, origin, self._length)
        return origin


class PlaneView(_View):
    """The body in the plane from above, with the path of every contact and of their mean."""

    def __init__(self, stream: Any, scene: Scene, extent: tuple[np.ndarray, np.ndarray] | None) -> None:
        """Choose the part of the plane that is shown first.

        Args:
            stream: the recording to log to.
            scene: the scene.
            extent: smallest and largest positions, each shape (2,) [m]; None where they are not known beforehand.
        """
        super().__init__(stream, scene)
        room = 2.0 if extent is None else 0.35
        low, high = (self._rest.min(axis=0), self._rest.max(axis=0)) if extent is None else extent
        self._low, self._high = low - room * self._length, high + room * self._length
        self._kept: list[np.ndarray] = []
        self._before: np.ndarray | None = None
        self._jumped: dict[int, int] = {}  # contacts that jumped, and when [ns]
        far = float((self._high - self._low).max())
        step = round_step(far / 6.0)
        draw_grid(stream, "world", self._low, self._high, step, "m")
        draw_areas(stream, scene, self._low, self._high)

    def build_view(self) -> Any:
        """Build the view."""
        directions = (
            "short strokes: directions of friction"
            if len(self._scene.directions)
            else "friction equal in all directions"
        )
        if self._scene.body.turning is not None:
            directions = f"{WORDS}; magenta: jumped"
        name = f"Crawler from above{self._note}: green slides, grey sticks; white: path of the mean; {directions}"
        return build_flat_view(self._stream, "world", name, bounds_of_grid(self._low, self._high))

    def draw(self, frame: Frame) -> None:
        """Log a frame at its time, which is set.

        Args:
            frame: the frame.
        """
        place = self._place(frame)
        points = place * (1.0, -1.0)  # y points down in rerun
        slides = frame.state[self._chosen] != 0
        colors = [STATES[int(s)] for s in slides]
        self._jumped |= {jump.contact: frame.time_ns for jump in frame.jumps}
        for contact in (i for i, ns in self._jumped.items() if 0 <= frame.time_ns - ns < _JUMP_SHOWN_NS):
            colors = [rgb(JUMP) if chosen == contact else c for c, chosen in zip(colors, self._chosen, strict=True)]
        self._log_body(points, colors, frame.yields)
        moved = np.zeros(points.shape) if self._before is None else points - self._before
        size = np.linalg.norm(moved, axis=1, keepdims=True)
        ways = slides[:, None] * moved / np.where(size > 0.0, size, 1.0)
        self._log_slips(points, ways, colors)
        self._before = points
        self._log_directions(points)
        mean = self._share @ (self._rest + frame.displacement.reshape(self._rest.shape)) * (1.0, -1.0)
        now = np.vstack((points[:MOST_ARROWS], mean[None]))
        if not self._kept or np.abs(now - self._kept[-1]).max() > _PATH_STEP * self._length:
            self._kept = [*self._kept, now][-max(_PATH_POINTS // now.shape[0], 20) :]
            paths = np.array(self._kept).transpose(1, 0, 2)
            paths_colors = [*(color_of(i) for i in range(now.shape[0] - 1)), MOVING]
            radii = [rr.Radius.ui_points(1.0)] * (now.shape[0] - 1) + [rr.Radius.ui_points(2.0)]
            drawn = rr.LineStrips2D(list(paths), colors=paths_colors, radii=radii, draw_order=-5.0)
            self._stream.log("world/paths", drawn)
        self._stream.log("world/mean", rr.Points2D([mean], colors=[MOVING], radii=rr.Radius.ui_points(4.0)))

    def _log_directions(self, points: np.ndarray) -> None:
        """Log short strokes along the directions of friction under each contact."""
        directions = self._scene.directions
        turns = self._scene.body.turning is not None
        if (len(directions) == 0 and not turns) or points.shape[0] > MOST_ARROWS:
            return
        reach = 2.2 * self._radius * directions * (1.0, -1.0)
        lines: Any = [[p, p + d] for p in points for d in reach]
        if turns:
            strokes = friction_strokes(self._scene.body, points * (1.0, -1.0), 3.0 * self._radius)
            lines = list(strokes * (1.0, -1.0))
        color, order = (TEXT, 1.5) if turns else (FAINT, -2.0)
        drawn = rr.LineStrips2D(lines, colors=[color], radii=rr.Radius.ui_points(1.5), draw_order=order)
        self._stream.log("world/friction", drawn)


def _rope(start: np.ndarray, end: np.ndarray, radius: float, bow: float) -> np.ndarray:
    """Draw a slack link between two points as a line that sags from an arch of height `bow`, shape (13, 2) [m]."""
    part = np.linspace(0.0, 1.0, 13)
    line = start + part[:, None] * (end - start)
    line[:, 1] += 4.0 * (0.6 * radius - bow) * part * (1.0 - part)  # y points down
    return np.asarray(line)


def _spring(start: np.ndarray, end: np.ndarray, radius: float, bow: float, teeth: int = 4) -> np.ndarray:
    """Draw a spring between two points as a zigzag, arched upwards by `bow`, shape (2 teeth + 3, 2) [m]."""
    length = max(float(np.hypot(*(end - start))), 1e-9 * radius)
    along = (end - start) / length
    across = np.array([along[1], -along[0]])
    x = np.concatenate(([0.0], np.linspace(radius, length - radius, 2 * teeth + 1), [length]))
    y = 4.0 * bow * (x / length) * (1.0 - x / length)
    y[2:-2:2] += 0.9 * radius
    y[3:-2:2] -= 0.9 * radius
    return np.asarray(start + x[:, None] * along + y[:, None] * across)
