"""The arrows between the packages, and docstrings against signatures."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import crawler_bench
import crawler_model
import crawler_ros

ROOT = Path(crawler_model.__file__).parent.parent
OPTIONAL = ("rclpy", "rerun", "mcap", "matplotlib", "rosbags", "osqp", "typer", "rich", "pyarrow", "distributed")


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
    assert "scipy.sparse" not in modules_of(code)  # numba itself loads a little of scipy


def test_the_command_loads_nothing_that_it_was_not_asked_for():
    assert not loaded_by("import crawler_ros.cli") & {"rclpy", "rerun", "mcap", "matplotlib", "rosbags", "pyarrow"}


def test_without_recording_or_viewer_neither_is_imported():
    pytest.importorskip("rclpy")
    assert not loaded_by("import crawler_ros.simulator") & {"rerun", "mcap", "matplotlib", "rosbags"}


def test_the_model_knows_nothing_of_ros():
    for file in (ROOT / "crawler_model").glob("*.py"):
        assert not imports(file) & {"crawler_ros", *OPTIONAL}, file


def test_pure_modules_stay_pure():
    for name in ("messages", "stepper", "commands", "bag", "recorder"):
        assert "rclpy" not in imports(ROOT / "crawler_ros" / f"{name}.py")


def public_functions():
    for package in (crawler_model, crawler_ros, crawler_bench):
        for info in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
            try:
                module = importlib.import_module(info.name)
            except ModuleNotFoundError:
                continue
            for name, thing in vars(module).items():
                if name.startswith("_"):
                    continue
                thing = getattr(thing, "py_func", thing)
                if getattr(thing, "__module__", None) != module.__name__:
                    continue
                if inspect.isfunction(thing):
                    yield f"{module.__name__}.{name}", thing
                elif inspect.isclass(thing):
                    for method, function in vars(thing).items():
                        if inspect.isfunction(function) and not method.startswith("_"):
                            yield f"{module.__name__}.{name}.{method}", function


@pytest.mark.parametrize(("name", "function"), list(public_functions()), ids=lambda v: v if isinstance(v, str) else "")
def test_docstrings_name_the_arguments_that_there_are(name, function):
    text = inspect.getdoc(function) or ""
    assert text, f"{name} has no docstring"
    if "Args:" not in text:
        return
    section = re.split(r"\n(?:Returns|Raises|Yields|Source)\b", text.split("Args:")[1])[0]
    documented = [m[1] for m in re.finditer(r"^ {4}\*{0,2}(\w+)(?=[,:])", section, re.M)]
    wanted = [p for p in inspect.signature(function).parameters if p not in ("self", "cls")]
    assert documented == wanted, name


def test_kernels_are_compiled_anew_when_any_of_their_files_changed(tmp_path):
    """A kernel compiled into another lives in the other's cache, too."""
    shutil.copytree(ROOT / "crawler_model", tmp_path / "crawler_model", ignore=shutil.ignore_patterns("__pycache__"))
    kernel = tmp_path / "crawler_model" / "_probe_inner.py"
    outer = tmp_path / "crawler_model" / "_probe_outer.py"
    outer.write_text(
        "from ._compiled import compiled\nfrom ._probe_inner import inner\n\n@compiled\ndef outer():\n    return inner()\n"
    )
    seen = []
    for value in ("1", "22"):
        kernel.write_text(f"from ._compiled import compiled\n\n@compiled\ndef inner():\n    return {value}\n")
        code = "from crawler_model._probe_outer import outer; print(outer())"
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
        seen.append(done.stdout.strip())
    assert seen == ["1", "22"]
