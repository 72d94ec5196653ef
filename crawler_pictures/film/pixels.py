"""Text and ticks of a film as pixels, which take less time than laying out text in every frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .camera import mark_ticks, round_step

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TICKS, _TICK = 7, 5
"""Numbers along an axis, and the length of a tick [pixels]."""


class Clock:
    """Writes the time at the upper right corner, with letters of equal width."""

    def __init__(self, figure: Figure, canvas: Any) -> None:
        """Draw each letter once; the canvas is left unchanged.

        Args:
            figure: the figure.
            canvas: its canvas, drawn.
        """
        width, height = canvas.get_width_height()
        self._rows, self._right = slice(round(0.005 * height), round(0.065 * height)), round(0.985 * width)
        saved, white = canvas.copy_from_bbox(figure.bbox), figure.patch
        text = figure.text(0.5, 0.965, "0" * 10, va="center", fontsize=13, family="monospace")
        self._advance = text.get_window_extent(canvas.get_renderer()).width / 10.0
        left, wide = round(0.5 * width), round(self._advance) + 1
        self._letters = {}
        for letter in "0123456789.-+=ts ":
            figure.draw_artist(white)  # a long title may reach below the letters
            text.set_text(letter)
            figure.draw_artist(text)
            self._letters[letter] = np.asarray(canvas.buffer_rgba())[self._rows, left : left + wide, :3].copy()
        text.remove()
        canvas.restore_region(saved)

    def write(self, picture: np.ndarray, text: str) -> None:
        """Write a text that ends at the right margin.

        Args:
            picture: the frame, changed in place.
            text: of the letters of a time.
        """
        for i, letter in enumerate(text):
            left = self._right - round((len(text) - i) * self._advance)
            glyph = self._letters[letter]
            picture[self._rows, left : left + glyph.shape[1]] = glyph


class RollingAxis:
    """Ticks and numbers of an axis whose limits move, below axes without ticks of their own."""

    def __init__(self, figure: Figure, canvas: Any, axes: Axes, left: np.ndarray, right: np.ndarray) -> None:
        """Choose the distance of the ticks.

        Args:
            figure: the figure.
            canvas: its canvas.
            axes: the axes.
            left: left limit in each frame, shape (F,).
            right: right limit in each frame, shape (F,).
        """
        self._figure, self._canvas, self._left, self._right = figure, canvas, left, right
        self._step = round_step(float(right[0] - left[0]) / _TICKS)
        box, height = axes.get_window_extent(), canvas.get_width_height()[1]
        self._first, self._last, self._row = box.x0, box.x1, height - round(box.y0)
        self._numbers: dict[float, np.ndarray] = {}

    def prepare(self, k: int) -> None:
        """Draw the numbers of a frame that were not drawn before; the canvas is changed.

        Args:
            k: number of the frame.
        """
        for value in mark_ticks(self._left[k], self._right[k], self._step).tolist():
            if value not in self._numbers:
                self._numbers[value] = self._draw(f"{value + 0.0:.6g}".replace("-", "\u2212"))

    def _draw(self, text: str) -> np.ndarray:
        canvas, size = self._canvas, self._canvas.get_width_height()
        canvas.get_renderer().clear()
        label = self._figure.text(0.5, 0.5, text, ha="left", va="bottom", fontsize=10)
        self._figure.draw_artist(label)
        box = label.get_window_extent(canvas.get_renderer())
        label.remove()
        rows = slice(size[1] - int(np.ceil(box.y1)), size[1] - int(box.y0))
        drawn = np.asarray(canvas.buffer_rgba())[rows, int(box.x0) : int(np.ceil(box.x1))].astype(float)
        part = drawn[..., 3:] / 255.0
        return np.rint(part * drawn[..., :3] + (1.0 - part) * 255.0).astype(np.uint8)

    def draw(self, picture: np.ndarray, k: int) -> None:
        """Draw ticks and numbers of a frame.

        Args:
            picture: the frame, changed in place.
            k: its number.
        """
        scale = (self._last - self._first) / (self._right[k] - self._left[k])
        for value in mark_ticks(self._left[k], self._right[k], self._step).tolist():
            at = round(self._first + (value - self._left[k]) * scale)
            picture[self._row : self._row + _TICK, at] = 0
            number = self._numbers[value]
            left, top = at - number.shape[1] // 2, self._row + _TICK + 3
            if left >= 0 and left + number.shape[1] <= picture.shape[1]:
                picture[top : top + number.shape[0], left : left + number.shape[1]] = number
