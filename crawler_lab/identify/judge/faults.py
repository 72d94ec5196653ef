"""Suspects that a robot fails, or that its model lacks something.

What a model lacks is a change of the commands, of friction or of measured positions by a few numbers and by the motion.
So the exact kernels of chains follow all of them but masses and viscosity, which are stepped through time.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from crawler_model.body.backlash import Backlash

from ..measurements import interpolate_rows
from ..replica.stepped import Dynamics
from .seen import Seen

_HELD = 30.0
"""Factor of the friction of a contact that sticks."""
_PARTS = (0.05, 0.15)
"""Parts of the way of a link in which backlash and hysteresis are guessed."""
_LATEST = 0.9
"""Part of a recording after which nothing sticks."""
_EARLIER = (-0.03, -0.01, 0.01, 0.03, 0.05, 0.07, 0.09)
"""By which parts of a recording a link may have stuck before the model ceases to fit."""
_BORDER = 0.005
"""Width of the borders of a stain, as a part of the way."""
_FINER = 4
"""Parts of each piece of the finer commands where actuators follow late, along curves."""
_LENS = 0.05
"""Largest bend of a lens, as a part of half a picture."""


class Changed(NamedTuple):
    """What a suspect changes; None for nothing.

    Attributes:
        commands: shape (K, C) [m, N].
        command_time: their times where these differ, shape (K,) [s].
        friction: factors of the friction of each contact, shape (K, N) [1].
        values: what was measured, shape (T, M) [m].
        dynamics: what the model lacks.
    """

    commands: np.ndarray | None = None
    command_time: np.ndarray | None = None
    friction: np.ndarray | None = None
    values: np.ndarray | None = None
    dynamics: Dynamics | None = None


class Fault(NamedTuple):
    """A suspect with its numbers.

    Attributes:
        what: describes it with its numbers.
        change: changes what a recording has seen by the numbers.
        guesses: of the numbers, shape (G, numbers).
        low: least numbers.
        high: largest numbers.
        moves: whether it depends on the motion, which may be that of the model.
        balanced: whether the balance of forces gives starts for its guesses.
        imitates: whether it is tried also where the one before it explains all, as both may.
    """

    what: Callable[..., str]
    change: Callable[..., Changed]
    guesses: Sequence[Sequence[float]]
    low: Sequence[float]
    high: Sequence[float]
    moves: bool = False
    balanced: bool = False
    imitates: bool = False


def list_faults(seen: Sequence[Seen], onset: float | None, cheap: bool) -> Iterator[Fault]:
    """List all suspects but stains; to add one, add it here.

    Args:
        seen: what all recordings show.
        onset: time until which the model fits; None if it fits no part of the recordings [s].
        cheap: whether they can be stepped through time soon.

    Yields:
        The suspects; the last one, friction at rest, imitates others, among them contacts that stick and stains.
    """
    first = seen[0]
    duration = float(first.measured.time[-1])
    stretch = 0.5 * max(1e-9, *(float(np.ptp(one.stretch, axis=0).max()) for one in seen))
    width = max(1e-9, *(float(np.ptp(one.elongation, axis=0).max()) for one in seen))
    for i, begun in enumerate(first.held_since):
        if 0.0 < begun < _LATEST * duration:
            yield Fault(f"contact_{i} sticks from {{:.3g}} s on".format, _glue(i), [(begun,)], (0.0,), (duration,))
    if onset is not None and onset < _LATEST * duration:
        guesses = [(onset - part * duration,) for part in _EARLIER]
        for k in range(first.links.size):
            yield Fault(f"link_{k} does not move from {{:.3g}} s on".format, _stick(k), guesses, (0.0,), (duration,))
    yield Fault(
        "actuators have a backlash of {:.3g} m".format, _loosen, [(part * width,) for part in _PARTS], (0.0,), (width,)
    )
    yield Fault(
        lambda b: f"springs harden: stretched by {stretch:.2g} m they are {1 + 3 * b * stretch**2:.3g} times as stiff",
        _harden,
        [(part / stretch**2,) for part in (0.03, 0.3, 1.0)],
        (0.0,),
        (30.0 / stretch**2,),
        True,
        True,
    )
    yield Fault(
        "springs have hysteresis: {:.3g} times their stiffness, which yields at {:.3g} m".format,
        _remember,
        [(1.0, part * stretch) for part in _PARTS],
        (0.0, 1e-3 * stretch),
        (20.0, stretch),
        True,
        True,
    )
    yield Fault(
        lambda part: f"friction changes by {100 * part:+.3g} % during the recording",
        lambda s, part: Changed(friction=np.ones(s.place.shape) + part * s.part[:, None]),
        [(-0.3,), (0.3,)],
        (-0.95,),
        (5.0,),
    )
    yield Fault(
        lambda late: f"actuators reach what is commanded with a time constant of {1e3 * late:.3g} ms",
        _follow_late,
        [(0.01,), (0.05,)],
        (0.0,),
        (1.0,),
    )
    if cheap:
        yield Fault(
            "viscosity: {:.3g} N s/m at each contact".format,
            lambda s, viscosity: Changed(dynamics=Dynamics(0.0, 0.0, viscosity)),
            [(0.1,), (0.3,), (1.0,)],
            (1e-3,),
            (100.0,),
            imitates=True,
        )
        yield Fault(  # with dampers, which imitate viscosity
            lambda mass, _: f"inertia: a mass of {1e3 * mass:.3g} g at each contact",
            lambda s, mass, drag: Changed(dynamics=Dynamics(mass, drag)),
            [(0.01, 0.05), (0.05, 0.2)],
            (1e-3, 0.0),
            (1.0, 10.0),
        )
    half = 0.5 * max(float(np.ptp(one.place)) for one in seen)
    yield Fault(
        lambda size, _: f"a lens bends positions by {size:.3g} m at the edge",
        _bend,
        [(0.01 * half, 0.1)],
        (-_LENS * half, -0.5),
        (_LENS * half, 0.5),
    )
    yield Fault(
        lambda part: f"friction at rest is {100 * part:.3g} % larger than of sliding",
        lambda s, part: Changed(friction=1.0 + part * s.rests),
        [(0.2,), (0.6,)],
        (0.0,),
        (1.0,),
    )


def find_stain(edges: np.ndarray, factors: np.ndarray, weight: np.ndarray) -> Fault:
    """Build the suspect of a stain from the friction along the way.

    Args:
        edges: of parts of the way, shape (B + 1,) [m].
        factors: of friction in each part, shape (B,) [1].
        weight: by how much each part is seen, shape (B,).

    Returns:
        The suspect, whose numbers are the middle and the length of the stain [m], and how much more than elsewhere
        friction is there [1].
    """
    low, high = float(edges[0]), float(edges[-1])
    best, guess = np.inf, (0.5 * (low + high), float(edges[1] - edges[0]), 0.5)
    for first, last in itertools.combinations(range(edges.size), 2):
        on = (np.arange(factors.size) >= first) & (np.arange(factors.size) < last)
        if weight[on].sum() * weight[~on].sum() > 0.0:
            there, elsewhere = (float(np.average(factors[part], weights=weight[part])) for part in (on, ~on))
            wrong = float(weight @ (factors - np.where(on, there, elsewhere)) ** 2)
            if wrong < best:
                begin, end = float(edges[first]), float(edges[last])
                best, more = wrong, min(max(there / elsewhere - 1.0, -0.9), 3.0)
                guess = (0.5 * (begin + end), end - begin, more)
    return Fault(
        lambda at, size, more: (
            f"a stain from {at - size / 2:.3g} m to {at + size / 2:.3g} m has {1 + more:.3g} times the friction"
        ),
        lambda s, at, size, more: Changed(friction=1.0 + more * is_inside(s, at - 0.5 * size, at + 0.5 * size)),
        [guess],
        (low, 0.02 * (high - low), -0.95),
        (high, high - low, 20.0),
        True,
    )


def is_inside(seen: Seen, low: float, high: float) -> np.ndarray:
    """Tell which contacts are between two places, as a number between 0 and 1 at the borders.

    Args:
        seen: the recording.
        low: the first place [m].
        high: the second one [m].

    Returns:
        Shape (K, N).
    """
    border = max(_BORDER * float(np.ptp(seen.place)), 1e-12)
    return np.asarray(np.clip((0.5 * (high - low) - np.abs(seen.place - 0.5 * (low + high))) / border + 0.5, 0.0, 1.0))


def _lengthen(seen: Seen, more: np.ndarray) -> np.ndarray:
    commands = seen.measured.commands.copy()
    commands[:, seen.links] += more
    return commands


def _follow_late(seen: Seen, late: float) -> Changed:
    """Let each link approach its command at a rate of its distance from it, exactly for straight commands."""
    at, parts = seen.measured.command_time, np.arange(_FINER) / _FINER
    time = np.append((at[:-1, None] + np.diff(at)[:, None] * parts).ravel(), at[-1])
    commands = interpolate_rows(time, at, seen.measured.commands)
    own = commands[:, seen.links]
    step = np.diff(time)
    behind, left = np.zeros(own.shape), np.exp(-step / max(late, 1e-9))
    lost = (1.0 - left)[:, None] * late * np.diff(own, axis=0) / step[:, None]
    for k in range(step.size):
        behind[k + 1] = left[k] * behind[k] + lost[k]
    commands[:, seen.links] = own - behind
    return Changed(commands, time)


def _loosen(seen: Seen, width: float) -> Changed:
    own = seen.measured.commands[:, seen.links]
    return Changed(_lengthen(seen, _play(own, 0.5 * width) - own))


def _play(rows: np.ndarray, half: float) -> np.ndarray:
    """Follow rows at a distance of at most `half`, from the middle."""
    every = np.arange(rows.shape[1])
    return Backlash(every, np.full(every.size, half), np.zeros(every.size)).lead_along(rows[0], rows)


def _harden(seen: Seen, cubic: float) -> Changed:
    more = -cubic * seen.stretch**3
    return Changed(_lengthen(seen, more - more[0]))


def _remember(seen: Seen, ratio: float, width: float) -> Changed:
    return Changed(_lengthen(seen, -ratio * (seen.elongation - _play(seen.elongation, width))))


def bend_positions(values: np.ndarray, ground: np.ndarray, size: float, aside: float) -> np.ndarray:
    """Remove what a lens does.

    Args:
        values: what was measured, shape (T, M) [m].
        ground: which channels are positions, bool, shape (M,).
        size: by how much it bends positions at the edge [m].
        aside: how far its axis is from the middle, as a part of half the picture [1].

    Returns:
        The values without the lens, shape (T, M) [m].
    """
    if not ground.any():
        return values
    straight = values.copy()
    low, high = np.nanmin(values[:, ground]), np.nanmax(values[:, ground])
    half = max(0.5 * (high - low), 1e-12)
    straight[:, ground] -= size * ((values[:, ground] - 0.5 * (low + high)) / half - aside) ** 3
    return straight


def _bend(seen: Seen, size: float, aside: float) -> Changed:
    return Changed(values=bend_positions(seen.measured.values, seen.measured.on_ground, size, aside))


def _glue(contact: int) -> Callable[[Seen, float], Changed]:
    def change(seen: Seen, onset: float) -> Changed:
        factor, time = np.ones(seen.place.shape), seen.measured.command_time
        step = np.maximum(np.gradient(time), 1e-9)
        factor[:, contact] += (_HELD - 1.0) * np.clip((time - onset) / step + 0.5, 0.0, 1.0)
        return Changed(friction=factor)

    return change


def _stick(link: int) -> Callable[[Seen, float], Changed]:
    def change(seen: Seen, onset: float) -> Changed:
        time, commands, column = seen.measured.command_time, seen.measured.commands.copy(), seen.links[link]
        commands[:, column] = np.interp(np.minimum(time, onset), time, commands[:, column])
        return Changed(commands)

    return change
