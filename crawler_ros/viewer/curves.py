"""The panels over time: contacts, tensions, net translation and commands, from the same frames, live or recorded."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from crawler_model import Scene
from crawler_model.body.body import Body
from crawler_model.body.names import name_joints
from crawler_model.body.turning import measure_angles, wrap
from crawler_model.run.table import unit_of_command
from crawler_model.theory.stasis import stasis_bounds
from crawler_pictures.ground import has_stasis_bounds
from crawler_pictures.run.forces import MOST_BANDS
from crawler_pictures.run.kymograph import MOST_LINES
from crawler_pictures.run.pixels import divide, join_extremes, join_states

from ..wire.states import station_names
from .frames import Frame
from .style import BOTH, BOUND, LINE_NAMES, MOVING, STATES, color_of

MOST_ROWS = 128
"""Rows of contacts or links in a panel; where there are more, neighbours share a row."""
_MOST_CURVES, _MOST_NAMED = 24, 4
_RESOLUTION = 1e-9
"""A net translation below this part of the body's length is rounding."""
_LOW, _MIDDLE, _HIGH = np.array([[70, 130, 255], [45, 48, 50], [255, 160, 40]])


class Curves:
    """Logs the panels over time."""

    def __init__(self, stream: Any, scene: Scene, rows: np.ndarray | None = None) -> None:
        """Choose the panels, and log what is constant.

        Args:
            stream: the recording to log to.
            scene: the scene.
            rows: the command rows of all frames, shape (F, C); None where they are not known beforehand.
        """
        self._stream, self._scene = stream, scene
        body = scene.body
        self._planar, self.bounded = body.dimension == 2, has_stasis_bounds(body)
        self._unsigned = self._planar and body.turning is None  # the tension of a vector spring has only a size
        self._rest = body.position[body.stations]
        self._contacts, self._joints = station_names(body), name_joints(body)[: len(body.joints)]
        self._yaw = 0.0
        n, links = len(self._contacts), len(self._joints)
        self.as_lines = not self._planar and n <= MOST_LINES
        self._length = float(np.ptp(self._rest, axis=0).max())
        self._rows = divide(np.arange(n + 1.0), min(n, MOST_ROWS))
        self._links = divide(np.arange(links + 1.0), min(links, MOST_ROWS)) if links > MOST_BANDS else None
        self._share = body.station_share
        self.commands = _choose_commands(scene, rows)
        self._log_names(n, links)

    def _log_names(self, n: int, links: int) -> None:
        log = self._stream.log
        rows = n if self.as_lines else min(n, MOST_ROWS)
        names = self._contacts if rows == n else [f"from {self._contacts[int(i)]}" for i in self._rows[0]]
        log(
            "contacts", rr.SeriesLines(names=names, widths=[3.0 if self.as_lines else _width(rows)] * rows), static=True
        )
        for i, name in enumerate(self._joints if self._links is None else []):
            names = (["lower bound", "upper bound"] if self.bounded else []) + [f"tension of {name}"]
            colors = [BOUND] * (len(names) - 1) + [color_of(i)]
            lines = rr.SeriesLines(colors=colors, names=names, widths=[1.0] * (len(names) - 1) + [2.5])
            log(f"tension/{name}", lines, static=True)
        if self._links is not None:
            rows = self._links[0].size
            names = [f"from {self._joints[int(i)]}" for i in self._links[0]]
            log("tensions", rr.SeriesLines(names=names, widths=[_width(rows)] * rows), static=True)
        names = ["x", "y"] if self._planar else ["y"]
        colors = [MOVING, color_of(0)][: len(names)]
        log("net_translation", rr.SeriesLines(colors=colors, names=names, widths=[2.0] * len(names)), static=True)
        if body_turns(self._scene):
            log("yaw", rr.SeriesLines(colors=[MOVING], names=["yaw"], widths=[2.0]), static=True)
        for kind, columns in self.commands.items():
            shown = columns[:_MOST_CURVES]
            names = [self._scene.columns.names[k] for k in shown]
            colors = [color_of(i) for i in range(len(shown))]
            log(f"commands/{kind}", rr.SeriesLines(colors=colors, names=names, widths=[1.5] * len(shown)), static=True)

    def draw(self, frame: Frame) -> None:
        """Log a frame at the time that is set.

        Args:
            frame: the frame.
        """
        log = self._stream.log
        place = self._rest + frame.displacement.reshape(self._rest.shape)
        if self.as_lines:
            values, state = place, frame.state
        else:
            values, state = np.asarray(self._rows[0], float), join_states(frame.state[:, None], *self._rows)[:, 0]
        colors = [STATES.get(int(s), BOTH) for s in state]
        log("contacts", rr.Scalars(values), rr.SeriesLines(colors=colors))
        y = self._share @ (place - self._rest)
        unit = _RESOLUTION * self._length
        log("net_translation", rr.Scalars(np.atleast_1d(np.round(y / unit) * unit)))
        if body_turns(self._scene):
            self._yaw = follow_yaw(self._scene.body, place, self._yaw)
            log("yaw", rr.Scalars([self._yaw]))
        least, most = stasis_bounds(frame.tension, frame.forward, frame.backward) if self.bounded else (None, None)
        if self._links is not None:
            log("tensions", rr.Scalars(np.asarray(self._links[0], float)), self._color_tensions(frame, least, most))
        else:
            for i, name in enumerate(self._joints):
                ends = [] if least is None or most is None else [least[i], most[i]]
                log(f"tension/{name}", rr.Scalars([*ends, frame.tension[i]]))
        for kind, columns in self.commands.items():
            log(f"commands/{kind}", rr.Scalars(frame.row[columns[:_MOST_CURVES]]))

    def _color_tensions(self, frame: Frame, least: Any, most: Any) -> Any:
        """Colour each link by its place between its bounds, or by its part of the largest tension so far."""
        assert self._links is not None
        if self.bounded:
            half = 0.5 * (most - least)
            open_range = half > 1e-9 * np.abs(frame.tension).max(initial=0.0)
            part = np.where(open_range, (frame.tension - least - half) / np.where(open_range, half, 1.0), 0.0)
        else:
            self._largest = max(getattr(self, "_largest", 0.0), float(np.abs(frame.tension).max(initial=0.0)))
            part = frame.tension / (self._largest or 1.0)
        part = np.clip(join_extremes(part[:, None], *self._links), -1.0, 1.0)
        toward = np.where(part > 0.0, _HIGH, _LOW)
        colors = np.rint(_MIDDLE + np.abs(part) * (toward - _MIDDLE)).astype(np.uint8)
        return rr.SeriesLines(colors=colors)

    def _name_colors(self, columns: list[int]) -> str:
        """Name the colours of a few curves; the viewer names more of them where the pointer is."""
        if len(columns) > _MOST_NAMED:
            return ""
        names, listed = self._scene.columns.names, []
        for number, k in enumerate(columns):
            both = names[k].removesuffix("/forward")
            alone = both != names[k] and names.index(f"{both}/backward") not in columns
            listed.append(f"{both if alone else names[k]} {LINE_NAMES[number]}")
        return ": " + ", ".join(listed)

    def build_views(self) -> tuple[list[Any], list[float], list[Any]]:
        """Build the views, whose time axes are linked.

        Returns:
            The views of the left column with their heights, and the views of the right column.
        """
        common: dict[str, Any] = {
            "axis_x": rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
            "plot_legend": rrb.PlotLegend(visible=False),
        }
        n, links = len(self._contacts), len(self._joints)
        colors = "green slides" if self._planar else "green slips forward, red slips back"
        if self.as_lines:
            ends = ", of segments the ends" if self._scene.body.segments else ""
            named = f"Contacts over time [m]{ends}: {colors}, grey sticks"
            left = [rrb.TimeSeriesView(origin="contacts", name=named, **common)]
        else:
            named = f"Contacts over time, one row each: {colors}, grey sticks"
            if n > MOST_ROWS:
                named = f"{n} contacts over time, {-(-n // MOST_ROWS)} in a row: {colors}, yellow both, grey sticks"
            rows = rrb.ScalarAxis(range=(-0.5 * n / min(n, MOST_ROWS), n - 0.5))
            left = [rrb.TimeSeriesView(origin="contacts", name=named, axis_y=rows, **common)]
        heights = [2.0]
        if self._links is None:
            for name in self._joints:
                words = "Size of the tension" if self._unsigned else "Tension"
                bound = ", stasis bounds grey" if self.bounded else ""
                view = rrb.TimeSeriesView(
                    origin=f"tension/{name}", name=f"{words} of {name.replace('_', ' ')} [N]{bound}", **common
                )
                left.append(view)
                heights.append(1.0)
        else:
            words = "orange at the upper stasis bound, blue at the lower"
            if not self.bounded:
                words = "the brighter, the larger" if self._unsigned else "orange stretched, blue compressed"
            joined = f", {-(-links // MOST_ROWS)} links in a row" if links > MOST_ROWS else ", one row each"
            axis = rrb.ScalarAxis(range=(-0.5 * links / self._links[0].size, links - 0.5))
            named = f"Tensions of {links} links{joined}: {words}"
            left.append(rrb.TimeSeriesView(origin="tensions", name=named, axis_y=axis, **common))
            heights.append(1.2)
        named = "Net translation" + (", from the ends of segments" if self._scene.body.segments else "") + " [m]"
        named += ": white along x, blue along y" if self._planar else ""
        right = [rrb.TimeSeriesView(origin="net_translation", name=named, **common)]
        if body_turns(self._scene):
            right.append(rrb.TimeSeriesView(origin="yaw", name="Yaw [rad]", **common))
        for kind, columns in self.commands.items():
            unit = unit_of_command(self._scene.columns, columns[0])
            some = f", {_MOST_CURVES} of {len(columns)}" if len(columns) > _MOST_CURVES else ""
            name = f"{kind.replace('_', ' ').capitalize()} [{unit}]{some or self._name_colors(columns)}"
            right.append(rrb.TimeSeriesView(origin=f"commands/{kind}", name=name, **common))
        return left, heights, right


