"""A run sampled at the frames of a film, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from crawler_model import CrawlerError, Scene, Trajectory
from crawler_model.body.drive import NS
from crawler_model.body.names import name_every_contact

from ..ground import has_stasis_bounds, local_bounds
from ..marks import can_be_marked, mark_springs

MOST_FRAMES = 20_000
"""More frames are refused: at 25 a second they are a film of 13 minutes."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Film:
    """A run at F instants, of N contacts and J springs that are drawn.

    Attributes:
        scene: the scene.
        names: of the contacts, shape (N,).
        rest: reference positions, shape (N,), in the plane (N, 2) [m].
        ends: the two contacts of each spring, shape (J, 2).
        share: weight of each contact in the net translation, shape (N,).
        time: simulated time, increasing, shape (F,) [s].
        displacement: shape (F, N), in the plane (F, N, 2) [m].
        state: sliding at that instant, 1 forward, -1 back, in the plane 1 in any direction, else 0, shape (F, N).
        tension: of each spring, of vector springs in the plane its size, shape (F, J) [N].
        forward: bounds of the spring force on each contact where tensions have bounds, shape (F, N), else (F, 0) [N].
        backward: bounds in the other direction, of the same shape [N].
        yields: mark of each spring, see `marks`, int8, shape (F, J); (F, 0) where none can be marked.
        ticks: the run from the first to the last instant with all its ticks; None if the instants are its ticks.
    """

    scene: Scene
    names: tuple[str, ...]
    rest: np.ndarray
    ends: np.ndarray
    share: np.ndarray
    time: np.ndarray
    displacement: np.ndarray
    state: np.ndarray
    tension: np.ndarray
    forward: np.ndarray
    backward: np.ndarray
    yields: np.ndarray
    ticks: Film | None = None

    @property
    def path(self) -> Film:
        """The run with all its ticks, for pictures over time."""
        return self.ticks or self

    @property
    def planar(self) -> bool:
        """Whether the body moves in the plane."""
        return self.displacement.ndim == 3

    @property
    def place(self) -> np.ndarray:
        """Positions of the contacts, shaped as the displacement [m]."""
        return self.rest + self.displacement

    @property
    def step(self) -> float:
        """Simulated time between frames [s]."""
        return float(self.time[-1] - self.time[0]) / max(self.time.size - 1, 1)

    @property
    def cycle_frames(self) -> int:
        """Number of frames in a period of the drive, or in a second."""
        return max(round((self.scene.drive.period or 1.0) / self.step), 1) if self.step > 0.0 else 1

    @property
    def net_translation(self) -> np.ndarray:
        """Mean displacement y, shape (F,), in the plane (F, 2) [m]."""
        return np.asarray(np.tensordot(self.displacement, self.share, (1, 0)))

    @property
    def moved(self) -> np.ndarray:
        """Displacement of each contact within the tick of each instant, shaped as the displacement [m]."""
        path = self.path
        steps = np.diff(path.displacement, axis=0, prepend=path.displacement[:1])
        return np.asarray(steps[path._tick_of(self.time)])

    def _tick_of(self, times: np.ndarray) -> np.ndarray:
        """Find the ticks of instants, shape (K,); an instant at the end of a tick belongs to that tick."""
        return np.minimum(np.searchsorted(self.time, times - 1.0 / NS), self.time.size - 1)

    def sample(self, times: np.ndarray) -> Film:
        """Sample the run at the frames of a film: positions and forces linearly, slips of the tick of the instant.

        What is slack or stalled is taken at the nearest tick.

        Args:
            times: instants within the run, increasing, shape (K,) [s].

        Returns:
            The run at these instants.
        """
        after = np.clip(np.searchsorted(self.time, times), 1, self.time.size - 1) if self.time.size > 1 else times * 0
        after = after.astype(np.int64)
        before = np.maximum(after - 1, 0)
        gap = self.time[after] - self.time[before]
        part = np.clip((times - self.time[before]) / np.where(gap > 0.0, gap, 1.0), 0.0, 1.0)

        def blend(values: np.ndarray) -> np.ndarray:
            weight = part.reshape(-1, *(1,) * (values.ndim - 1))
            return np.asarray(values[before] + weight * (values[after] - values[before]))

        shown = slice(int(before[0]), int(after[-1]) + 1)
        over_time = ("time", "displacement", "state", "tension", "forward", "backward", "yields")
        return replace(
            self,
            time=times,
            displacement=blend(self.displacement),
            state=self.state[self._tick_of(times)],
            tension=blend(self.tension),
            forward=blend(self.forward),
            backward=blend(self.backward),
            yields=self.yields[np.where(part < 0.5, before, after)],
            ticks=replace(self, **{name: getattr(self, name)[shown] for name in over_time}),
        )


def film_of_run(scene: Scene, run: Trajectory) -> Film:
    """Take all contacts and springs of a run, with its ticks as instants.

    Args:
        scene: the scene that ran.
        run: the run.

    Returns:
        The film.
    """
    body = scene.body
    tension = run.tension[:, : body.springs]
    if tension.ndim == 3:
        tension = np.linalg.norm(tension, axis=2)
    forward = backward = np.zeros((run.time.size, 0))
    yields, times_ns = np.zeros((run.time.size, 0), np.int8), np.rint(run.time * NS).astype(np.int64)
    if can_be_marked(body):
        actuation = scene.drive.sample(times_ns)[:, : body.springs]
        yields = mark_springs(body, body.elongation(run.displacement), actuation, tension)
    if has_stasis_bounds(body):
        targets = scene.drive.sample(times_ns)
        bounds = [local_bounds(scene, target, x) for target, x in zip(targets, run.displacement, strict=True)]
        forward, backward = (np.array(side) for side in zip(*bounds, strict=True))
    names = tuple(name.removeprefix("contact_") for name in name_every_contact(body))
    return Film(
        scene=scene,
        names=names,
        rest=body.position,
        ends=body.ends,
        share=body.share,
        time=run.time,
        displacement=run.displacement,
        state=run.contact_state,
        tension=tension,
        forward=forward,
        backward=backward,
        yields=yields,
    )


def frame_times(start: float, end: float, fps: float, speed: float) -> np.ndarray:
    """Compute the instants of the frames of a film.

    Args:
        start: simulated time of the first frame [s].
        end: simulated time of the last one, not before the first [s].
        fps: frames per second of the film [Hz].
        speed: simulated seconds per second of the film [1].

    Returns:
        Shape (F,) [s].

    Raises:
        CrawlerError: when there would be too many frames, or fewer than two.
    """
    count = (end - start) * fps / speed
    if not 1.0 - 1e-9 <= count < MOST_FRAMES:
        raise CrawlerError(
            f"the film would have {count + 1:.6g} frames; it must have 2 .. {MOST_FRAMES}: choose the simulated time "
            "with --from and --to, and --fps or --speed"
        )
    return start + np.arange(int(count + 1e-9) + 1) * (speed / fps)
