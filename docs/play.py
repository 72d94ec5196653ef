"""Photograph the page of `crawler play` at the beginning of each lesson: the pictures of the lessons and of play.md."""

from __future__ import annotations

import io
import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from crawler_lab.play.lessons import read_lessons  # noqa: E402
from crawler_lab.play.simulated import Simulated  # noqa: E402
from crawler_model import load_scene  # noqa: E402
from tests.lab.play.pages import browsing, open_page, served  # noqa: E402

FOLDER = ROOT / "docs" / "pictures" / "play"
SIZE = {"width": 1440, "height": 900}


def photograph() -> None:
    """Open every lesson, the first of those on one page, in a browser without a window."""
    with browsing() as browser:
        for name in dict.fromkeys(name.partition(":")[0] for name in read_lessons()):
            lesson = next(key for key in read_lessons() if key.partition(":")[0] == name)
            robot = Simulated(load_scene(read_lessons()[lesson].scene)).open_lesson(lesson)
            with served(robot) as server:
                page = open_page(browser, server.address)
                page.set_viewport_size(SIZE)
                page.wait_for_timeout(500)
                shot = Image.open(io.BytesIO(page.screenshot()))
                shot.convert("RGB").quantize(128, kmeans=1).save(FOLDER / f"{name}.png", optimize=True)
                page.close()


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    photograph()
