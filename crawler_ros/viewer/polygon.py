"""The stasis polygon of three contacts in the rerun view, with a scale, and the path of the tensions in it."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import rerun as rr

from crawler_model import Scene
from crawler_model.theory.stasis import StasisDomain, holds_loads
from crawler_pictures.domain_many import sides_of
from crawler_pictures.film.camera import round_step

from .frames import Frame
from .style import BOUND, MOVING, STATES, bounds_of_grid, build_flat_view, draw_grid

_TRAIL = 100


class PolygonView:
    """The polygon of admissible tensions; its sides are coloured by the direction in which the body moves there."""

    def __init__(self, stream: Any, scene: Scene) -> None:
        """Draw the scale.

        Args:
            stream: the recording to log to.
            scene: a chain of three contacts.
        """
        self._stream = stream
        drive = scene.drive
        rows = zip(drive.forward, drive.backward, strict=True)
        corners = np.concatenate(
            [StasisDomain(plus, minus).vertices() for plus, minus in rows if holds_loads(plus, minus)]
            or [np.zeros((1, 2))]
        )
        low, high = corners.min(axis=0), corners.max(axis=0)
        size = float((high - low).max()) or 1.0
        middle = 0.5 * (low + high)
        self._low, self._high = middle - 0.65 * size, middle + 0.65 * size
        draw_grid(stream, "stasis", self._low, self._high, round_step(size / 4.0), "N")
        self._last = b""
        self._trail: deque[np.ndarray] = deque(maxlen=_TRAIL)

    def build_view(self) -> Any:
        """Build the view."""
        name = "Stasis polygon: tension of link 0 right, of link 1 up [N]; at green sides forward, at red back"
        return build_flat_view(self._stream, "stasis", name, bounds_of_grid(self._low, self._high))

    def draw(self, frame: Frame) -> None:
        """Log a frame at the time that is set.

        Args:
            frame: the frame.
        """
        bounds = np.concatenate((frame.forward, frame.backward)).tobytes()
        if bounds != self._last:
            self._last = bounds
            self._draw_domain(frame)
        self._trail.append(frame.tension * (1.0, -1.0))
        path = rr.LineStrips2D([list(self._trail)], colors=[MOVING], radii=rr.Radius.ui_points(0.8), draw_order=20.0)
        self._stream.log("stasis/path", path)
        color = STATES[int(np.sign(int(frame.state.sum())))]
        point = rr.Points2D([self._trail[-1]], colors=[color], radii=rr.Radius.ui_points(6.0), draw_order=30.0)
        self._stream.log("stasis/point", point)

    def _draw_domain(self, frame: Frame) -> None:
        """Draw the stasis domain, or none where walls hold what friction does not."""
        if not holds_loads(frame.forward, frame.backward):
            self._stream.log("stasis/domain", rr.Clear(recursive=False))
            return
        domain = StasisDomain(frame.forward, frame.backward)
        corners = domain.vertices()
        lines = [np.vstack((corners, corners[:1]))]
        colors = [BOUND]
        for facet, a, b in sides_of(domain) if corners.shape[0] > 2 else ():
            lines.append(np.array([a, b]))
            colors.append(STATES[facet.direction])
        radii = [rr.Radius.ui_points(1.0)] + [rr.Radius.ui_points(2.5)] * (len(lines) - 1)
        drawn = rr.LineStrips2D([line * (1.0, -1.0) for line in lines], colors=colors, radii=radii)
        self._stream.log("stasis/domain", drawn)
