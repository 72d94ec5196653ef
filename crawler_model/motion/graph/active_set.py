"""Velocities of a body with any connected springs: exact, by an active-set method on the contacts.

    minimise  1/2 v' K v - r' v + sum_i phi_i(v_i),   phi_i(v) = upper_i v for v > 0, lower_i v for v < 0

over the velocities v of N contacts, with the stiffness matrix K of the graph. It is a catch-up step if r are the trial
spring forces and lower, upper = -mu_minus, mu_plus, and the rate problem of an exact ramp if r are rates of forces and
the bounds are rates of friction, infinite where a contact cannot slide in that direction. It is the dual of the
projection that chains solve in the tensions (`chain.projection`).

Each contact is stuck or slides in one direction. For the sliding contacts the minimum solves a linear system
(`elimination`). The step towards it ends where the objective is least on the way, for each group of sliding contacts on
its own: contacts that would reverse their direction do so, or stick. If none does, the contacts whose force is beyond
its bound are released. Every round lowers the objective, so the search terminates. It is warm-started with the contacts
that slid before, and inside a ramp with their velocities: few rounds then find the contacts that stick.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...body.body import Body
from ...compiled import inlined, lean
from ...errors import SceneError
from ...rounding import EPS, NOISE
from .descent import relax, search
from .elimination import WIDE, eliminate, pull_at

_MOST_NUMBERS = 50_000_000
_FEW_ROUNDS = 8
"""Rounds after which contacts that begin to slide are found by a sweep. Released contacts begin to slide at once, but
their neighbours are found only in later rounds: where blocks grow by many contacts, that takes as many rounds."""


class Layout(NamedTuple):
    """Which springs join which contacts, and the order of the contacts in the band.

    Attributes:
        order: contact at each position in the band, int, shape (N,).
        place: position of each contact, int, shape (N,).
        starts: first of the ends of springs at each contact in the next two, and 2 S, int, shape (N + 1,).
        others: the contact at the other end, int, shape (2 S,).
        springs: the spring, int, shape (2 S,).
        heads: first of the neighbours of each position in `near`, and their number, int, shape (N + 1,).
        near: the positions in the band that springs join to a position, increasing, int.
    """

    order: np.ndarray
    place: np.ndarray
    starts: np.ndarray
    others: np.ndarray
    springs: np.ndarray
    heads: np.ndarray
    near: np.ndarray


class Network(NamedTuple):
    """The springs as conductances between the contacts, in an order in which they are a narrow band.

    Attributes:
        layout: which springs join which contacts, and their order.
        conductances: stiffness of the springs to each of the contacts `layout.near`, shape (C,), of variations (M, C)
            [N/m].
        width: largest distance of two contacts in the order that a spring joins.
    """

    layout: Layout
    conductances: np.ndarray
    width: int

    @property
    def order(self) -> np.ndarray:
        """Contact at each position in the band, int, shape (N,)."""
        return self.layout.order


def build_network(body: Body) -> Network:
    """Order the contacts of a body so that its stiffness matrix is a narrow band.

    Args:
        body: any body on a line, or variations of it that differ in their stiffness.

    Returns:
        Its springs as conductances.

    Raises:
        SceneError: if the band would not fit in memory.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    n = body.contacts
    a, b = body.ends.T
    graph = coo_matrix((np.ones(2 * a.size), (np.concatenate((a, b)), np.concatenate((b, a)))), shape=(n, n)).tocsr()
    order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    place = np.argsort(order)
    ends = place[body.ends]  # positions of the two contacts of each spring
    width = int(np.abs(ends[:, 1] - ends[:, 0]).max())
    if n * width > _MOST_NUMBERS:
        raise SceneError(
            f"body.links.between: the links of {n} contacts need a band matrix with {n * width:.1e} entries; "
            f"at most {_MOST_NUMBERS:.0e} are allowed"
        )
    at, others, springs = np.concatenate((a, b)), np.concatenate((b, a)), np.tile(np.arange(a.size), 2)
    sort = np.argsort(at, kind="stable")
    each = np.arange(n + 1)
    starts = np.searchsorted(at[sort], each)
    pairs, joint = np.unique(place[at] * n + place[others], return_inverse=True)
    heads, near = np.searchsorted(pairs // n, each), pairs % n
    conductances = np.zeros((*body.stiffness.shape[:-1], near.size))
    np.add.at(conductances, (..., joint), body.stiffness[..., springs])  # type: ignore[arg-type]
    layout = Layout(order, place, starts, others[sort], springs[sort], heads, near)
    return Network(layout, conductances, width)


def most_rounds(contacts: int) -> int:
    """Compute the number of rounds after which the active set of a graph stops without a solution.

    Args:
        contacts: number of contacts N.

    Returns:
        Rounds of `move`, many times more than were ever observed.
    """
    return 200 + 40 * contacts


def workspace(network: Network) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Allocate the scratch memory of `move`.

    Args:
        network: the springs.

    Returns:
        Rows of the band, floats of shape (5, N), whole numbers of shape (5, N) and flags of shape (N,).
    """
    n = network.order.size
    # elimination multiplies numbers of contacts that it does not solve for by zero, so they have to be finite
    return np.empty((n, network.width)), np.zeros((5, n)), np.empty((5, n), np.int64), np.zeros(n, np.int8)


@inlined
def move(net, load, lower, upper, magnitude, most_rounds, work, floats, ints, sliding, velocity, side, places):
    """Solve for the velocities; all arrays in the order of the band.

    Args:
        net: conductances of the `Network`, and heads and near of its `Layout`.
        load: r, shape (N,) [N].
        lower: smallest force at rest, shape (N,) [N], -inf where there is none.
        upper: largest force at rest, shape (N,) [N], inf where there is none; lower <= upper.
        magnitude: magnitude of the numbers whose differences load and bounds are, shape (N,) [N].
        most_rounds: upper limit of rounds.
        work: memory from `workspace`, which also allocates the next three.
        floats: forces, magnitudes, loads and trial velocities.
        ints: for `eliminate`.
        sliding: 1 for sliding contacts during the call, else zeros.
        velocity: output, shape (N,). On entry where the search begins: zeros, or the solution of a similar problem.
        side: output, int8, shape (N,): 1 where the force is at its upper bound, -1 at its lower bound, else 0. A force
            within rounding of a bound counts as on it. On entry a guess of the directions in which contacts slide.
        places: positions of the contacts to solve for, increasing, int, shape (P,): all of them, or contacts that can
            slide and all that springs join to them. The other contacts must be at rest or separated from these by
            contacts without bounds, which cannot slide; their velocities are read but not written.

    Returns:
        0 if the translation is determined, 1 if all contacts slide and nothing fixes it (the last contact is then at
        rest), -1 if it did not converge; and the number of rounds.
    """
    found = _search_sides(
        net, load, lower, upper, magnitude, most_rounds, work, floats, ints, sliding, velocity, side, places
    )
    for p in places:
        sliding[p] = 0
    return found


@lean
def _find_sides(lower, upper, magnitude, force, size, velocity, side, places):
    """Set velocities that are rounding to zero, and find the contacts at rest whose force is at a bound."""
    largest = 0.0
    for p in places:
        largest = max(largest, abs(velocity[p]))
    for p in places:
        if abs(velocity[p]) <= NOISE * largest:
            velocity[p] = 0.0
        if side[p] == 0 and (upper[p] < np.inf or lower[p] > -np.inf):
            close = 32.0 * EPS * (size[p] + magnitude[p])
            if upper[p] - force[p] <= close:
                side[p] = 1
            elif force[p] - lower[p] <= close:
                side[p] = -1


@inlined
def _search_sides(net, load, lower, upper, magnitude, most_rounds, work, floats, ints, sliding, velocity, side, places):
    """Search for the sides of the contacts; see `move`."""
    ground, size, force, total, trial = floats[0], floats[1], floats[2], floats[3], floats[4]
    groups = ints[1]
    for p in places:
        if (upper[p] if side[p] == 1 else -lower[p]) == np.inf:
            side[p] = 0
        if side[p] * velocity[p] <= 0.0:
            velocity[p] = 0.0
    grounded = True
    for turn in range(most_rounds):
        # the minimum for the sliding contacts
        mean = 0.0
        scale = 0.0
        free = True
        for p in places:
            sliding[p] = side[p] != 0
            free = free and sliding[p]
            total[p] = load[p] - (upper[p] if side[p] == 1 else lower[p] if side[p] == -1 else 0.0)
            mean += total[p]
            scale += abs(load[p]) + magnitude[p] + (abs(load[p] - total[p]))
        if free and abs(mean) > 64.0 * EPS * scale:
            # no contact holds the body: it moves in the direction of the mean force until a contact sticks
            direction = 1.0 if mean > 0.0 else -1.0
            first = -1
            far = np.inf
            for p in places:
                if side[p] * direction < 0.0 and abs(velocity[p]) < far:
                    far = abs(velocity[p])
                    first = p
            if first < 0:
                return -1, turn + 1
            for p in places:
                velocity[p] += direction * far
            side[first] = 0
            velocity[first] = 0.0
            continue
        grounded = eliminate(net, work, ground, ints, total, sliding, trial, places)
        if not grounded:
            # the translation is free: choose one for which all contacts slide in their directions, if possible
            least = -np.inf
            most = np.inf
            for p in places:
                if side[p] == 1:
                    least = max(least, -trial[p])
                else:
                    most = min(most, -trial[p])
            away = 0.5 * (least + most) if least > -np.inf and most < np.inf else (least if most == np.inf else most)
            for p in places:
                trial[p] += away
        # stop where the cost is least, or at a contact that would reverse its direction and may not
        largest = 0.0
        for p in places:
            largest = max(largest, abs(trial[p]))
        close = 16.0 * EPS * largest
        may_pass = grounded and 2 * turn < most_rounds
        parts = force  # memory that is free until the forces are computed
        turned = search(net, lower, upper, velocity, trial, side, sliding, close, may_pass, parts, groups, places)
        for p in places:
            if side[p] == 0:
                continue
            was = velocity[p]
            velocity[p] = was + parts[p] * (trial[p] - was) if parts[p] < 1.0 else trial[p]
            if side[p] * trial[p] < -close and side[p] * velocity[p] <= 4.0 * EPS * abs(was):
                passed = side[p] * velocity[p] < -4.0 * EPS * abs(was)
                side[p] = -side[p] if passed else 0
                velocity[p] = velocity[p] if passed else 0.0
            elif side[p] * velocity[p] < 0.0:
                velocity[p] = 0.0
        if turned:
            # A round finds only the first contact of each group that stops, and in a wide band takes much longer than a
            # sweep. In a narrow band groups are long, and a sweep, which passes on changes from neighbour to neighbour,
            # would stop contacts that the whole group moves on.
            if may_pass and turn < _FEW_ROUNDS and work.shape[1] > WIDE:
                relax(net, load, lower, upper, magnitude, False, velocity, side, places)
                relax(net, load, lower, upper, magnitude, True, velocity, side, places)
            continue
        # release contacts whose force is beyond its bound
        worst = -1
        excess = 0.0
        count = 0
        for p in places:
            if side[p] != 0 or (upper[p] == np.inf and lower[p] == -np.inf):
                continue
            force[p], size[p], _ = pull_at(net, velocity, load, p)
            close = 32.0 * EPS * (size[p] + magnitude[p])
            above, below = force[p] - upper[p], lower[p] - force[p]
            if max(above, below) > close:
                count += 1
                if max(above, below) > excess:
                    excess = max(above, below)
                    worst = p
                if turn < _FEW_ROUNDS and 2 * turn < most_rounds:
                    side[p] = 1 if above > below else -1
        if count == 0:
            _find_sides(lower, upper, magnitude, force, size, velocity, side, places)
            return (0 if grounded else 1), turn + 1
        if turn >= _FEW_ROUNDS and 2 * turn < most_rounds:
            relax(net, load, lower, upper, magnitude, turn % 2 == 1, velocity, side, places)
        elif 2 * turn >= most_rounds:  # rounding may have caused a cycle: one contact at a time is slow but safe
            side[worst] = 1 if force[worst] > upper[worst] else -1
    return -1, most_rounds
