"""Films as files: mp4 by PyAV, gif by Pillow, one frame at a time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..style import own_style
from .film import Film
from .stage import TALK_SIZE, Stage

_GIF_SIZE = (960, 540)
_PALETTE_FRAMES = 12
_QUALITY = "20"
_WHITE = 250


@own_style()
def write_mp4(film: Film, file: Path, fps: float, progress: Callable[[float], None], talk: bool = False) -> None:
    """Write a film as H.264 in mp4, which every player and slide program shows.

    Args:
        film: the run, sampled at the frames.
        file: the file to write.
        fps: frames per second [Hz].
        progress: called with the fraction done, in [0, 1].
        talk: as for `Stage`, with frames of 1920 x 1080 pixels.

    Raises:
        ModuleNotFoundError: when PyAV is not installed.
    """
    from fractions import Fraction

    import av

    stage = Stage(film, *TALK_SIZE, talk=True) if talk else Stage(film)
    with av.open(str(file), "w", format="mp4", options={"movflags": "+faststart"}) as container:
        stream: Any = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001))
        stream.width, stream.height = stage.size
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": _QUALITY, "preset": "veryfast"}
        for k in range(film.time.size):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(stage.draw(k)), format="rgb24")
            container.mux(stream.encode(frame))
            progress((k + 1) / film.time.size)
        container.mux(stream.encode())


@own_style()
def write_gif(film: Film, file: Path, fps: float, progress: Callable[[float], None], talk: bool = False) -> None:
    """Write a film as an endless gif; of each frame only the rectangle that changed is stored.

    Args:
        film: the run, sampled at the frames.
        file: the file to write.
        fps: frames per second, 1 .. 50; the format rounds their duration to hundredths of a second [Hz].
        progress: called with the fraction done, in [0, 1].
        talk: as for `Stage`, with frames of 1920 x 1080 pixels.
    """
    from PIL import GifImagePlugin, Image

    stage = Stage(film, *(TALK_SIZE if talk else _GIF_SIZE), talk=talk)
    count = film.time.size
    some = np.unique(np.linspace(0, count - 1, _PALETTE_FRAMES).round().astype(int))
    shown = np.concatenate([stage.draw(int(k)).copy() for k in some])  # each frame is drawn into the same memory
    palette = Image.fromarray(shown).quantize(255, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    colors = np.array(palette.getpalette())
    palette.putpalette(np.where(colors >= _WHITE, 255, colors).tolist())
    ends = np.rint(100.0 / fps * np.arange(1, count + 1)).astype(int)
    before: np.ndarray | None = None
    with file.open("wb") as out:
        for k in range(count):
            image = Image.fromarray(stage.draw(k)).quantize(palette=palette, dither=Image.Dither.NONE)
            pixels = np.asarray(image)
            top, bottom, left, right = 0, pixels.shape[0], 0, pixels.shape[1]
            if before is None:
                for part in GifImagePlugin.getheader(image, info={"loop": 0})[0]:
                    out.write(part)
            else:
                top, bottom, left, right = _changed(pixels, before)
            duration = 10 * int(ends[k] - (ends[k - 1] if k else 0))
            for part in GifImagePlugin.getdata(image.crop((left, top, right, bottom)), (left, top), duration=duration):
                out.write(part)
            before = pixels
            progress((k + 1) / count)
        out.write(b";")


def _changed(pixels: np.ndarray, before: np.ndarray) -> tuple[int, int, int, int]:
    """Find the first and the last row and column that changed, the latter exclusive; at least one pixel."""
    differs = pixels != before
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    if rows.size == 0:
        return 0, 1, 0, 1
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
