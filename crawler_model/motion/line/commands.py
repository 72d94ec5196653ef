"""Commands that are refused on some ground."""

from __future__ import annotations

import numpy as np

from ...body.body import Body
from ...errors import CommandError


def check_friction(body: Body, friction: np.ndarray, bounds: np.ndarray) -> None:
    """Check that no command changes friction: with a factor that changes, too, its bounds would be no straight lines.

    Args:
        body: the body.
        friction: in force, forward then backward, shape (2 N,) [N].
        bounds: forward bounds, backward bounds and, with loads, these, shape (V, 2 N) or (V, 3 N) [N].

    Raises:
        CommandError: if one does, beyond rounding; the message names the contact.
    """
    n = body.contacts
    load = bounds[:, 2 * n :] if bounds.shape[1] > 2 * n else np.zeros((1, n))
    commanded = bounds[:, : 2 * n] + np.hstack((load, -load))
    size = np.abs(bounds[:, : 2 * n]) + np.abs(np.hstack((load, load))) + friction
    changed = np.abs(commanded - friction) > 1e-12 * size
    if changed.any():
        i = int(changed.any(axis=0).argmax())
        raise CommandError(
            f"friction: it changes at {body.name_of(i % n)} from {friction[i]:g} N to "
            f"{commanded[changed[:, i].argmax(), i]:g} N; on a ground.profile of friction it cannot be commanded"
        )
