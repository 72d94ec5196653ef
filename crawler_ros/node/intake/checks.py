"""Checks of commands: known names, numbers that can be followed, times of the simulation's clock."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

import numpy as np

from crawler_model.body.columns import Columns
from crawler_model.body.drive import NS
from crawler_model.body.turning import SIDES, check_sides
from crawler_model.errors import LARGEST, CommandError

from .limits import Limits

_MOST_AHEAD_NS = 60 * NS
"""A stamp farther ahead is from another clock."""
_LONGEST_NS = 86_400 * NS
"""A longer trajectory is a mistake; in lock-step all its ticks would run at once."""


def named_columns(
    columns: Columns, names: Sequence[str], only_lengths: bool, what: str = "trajectory"
) -> list[np.ndarray]:
    """Find the columns that the names of a message command.

    Args:
        columns: the columns that can be commanded.
        names: the names in the message.
        only_lengths: whether only links and segments may be named.
        what: name of the message, for the errors.

    Returns:
        The columns of each name.

    Raises:
        CommandError: naming the unknown, unsuitable or repeated name.
    """
    found = []
    for name in names:
        if name not in columns.aliases:
            raise CommandError(f"{what}: no joint is called {name!r}; {_known(columns, name, only_lengths)}")
        found.append(columns.aliases[name])
        if only_lengths and found[-1][0] >= columns.lengths:
            kind = "friction" if columns.kind(int(found[-1][0])) == "friction" else "load"
            items = "links and segments" if columns.joints is None else "links and joints"
            raise CommandError(f"{what}: {name!r} is a {kind}; this topic takes only {items}")
    taken: set[int] = set()
    for name, places in zip(names, found, strict=True):
        if not taken.isdisjoint(places.tolist()):
            raise CommandError(f"{what}: a joint is named twice, at last by {name!r}; name each one once")
        taken.update(places.tolist())
    return found


def _known(columns: Columns, name: str, only_lengths: bool) -> str:
    """List the names that may be used, the nearest first."""
    names = [known for known, at in columns.aliases.items() if not only_lengths or at[0] < columns.lengths]
    near = difflib.get_close_matches(name, names, n=4, cutoff=0.3) or names[:4]
    return f"there are {', '.join(near)}{f' and {len(names) - len(near)} more' if len(names) > len(near) else ''}"


def check_finite(what: str, values: np.ndarray, names: Sequence[str] = ()) -> None:
    """Refuse numbers that are not finite, or so large that products of them would overflow.

    Args:
        what: name of the message, for the error.
        values: shape (M,).
        names: of the values; () to number them.

    Raises:
        CommandError: naming the entry.
    """
    most = np.abs(values).max(initial=0.0)
    if most <= LARGEST:  # not for NaN
        return
    if most < np.inf:
        i = int(np.abs(values).argmax())
        wrong, bound = f"{values[i]:g}", f"at most {LARGEST:g} in size"
    else:
        i = int(np.flatnonzero(~np.isfinite(values))[0])
        wrong, bound = str(values[i]), "finite"
    raise CommandError(f"{what}: {names[i] if names else f'entry {i}'} is {wrong}; it must be {bound}")


def check_points(
    names: Sequence[str], columns: list[np.ndarray], times: np.ndarray, table: np.ndarray, limits: Limits
) -> None:
    """Refuse points that cannot be followed, all at once.

    Args:
        names: of a trajectory, N of them.
        columns: of each name.
        times: time_from_start of each point, shape (P,) [ns].
        table: positions, shape (P, N).
        limits: the largest sizes accepted.

    Raises:
        CommandError: naming the first invalid point and the reason.
    """
    falls = np.flatnonzero(np.diff(times, prepend=0) < 0)
    if falls.size:
        i = int(falls[0])
        before = int(times[i - 1]) if i else 0
        raise CommandError(f"trajectory: point {i} at {times[i]} ns comes before {before} ns; times must not decrease")
    first = np.array([column[0] for column in columns], dtype=np.int64)
    least = np.where((first >= limits.lengths) & (first < limits.lengths + limits.frictions), 0.0, -np.inf)
    fits = (np.abs(table) <= limits.largest[first]) & (table >= least)
    if fits.all():
        return
    i = int(np.argmin(fits.all(axis=1)))
    what = f"trajectory: point {i}"
    check_finite(what, table[i], names)
    for name, low, value in zip(names, least, table[i], strict=True):
        if value < low:
            raise CommandError(f"{what}: {name} is {value:g} N; friction must be >= 0")
    limits.check(what, names, table[i], first)


def spread_friction(columns: Columns, values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Check a command for all frictions, and spread it over the columns.

    Args:
        columns: the layout of the commands.
        values: a single value, one per isolated contact [N] and then per segment [N/m], or all forward and then all
            backward values; for a body that turns forward, backward, left and right of each point in turn.

    Returns:
        One value per column of friction [N, N/m].

    Raises:
        CommandError: on a wrong length, a value that is negative or not finite, or friction given by directions.
    """
    array = np.array(values, dtype=np.float64)
    check_finite("friction command", array)
    sizes, sides = columns.friction_sizes, columns.sides
    if columns.joints is not None:
        return _spread_sides(columns, array)
    if columns.planar:
        raise CommandError("friction command: friction given by directions is constant in this scene")
    if array.size == 1:
        array = np.full(sizes.size, array[0])
    if array.size not in (sizes.size, sides * sizes.size):
        raise CommandError(
            f"friction command has {array.size} value(s); "
            f"it needs 1, {sizes.size} (one per {columns.items('contact')})"
            + (f" or {2 * sizes.size} (all forward, then all backward)" if sides == 2 else "")
        )
    if array.min() < 0.0:
        i = int(np.argmin(array))
        raise CommandError(f"friction command: entry {i} is {array[i]:g} N; friction must be >= 0")
    parts = np.tile(array, sides) if array.size == sizes.size else array
    return np.repeat(parts, np.tile(sizes, sides))


