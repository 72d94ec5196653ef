"""The layout of command rows: the columns, their names, and how they map to springs and contacts.

A command row holds, in this order, the rest length of each link (m), the strain of each segment, the friction against
sliding forward of each isolated contact (N) and of each segment (N/m), and the same for sliding backward. A segment
whose strain or friction varies along it has one column per element or contact instead of a single one. If the
scene has loads, they follow: one per isolated contact (N) and per segment (N/m). In the plane each link has two columns
(x, y), and each contact has one friction, or one per direction, and with loads two columns (x, y). If a body turns,
each link has one column (m), each joint one (rad), and each point four frictions, forward, backward, left and right.

A target is the input of the kernels: one rest length per spring, then the forward and the backward bound of
every contact on the force of its springs. With loads f these bounds are mu_plus - f and mu_minus + f, and f follows;
without loads they are mu_plus and mu_minus. In the plane, where a load shifts the set of friction forces, a target
holds the rest lengths, the friction and with loads f.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from ..errors import CrawlerError, SceneError
from .names import name_each
from .planar_loads import check_planar_equilibrium
from .turning import SIDES

_NONE = np.zeros(0, np.int64)


@dataclass(frozen=True, eq=False)
class Columns:
    """The layout of a command row and its conversion to a target.

    Attributes:
        links: number of links.
        contacts: number of isolated contacts.
        segments: for each segment its name, number of strain columns and number of friction columns per side.
        planar: in the plane, the number of friction directions, 0 for isotropic friction, 4 for a body that turns;
            None on a line.
        index: for each entry of the target, the column from which it is read, shape (S + 2 N,), with loads (S + 3 N,).
        factor: factor by which that column is multiplied, of the same shape.
        slope_load: with loads, what the slope adds to the load of each contact, shape (N,), for variations (M, N), in
            the plane (N, 2) [N]; None without loads.
        directions: in the plane, unit vectors of friction directions fixed to the ground, shape (m, 2); None on a line.
        patched: whether the ground changes with place, so that only the motion shows whether friction holds the loads.
        joints: number of joints of a body that turns; None for all others.
        further: what is added to entries of contacts that several parts share: the entries, the columns and their
            factors, shape (A,) each.
    """

    links: int
    contacts: int
    segments: tuple[tuple[str, int, int], ...]
    planar: int | None
    index: np.ndarray
    factor: np.ndarray
    slope_load: np.ndarray | None = None
    directions: np.ndarray | None = None
    patched: bool = False
    joints: int | None = None
    further: tuple[np.ndarray, np.ndarray, np.ndarray] = (_NONE, _NONE, _NONE)

    @functools.cached_property
    def actuation_sizes(self) -> np.ndarray:
        """Number of columns of each link, then of each segment's strain or of each joint."""
        if self.joints is not None:
            return np.ones(self.links + self.joints, dtype=np.int64)
        each = 1 if self.planar is None else 2
        return np.array([each] * self.links + [strain for _, strain, _ in self.segments], dtype=np.int64)

    @functools.cached_property
    def friction_sizes(self) -> np.ndarray:
        """Number of columns per side of each isolated contact, then of each segment, shape (contacts + segments,)."""
        each = max(self.planar or 0, 1)
        return np.array([each] * self.contacts + [friction for _, _, friction in self.segments], dtype=np.int64)

    @functools.cached_property
    def lengths(self) -> int:
        """Number of columns with rest lengths and strains; the other columns hold friction."""
        return int(self.actuation_sizes.sum())

    @functools.cached_property
    def plain_lengths(self) -> tuple[int, ...] | None:
        """Shape of the lengths of a command that has a number for each column; None where parts have several."""
        sizes = self.actuation_sizes
        each = int(sizes[0]) if self.planar is not None and sizes.size else 1
        if (sizes != each).any():
            return None
        return (sizes.size,) if each == 1 else (sizes.size, each)

    @functools.cached_property
    def frictions(self) -> int:
        """Number of columns that hold friction."""
        return self.sides * int(self.friction_sizes.sum())

    @property
    def loads(self) -> int:
        """Number of columns that hold loads: one (in the plane two) per isolated contact and segment; 0 if none."""
        return 0 if self.slope_load is None else int(self.load_sizes.sum())

    @functools.cached_property
    def load_sizes(self) -> np.ndarray:
        """Number of load columns of each isolated contact, then of each segment, if there are loads."""
        each = 1 if self.planar is None else 2
        return np.array([each] * self.contacts + [1] * len(self.segments), dtype=np.int64)

    @functools.cached_property
    def count(self) -> int:
        """Number of columns C."""
        return self.lengths + self.frictions + self.loads

    @property
    def sides(self) -> int:
        """2 on a line, forward and backward; 1 in the plane."""
        return 2 if self.planar is None else 1

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, shape (C,)."""
        contacts, names = name_each("contact", self.contacts), name_each("link", self.links)
        if self.planar is not None:
            suffixes = [f"direction_{k}" for k in range(self.planar)] or ["friction"]
            if self.joints is None:
                names = [f"{link}/{axis}" for link in names for axis in "xy"]
            else:
                names, suffixes = names + name_each("joint", self.joints), list(SIDES)
            names += [f"{contact}/{suffix}" for contact in contacts for suffix in suffixes]
            loads = [f"{contact}/load_{axis}" for contact in contacts for axis in "xy"]
            return (*names, *loads[: self.loads])
        for name, strain, _ in self.segments:
            names += [name] if strain == 1 else [f"{name}/element_{j}" for j in range(strain)]
        for side in ("forward", "backward"):
            names += [f"{contact}/{side}" for contact in contacts]
            for name, _, friction in self.segments:
                each = [f"{name}/contact_{j}/{side}" for j in range(friction)]
                names += [f"{name}/{side}"] if friction == 1 else each
        if self.loads:
            names += [f"{contact}/load" for contact in contacts]
            names += [f"{name}/load" for name, _, _ in self.segments]
        return tuple(names)

    @functools.cached_property
    def aliases(self) -> dict[str, np.ndarray]:
        """Columns set by each name: names of single columns, of whole segments, and of all sides together."""
        # direction-dependent friction cannot be commanded, as it has to stay convex
        aliases = {name: np.array([i]) for i, name in enumerate(self.names) if "/direction_" not in name}
        if self.joints is not None:
            for i, contact in enumerate(name_each("contact", self.contacts)):
                aliases[f"{contact}/friction"] = self.lengths + len(SIDES) * i + np.arange(len(SIDES))
        if self.planar is not None:
            return aliases
        first = self.links
        for name, strain, _ in self.segments:
            aliases[name] = np.arange(first, first + strain)
            first += strain
        parts = name_each("contact", self.contacts) + [name for name, _, _ in self.segments]
        half = int(self.friction_sizes.sum())
        starts = self.lengths + np.concatenate(([0], np.cumsum(self.friction_sizes)[:-1]))
        for name, start, size in zip(parts, starts, self.friction_sizes, strict=True):
            forward = np.arange(start, start + size)
            aliases[f"{name}/forward"], aliases[f"{name}/backward"] = forward, forward + half
            aliases[f"{name}/friction"] = np.concatenate((forward, forward + half))
        return aliases

    def check_two_sided(self, side: str) -> None:
        """Check that friction is only forward and backward.

        Args:
            side: the side asked for, for the error message.

        Raises:
            SceneError: if the body turns.
        """
        if self.joints is not None:
            raise SceneError(f"{side}: a body that turns has friction in four directions; read `friction`")

    def items(self, item: str) -> str:
        """Return the noun for what a command addresses.

        Args:
            item: "link" or "contact".

        Returns:
            The same noun, with "and segment" appended if there are segments.
        """
        return f"{item} and segment" if self.segments else item

    def kind(self, column: int) -> str:
        """Name the key of a drive that a column comes from.

        Args:
            column: its number.

        Returns:
            "actuation", "friction" or "loads".
        """
        if column < self.lengths:
            return "actuation"
        return "friction" if column < self.lengths + self.frictions else "loads"

    def spread(self, rows: np.ndarray) -> np.ndarray:
        """Spread command rows over springs and contacts: a target but for the loads, which shift bounds.

        Args:
            rows: shape (..., C).

        Returns:
            Shape (..., S + 2 N), with loads (..., S + 3 N) [m, N].
        """
        values = np.take(rows, self.index, axis=-1) * self.factor
        for entry, column, factor in zip(*self.further, strict=True):
            values[..., entry] += rows[..., column] * factor
        return values

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Gather a command row from what it was spread to.

        Where the contacts that parts share leave a row open, it is one that is spread to the same values.

        Args:
            values: as from `spread`, the entries first, shape (S + 2 N, ...), with loads (S + 3 N, ...).

        Returns:
            Shape (C, ...).
        """
        factor = self.factor.reshape(-1, *(1,) * (values.ndim - 1))
        shared = np.unique(self.further[0])
        alone = np.delete(np.arange(self.index.size), shared)
        found, first = np.unique(self.index[alone], return_index=True)
        row = np.zeros((self.count, *values.shape[1:]))
        row[found] = values[alone[first]] / factor[alone[first]]
        lacking = np.delete(np.arange(self.count), found)
        if lacking.size:
            matrix = self.spread(np.eye(self.count))[:, shared].T
            left = values[shared] - np.tensordot(matrix, row, axes=1)
            solved = np.linalg.lstsq(matrix[:, lacking], left.reshape(shared.size, -1), rcond=None)[0]
            row[lacking] = solved.reshape(lacking.size, *values.shape[1:])
        return row

    def target(self, rows: np.ndarray) -> np.ndarray:
        """Convert command rows to targets.

        Args:
            rows: shape (..., C); for variations of the load of the slope (..., W, C).

        Returns:
            Shape (..., S + 2 N), with loads (..., S + 3 N) [m, N]; `rows` itself if no conversion is needed.
        """
        if self.is_plain:
            return rows
        target = self.spread(rows)
        if self.slope_load is not None and self.planar is not None:
            target[..., target.shape[-1] - self.slope_load.size :] += self.slope_load.ravel()
        elif self.slope_load is not None:
            slope, n = self.slope_load, self.slope_load.shape[-1]
            if slope.ndim == 2:
                slope = slope[:, None, :]
                target = np.broadcast_to(target, (slope.shape[0], *target.shape[-2:])).copy()
            forward, backward, load = (target[..., target.shape[-1] - k * n :][..., :n] for k in (3, 2, 1))
            load += slope
            forward -= load
            backward += load
        return target

    def held_target(self, row: np.ndarray, actuation: np.ndarray, bounds: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """Convert a command row to a target; where the row is NaN, the value in force remains.

        Args:
            row: shape (C,).
            actuation: L in force, shape (S,), in the plane (2 S,) [m].
            bounds: of the spring forces in force, shape (F,) [N].
            loads: in force, the slope's share included, shape (N,), in the plane (N, 2), or empty without loads [N].

        Returns:
            The target.
        """
        target = self.target(row).copy()
        if self.slope_load is None or self.planar is not None:
            held = np.isnan(target)
            target[held] = np.concatenate((actuation, bounds, loads.ravel()))[held]
            return target
        n = loads.size
        lengths = target[: -3 * n]
        raw = self.spread(row)
        forward, backward, load = raw[-3 * n :].reshape(3, n)
        now = np.where(np.isnan(load), loads, load + self.slope_load)
        lengths[np.isnan(lengths)] = actuation[np.isnan(lengths)]
        shifted = loads - now  # by which bounds that are held move
        target[-3 * n : -2 * n] = np.where(np.isnan(forward), bounds[:n] + shifted, forward - now)
        target[-2 * n : -n] = np.where(np.isnan(backward), bounds[n:] - shifted, backward + now)
        target[-n:] = now
        return target

    def row(self, actuation: np.ndarray, friction: np.ndarray, loads: np.ndarray) -> np.ndarray:
        """Read back the command row in force.

        Args:
            actuation: L in force, shape (S,), in the plane (2 S,) [m].
            friction: in force, shape (F,) [N].
            loads: in force, the slope's share included, shape (N,), in the plane (N, 2), or empty without loads [N].

        Returns:
            Shape (C,).
        """
        own = (loads - self.slope_load if self.slope_load is not None else loads).ravel()
        return self.gather(np.concatenate((actuation, friction, own)))

    def check_equilibrium(self, target: np.ndarray, where: str, error: type[CrawlerError]) -> None:
        """Check that friction can hold the loads of a command: -sum mu_minus <= sum f <= sum mu_plus.

        In the plane the sum of the loads has to lie in the sum of the sets of friction forces.

        Args:
            target: L, bounds and loads, shape (S + 3 N,), or (S + 2 N,) without loads.
            where: what to call the command.
            error: the class of the error.

        Raises:
            CrawlerError: of that class, with the sums that do not fit, if nothing would stop the body.
        """
        if self.slope_load is None or self.patched:
            return
        n = self.slope_load.size
        if self.directions is not None:
            friction = target[self.lengths : target.size - n].reshape(self.contacts, -1)
            if self.joints is not None:  # whichever way the points are turned
                friction = friction.max(axis=1, keepdims=True)
            check_planar_equilibrium(target[-n:].reshape(-1, 2), friction, self.directions, where, error)
            return
        forward, backward, load = target[-3 * n :].reshape(3, n)
        total = float(load.sum())
        sides = ("forward", total, forward + load), ("backward", -total, backward - load)
        for lacks, (side, pull, friction) in zip(self.lacks_equilibrium(target), sides, strict=True):
            if lacks:
                raise error(
                    f"{where}: the loads sum to {pull:g} N {side}, but friction against sliding {side} to "
                    f"{float(friction.sum()):g} N: no equilibrium, the body would run away"
                )

    def lacks_equilibrium(self, targets: np.ndarray) -> np.ndarray:
        """Find the commands on a line whose loads friction cannot hold.

        Args:
            targets: L, bounds and loads, shape (..., S + 3 N).

        Returns:
            Whether it cannot hold them forward, and backward, shape (2, ...).
        """
        assert self.slope_load is not None
        n = self.slope_load.shape[-1]
        forward, backward = (np.ascontiguousarray(targets[..., -k * n :][..., :n]) for k in (3, 2))
        near = 1e-12 * (forward + backward).sum(axis=-1)
        return np.stack((forward.sum(axis=-1) < -near, backward.sum(axis=-1) < -near))

    @functools.cached_property
    def is_plain(self) -> bool:
        """Whether a row equals its target, as for bodies without segments and loads."""
        if self.slope_load is not None:
            return False
        same = self.count == self.index.size and (self.index == np.arange(self.count)).all()
        return bool(same and (self.factor == 1.0).all())
