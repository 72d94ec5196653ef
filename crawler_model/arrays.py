"""Checks of array lengths and values, and read-only copies.

Where variations of a scene are assembled together, a number that varies is an array of shape (M, 1), one row per
variation, and every array built from it has a leading axis of variations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .errors import LARGEST, CommandError, SceneError

FLOAT = np.dtype(np.float64)
"""The type of nearly all arrays, which they share: to compare it by identity costs nothing."""


def spread(values: Any, size: int, field: str, item: str) -> np.ndarray:
    """Spread one number over all entries, or check that there is one per entry.

    Args:
        values: one number or `size` of them; numbers may vary.
        size: number of entries.
        field: name of the field that holds the values, for error messages.
        item: noun for what one entry belongs to, for error messages.

    Returns:
        A new array of shape (size,), or (M, size) if a number varies.

    Raises:
        SceneError: if there is neither one number nor one per entry.
    """
    given = read_numbers(values)
    if given.ndim == 0:
        return np.full(size, float(given))
    if given.ndim == 2 and given.shape[1] == 1:
        return np.repeat(given, size, axis=1)
    if given.shape[-1] != size or given.ndim > 2:
        raise SceneError(f"{field}: {given.size} value(s) for {size} {item}(s); give one number or {size}")
    return given.copy()


def read_numbers(values: Any) -> np.ndarray:
    """Convert numbers to an array.

    Args:
        values: one number or a sequence of them; numbers may vary.

    Returns:
        Shape () or (K,), or (M, K) if a number varies.
    """
    if isinstance(values, tuple) and any(isinstance(value, np.ndarray) for value in values):
        return join(values)
    return np.asarray(values, dtype=np.float64)


def join(parts: Iterable[ArrayLike]) -> np.ndarray:
    """Join arrays along their last axis.

    Args:
        parts: numbers and arrays whose other axes can be broadcast together.

    Returns:
        A new array.
    """
    arrays = [np.atleast_1d(np.asarray(part, dtype=np.float64)) for part in parts]
    leading = np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    return np.concatenate([np.broadcast_to(a, (*leading, a.shape[-1])) for a in arrays], axis=-1)


def refuse(bad: np.ndarray, axes: int, explain: Callable[..., str], doubts: np.ndarray | None) -> None:
    """Refuse values that break a rule: of a single scene with an error, of variations by noting which are in doubt.

    Args:
        bad: True where a value breaks the rule; its last `axes` axes belong to a single scene.
        axes: number of these axes.
        explain: called with the indices of the first bad value; returns the message.
        doubts: of variations: set where a value is bad, bool, shape (M,), changed in place; None for a single scene.

    Raises:
        SceneError: for a single scene, if a value is bad.
    """
    if doubts is not None:
        doubts |= bad.any(axis=tuple(range(-axes, 0)))
    elif bad.any():
        raise SceneError(explain(*np.argwhere(bad)[0].tolist()))


def frozen(array: ArrayLike, dtype: type[np.generic] = np.float64) -> np.ndarray:
    """Copy an array and make the copy read-only.

    Args:
        array: any shape.
        dtype: data type of the copy.

    Returns:
        A read-only copy.
    """
    copy = np.array(array, dtype=dtype)
    copy.flags.writeable = False
    return copy


def check_numbers(name: str, values: ArrayLike | None, shape: tuple[int, ...]) -> np.ndarray:
    """Convert the numbers of a command to an array.

    Args:
        name: what they are, for error messages.
        values: the numbers.
        shape: shape that they must have.

    Returns:
        An array of this shape.

    Raises:
        CommandError: if the shape is another one, or a number is not finite or too large.
    """
    count = " x ".join(map(str, shape))
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise CommandError(f"{name}: {values!r}; it must be {count} numbers") from None
    if array.shape != shape:
        raise CommandError(f"{name}: shape {array.shape}; it must be {shape}")
    flat = array.ravel()
    if not np.isfinite(flat).all():
        i = int(np.flatnonzero(~np.isfinite(flat))[0])
        raise CommandError(f"{name}: entry {i} is {flat[i]}; it must be finite")
    if flat.size and np.abs(flat).max() > LARGEST:
        i = int(np.abs(flat).argmax())
        raise CommandError(f"{name}: entry {i} is {flat[i]:g}; it must be at most {LARGEST:g} in size")
    return array