def body_turns(scene: Scene) -> bool:
    """Return whether the body of a scene turns, so that there is a yaw to draw."""
    return scene.body.turning is not None


def follow_yaw(body: Body, place: np.ndarray, before: float) -> float:
    """Compute the yaw of a body that turns, counting whole turns.

    Args:
        body: the body.
        place: positions of its points, shape (N, 2) [m].
        before: the yaw in the frame before [rad].

    Returns:
        The yaw nearest to it [rad].
    """
    assert body.turning is not None
    now = float(measure_angles(place, body.turning.heading[None])[0])
    return before + float(wrap(np.array(now - before)))


def _width(rows: int) -> float:
    """Choose the width of the lines that fill the rows of a panel [points]."""
    return float(np.clip(260.0 / rows, 2.5, 9.0))


def _choose_commands(scene: Scene, rows: np.ndarray | None) -> dict[str, list[int]]:
    """Choose the columns of the commands that change, by kind.

    Where the rows are not known the drive's rows count; without a drive all commands may change. Friction that is
    equal in both directions throughout has one curve.
    """
    columns, may_change = scene.columns, rows is None and scene.drive.holds
    rows = scene.drive.rows if rows is None else rows
    links = int(columns.actuation_sizes[: columns.links].sum())
    ends = {"rest_lengths": links, "strains" if columns.joints is None else "rest_angles": columns.lengths}
    ends |= {"friction": columns.lengths + columns.frictions, "loads": rows.shape[1]}
    changes, found, start = np.ptp(rows, axis=0) > 0.0, {}, 0
    for kind, end in ends.items():
        if end > start and (bool(changes[start:end].any()) or may_change):
            shown = range(start, end)
            half = (start + end) // 2
            equal = kind == "friction" and columns.sides == 2 and not may_change
            if equal and np.array_equal(rows[:, start:half], rows[:, half:end]):
                shown = range(start, half)
            units = [unit_of_command(columns, k) for k in shown]
            for i, unit in enumerate(dict.fromkeys(units)):  # isolated contacts are before segments
                name = f"{kind}_of_segments" if i else kind
                found[name] = [k for k, its in zip(shown, units, strict=True) if its == unit]
        start = end
    return found
