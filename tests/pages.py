"""The pages of the documentation: their fenced blocks, run as a reader would run them, and their links.

What is done with a block follows from its language:

    bash, console   run by bash in the page's folder, every command with success, background jobs too, ended at its end
    python          run in the page's one Python session; with a first line `# name.py` a file, for a later command to run
    yaml            a scene, loaded; and a file, called by its first line `# name.yaml` or else after the scene
    text            what the block before it printed; `...` stands for any lines, or for anything within a line
    equations       read by people

A block that cannot be run says so in its first line, `# REASON` or `# REASON: more`; its commands are looked up instead.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from crawler_model import load_scene
from crawler_ros.node.life.domains import reserved_domain

from .instrument.ros.launch_files import FOLDER, read

ROOT = Path(__file__).parent.parent
BIN = Path(sys.executable).parent
REASONS = ("needs a ROS 2 installation", "needs a network", "needs a display", "takes minutes")
PATIENCE_S = 1200.0  # only what hangs takes so long, on the busiest machine
_NODES = re.compile(r"\bcrawler-[a-z]|\brclpy\b|\bcrawler (?:demo|run)\b")
_FENCE = re.compile(r"^(?P<indent> *)```(?P<info>.*)\n(?P<text>(?:.*\n)*?)(?P=indent)```[ \t]*$", re.M)
_TROUBLE = ("Traceback", "command not found", "[ERROR]", "[FATAL]")
_NOISE = re.compile(r"^(crawler: compiling the kernels|\[\d+\][-+ ]).*\n", re.M)  # on the first run; of jobs that end
_ANYTHING = re.compile(r"\.\.\.|…")


def pages() -> list[Path]:
    """List the pages of the documentation."""
    top = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    return top + sorted((ROOT / "docs").rglob("*.md")) + sorted((ROOT / "examples").glob("*.md"))


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    Attributes:
        place: page and line, for people.
        line: of its first line in the page, counted from 1.
        language: the word behind the fence.
        text: what is in it.
    """

    place: str
    line: int
    language: str
    text: str

    @property
    def first(self) -> str:
        """What its first line says as a comment."""
        line = self.text.split("\n", 1)[0]
        return line[2:].strip() if line.startswith("# ") else ""

    @property
    def reason(self) -> str:
        """Why it is not run; empty when it is."""
        said = re.split(r"[:;,]", self.first)[0]
        return said if said in REASONS else ""

    @property
    def file(self) -> str:
        """What it is called as a file; empty when it is none."""
        return self.first if re.fullmatch(r"[\w-]+\.(py|yaml)", self.first) else ""


def blocks(page: str, text: str) -> list[Block]:
    """Find the fenced blocks of a page."""
    found = []
    for fence in _FENCE.finditer(text):
        line = text.count("\n", 0, fence.start("text")) + 1
        body = re.sub(rf"^{fence['indent']}", "", fence["text"], flags=re.M)
        found.append(Block(f"{page}:{line}", line, fence["info"].strip(), body))
    assert text.count("```") == 2 * len(found), f"{page}: a fence that is not closed, or inside a line"
    return found


def needs_ros(found: list[Block]) -> bool:
    """Tell whether a page starts nodes."""
    return any(_NODES.search(block.text) for block in found if not block.reason)


