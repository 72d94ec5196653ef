"""When a period repeats the one before: the one criterion of periodic regimes, limits and searches.

The tensions at the ends of periods decide, each against the scale of the forces at its own two contacts. Against the
largest force of the body, one anchor would hide all that happens at the other contacts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..body.body import Body
from ..body.curves import STIFFNESS, list_sliders
from ..crawler.crawler import Crawler
from ..motion.follow import State
from ..rounding import EPS

REPEATS = 1e-13
"""Part of the forces at its weaker contact within which a tension repeats."""
_ROUNDING = 16.0 * EPS


def determining_tension(body: Body, state: Crawler | State) -> np.ndarray:
    """Compute the tensions from which the motion goes on; where a spring is bent, tensions of a linear one instead.

    The tension of a bent spring that is slack or at a limit does not tell its length. The forces of elements of
    hysteresis follow, which remember, and what actuators with backlash do, as tensions by which they are ahead of their
    commands.

    Args:
        body: the body.
        state: a crawler, or the state of a motion.

    Returns:
        T, of bent springs k (z - L) with their largest stiffness, then the forces of the H elements of hysteresis and
        of the B actuators with backlash, shape (S + H + B,), in the plane (S, 2) [N].
    """
    tension = np.array(state.tension)
    for bend in body.bends:
        s = bend.spring
        tension[s] = bend.stiffness * (state.shape[s] - state.actuation[s])
    if not body.bends:
        return tension
    memory: Any = getattr(state, "hysteresis", np.empty(0))
    ahead = body.stiffness * (state.actuation - state.commanded)
    return np.concatenate((tension, memory, ahead[_remembering(body)[memory.size :]]))


def determining_stiffness(body: Body) -> np.ndarray:
    """Compute the stiffnesses that belong to `determining_tension`.

    Args:
        body: the body, or M variations of it.

    Returns:
        Shape (S + H + B,), of variations (M, S) [N/m].
    """
    if not body.bends:
        return body.stiffness
    sliders, springs = list_sliders(body.bends), _remembering(body)
    return np.concatenate((body.stiffness, sliders[:, 1 + STIFFNESS], body.stiffness[springs[len(sliders) :]]))


_ROOM = 2.0
"""Travels of a period by which it has to keep clear of other ground."""


def has_left_all_ground(crawler: Crawler, begin: np.ndarray, gained: float, travel: float) -> bool:
    """Determine whether a period on a line was beyond all borders and walls, so that it may repeat for ever.

    The period that ends is judged: ground that it still met when it began, as on its way back, has changed its gain.

    Args:
        crawler: the body, at the end of the period.
        begin: displacement at its beginning, shape (N,) [m].
        gained: what the body gained in it, whose sign is the direction of travel [m].
        travel: the largest displacement at its waypoints [m]; between them a contact may go a little further, and one
            that stands at a wall has no distance from it.

    Returns:
        True on ground that is the same everywhere, too.
    """
    track = crawler.scene.ground.track
    if track is None:
        return True
    walls = np.zeros(0) if track.walls is None else track.walls.place[np.isfinite(track.walls.place)]
    at = crawler.body.position + begin
    return bool((np.sign(gained) * (at[:, None] - np.concatenate((track.borders, walls))) > _ROOM * travel).all())


def _remembering(body: Body) -> np.ndarray:
    """List the springs of the elements of hysteresis, then of the actuators with backlash, shape (H + B,)."""
    sliders = list_sliders(body.bends)[:, 0].astype(np.int64)
    return sliders if body.backlash is None else np.concatenate((sliders, body.backlash.springs))


def tensions_repeat(
    body: Body, targets: np.ndarray, tension: np.ndarray, before: np.ndarray, part: float
) -> np.ndarray:
    """Determine whether the tensions at the ends of two periods are equal within their tolerance.

    That is never less than the rounding of a tension that follows from displacements.

    Args:
        body: the body, or M variations of it.
        targets: the commands of a period, shape (V, F), of variations (M, V, F).
        tension: at the end of a period, from `determining_tension`, shape (S + H + B,) or (M, S), in the plane (S, 2)
            [N].
        before: at the end of the period before, same shape.
        part: of the friction and the tensions at the contact where they are weaker, by which a tension may differ [1].

    Returns:
        A single truth value, or one of each variation, shape (M,).
    """
    n, lengths = body.contacts, body.springs * body.dimension
    change = tension - before
    if body.dimension == 2:
        change, pull = np.linalg.norm(change, axis=-1), np.linalg.norm(tension, axis=-1)
        reach = np.linalg.norm(targets[:, :lengths].reshape(-1, body.springs, 2), axis=-1).max(axis=0)
        each = (targets.shape[-1] - lengths) // n  # by direction, and two numbers of the load
        friction = np.abs(targets[:, lengths : lengths + each * n]).reshape(-1, each, n).max(axis=(0, 1))
    else:
        change, pull = np.abs(change), np.abs(tension)
        reach = np.abs(targets[..., :lengths]).max(axis=-2)
        bounds = np.abs(targets[..., lengths : lengths + 2 * n]).max(axis=-2)
        friction = np.maximum(bounds[..., :n], bounds[..., n:])
    at_contact = body.force_size(pull[: body.springs] if pull.ndim == 1 else pull) + friction
    weaker = np.minimum(at_contact[..., body.ends[:, 0]], at_contact[..., body.ends[:, 1]])
    if body.bends:
        of = np.concatenate((np.arange(body.springs), _remembering(body)))
        weaker, reach = weaker[of], reach[of]
    tolerance = part * weaker + _ROUNDING * (determining_stiffness(body) * reach + pull)
    return np.asarray((change <= tolerance).all(axis=-1))
