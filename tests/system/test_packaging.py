"""The package as pip and colcon install it: what is listed twice agrees, and a colcon workspace runs."""

from __future__ import annotations

import importlib
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml

import crawler_model
from crawler_command.cite import ENTRIES
from crawler_ros.node.life.domains import reserved_domain

from ..pages import ROOT
from ..processes import PATIENCE_S

PACKAGE = "crawler_ros"
CONTROLLERS = (ROOT / "docs" / "controllers.md").read_text(encoding="utf-8")
EXECUTABLES = ("gait_player", "path_control", "phase_control", "plan", "policy", "replay", "simulator", "speed_control")


@pytest.fixture(scope="module")
def project():
    try:
        import tomllib
    except ImportError:  # before Python 3.11
        import tomli as tomllib

    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.fixture
def setup(monkeypatch):
    """What colcon reads of setup.py."""
    pytest.importorskip("setuptools")
    from distutils.core import run_setup

    monkeypatch.chdir(ROOT)
    return run_setup("setup.py", stop_after="init")


# -- what is listed twice -----------------------------------------------------------------------------------------


def test_the_version_and_the_licence_are_the_same_everywhere(project, setup):
    manifest = ET.parse(ROOT / "package.xml").getroot()
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    version = crawler_model.__version__  # hatch reads it there
    assert {setup.get_version(), manifest.findtext("version"), citation["version"]} == {version}
    assert {manifest.findtext("license"), citation["license"]} == {project["project"]["license"]["text"]}
    assert {setup.get_name(), manifest.findtext("name")} == {PACKAGE}
    assert project["project"]["name"] == PACKAGE.replace("_", "-")


def test_the_citation_in_bibtex_says_what_the_citation_file_says():
    program, paper = (dict(re.findall(r"(\w+) += \{+(.+?)\}+,\n", entry)) for entry in ENTRIES.split("@article"))
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    (article,) = cited["references"]
    assert program == {
        "title": cited["title"],
        "author": cited["authors"][0]["name"],
        "version": cited["version"],
        "year": str(cited["date-released"].year),
    }
    assert paper == {
        "title": article["title"],
        "author": "{family-names}, {given-names}".format(**article["authors"][0]),
        "journal": article["journal"],
        "year": str(article["year"]),
        "volume": str(article["volume"]),
        "number": str(article["issue"]),
        "pages": f"{article['start']}--{article['end']}",
        "eprint": article["identifiers"][0]["value"].removeprefix("arXiv:"),
        "archiveprefix": "arXiv",
    }


def test_every_package_of_the_tree_is_installed(project, setup):
    roots = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    found = {f.parent.relative_to(ROOT) for root in ROOT.glob("[a-z]*/__init__.py") for f in root.parent.rglob("*.py")}
    found = {".".join(folder.parts) for folder in found if folder.parts[0] not in ("benchmarks", "tests")}
    assert {name for name in found if "." not in name} == set(roots)
    assert sorted(setup.packages) == sorted(found)
    assert all((ROOT / name.replace(".", "/") / "__init__.py").is_file() for name in found)


def test_every_file_of_the_packages_is_installed(setup):
    listed = {
        path
        for package, patterns in setup.package_data.items()
        for pattern in patterns
        for path in (ROOT / package.replace(".", "/")).glob(pattern)
    }
    folders = [ROOT / name.replace(".", "/") for name in setup.packages]
    there = {
        path for folder in folders for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts
    }
    assert {path for path in there if path.suffix != ".py"} == listed


def test_colcon_and_pip_put_the_same_files_beside_the_packages(project, setup):
    shared = project["tool"]["hatch"]["build"]["targets"]["wheel"]["shared-data"]
    by_pip = {}
    for source, target in shared.items():
        for path in [ROOT / source] if (ROOT / source).is_file() else (ROOT / source).iterdir():
            to = target if path == ROOT / source else f"{target}/{path.name}"
            by_pip[to] = str(path.relative_to(ROOT))
    by_colcon = {f"{folder}/{Path(f).name}": f for folder, files in setup.data_files for f in files}
    executables = {f"lib/{PACKAGE}/{name}" for name in EXECUTABLES}  # colcon makes them of entry points
    assert {to: path for to, path in by_pip.items() if to not in executables} == by_colcon
    assert executables <= set(by_pip)


def test_every_executable_is_an_entry_point_of_both(project, setup):
    by_colcon = dict(line.split(" = ") for line in setup.entry_points["console_scripts"])
    by_pip = project["project"]["scripts"]
    assert by_colcon.pop("crawler") == by_pip["crawler"]
    assert sorted(by_colcon) == list(EXECUTABLES)
    assert {f"crawler-{name.replace('_', '-')}": where for name, where in by_colcon.items()} | {
        "crawler": by_pip["crawler"]
    } == by_pip
    verbs = dict(line.split(" = ") for line in setup.entry_points["crawler.verbs"])
    assert verbs == project["project"]["entry-points"]["crawler.verbs"]
    for name, where in by_colcon.items():
        module, function = where.split(":")
        assert callable(getattr(importlib.import_module(module), function))
        shim = ROOT / "resource" / "lib" / name
        assert os.access(shim, os.X_OK)
        assert f'/../../bin/crawler-{name.replace("_", "-")}" ' in shim.read_text(encoding="utf-8")


