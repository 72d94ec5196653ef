"""Render the first picture of the README: the demonstration's crawler in rerun, pictures/rerun.png."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from crawler_command.demo import SCENE
from crawler_model import Crawler, load_scene
from crawler_ros.viewer.frames import FRAME_EVERY_NS, frame_of
from crawler_ros.viewer.render import screenshot
from crawler_ros.viewer.visualizer import Drawing, to_file

PICTURE = Path(__file__).parent / "pictures" / "rerun.png"
SECONDS, SHOWN = 4.0, 2.2


def draw(file: Path) -> None:
    """Draw a run of the scene into a file for rerun.

    Args:
        file: the .rrd file to write.
    """
    scene = load_scene(SCENE)
    crawler, drawing = Crawler(scene), Drawing(scene, to_file(file))
    for ns in range(0, round(SECONDS * 1e9) + 1, FRAME_EVERY_NS):
        crawler.follow(scene.drive.sample(np.array([ns])))
        drawing.draw(frame_of(crawler, ns, crawler.contact_state))
    drawing.close()


def main() -> None:
    """Render the picture."""
    with tempfile.TemporaryDirectory() as folder:
        draw(Path(folder) / "run.rrd")
        screenshot(Path(folder) / "run.rrd", PICTURE, SHOWN)
    picture = Image.open(PICTURE).convert("RGB").resize((1440, 783), Image.Resampling.LANCZOS)
    picture.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(PICTURE, optimize=True)
    print(f"written: {PICTURE}")


if __name__ == "__main__":
    main()
