"""The one door to all bodies: make a crawler's state, and follow ramps of commands.

Behind it are `chain_tick` for chains, `graph_tick` for any other springs on a line and `planar_tick` for the plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body.body import Body
from ..scene.scene import Scene
from . import state
from .chain import events as chain_events
from .chain import memory as chain_memory
from .chain import ramp as chain_tick
from .state import (
    ACTUATION,
    ACTUATION_REF,
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    FORWARD,
    PLANAR_ACTUATION,
    PLANAR_TENSION,
    PLANAR_X,
    RELATIVE,
    SHAPE,
    TENSION,
    TENSION_REF,
    X,
)

DEFAULT_TOLERANCE = 1e-4
"""Error of a planar ramp relative to its change of length, unless the scene says otherwise."""
_MOST_STEPS = 1 << 16
"""Implicit steps of a planar ramp, about a second; the rest of it then goes in equal steps, and that is said."""
_SHARE = 0.25
"""Part of the tolerance that a ramp's substeps may use up: later ones may enlarge the errors of earlier ones."""


@dataclass(eq=False)
class State:
    """What changes: rows of the contacts and of the springs, and which bounds contacts are at.

    Attributes:
        contacts: rows X .. RELATIVE, shape (6, N); in the plane X, X_REST and GAINED, shape (3, N, 2).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S); in the plane TENSION and ACTUATION, shape (2, S, 2).
        status: bits AT_FORWARD and AT_BACKWARD, shape (N,); unused in the plane.
        friction: in the plane, shape (N, max(m, 1)); unused on a line.
    """

    contacts: np.ndarray
    links: np.ndarray
    status: np.ndarray
    friction: np.ndarray

    def copy(self) -> State:
        """Fork the state.

        Returns:
            Another state of the same numbers, in arrays of its own.
        """
        return State(self.contacts.copy(), self.links.copy(), self.status.copy(), self.friction.copy())

    def bits(self) -> bytes:
        """Lay all numbers out for comparison.

        Returns:
            The bytes of all arrays, one after another.
        """
        return b"".join(a.tobytes() for a in (self.contacts, self.links, self.status, self.friction))


def start_state(scene: Scene) -> State:
    """Make the state at a scene's start.

    Args:
        scene: the scene.

    Returns:
        The state, at rest.
    """
    return state_at(scene, scene.start_displacement, scene.commands.targets[0])


def state_at(scene: Scene, x: np.ndarray, target: np.ndarray) -> State:
    """Make the state of a body that stands somewhere under some command.

    Args:
        scene: whose body it is.
        x: displacement, shape (N,), in the plane (N, 2) [m].
        target: the command in force, shape (S + 2 N,).

    Returns:
        The state, at rest. Contacts at a bound, but for rounding, are taken to be there.
    """
    mesh = scene.mesh
    if mesh.dimension == 2:
        contacts = np.zeros((3, mesh.contacts, 2))
        contacts[PLANAR_X] = x
        links = np.zeros((2, mesh.springs, 2))
        links[PLANAR_ACTUATION] = target[: 2 * mesh.springs].reshape(-1, 2)
        links[PLANAR_TENSION] = mesh.stiffness[:, None] * (mesh.elongation(x) - links[PLANAR_ACTUATION])
        friction = target[2 * mesh.springs :].reshape(mesh.contacts, -1).copy()
        return State(contacts, links, np.zeros(0, np.int8), friction)
    contacts = np.zeros((state.CONTACT_ROWS, mesh.contacts))
    links = np.zeros((state.LINK_ROWS, mesh.springs))
    contacts[X] = contacts[RELATIVE] = x
    contacts[FORWARD], contacts[BACKWARD] = target[mesh.springs :].reshape(2, -1)
    links[ACTUATION] = links[ACTUATION_REF] = target[: mesh.springs]
    links[SHAPE] = mesh.elongation(x)
    links[TENSION] = links[TENSION_REF] = mesh.stiffness * (links[SHAPE] - target[: mesh.springs])
    return State(contacts, links, _status_at_rest(scene, links[TENSION], contacts), np.zeros((0, 0)))


