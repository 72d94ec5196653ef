"""The arrows between the packages, and docstrings against signatures."""

from __future__ import annotations

import ast
import dataclasses
import functools
import importlib
import inspect
import itertools
import os
import pkgutil
import re
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from pydantic import BaseModel

import crawler_command
import crawler_lab
import crawler_model
import crawler_pictures
import crawler_ros
import crawler_ros.replay
from crawler_model import kernel_cache

ROOT = Path(crawler_model.__file__).parent.parent
PACKAGES = (
    "crawler_model",
    "crawler_lab",
    "crawler_pictures",
    "crawler_ros",
    "crawler_command",
)
OPTIONAL = (
    "rclpy",
    "rerun",
    "mcap",
    "matplotlib",
    "rosbags",
    "osqp",
    "typer",
    "rich",
    "pyarrow",
    "distributed",
    "pandas",
    "polars",
    "gymnasium",
    "aiohttp",
)


def imports(file: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module.split(".")[0])
    return found


def modules_of(statement: str) -> set[str]:
    code = f"{statement}; import sys; print(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def loaded_by(statement: str) -> set[str]:
    return {name.split(".")[0] for name in modules_of(statement)}


def test_the_model_loads_nothing_of_ros_pictures_or_recordings():
    assert not loaded_by("import crawler_model") & set(OPTIONAL)


def test_a_chain_loads_nothing_that_other_bodies_need():
    code = "import crawler_model as c; c.Crawler(c.load_scene('two_anchor_a')).advance([1.0])"
    assert not loaded_by(code) & {"clarabel", "osqp"}
    assert "scipy.sparse" not in modules_of(code) - modules_of("import numba, scipy.linalg")  # as numba does


def test_who_only_reads_scenes_loads_no_kernels():
    pytest.importorskip("rclpy")
    assert "numba" not in loaded_by("import crawler_ros.node.gait_player as player; player.load_scene('two_anchor_a')")


def test_the_command_loads_nothing_that_it_was_not_asked_for():
    assert not loaded_by("import crawler_command.app") & {"rclpy", "rerun", "mcap", "matplotlib", "rosbags", "pyarrow"}


def test_without_recording_or_viewer_neither_is_imported():
    pytest.importorskip("rclpy")
    assert not loaded_by("import crawler_ros.node.simulator") & {"rerun", "mcap", "matplotlib", "rosbags"}


KERNELS = {"compiled", "entry", "inner", "lean", "inlined"}
"""Decorators of kernels."""


def test_the_model_knows_nothing_of_ros():
    for file in (ROOT / "crawler_model").rglob("*.py"):
        assert not imports(file) & {"crawler_ros", *OPTIONAL}, file


def test_pure_rooms_stay_pure():
    pure = [*(ROOT / "crawler_ros" / "recording").glob("*.py"), *(ROOT / "crawler_ros" / "node").rglob("*.py")]
    impure = {file.name for file in pure if "rclpy" in imports(file)}
    assert impure <= {
        "simulator.py",
        "gait_player.py",
        "intake.py",
        "parameters.py",
        "peers.py",
        "quiet_node.py",
        "run.py",
    }


def modules(package: ModuleType) -> Iterator[ModuleType]:
    yield package
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        try:
            yield importlib.import_module(info.name)
        except ModuleNotFoundError as error:  # an extra that is not installed, never a module of ours
            if str(error.name).startswith("crawler_"):
                raise


def public_things(package: ModuleType) -> Iterator[tuple[str, Any]]:
    """Every public function and class of a package, methods and properties as functions, each where it is written."""
    for module in modules(package):
        for name, thing in vars(module).items():
            thing = getattr(thing, "py_func", thing)
            if name.startswith("_") or getattr(thing, "__module__", None) != module.__name__:
                continue
            if inspect.isfunction(thing):
                yield f"{module.__name__}.{name}", thing
            elif inspect.isclass(thing):
                yield f"{module.__name__}.{name}", thing
                for member, value in vars(thing).items():
                    if not member.startswith("_") and (inspect.isfunction(value) or isinstance(value, _WRAPPED)):
                        yield f"{module.__name__}.{name}.{member}", value


_WRAPPED = (property, functools.cached_property, staticmethod, classmethod)
EVERYTHING = (
    crawler_model,
    crawler_lab,
    crawler_pictures,
    crawler_ros,
    crawler_command,
)
LABORATORY = ("derivative", "sweep", "optimise", "identify", "springs")
INTERFACE = (
    crawler_model,
    *(importlib.import_module(f"crawler_lab.{room}") for room in LABORATORY),
    crawler_ros.replay,
)
"""What others call: the model, the laboratory's functions, and what reads recordings."""


@functools.cache
def things_of(packages: tuple[ModuleType, ...]) -> list[tuple[str, Any]]:
    """All public things of packages, each once."""
    return list(dict(thing for package in packages for thing in public_things(package)).items())


def plain(thing: Any) -> Any:
    """The function behind a property, a class method or a static method."""
    if isinstance(thing, property):
        return thing.fget
    return getattr(thing, "func", getattr(thing, "__func__", thing))


