"""The motion of a body of any connected springs: exact, by an active set on the contacts.

    minimise  1/2 v' K v - r' v + sum_i phi_i(v_i),   phi_i(v) = upper_i v for v > 0, lower_i v for v < 0

over the velocities v of N contacts, K the stiffness matrix of the graph. It is a catch-up step when r are the trial
spring forces and lower, upper = -mu_minus, mu_plus, and the rate problem of an exact tick when r are rates of forces
and the bounds are rates of friction, infinite where a contact cannot slide that way. The dual of the projection that
`chain_kernel` solves in the tensions.

Each contact is stuck or slides in one direction. Among those that slide, the minimum solves a linear system; the way
there is cut short where a contact would turn round, which then sticks. When nobody turns round, the contacts whose
force is beyond its bound are set free. Every round lowers the objective, so that the search ends. It is warm-started
with who slid last time.

The linear system is eliminated like a network of resistors (star to mesh): conductances are only ever added, never
subtracted, so that stiffness ratios cost no digits. Contacts are numbered so that springs join near numbers (reverse
Cuthill-McKee) and a row holds only the `band` next ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...body.body import Body
from ...compiled import compiled
from ...errors import SceneError
from ..translation import NOISE

EPS = float(np.finfo(np.float64).eps)

_MOST_NUMBERS = 50_000_000


class Network(NamedTuple):
    """The springs as a band matrix of conductances.

    Attributes:
        order: contact at each place of the band, int, shape (N,).
        band: stiffness between the contacts at places p and p + 1 + d, shape (N, width) [N/m].
    """

    order: np.ndarray
    band: np.ndarray


def build_network(body: Body) -> Network:
    """Number a body's contacts so that springs join near numbers.

    Args:
        body: any body on a line.

    Returns:
        Its springs as a band matrix.

    Raises:
        SceneError: when the band would not fit in memory.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    n = body.contacts
    a, b = body.ends.T
    graph = coo_matrix((np.ones(2 * a.size), (np.concatenate((a, b)), np.concatenate((b, a)))), shape=(n, n)).tocsr()
    order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.int64)
    ends = np.argsort(order)[body.ends]  # places of the two contacts of each spring
    width = int(np.abs(ends[:, 1] - ends[:, 0]).max())
    if n * width > _MOST_NUMBERS:
        raise SceneError(
            f"body.links.between: {n} contacts are joined so widely that {n * width:.1e} numbers would be needed; "
            f"at most {_MOST_NUMBERS:.0e}"
        )
    band = np.zeros((n, width))
    low, high = ends.min(axis=1), ends.max(axis=1)
    np.add.at(band, (low, high - low - 1), body.stiffness)
    return Network(order, band)


def most_rounds(contacts: int) -> int:
    """Tell after how many rounds the active set of a graph gives up.

    Args:
        contacts: number of contacts N.

    Returns:
        Rounds of `move`, many times what it has ever taken.
    """
    return 200 + 40 * contacts


