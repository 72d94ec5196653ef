"""The ground in the rerun view: bands of colour, walls, heights of slopes, and marks of the contacts that jump."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr

from crawler_model import Scene
from crawler_model.body.drive import NS
from crawler_model.body.names import name_every_contact
from crawler_model.run.trajectory import TimedJump
from crawler_pictures.colors import JUMP, WALL, rgb
from crawler_pictures.ground import Section, list_areas, list_sections, list_walls, trace_profile

from .style import line_radius

_ROWS = 12  # lines that fill a band: a single thick one would have round ends beyond its borders
_LETTER = 0.0145  # width of a letter in a window of the usual size, in body lengths
_SHOWN_NS = 200_000_000
_MOST_MARKS = 8
_PROFILE_COLOR = (110, 110, 110)


def draw_areas(stream: Any, scene: Scene, low: np.ndarray, high: np.ndarray) -> None:
    """Draw the borders of the regions of the plane, each with its factor on friction, in a view in which y points down.

    Args:
        stream: the recording to log to.
        scene: the scene.
        low: least coordinates of the view, shape (2,) [m].
        high: largest coordinates, shape (2,) [m].
    """
    areas = list_areas(scene, low, high)
    if not areas:
        return
    lines = [np.vstack((area.corners, area.corners[:1])) * (1.0, -1.0) for area in areas]
    colors, width = [rgb(area.color) for area in areas], rr.Radius.ui_points(1.5)
    borders = rr.LineStrips2D(lines, colors=colors, radii=width, draw_order=-20.0)
    stream.log("world/ground", borders, static=True)
    texts = rr.Points2D(
        [area.corners.mean(axis=0) * (1.0, -1.0) for area in areas],
        labels=[area.text for area in areas],
        colors=colors,
        radii=rr.Radius.ui_points(0.0),
        show_labels=True,
    )
    stream.log("world/ground/text", texts, static=True)


def draw_ground(stream: Any, scene: Scene, window: np.ndarray, origin: float, length: float) -> None:
    """Draw the ground of a page of track; nothing for a scene without ground.

    Args:
        stream: the recording to log to.
        scene: the scene.
        window: both ends of the page, on the track, shape (2,) [m].
        origin: position of the page's origin on the track [m].
        length: length of the body [m].
    """
    if scene.parts.ground is None:
        return
    left, right = window.tolist()
    sections = list_sections(scene, left, right)
    lines, colors, radii = [], [], []
    depth = 0.05 * length
    bands = [(section.end, *band) for section in sections for band in section.bands]
    for last, start, end, color in bands:
        covered = min(end + depth / _ROWS, last)  # between round ends of two shades no gap is left
        made, radius = _fill(start - origin, covered - origin, depth)
        lines += made
        colors += [rgb(color)] * len(made)
        radii += [line_radius(radius, length)] * len(made)
    stream.log("world/ground", rr.LineStrips2D(lines, colors=colors, radii=radii, draw_order=-20.0))
    sections.sort(key=lambda section: section.middle)
    texts = rr.Points2D(
        [(s.middle - origin, y * length) for s, y in zip(sections, _text_rows(sections, length), strict=True)],
        labels=[s.text for s in sections],
        colors=[(235, 235, 235)],
        radii=rr.Radius.ui_points(0.0),
        show_labels=True,
    )
    stream.log("world/ground/text", texts)
    if scene.parts.ground.walls:  # also on a page without walls, to clear the walls of the page before
        places = [wall.at - origin for wall in list_walls(scene, left, right)]
        bars, radius = [[[x, 0.05 * length], [x, -0.3 * length]] for x in places], rr.Radius.ui_points(3.0)
        stream.log("world/ground/walls", rr.LineStrips2D(bars, colors=[rgb(WALL)], radii=radius, draw_order=-10.0))
    at, height = trace_profile(scene, left, right)
    if at.size:
        scale = min(1.0, 0.1 * length / float(height.max()))
        profile = np.column_stack((at - origin, 0.4 * length - scale * height))
        base = [[at[0] - origin, 0.4 * length], [at[-1] - origin, 0.4 * length]]
        stream.log(
            "world/ground/profile",
            rr.LineStrips2D(
                [profile, base],
                colors=[_PROFILE_COLOR, (205, 205, 205)],
                radii=[rr.Radius.ui_points(2.0), rr.Radius.ui_points(0.5)],
            ),
        )


def _text_rows(sections: list[Section], length: float) -> list[float]:
    """Choose the heights of texts, from left to right: a text that would cover its neighbour goes one row down."""
    rows = [0.19, 0.24]
    ends = [-np.inf, -np.inf]
    chosen = []
    for section in sections:
        half = 0.5 * _LETTER * length * (len(section.text) + 2)
        row = 0 if section.middle - half >= ends[0] else 1
        ends[row] = section.middle + half
        chosen.append(rows[row])
    return chosen


def _fill(start: float, end: float, depth: float) -> tuple[list[list[list[float]]], float]:
    """Fill a rectangle below the track with lines whose round ends stay inside; return the lines and their radius."""
    radius = min(0.5 * depth / _ROWS, 0.5 * (end - start))
    rows = (np.arange(_ROWS) + 0.5) * depth / _ROWS
    return [[[start + radius, y], [end - radius, y]] for y in rows.tolist()], 1.2 * radius


class JumpMarks:
    """Marks the contacts that jumped: an arrow over the distance for a fifth of a second, and a line of text."""

    def __init__(self, stream: Any, scene: Scene, length: float) -> None:
        """Start without marks.

        Args:
            stream: the recording to log to.
            scene: the scene.
            length: length of the body [m].
        """
        self._stream, self._length = stream, length
        self._names = name_every_contact(scene.body)
        self._marked: list[TimedJump] = []
        self._origin = 0.0

    @property
    def contacts(self) -> list[int]:
        """The contacts marked now."""
        return [jump.contact for jump in self._marked]

    def mark_jumps(self, jumps: tuple[TimedJump, ...], origin: float) -> None:
        """Mark jumps at their own times.

        Args:
            jumps: the jumps, in order.
            origin: position of the page's origin on the track [m].
        """
        for jump in jumps:
            self._stream.set_time("sim_time", duration=jump.time)
            text = f"{self._names[jump.contact]} jumps {jump.distance:.4g} m from {jump.border:g} m on, "
            text += f"{jump.loss:.4g} J lost"
            self._stream.log("jumps", rr.TextLog(text, level="INFO", color=rgb(JUMP)))
            self._marked = [*self._marked, jump][-_MOST_MARKS:]
            self._draw(origin)

    def age(self, now_ns: int, origin: float) -> None:
        """Remove marks that were shown long enough; when the page turns, draw the others in their places on it.

        Args:
            now_ns: time of the frame [ns].
            origin: position of the page's origin on the track [m].
        """
        kept = [jump for jump in self._marked if now_ns - round(jump.time * NS) < _SHOWN_NS]
        if len(kept) < len(self._marked) or (kept and origin != self._origin):
            self._marked = kept
            self._draw(origin)

    def _draw(self, origin: float) -> None:
        self._origin = origin
        if not self._marked:
            self._stream.log("world/jumps", rr.Clear(recursive=True))
            return
        self._stream.log(
            "world/jumps",
            rr.Arrows2D(
                origins=[((jump.border or 0.0) - origin, -0.15 * self._length) for jump in self._marked],
                vectors=[(jump.distance, 0.0) for jump in self._marked],
                colors=[rgb(JUMP)],
                radii=line_radius(0.008 * self._length, self._length),
                draw_order=10.0,
            ),
        )
        whole: dict[tuple[int, float], list[TimedJump]] = {}  # one text, too, where further borders were on the way
        for jump in self._marked:
            whole.setdefault((jump.contact, jump.time), []).append(jump)
        distance = {key: sum(jump.distance for jump in parts) for key, parts in whole.items()}
        self._stream.log(
            "world/jumps/text",
            rr.Points2D(
                [((p[0].border or 0.0) + 0.5 * distance[k] - origin, -0.24 * self._length) for k, p in whole.items()],
                labels=[f"{self._names[key[0]]} jumps {distance[key]:.4g} m" for key in whole],
                colors=[(235, 235, 235)],
                radii=rr.Radius.ui_points(0.0),
                show_labels=True,
            ),
        )