def functions(packages: tuple[ModuleType, ...]) -> list[tuple[str, Any]]:
    return [(name, thing) for name, thing in things_of(packages) if inspect.isfunction(plain(thing))]


def classes(packages: tuple[ModuleType, ...]) -> list[tuple[str, Any]]:
    return [(name, thing) for name, thing in things_of(packages) if inspect.isclass(thing)]


def entries(text: str, section: str) -> dict[str, str]:
    """The entries of a section of a docstring: name (`a, b` for two) and what is said of it."""
    found: dict[str, str] = {}
    lines = text.split(f"\n{section}:\n")[1].splitlines() if f"\n{section}:\n" in text else []
    for line in itertools.takewhile(lambda line: not line or line.startswith("    "), lines):
        entry = re.match(r" {4}(\*{0,2}\w+(?:, \*{0,2}\w+)*): (.*)", line)
        if entry:
            found[entry[1].replace("*", "")] = entry[2]
        elif found:
            found[list(found)[-1]] += " " + line.strip()
    return found


def names(text: str, section: str) -> list[str]:
    return [name for entry in entries(text, section) for name in entry.split(", ")]


def parameters(function: Any) -> list[str]:
    return [p for p in inspect.signature(function).parameters if p not in ("self", "cls")]


def body(function: Any) -> list[ast.AST]:
    """The nodes of a function, without the functions inside it."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
    found: list[ast.AST] = []
    todo = list(ast.iter_child_nodes(tree))
    while todo:
        node = todo.pop()
        found.append(node)
        if not isinstance(node, (ast.FunctionDef, ast.Lambda, ast.ClassDef)):
            todo += ast.iter_child_nodes(node)
    return found


def raised(function: Any) -> set[str]:
    """Names of the errors that a function itself raises."""
    found = set()
    for node in body(function):
        if isinstance(node, ast.Raise) and node.exc is not None:
            error = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
            name = error.attr if isinstance(error, ast.Attribute) else getattr(error, "id", "")
            found |= {name} if name[:1].isupper() else set()
    return found


def documentation(thing: Any) -> str:
    return inspect.cleandoc(plain(thing).__doc__ or "")  # its own: not one that it inherits


def shared(function: Any) -> dict[str, str]:
    """The arguments that the packages around a function describe for all that is inside them."""
    found: dict[str, str] = {}
    package = function.__module__
    while "." in package:
        package = package.rpartition(".")[0]
        found |= entries(importlib.import_module(package).__doc__ or "", "Args")
    return found


def names_arguments(text: str, function: Any) -> bool:
    """Whether a docstring names the arguments of a function in order, but for arguments that its package describes."""
    named = names(text, "Args")
    return named == [p for p in parameters(function) if p in named or p not in shared(function)]


def test_docstrings_do_not_repeat_what_their_package_describes():
    for name, function in functions(EVERYTHING):
        function = plain(function)
        assert not entries(documentation(function), "Args").items() & shared(function).items(), name


def described(text: str, function: Any) -> bool:
    """Whether a docstring describes what a function takes, returns or yields, and raises."""
    attribute = isinstance(function, (property, functools.cached_property))
    function = plain(function)
    nodes = body(function)
    gives = any(isinstance(n, ast.Return) and n.value is not None for n in nodes)
    yields = any(isinstance(n, (ast.Yield, ast.YieldFrom)) for n in nodes)
    returned = attribute or (gives <= ("\nReturns:\n" in text) and yields <= ("\nYields:\n" in text))
    return names_arguments(text, function) and returned and raised(function) <= set(names(text, "Raises"))


def test_docstrings_say_what_a_function_takes_gives_and_raises():
    """Where a function keeps the contract of `Motion` or of `State`, that describes it."""
    texts = {name: (documentation(function), function) for name, function in functions(INTERFACE)}
    own = [name for name, (text, _) in texts.items() if not re.search("see `(Motion|State)`", text)]
    assert [name for name in own if not described(*texts[name])] == []


def test_docstrings_of_dataclasses_name_the_fields_that_there_are():
    wrong = []
    for name, kind in classes(INTERFACE):
        if dataclasses.is_dataclass(kind):
            own = [f.name for f in dataclasses.fields(kind) if f.name in vars(kind).get("__annotations__", {})]
            named = names(documentation(kind), "Attributes")
            wrong += [] if named == [f for f in own if not f.startswith("_")] else [name]
    assert wrong == []


FLOAT = ("float", "float | None")
UNIT = r"\[[^\]]+\]"


def test_numbers_in_docstrings_have_units():
    """What is annotated `float` has its unit in brackets; [1] where it has none."""
    silent = []
    for name, thing in things_of(INTERFACE):
        text, annotated = documentation(thing), inspect.get_annotations(plain(thing))
        for entry, said in {**entries(text, "Args"), **entries(text, "Attributes")}.items():
            for key in entry.split(", "):
                if annotated.get(key) in FLOAT and not re.search(UNIT, said):
                    silent.append(f"{name}: {key}")
        if annotated.get("return") in FLOAT and not re.search(UNIT, text.split("Returns:")[-1]):
            silent.append(f"{name}: what it returns")
    assert silent == []


def test_keys_of_scene_files_are_described():
    models = [(name, kind) for name, kind in classes(INTERFACE) if issubclass(kind, BaseModel)]
    keys = [(f"{name}.{key}", field.description) for name, kind in models for key, field in kind.model_fields.items()]
    assert [key for key, text in keys if not (text and text.endswith("."))] == []


def run_probe(folder, cache):
    code = "from crawler_model._probe_outer import outer; print(outer())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env=os.environ | {"XDG_CACHE_HOME": str(cache), "NUMBA_CACHE_DIR": "", "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.mark.parametrize(
    "inner",
    ["from .compiled import compiled\n\n@compiled\ndef inner():\n    return {}\n", "ROW = {}\n"],
    ids=["kernel of another file", "constant of a file without kernels"],
)
def test_kernels_are_compiled_anew_when_a_file_changed_that_they_are_built_from(tmp_path, inner):
    """A kernel or a constant compiled into another kernel lives in the other's cache, too."""
    package = tmp_path / "crawler_model"
    shutil.copytree(ROOT / "crawler_model", package, ignore=shutil.ignore_patterns("__pycache__"))
    name = "inner" if "inner" in inner else "ROW"
    value = "inner()" if name == "inner" else "ROW"
    (package / "_probe_outer.py").write_text(
        f"from .compiled import compiled\nfrom ._probe_inner import {name}\n\n"
        f"@compiled\ndef outer():\n    return {value}\n"
    )
    seen = []
    for number in ("1", "2"):
        (package / "_probe_inner.py").write_text(inner.format(number))
        os.utime(package / "_probe_inner.py", (1e9, 1e9))  # as old and as long as before: contents count
        seen.append(run_probe(tmp_path, tmp_path / "cache"))
    assert seen == ["1", "2"]


