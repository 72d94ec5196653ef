"""How long actuators of a recorded run were beyond the limits of their tension."""

from __future__ import annotations

import numpy as np

from crawler_model import Scene
from crawler_model.crawler.yields import YieldTimes

from .ramps import Piece


class YieldSink:
    """Adds up the times of all runs together, of a recording that is simulated again: a `Sink`."""

    def __init__(self, scene: Scene | None) -> None:
        """Start at zero.

        Args:
            scene: the scene that ran; None when it is not known.
        """
        self._scene = scene if scene is not None and scene.body.joint_limits.index.size else None
        self._times = None if self._scene is None else YieldTimes(self._scene.body)

    def __call__(self, piece: Piece) -> None:
        """Add the ticks of a piece."""
        rows = np.flatnonzero(piece.ends_tick)
        if self._scene is None or self._times is None or not piece.tension.shape[1] or not rows.size:
            return
        body, begins = self._scene.body, np.append(0, rows[:-1] + 1)
        actuation = self._scene.columns.target(piece.command[rows])[:, : body.springs]
        self._times.add_ticks(
            piece.elongation[rows], body.joint_sum(actuation.T).T, piece.end_ns[rows] - piece.start_ns[begins]
        )

    def list_seconds(self) -> dict[str, dict[str, float]]:
        """List the times.

        Returns:
            As `YieldTimes.list_seconds`, of all runs together [s]; empty where no link has limits of tension.
        """
        return {} if self._times is None else self._times.list_seconds()
