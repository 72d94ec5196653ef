"""Waiting for compilers: what is announced, and what `crawler warm` compiles ahead."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import pytest

import crawler_model.motion.line.motion
from crawler_lab.verbs.warm import BUILDS, EXAMPLES, JOBS, SECONDS, Kind, example_of, measure_compiled
from crawler_model import Scene, simulate

from ..commands import crawler

TINY = """
import sys
from crawler_model.compiled import compiled

@compiled
def inner(x):
    return x + 1

@compiled
def outer(x):
    return inner(x) * inner(x)

for function in (inner, outer):
    function.py_func.__module__ = "crawler_model.motion.plane.tiny"
outer(1.0)
outer(1)
"""
"""Two small kernels that seem to belong to the plane, each compiled for two types."""


def on_a_terminal(words: list[str], **more: str) -> str:
    """Run a command whose standard error is a terminal; return what it shows."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=theirs, env=os.environ | more)
    os.close(theirs)
    shown = b""
    while True:
        try:
            part = os.read(ours, 4096)
        except OSError:  # its end, on Linux
            break
        if not part:
            break
        shown += part
    os.close(ours)
    assert process.wait(200) == 0
    return shown.decode()


@pytest.fixture
def tiny(tmp_path) -> Path:
    script = tmp_path / "tiny.py"
    script.write_text(TINY)
    return script


def test_in_a_pipe_a_kind_is_announced_by_one_line(tiny, tmp_path):
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "NUMBA_CACHE_DIR": ""}
    done = subprocess.run([sys.executable, tiny], capture_output=True, text=True, env=environment, timeout=200)
    assert done.returncode == 0, done.stderr
    (line,) = done.stderr.splitlines()
    assert line == (
        "crawler: compiling the kernels of bodies in the plane, once on this machine: about 100 functions ..."
    )


def test_on_a_terminal_the_announcement_moves_and_is_removed(tiny, tmp_path):
    shown = on_a_terminal([sys.executable, str(tiny)], XDG_CACHE_HOME=str(tmp_path), NUMBA_CACHE_DIR="", COLUMNS="80")
    *lines, last = shown.split("\r\x1b[K")
    assert "crawler: compiling bodies in the plane" in lines[1]
    assert " of about 100, " in lines[1]
    assert all(len(line) < 80 for line in lines)
    assert last == ""