# -- a workspace --------------------------------------------------------------------------------------------------


class Workspace:
    """A colcon workspace that holds a copy of this project, and a shell in which its setup was sourced."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        left_out = shutil.ignore_patterns(
            ".*", "__pycache__", "build", "dist", "*.egg-info", "docs", "benchmarks", "tests"
        )
        shutil.copytree(ROOT, folder / "src" / PACKAGE, ignore=left_out)

    def shell(self, command: str, status: int = 0) -> str:
        """Run a command where ROS 2 is what this environment has, as after its setup.bash; return what it says."""
        own = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "ROS_LOCALHOST_ONLY")}
        own["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{own['PATH']}"
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=self.folder,
            env=own | {"AMENT_PREFIX_PATH": sys.prefix, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "COLUMNS": "120"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=PATIENCE_S,
        )
        assert done.returncode == status, done.stdout
        return done.stdout

    def sourced(self, command: str, status: int = 0) -> str:
        return self.shell(f"source install/setup.bash && {command}", status)

    def python(self, code: str) -> list[str]:
        return self.sourced(f"python - <<'END'\n{code}\nEND").splitlines()


@pytest.fixture(
    scope="module", params=["", pytest.param(" --symlink-install", marks=pytest.mark.slow)], ids=["copied", "linked"]
)
def workspace(request, tmp_path_factory):
    pytest.importorskip("rclpy")
    pytest.importorskip("colcon_ros")
    made = Workspace(tmp_path_factory.mktemp("workspace"))
    (line,) = [text for text in CONTROLLERS.splitlines() if text.startswith("colcon build")]
    made.shell(line.replace(" &&", f"{request.param} &&", 1))
    return made


def test_the_package_is_found_through_the_ament_index(workspace):
    prefix, share = workspace.python(
        "from ament_index_python.packages import get_package_prefix, get_package_share_directory\n"
        f"print(get_package_prefix('{PACKAGE}'))\nprint(get_package_share_directory('{PACKAGE}'))"
    )
    assert Path(prefix) == workspace.folder / "install" / PACKAGE
    assert (Path(share) / "package.xml").read_text() == (ROOT / "package.xml").read_text()
    launch = {file.name: file.read_text() for file in (ROOT / "launch").iterdir()}
    assert {file.name: file.read_text() for file in (Path(share) / "launch").iterdir()} == launch


def test_what_is_imported_is_the_workspaces(workspace):
    names = ("crawler_model", "crawler_ros", "msgs_config")
    code = f"import {', '.join(names)}\nprint(*(m.__file__ for m in ({', '.join(names)})), sep='\\n')"
    assert all(str(workspace.folder) in line for line in workspace.python(code))


def test_every_scene_is_installed(workspace):
    lines = workspace.sourced(f"install/{PACKAGE}/lib/{PACKAGE}/crawler scenes").splitlines()
    assert [line.split()[0] for line in lines] == sorted(p.stem for p in (ROOT / "msgs_config" / "scenes").iterdir())


@pytest.mark.parametrize("name", EXECUTABLES)
def test_an_executable_says_how_it_is_used(workspace, name):
    usage = {"replay": "Usage: crawler replay"}.get(
        name, "An example controller" if "control" in name else f"usage: {name}"
    )
    assert usage in workspace.sourced(f"install/{PACKAGE}/lib/{PACKAGE}/{name} --help")


@pytest.mark.parametrize("workspace", [""], ids=["copied"], indirect=True)  # kernels are compiled anew: once is enough
def test_a_scene_and_every_executable_run_from_there(workspace):
    lib = workspace.folder / "install" / PACKAGE / "lib" / PACKAGE
    assert {file.name for file in lib.iterdir()} == {"crawler", *EXECUTABLES}
    assert f"ros2 run {PACKAGE} simulator --ros-args -p scene:=two_anchor_a" in CONTROLLERS
    with reserved_domain() as domain:
        said = workspace.sourced(
            f"""export ROS_DOMAIN_ID={domain}
        {lib}/simulator --ros-args -p scene:=two_anchor_a -p real_time_factor:=5.0 -p record:=bags & simulator=$!
        {lib}/gait_player --ros-args -p scene:=two_anchor_a -p periods:=2
        {lib}/speed_control --ros-args -p periods:=2
        {lib}/phase_control --ros-args -p phases:=1 -p tolerance:=1.0
        kill -INT $simulator; wait $simulator && {lib}/replay bags/*"""
        )
    for part in ("period 2 of 2", "period 2: amplitude", "best phase", "complete", "identical to the bit"):
        assert part in said, said


def test_a_wrong_scene_ends_a_node_with_one_line(workspace):
    said = workspace.sourced(f"install/{PACKAGE}/lib/{PACKAGE}/simulator --ros-args -p scene:=nowhere", status=1)
    assert said.startswith("simulator: nowhere: no such file, nor a scene of the gallery")
