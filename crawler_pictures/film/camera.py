"""The part of the world that each frame of a film shows."""

from __future__ import annotations

import numpy as np


def pan_camera(low: np.ndarray, high: np.ndarray, most: float, frames: int) -> tuple[np.ndarray, np.ndarray]:
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
    padded = np.concatenate(
        (2.0 * middle[0] - middle[half:0:-1], middle, 2.0 * middle[-1] - middle[-2 : -half - 2 : -1])
    )
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


def watch_track(place: np.ndarray, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Choose the part of the track that each frame shows.

    Args:
        place: positions of the contacts, shape (F, N) [m].
        frames: number of frames in a period.

    Returns:
        Both ends, each shape (F,) [m].
    """
    low, high = place.min(axis=1), place.max(axis=1)
    reach = float((high - low).max()) or 1.0
    return pan_camera(low - 0.25 * reach, high + 0.25 * reach, 4.0 * reach, frames)


def watch_set(outline: np.ndarray, ratio: float, frames: int) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Choose the part of the plane of a moving set that each frame shows, in equal units along both axes.

    Args:
        outline: corners of the set, shape (F, V, 2).
        ratio: width of the axes over their height.
        frames: number of frames in a period.

    Returns:
        Left and right end, each shape (F,), and the lower and the upper end.
    """
    low, high = outline.min(axis=1), outline.max(axis=1)
    bottom, top = widen(float(low[:, 1].min()), float(high[:, 1].max()), 0.06)
    most = max(1.05 * ratio * (top - bottom), 2.5 * float((high - low)[:, 0].max()))
    left, right = pan_camera(low[:, 0], high[:, 0], most, frames)
    ends = widen(0.0, float(right[0] - left[0]), 0.06)
    corner, far = fit(np.array([ends[0], bottom]), np.array([ends[1], top]), ratio)
    return left + corner[0], left + far[0], (float(corner[1]), float(far[1]))


def watch_plane(place: np.ndarray, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Choose the part of the plane in which a body moves, in equal units along both axes.

    Args:
        place: positions of the contacts, shape (F, N, 2) [m].
        ratio: width of the axes over their height.

    Returns:
        Lower left and upper right corner, each shape (2,) [m].
    """
    low, high = place.min(axis=(0, 1)), place.max(axis=(0, 1))
    margin = 0.12 * (float((high - low).max()) or 1.0)
    return fit(low - margin, high + margin, ratio)


def round_step(size: float) -> float:
    """Round a size to 1, 2 or 5 times a power of ten.

    Args:
        size: > 0.

    Returns:
        The nearest one.
    """
    power = 10.0 ** np.floor(np.log10(size))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(m * power - size)))


def mark_ticks(low: float, high: float, step: float) -> np.ndarray:
    """List the multiples of a step in an interval.

    Args:
        low: lower end.
        high: upper end.
        step: > 0.

    Returns:
        The multiples, shape (K,).
    """
    return np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