def workspace(network: Network) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Make the scratch memory that `move` wants.

    Args:
        network: the springs.

    Returns:
        A copy of the band to eliminate in, floats of shape (5, N) and flags of shape (N,).
    """
    n, width = network.band.shape
    return np.empty((n, width)), np.empty((5, n)), np.zeros(n, np.int8)


@compiled
def eliminate(band, work, ground, load, sliding, result):
    """Solve K v = load over the sliding contacts, the others at rest; all arrays in the order of the band.

    Args:
        band: as in `Network`, shape (N, width) [N/m].
        work: scratch like `band`.
        ground: scratch, shape (N,).
        load: forces, shape (N,) [N].
        sliding: who slides, int8, shape (N,).
        result: output, v, shape (N,).

    Returns:
        False when no contact is at rest. Then the last one is put at rest, and K v = load holds at the others.
    """
    n, width = band.shape
    last = -1
    for p in range(n):
        ground[p] = 0.0
        result[p] = load[p] if sliding[p] else 0.0
        for d in range(width):
            work[p, d] = band[p, d]
    for p in range(n):
        for d in range(min(width, n - 1 - p)):
            k = work[p, d]
            if k != 0.0 and sliding[p] != sliding[p + 1 + d]:
                work[p, d] = 0.0
                if sliding[p]:
                    ground[p] += k
                else:
                    ground[p + 1 + d] += k
    grounded = False
    for p in range(n):
        if not sliding[p]:
            grounded = True
            continue
        last = p
        reach = min(width, n - 1 - p)
        pivot = ground[p]
        for d in range(reach):
            if sliding[p + 1 + d]:
                pivot += work[p, d]
        if pivot == 0.0:
            continue
        for d in range(reach):
            k = work[p, d]
            if k == 0.0 or not sliding[p + 1 + d]:
                continue
            part = k / pivot
            result[p + 1 + d] += part * result[p]
            ground[p + 1 + d] += part * ground[p]
            for e in range(d + 1, reach):
                if work[p, e] != 0.0 and sliding[p + 1 + e]:
                    work[p + 1 + d, e - d - 1] += part * work[p, e]
    for p in range(last, -1, -1):
        if not sliding[p]:
            continue
        pivot = ground[p]
        total = result[p]
        for d in range(min(width, n - 1 - p)):
            if sliding[p + 1 + d]:
                pivot += work[p, d]
                total += work[p, d] * result[p + 1 + d]
        result[p] = total / pivot if pivot > 0.0 else 0.0
    return grounded


@compiled
def _forces(band, v, load, force, size):
    """Compute load - K v, and the sizes of the numbers that it is made of."""
    n, width = band.shape
    for p in range(n):
        force[p] = load[p]
        size[p] = abs(load[p])
    for p in range(n):
        for d in range(min(width, n - 1 - p)):
            k = band[p, d]
            if k != 0.0:
                pull = k * (v[p + 1 + d] - v[p])
                force[p] += pull
                force[p + 1 + d] -= pull
                size[p] += k * (abs(v[p]) + abs(v[p + 1 + d]))
                size[p + 1 + d] += k * (abs(v[p]) + abs(v[p + 1 + d]))


@compiled
def move(band, load, lower, upper, grain, most_rounds, work, floats, sliding, velocity, side):
    """Find the velocities; all arrays in the order of the band.

    Args:
        band: as in `Network`, shape (N, width) [N/m].
        load: r, shape (N,) [N].
        lower: least force at rest, shape (N,) [N], -inf where there is none.
        upper: greatest force at rest, shape (N,) [N], inf where there is none; lower <= upper.
        grain: size of the numbers that load and bounds are differences of, shape (N,) [N].
        most_rounds: rounds after which to give up.
        work: from `workspace`, as are the next two.
        floats: forces, sizes, loads and trial velocities.
        sliding: who slides.
        velocity: shape (N,): output. On entry a guess: only signs matter.
        side: output, int8, shape (N,): 1 where the force is at its upper bound, -1 at its lower, else 0. What lies
            within rounding of a bound counts as on it.

    Returns:
        0 when the translation is determined, 1 when all contacts slide and nothing fixes it (the last contact is then
        at rest), -1 when the rounds were not enough; and how many rounds it took.
    """
    n = load.shape[0]
    ground, size, force, total, trial = floats[0], floats[1], floats[2], floats[3], floats[4]
    for p in range(n):
        side[p] = 0
        if velocity[p] > 0.0 and upper[p] < np.inf:
            side[p] = 1
        elif velocity[p] < 0.0 and lower[p] > -np.inf:
            side[p] = -1
        velocity[p] = 0.0
    grounded = True
    for turn in range(most_rounds):
        # the minimum over those that slide
        mean = 0.0
        scale = 0.0
        free = True
        for p in range(n):
            sliding[p] = side[p] != 0
            free = free and sliding[p]
            total[p] = load[p] - (upper[p] if side[p] == 1 else lower[p] if side[p] == -1 else 0.0)
            mean += total[p]
            scale += abs(load[p]) + grain[p] + (abs(load[p] - total[p]))
        if free and abs(mean) > 64.0 * EPS * scale:
            # nothing holds the body: it runs away in the direction of the mean force until a contact sticks
            way = 1.0 if mean > 0.0 else -1.0
            first = -1
            far = np.inf
            for p in range(n):
                if side[p] * way < 0.0 and abs(velocity[p]) < far:
                    far = abs(velocity[p])
                    first = p
            if first < 0:
                return -1, turn + 1
            for p in range(n):
                velocity[p] += way * far
            side[first] = 0
            velocity[first] = 0.0
            continue
        grounded = eliminate(band, work, ground, total, sliding, trial)
        if not grounded:
            # any translation will do: one that lets everyone slide their way, if there is one
            least = -np.inf
            most = np.inf
            for p in range(n):
                if side[p] == 1:
                    least = max(least, -trial[p])
                else:
                    most = min(most, -trial[p])
            away = 0.5 * (least + most) if least > -np.inf and most < np.inf else (least if most == np.inf else most)
            for p in range(n):
                trial[p] += away
        # up to the first that would turn round
        part = 1.0
        largest = 0.0
        for p in range(n):
            largest = max(largest, abs(trial[p]))
        for p in range(n):
            if side[p] * trial[p] < -16.0 * EPS * largest:
                step = velocity[p] / (velocity[p] - trial[p]) if velocity[p] != 0.0 else 0.0
                part = min(part, step)
        turned = part < 1.0
        for p in range(n):
            if side[p] == 0:
                continue
            was = velocity[p]
            velocity[p] += part * (trial[p] - was)
            if turned and side[p] * trial[p] < -16.0 * EPS * largest and side[p] * velocity[p] <= 4.0 * EPS * abs(was):
                velocity[p] = 0.0
                side[p] = 0
            elif not turned and side[p] * velocity[p] < 0.0:
                velocity[p] = 0.0
        if turned:
            continue
        # those whose force is beyond its bound are set free
        _forces(band, velocity, load, force, size)
        worst = -1
        excess = 0.0
        count = 0
        for p in range(n):
            if side[p] != 0:
                continue
            close = 32.0 * EPS * (size[p] + grain[p])
            above, below = force[p] - upper[p], lower[p] - force[p]
            if max(above, below) > close:
                count += 1
                if max(above, below) > excess:
                    excess = max(above, below)
                    worst = p
                if 2 * turn < most_rounds:
                    side[p] = 1 if above > below else -1
        if count == 0:
            for p in range(n):
                if abs(velocity[p]) <= NOISE * largest:
                    velocity[p] = 0.0
                close = 32.0 * EPS * (size[p] + grain[p])
                if side[p] == 0 and upper[p] - force[p] <= close and upper[p] < np.inf:
                    side[p] = 1
                elif side[p] == 0 and force[p] - lower[p] <= close and lower[p] > -np.inf:
                    side[p] = -1
            return (0 if grounded else 1), turn + 1
        if 2 * turn >= most_rounds:  # rounding may have led in circles: one at a time is slow and sure
            side[worst] = 1 if force[worst] > upper[worst] else -1
    return -1, most_rounds
