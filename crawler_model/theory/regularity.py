"""Regularity of time-dependent friction: conditions under which the path is well defined and unique."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.drive import Drive


@dataclass(frozen=True)
class Regularity:
    """Regularity of the friction of a drive.

    Attributes:
        least: smallest coefficient of any contact at any time [N, on a segment N/m].
        greatest: largest coefficient [N, on a segment N/m].
        rate: largest rate of change of a coefficient, the Lipschitz constant [N/s, on a segment N/m/s].
        load_rate: largest rate of change of a load; loads belong to the energy and may have any sign [N/s, on a segment
            N/m/s].
        where: name of the column with the smallest coefficient.

    Source: [G] section 5.1, Lemmas on condition (diamond diamond) for discrete and for continuous models.
    """

    least: float
    greatest: float
    rate: float
    load_rate: float
    where: str

    @property
    def is_regular(self) -> bool:
        """Whether all coefficients stay between two positive bounds; rates of waypoints are always finite."""
        return self.least > 0.0


def check_regularity(drive: Drive) -> Regularity:
    """Compute the bounds and the rate of change of the friction of a drive.

    A drive is linear between its waypoints, which therefore determine bounds and rates. Points of a body that turns
    that never have friction are left out.

    Args:
        drive: the drive.

    Returns:
        Bounds and rate.
    """
    columns = drive.columns
    held = drive.rows[:, columns.lengths :]
    times = drive.times
    if drive.period is not None and drive.period > times[-1]:
        times = np.append(times, drive.period)
        held = np.vstack((held, held[:1]))
    rate = np.abs(np.diff(held, axis=0)) / np.diff(times)[:, None]
    friction = held[:, : columns.frictions]
    places = np.arange(columns.frictions)
    if columns.joints is not None:
        touches = (friction > 0.0).any(axis=0).reshape(columns.contacts, -1).any(axis=1)
        places = places.reshape(columns.contacts, -1)[touches].ravel()
        friction = friction[:, places]
    weakest = int(places[friction.min(axis=0).argmin()])
    return Regularity(
        float(friction.min()),
        float(friction.max()),
        float(rate[:, : columns.frictions].max(initial=0.0)),
        float(rate[:, columns.frictions :].max(initial=0.0)),
        columns.names[columns.lengths + weakest],
    )