def _spread_sides(columns: Columns, array: np.ndarray) -> np.ndarray:
    """Spread friction over the columns of a body that turns: one value, one per point or four per point."""
    if array.size not in (1, columns.contacts, columns.frictions):
        raise CommandError(
            f"friction command has {array.size} value(s); it needs 1, {columns.contacts} (one per point) or "
            f"{columns.frictions} ({', '.join(SIDES)} of each point in turn)"
        )
    row = np.tile(array, columns.frictions) if array.size == 1 else np.repeat(array, columns.frictions // array.size)
    check_sides(row.reshape(-1, len(SIDES)), "friction command", CommandError)
    return row


def spread_loads(columns: Columns, values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Check the length of a command for all loads, and repeat a single value.

    Args:
        columns: the layout of the commands.
        values: one, or one per isolated contact [N], then per segment [N/m]; in the plane x and y, for all contacts or
            of each in turn.

    Returns:
        One value per isolated contact, then per segment, in the plane x and y of each, shape (loads,) [N, N/m].

    Raises:
        CommandError: on a wrong length, a value that is not finite, or a scene without loads.
    """
    array = np.array(values, dtype=np.float64)
    check_finite("load command", array)
    if not columns.loads:
        raise CommandError("load command: the scene has no loads; add `loads: 0` to the scene to command loads")
    each = 1 if columns.planar is None else 2
    if array.size == each:
        return np.tile(array, columns.loads // each)
    if array.size != columns.loads:
        of = f"one per {columns.items('contact')}" if each == 1 else "x and y of each contact"
        counts = f"give {each} or {columns.loads} ({of})"
        raise CommandError(f"load command has {array.size} value(s); {counts}")
    return array


def check_rows(columns: Columns, in_force: np.ndarray, named: list[np.ndarray], table: np.ndarray) -> None:
    """Refuse points with loads that no equilibrium holds, or with frictions of a point that do not fit together.

    Args:
        columns: the layout of the commands.
        in_force: the command row in force, shape (C,).
        named: the columns of each name of a trajectory, N of them.
        table: positions, shape (P, N).

    Raises:
        CommandError: naming the first such point, with the numbers that do not fit.
    """
    if not any(column[0] >= columns.lengths for column in named):
        return
    for i, values in enumerate(table if columns.loads or columns.joints is not None else ()):
        row = in_force.copy()
        for column, value in zip(named, values, strict=True):
            row[column] = value
        _check_row(columns, row, f"trajectory: point {i}")


def is_held(columns: Columns, row: np.ndarray, in_force: np.ndarray) -> bool:
    """Determine whether a row can be followed as far as its friction and loads go, as `check_rows` does.

    Commands that were checked one by one may not fit together.

    Args:
        columns: the layout of the commands.
        row: a command row, shape (C,).
        in_force: the row before it, shape (C,).

    Returns:
        True unless a row of loads, or of four frictions a point, that differs from the one before cannot be followed.
    """
    first = columns.lengths
    if not (columns.loads or columns.joints is not None) or row[first:].tobytes() == in_force[first:].tobytes():
        return True
    try:
        _check_row(columns, row, "commands")
    except CommandError:
        return False
    return True


def _check_row(columns: Columns, row: np.ndarray, where: str) -> None:
    if columns.joints is not None:
        sides = row[columns.lengths : columns.lengths + columns.frictions].reshape(-1, len(SIDES))
        check_sides(sides, where, CommandError)
    columns.check_equilibrium(columns.target(row), where, CommandError)


def check_times(stamp_ns: int, now_ns: int, tick_ns: int, last_ns: int) -> None:
    """Refuse a trajectory that was stamped by another clock.

    Args:
        stamp_ns: when it starts [ns, simulated].
        now_ns: simulated time [ns].
        tick_ns: duration of a tick [ns].
        last_ns: time_from_start of its last point [ns].

    Raises:
        CommandError: when it starts before time 0 or far ahead, or lasts too long.
    """
    if stamp_ns < 0:
        raise CommandError(f"trajectory: stamp {stamp_ns} ns; simulated time starts at 0")
    ahead, most = stamp_ns - now_ns, _MOST_AHEAD_NS + tick_ns
    if ahead > most:
        raise CommandError(
            f"trajectory: stamp {stamp_ns / NS:g} s is {ahead / NS:g} s ahead of simulated time; at most "
            f"{most / NS:g} s are allowed; stamps are simulated time, as in joint_states, and 0 starts at once"
        )
    if last_ns > _LONGEST_NS:
        raise CommandError(
            f"trajectory: time_from_start of the last point is {last_ns / NS:g} s; "
            f"at most {_LONGEST_NS / NS:g} s are allowed"
        )
