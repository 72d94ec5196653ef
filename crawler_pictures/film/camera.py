"""The part of the world that each frame of a film shows."""

from __future__ import annotations

import numpy as np


def follow(low: np.ndarray, high: np.ndarray, most: float, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Choose the visible interval of each frame: fixed where everything fits, else it follows smoothly.

    Args:
        low: lower end of what must be seen in each frame, shape (F,).
        high: its upper end.
        most: the largest width of a fixed interval.
        frames: number of frames over which the motion of the interval is averaged.

    Returns:
        Both ends of the interval, each shape (F,).
    """
    if float(high.max() - low.min()) <= most:
        return np.full(low.size, low.min()), np.full(low.size, high.max())
    middle = 0.5 * (low + high)
    count = int(np.clip(frames, 1, middle.size)) | 1
    half = count // 2
    # mirrored through both ends, so that a steady motion stays steady there
    padded = np.concatenate((2.0 * middle[0] - middle[half:0:-1], middle, 2.0 * middle[-1] - middle[-2 : -half - 2 : -1]))
    padded = np.pad(padded, (0, max(middle.size + 2 * half - padded.size, 0)), mode="edge")
    smooth = np.convolve(padded, np.full(count, 1.0 / count), "valid")
    reach = max(float((high - smooth).max()), float((smooth - low).max()))
    return smooth - reach, smooth + reach


def widen(low: float, high: float, part: float) -> tuple[float, float]:
    """Widen an interval on both sides.

    Args:
        low: lower end.
        high: upper end.
        part: of its width that is added on each side; an interval of no width gets a width of one.

    Returns:
        Both ends.
    """
    width = high - low if high > low else 1.0
    return low - part * width, high + part * width


def fit(low: np.ndarray, high: np.ndarray, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Enlarge a rectangle about its middle to a ratio of width to height.

    Args:
        low: lower left corner, shape (2,).
        high: upper right corner, shape (2,).
        ratio: width over height, in equal units.

    Returns:
        Both corners.
    """
    middle, size = 0.5 * (low + high), np.maximum(high - low, 1e-12)
    size = np.array([max(size[0], ratio * size[1]), max(size[1], size[0] / ratio)])
    return middle - 0.5 * size, middle + 0.5 * size