class Page:
    """A page while its blocks are run, in a folder of its own."""

    def __init__(self, name: str, text: str, folder: Path) -> None:
        self.blocks = blocks(name, text)
        self._folder = folder
        self._said: str | None = None
        self._files: set[str] = set()
        self._session: Session | None = None
        self._environment: dict[str, str] = {}

    def run(self) -> None:
        """Run all blocks in their order, a page with nodes in a ROS domain of its own."""
        paths = {"PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}", "MPLBACKEND": "Agg", "COLUMNS": "120"}
        with contextlib.ExitStack() as stack:
            given = dict(os.environ)
            if needs_ros(self.blocks):
                from .instrument.ros.graph import environment

                given = environment(stack.enter_context(reserved_domain()))
            self._environment = {k: v for k, v in given.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")} | paths
            self._run_all()

    def _run_all(self) -> None:
        try:
            for block in self.blocks:
                self._run(block)
        finally:
            if self._session is not None:
                self._session.end()
        scripts = [block.text for block in self.blocks if block.language in ("bash", "console")]
        for file in self._files:
            assert any(file in script for script in scripts), f"{file} is written, but no command takes it"

    def _run(self, block: Block) -> None:
        if block.language == "text":
            assert self._said is not None, f"{block.place}: shows what no block before it printed"
            compare(block, self._said)
            self._said = None
        elif block.reason:
            look_up(block)
            self._said = None
        elif block.language in ("bash", "console"):
            self._said = run_shell(block, self._folder, self._environment)
        elif block.language == "python" and block.file:
            (self._folder / block.file).write_text(block.text, encoding="utf-8")
            self._files.add(block.file)
        elif block.language == "python":
            if self._session is None:
                self._session = Session(self._folder, self._environment)
            self._said = self._session.run(block)
        elif block.language == "yaml":
            name = re.search(r"^name: (\w+)$", block.text, re.M)
            assert name, f"{block.place}: a yaml block is a scene, and a scene has a name"
            file = self._folder / (block.file or f"{name[1]}.yaml")
            file.write_text(block.text, encoding="utf-8")
            load_scene(file)
        elif block.language == "equations":
            words = {line.split()[0] for line in block.text.splitlines() if line.strip()}
            assert not words & KNOWN.keys(), f"{block.place}: commands, not equations"
        else:
            raise AssertionError(
                f"{block.place}: nobody knows what to do with a block of {block.language or 'no kind'}"
            )


def run_shell(block: Block, folder: Path, environment: dict[str, str]) -> str:
    """Run a block in a shell with job control; return what was printed, errors too."""
    shell = subprocess.Popen(
        ["bash", "-c", f"set -me\n{block.text}\nwait || true\n"],
        env=environment,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        said, _ = shell.communicate(timeout=PATIENCE_S)
    finally:
        subprocess.run(["pkill", "-KILL", "-s", str(shell.pid)], check=False)  # its jobs have groups of their own
    assert shell.returncode == 0, f"{block.place}: exit status {shell.returncode}\n{said}"
    for word in _TROUBLE:
        assert word not in said, f"{block.place}:\n{said}"
    return said


_SESSION = """
import json, sys, traceback
names = {"__name__": "__main__"}
for order in sys.stdin:
    place, line, text = json.loads(order)
    good = True
    try:
        exec(compile("\\n" * (line - 1) + text, place, "exec"), names)
    except BaseException:
        good = False
        traceback.print_exc(file=sys.stdout)
    sys.stderr.flush()
    print(f"\\n\\0{int(good)}", flush=True)
"""


class Session:
    """A Python session in which the blocks of a page follow one another."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _SESSION],
            env=environment,
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def run(self, block: Block) -> str:
        """Run a block; return what it printed."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([block.place.split(":")[0], block.line, block.text]) + "\n")
        self._process.stdin.flush()
        said: list[str] = []
        for line in self._process.stdout:
            if line.startswith("\0"):
                assert line == "\x001\n", f"{block.place}:\n{''.join(said)}"
                return "".join(said).removesuffix("\n")
            said.append(line)
        raise AssertionError(f"{block.place}: the session ended\n{''.join(said)}")

    def end(self) -> None:
        """End it."""
        self._process.kill()
        self._process.communicate()


def compare(block: Block, said: str) -> None:
    """Compare what a page shows with what was printed, word by word."""
    printed = _lines(_NOISE.sub("", said))
    shown: list[list[str]] = [[]]  # what stands between lines of dots
    for line in _lines(block.text):
        if _ANYTHING.fullmatch(line):
            shown.append([])
        else:
            shown[-1].append(".*".join(re.escape(piece) for piece in _ANYTHING.split(line)))
    at = 0
    for k, part in enumerate(shown):
        first, last = k == 0, k == len(shown) - 1
        end = len(printed) - len(part)
        places = [p for p in range(at, end + 1) if (not first or p == 0) and (not last or p == end)]
        found = [p for p in places if all(map(re.fullmatch, part, printed[p : p + len(part)]))]
        assert found, f"{block.place} shows\n{block.text}\nbut this was printed:\n{said}"
        at = found[0] + len(part)


def _lines(text: str) -> list[str]:
    return [" ".join(line.split()) for line in text.splitlines() if line.strip()]


def look_up(block: Block) -> None:
    """Check of the commands of a block that is not run that they are there."""
    if block.language == "python":
        compile(block.text, block.place, "exec")
        return
    assert block.language in ("bash", "console"), f"{block.place}: {block.language} has no reason not to be read"
    done = subprocess.run(["bash", "-n", "-c", block.text], capture_output=True, text=True)
    assert done.stderr == "", f"{block.place}: {done.stderr}"
    for line in block.text.splitlines():
        for part in re.split(r"&&|\|\||;", line.split("# ")[0].removeprefix("#")):
            words = shlex.split(part.rstrip(" &"))
            if words and not line.startswith("# "):
                assert words[0] in KNOWN, f"{block.place}: nobody knows {words[0]}"
                assert KNOWN[words[0]](words[1:]), f"{block.place}: there is no such thing: {part.strip()}"


def _make(words: list[str]) -> bool:
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    return bool(words) and set(words) <= set(targets)


@functools.cache
def verbs() -> dict[str, set[str]]:
    """Read the verbs of the command with their options."""
    text = (ROOT / "docs" / "reference" / "command.md").read_text(encoding="utf-8")
    parts = re.split(r"^## crawler (\w+)$", text, flags=re.M)[1:]
    return {v: set(re.findall(r"`(--[\w-]+)`", said)) for v, said in zip(parts[::2], parts[1::2], strict=True)}


def _crawler(words: list[str]) -> bool:
    own = words[: words.index("--")] if "--" in words else words
    options = {word.split("=")[0] for word in own if word.startswith("--")}
    return words[0] in verbs() and options <= verbs()[words[0]]


def _ros2(words: list[str]) -> bool:
    if words[:2] == ["run", "crawler_ros"]:
        return (ROOT / "resource" / "lib" / words[2]).is_file()
    if words[:2] == ["launch", "crawler_ros"]:
        arguments = {a.get("name") for a in read(FOLDER / words[2]).findall("arg")}
        return {word.split(":=")[0] for word in words[3:]} <= arguments
    return words[0] in ("topic", "security", "bag")


def _pip(words: list[str]) -> bool:
    extras = re.findall(r"^(\w+) = \[", (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.M)
    wanted = [name for word in words for part in re.findall(r"\[(.*)\]", word) for name in part.split(",")]
    return words[0] == "install" and set(wanted) <= set(extras)


def _python(words: list[str]) -> bool:
    return (ROOT / words[0]).is_file() or words[0].startswith("-")


def _anything(words: list[str]) -> bool:
    return True


KNOWN = {
    "make": _make,
    "crawler": _crawler,
    "ros2": _ros2,
    "pip": _pip,
    "python": _python,
    **dict.fromkeys(("git", "ln", "cd", "source", ".", "export", "colcon", "mkdir"), _anything),
    **{path.name: _anything for path in BIN.glob("crawler-*")},
}
"""Commands that are looked up, and how."""


def prose(text: str) -> str:
    """Return a page without its fenced blocks."""
    return _FENCE.sub("", text)


def inline_code(text: str) -> Iterator[str]:
    """Find what stands between backticks in a page's prose."""
    for code in re.finditer(r"`([^`\n]+)`", prose(text)):
        yield code[1]


def links(text: str) -> Iterator[str]:
    """Find the targets of a page's links and pictures."""
    plain = re.sub(r"`[^`\n]+`", "", prose(text))
    for link in re.finditer(r"\]\(<?([^)\s>]+)>?(?: \"[^\"]*\")?\)|<(?:img|a)[^>]* (?:src|href)=\"([^\"]+)\"", plain):
        yield link[1] or link[2]


def anchors(text: str) -> set[str]:
    """Make the anchors that a forge gives a page's headings."""
    found: dict[str, int] = {}
    for heading in re.findall(r"^#+ (.*)$", prose(text), re.M):
        shown = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").replace("\\", "").strip()
        slug = re.sub(r"[^\w\- ]", "", shown.lower()).replace(" ", "-")
        found[slug] = found.get(slug, -1) + 1
    return {slug if k == 0 else f"{slug}-{k}" for slug, times in found.items() for k in range(times + 1)}