def test_compiled_kernels_are_loaded_without_what_only_compilation_needs():
    run = "from crawler_model import *; simulate(load_scene('two_anchor_a'), duration=0.1)"
    ask = "import sys; print('numba.np.random.generator_core' in sys.modules)"
    for _ in range(2):  # the first one may compile
        done = subprocess.run([sys.executable, "-c", f"{run}; {ask}"], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_a_chain_compiles_nothing_that_other_bodies_need(tmp_path):
    """From an empty cache: no sleeping cluster of a long chain, no border of a patch, no knot of a curve.

    Nothing is optimised, which would take half of the time.
    """
    run = """
from crawler_model import load_scene, simulate
from crawler_model.motion.line import clusters, path
from crawler_model.motion.line.ground import borders, falls, ramp_bounds
from crawler_model.motion.line.springs import bends
simulate(load_scene("two_anchor_a"), duration=0.1)
needed = [len(k.signatures) for k in (path.solve_path, path._find_first_flow)]
others = (bends.find_pieces, clusters._form_leaf, clusters._wake, borders.set_bound, falls._let_all_fall, ramp_bounds.place_anew)
print(min(needed) > 0, sum(len(k.signatures) for k in others))
"""
    cold = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_OPT": "0"}
    done = subprocess.run([sys.executable, "-c", run], env=cold, capture_output=True, text=True, check=True)
    assert done.stdout == "True 0\n"


def test_the_kernels_cache_covers_all_files_that_kernels_import():
    """Imports only for types leave no trace in a kernel."""
    model = ROOT / "crawler_model"
    covered = {file for pattern in kernel_cache._SOURCES for file in model.glob(pattern)}
    marks = tuple(f"\n@{mark}\n" for mark in KERNELS)
    waiting = [file for file in model.rglob("*.py") if any(mark in file.read_text(encoding="utf-8") for mark in marks)]
    assert len(waiting) > 20
    reached: set[Path] = set()
    while waiting:
        file = waiting.pop()
        if file not in reached:
            reached.add(file)
            waiting += imported_at_run_time(file)
    assert sorted(reached - covered) == []


def imported_at_run_time(file: Path) -> Iterator[Path]:
    """The modules that a module of the model imports from its package."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    blocks = [node for node in ast.walk(tree) if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)]
    for_types = {node for block in blocks for node in ast.walk(block)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level and node not in for_types:
            base = file.parents[node.level - 1].joinpath(*(node.module.split(".") if node.module else []))
            for name in node.names:
                yield from (f for f in (base.with_suffix(".py"), base / f"{name.name}.py") if f.is_file())


def test_equal_copies_of_the_model_share_their_compiled_kernels(tmp_path):
    """The cache belongs to contents, not to places."""
    written = []
    for copy in ("first", "second"):
        package = tmp_path / copy / "crawler_model"
        shutil.copytree(ROOT / "crawler_model", package, ignore=shutil.ignore_patterns("__pycache__"))
        (package / "_probe_outer.py").write_text(
            "from .compiled import compiled\n\n@compiled\ndef outer():\n    return 3\n"
        )
        assert run_probe(tmp_path / copy, tmp_path / "cache") == "3"
        written.append({f: f.stat().st_mtime_ns for f in (tmp_path / "cache").rglob("*.nb?")})
    assert len(written[0]) >= 2
    assert written[0] == written[1]