def errors_of(code: str) -> str:
    """What a program that ends well writes to its standard error."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    return done.stderr


def test_a_kernel_that_does_not_compile_is_not_announced_for_ever():
    """The balance of begun and ended compilations holds after an error, too."""
    code = (
        "from crawler_model.compiled import announcer, compiled\n"
        "from numba.core.errors import TypingError\n"
        "broken = compiled(lambda x: x.no_such_attribute)\n"
        "broken.py_func.__module__ = 'crawler_lab.gym.x'\n"
        "try:\n    broken(1.0)\nexcept TypingError:\n    pass\n"
        "assert announcer._depth == 0 and not announcer._kind"
    )
    assert "compiling the kernels of environments" in errors_of(code)


def test_time_limits_do_not_count_what_compiling_takes():
    code = (
        "import time\n"
        "from crawler_model.compiled import announcer, clock, compiled\n"
        "kernel = compiled(lambda x: x + 1.0)\n"
        "kernel.py_func.__module__ = 'crawler_lab.gym.x'\n"
        "begin, began = clock(), time.monotonic()\n"
        "kernel(1.0)\n"
        "time.sleep(0.05)\n"
        "passed, took = clock() - begin, time.monotonic() - began\n"
        "assert 0.05 <= passed <= took - 0.5 * announcer.spent() < took, (passed, took, announcer.spent())"
    )
    errors_of(code)


def test_time_limits_do_not_count_what_loading_takes():
    """On a busy machine it took all of an `optimise --seconds 5`, which then returned a gait that does not move."""
    errors_of("from crawler_model import Crawler, load_scene; Crawler(load_scene('two_anchor_a')).advance([0.1])")
    code = (
        "import time\n"
        "from crawler_model import Crawler, load_scene\n"
        "from crawler_model.compiled import announcer, clock\n"
        "from crawler_model.kernel_cache import KernelCache\n"
        "load = KernelCache._load_overload\n"
        "KernelCache._load_overload = lambda *words: time.sleep(0.05) or load(*words)\n"
        "crawler = Crawler(load_scene('two_anchor_a'))\n"
        "begin, began = clock(), time.monotonic()\n"
        "crawler.advance([0.1])\n"
        "passed, took = clock() - begin, time.monotonic() - began\n"
        "assert 0.0 <= passed <= took - 0.05 and not announcer._done, (passed, took)"
    )
    errors_of(code)


@pytest.mark.parametrize(("index", "shape"), [("i", 6), ("i, 0", (6, 1))])
def test_no_index_counts_from_the_end(index, shape):
    """A kernel reads what precedes the view in memory; one that checks its indices refuses to."""
    code = (
        "import numpy as np\nfrom crawler_model.compiled import compiled\n"
        f"read = compiled(lambda rows, i: rows[{index}])\n"
        f"rows = np.arange(6.0).reshape({shape})[2:]\n"
        "print(read(rows, 1), read(rows, -1))"
    )
    words = [sys.executable, "-c", code]
    assert subprocess.check_output(words, text=True, timeout=200).split() == ["3.0", "1.0"]
    checked = subprocess.run(
        words, capture_output=True, text=True, timeout=200, env=os.environ | {"NUMBA_BOUNDSCHECK": "1"}
    )
    assert checked.returncode == 1
    assert "IndexError: index is out of bounds" in checked.stderr


def test_every_kind_is_compiled_by_one_job():
    kinds = [kind for job in JOBS for kind in job]
    assert sorted(kinds) == sorted(Kind) == sorted(BUILDS) == sorted(SECONDS)


ELEMENT = {"stiffness": 1.0, "yield": 0.1}
LINKS = {
    "linear": {"stiffness": 1.0},
    "tendons": {"stiffness": 1.0, "tension": {"least": 0.0}},
    "loops": {"stiffness": 1.0, "hysteresis": [ELEMENT]},
    "backlash": {"stiffness": 1.0, "backlash": 0.01},
}
PATCHES = {"patches": [{"from": 0.1, "to": 0.2, "friction": 0.5}]}
WALLS = {"walls": [{"at": 9.0, "stops": "forward"}]}
PROFILE = {"profile": {"at": [0.0, 1.0], "friction": [1.0, 0.5]}}
GROUNDS = [PATCHES, WALLS, PROFILE, PATCHES | WALLS, WALLS | PROFILE, PATCHES | WALLS | PROFILE]
ADDED = {"with_elongation": [{"link": 0, "contacts": [0], "elongation": [0.0, 1.0], "added": [0.0, 0.1]}]}


def types_of(monkeypatch, scene: Scene) -> tuple[str, ...]:
    """Find the types of what a simulation gives to the kernel that follows ramps."""

    class FollowedError(Exception):
        pass

    def note(*arguments: Any) -> None:
        raise FollowedError(*(re.sub(r"\d+d, ", "", str(numba.typeof(each))) for each in arguments))

    with monkeypatch.context() as patch:
        patch.setattr(crawler_model.motion.line.motion, "follow", note)
        with pytest.raises(FollowedError) as followed:
            simulate(scene, duration=0.1)
    return followed.value.args


@pytest.mark.parametrize("between", [[[0, 1], [1, 2]], [[0, 1], [1, 2], [0, 2]]], ids=["chain", "graph"])
@pytest.mark.parametrize("links", LINKS)
def test_no_body_on_a_line_needs_other_kernels(monkeypatch, links, between):
    """Whatever a scene combines, its kernels are those of an example of `crawler warm`; even ground adds none."""
    known = {kind: types_of(monkeypatch, example_of(kind)) for kind in EXAMPLES if kind != Kind.plane}
    assert len(set(known.values())) == len(EXAMPLES) - 1
    document = {
        "name": "combined",
        "body": {"contacts": [0.0, 1.0, 2.0], "links": LINKS[links] | {"between": between}},
        "friction": {"forward": 0.2, "backward": 0.5},
        "drive": {"times": [0.0, 1.0], "actuation": [[0.0] * len(between), [1.0] * len(between)]},
    }
    even = types_of(monkeypatch, Scene.model_validate(document))
    assert even in known.values()
    scenes = [document | {"ground": ground} for ground in GROUNDS]
    if links == "linear":
        assert even == known[Kind.line if len(between) == 2 else Kind.graphs]
        scenes += [scene | {"friction": scene["friction"] | ADDED} for scene in (document, *scenes)]
    for scene in scenes:
        assert types_of(monkeypatch, Scene.model_validate(scene)) in known.values(), scene


def test_warm_loads_what_is_there_and_says_where_it_is():
    """The kernels of other tests are there."""
    done = crawler("warm", "line")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("ready: line; 0 functions compiled in ")
    assert (
        done.stderr == f"crawler: compiling line: up to {SECONDS[Kind.line]} s of processor time in 1 process(es) ...\n"
    )


@pytest.mark.slow
def test_what_is_expected_is_about_what_is_compiled(tmp_path):
    """The bars end near their ends. Compiled anew, on all cores."""
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "NUMBA_CACHE_DIR": ""}
    words = [sys.executable, "-m", "crawler_command.app", "warm", "line", "plane"]
    done = subprocess.run(words, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    code = "from crawler_lab.verbs.warm import measure_compiled; print(measure_compiled()[1])"
    seconds = float(subprocess.check_output([sys.executable, "-c", code], text=True, env=environment))
    assert seconds == pytest.approx(SECONDS[Kind.line] + SECONDS[Kind.plane], rel=0.3)


def test_the_cache_is_measured_by_the_cost_of_its_functions():
    count, seconds = measure_compiled()
    assert count > 100
    assert 0.05 * count <= seconds <= 0.5 * count
