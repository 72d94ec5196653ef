"""The guided scenes: pages of the documentation, each opening at an instant that is worth looking at."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from importlib import resources

_PAGES = (
    "why_it_does_not_move",
    "stasis_polygon",
    "strategies",
    "slack_tendon",
    "stalled_motor",
    "turning_body",
)


@dataclass(frozen=True)
class Lesson:
    """A guided scene.

    Attributes:
        name: of its page, and of its scene if the page opens several.
        title: of its page, or of its scene.
        text: what is seen.
        steps: what to do, in order.
        scene: name of the scene in the gallery.
        state: the end of a link to the instant, as of `Session.encode`.
    """

    name: str
    title: str
    text: str
    steps: tuple[str, ...]
    scene: str
    state: str


@cache
def read_lessons() -> dict[str, Lesson]:
    """Read all lessons from their pages.

    Returns:
        The lessons by name, in order.
    """
    found = {}
    for page in _PAGES:
        text = (resources.files("crawler_lab.play") / "lessons" / f"{page}.md").read_text(encoding="utf-8")
        opens = re.findall(r"^crawler play (\S+) --state (\S+)$", text, re.M)
        plain = re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", text).replace("`", "")
        head, _, rest = plain.partition("bash\n")
        title, _, about = head.removeprefix("# ").partition("\n")
        steps = tuple(" ".join(step.split()) for step in re.split(r"^\d\. ", rest, flags=re.M)[1:])
        for scene, state in opens:
            more = f": {scene}" if len(opens) > 1 else ""
            lesson = Lesson(page + more, title + more, " ".join(about.split()), steps, scene, state)
            found[lesson.name] = lesson
    return found
