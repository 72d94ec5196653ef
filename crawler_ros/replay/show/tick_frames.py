"""Frames of a run that is simulated again, where not every state was published."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from crawler_model import Scene
from crawler_model.body.drive import NS

from ...viewer.frames import Frame, find_moving, frame_of_tick, thin
from ...wire.states import shown_contacts
from ..ramps import Piece
from ..slips import sliding


class TickFrames:
    """The frames of a run that is simulated again, one for each tick: a `Sink`."""

    def __init__(self, scene: Scene, every_ns: int = 0) -> None:
        """Start empty.

        Args:
            scene: the scene that ran.
            every_ns: least time between frames [ns].
        """
        shown = shown_contacts(scene.body).tolist()
        self._scene, self._every_ns = scene, every_ns
        self._stations = np.array([shown.index(station) for station in scene.body.stations])
        self._rest = scene.body.position[scene.body.stations]
        self._run, self._offset_ns = 0, 0
        self._before: np.ndarray | None = None
        self.frames: list[Frame] = []
        """In sequence; none where the run is not simulated again."""

    def __call__(self, piece: Piece) -> None:
        """Add the frames of a piece, which is of a single run between resets."""
        if not piece.tension.shape[1]:  # as recorded, not simulated
            return
        if piece.run[0] != self._run:
            self._run, self._offset_ns, self._before = piece.run[0], self.frames[-1].time_ns, None
        # the last frame may be nearer to the one before than the next one will let it
        self.frames[-2:] = thin([*self.frames[-2:], *self._read(piece)], self._every_ns)

    def _read(self, piece: Piece) -> Iterator[Frame]:
        displacement, state = piece.position[:, self._stations] - self._rest, sliding(piece.station_gained)
        if self._scene.body.turning is not None:
            before = displacement[:1] if self._before is None else self._before
            state = find_moving(self._scene.body, np.diff(displacement, axis=0, prepend=before))
            self._before = displacement[-1:]
        ahead = deque(replace(jump, time=jump.time + self._offset_ns / NS) for _, jump in piece.jumps)
        moved = np.zeros_like(state[0])
        for k, end_ns in enumerate((piece.end_ns + self._offset_ns).tolist()):
            moved, passed = np.where(state[k] != 0, state[k], moved), []
            if not piece.ends_tick[k]:
                continue
            while ahead and round(ahead[0].time * NS) <= end_ns:
                passed.append(ahead.popleft())
            motion = displacement[k], piece.elongation[k], piece.tension[k], moved
            yield frame_of_tick(self._scene, end_ns, *motion, piece.command[k], tuple(passed))
            moved = np.zeros_like(moved)