def _status_at_rest(scene: Scene, tension: np.ndarray, contacts: np.ndarray) -> np.ndarray:
    """Find the bounds that contacts are at, but for rounding; both only where there is no friction."""
    g = scene.mesh.spring_force(tension)
    friction = contacts[FORWARD] + contacts[BACKWARD]
    near = 32.0 * np.finfo(np.float64).eps * (scene.mesh.force_size(tension) + friction)
    above, below = contacts[FORWARD] - g, g + contacts[BACKWARD]
    none = friction == 0.0
    at_forward = none | ((above <= near) & (above <= below))
    at_backward = none | ((below <= near) & (below < above))
    return (AT_FORWARD * at_forward + AT_BACKWARD * at_backward).astype(np.int8)


def build_scratch(scene: Scene) -> tuple[Any, ...]:
    """Make the memory that `follow` works in, for one crawler.

    Args:
        scene: the scene.

    Returns:
        What the body's kernel wants beside state and commands.
    """
    mesh = scene.mesh
    if mesh.dimension == 2:
        return ()
    if mesh.is_chain:
        return tuple(chain_memory.scratch(mesh.contacts))
    from .graph import active_set as graph_kernel
    from .graph import memory as graph_memory

    network = scene.network
    return (
        (network.order, network.band),
        graph_kernel.workspace(network),
        graph_memory.scratch(mesh.contacts, mesh.springs),
    )


def samples_margin(mesh: Body) -> bool:
    """Tell whether an exact ramp sees its visited margin at its ends only.

    Args:
        mesh: the body.

    Returns:
        True for chains that are too long to be looked at after each event.
    """
    return bool(mesh.is_chain) and mesh.contacts > chain_events.FEW_CONTACTS


def follow(
    scene: Scene,
    state: State,
    scratch: tuple[Any, ...],
    targets: np.ndarray,
    exact: bool,
    budget: int,
    account: np.ndarray,
    records: np.ndarray,
) -> None:
    """Follow straight ramps to each of the targets in turn.

    Args:
        scene: whose body it is.
        state: changed in place.
        scratch: from `build_scratch`.
        targets: rows as in `Columns.target`, shape (V, S + 2 N).
        exact: True to follow every event, False for one catch-up step a ramp (in the plane, refined steps).
        budget: most work in one ramp, as for `Crawler`.
        account: shape (13,), added to.
        records: displacement, its rest and tension after each ramp, shape (V, 2 N + S), or no rows for none.
    """
    mesh = scene.mesh
    if mesh.is_chain:
        chain_tick.follow(
            mesh.elasticity,
            state.contacts,
            state.links,
            state.status,
            targets,
            exact,
            budget,
            mesh.element_ends,
            mesh.share,
            *scratch,
            account,
            records,
        )
    elif mesh.dimension == 1:
        from .graph import active_set as graph_kernel
        from .graph import ramp as graph_tick

        network, work, memory = scratch
        graph_tick.follow(
            mesh.ends,
            mesh.stiffness,
            network,
            work,
            state.contacts,
            state.links,
            state.status,
            targets,
            exact,
            budget,
            mesh.element_ends,
            mesh.share,
            graph_kernel.most_rounds(mesh.contacts),
            *memory,
            account,
            records,
        )
    else:
        _follow_in_plane(scene, state, targets, account, records)


def _follow_in_plane(scene: Scene, state: State, targets: np.ndarray, account: np.ndarray, records: np.ndarray) -> None:
    """Follow ramps to the scene's tolerance, a part of the lengths that the drive commands."""
    from .plane import ramp as planar_tick

    mesh = scene.mesh
    size = float(np.abs(np.ptp(scene.commands.targets[:, : 2 * mesh.springs], axis=0)).max(initial=0.0))
    size = size or float(np.abs(np.ptp(mesh.position, axis=0)).max())
    tolerance = _SHARE * (scene.tolerance or DEFAULT_TOLERANCE) * size
    planar_tick.follow(
        mesh.ends,
        mesh.stiffness,
        scene.directions,
        state.contacts,
        state.links,
        state.friction,
        targets,
        tolerance,
        _MOST_STEPS,
        account,
        records,
    )
