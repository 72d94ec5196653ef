"""A package of interfaces, generated and compiled from their fields, as colcon would, with the wheels of rosidl."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

_GENERATE = """
import sys
from pathlib import Path
from rosidl_cli import entry_points
find = entry_points.get_entry_points  # the wheels declare each of them twice
entry_points.get_entry_points = lambda group, specs=None, strict=False: find(group, specs=specs)
from rosidl_cli.command.generate.api import generate
package, source, out, *files = sys.argv[1:]
generate(package_name=package, interface_files=[f"{source}:{file}" for file in files], output_path=Path(out),
    include_paths=[f"{sys.prefix}/share"], types=["c", "py"], typesupports=["c", "fastrtps_c"])
"""


def build(package: str, files: dict[str, str], folder: Path) -> dict[str, str]:
    """Build a package.

    Args:
        package: its name.
        files: the text of each interface by its path, as in "srv/Step.srv".
        folder: an empty folder.

    Returns:
        Variables of the environment with which programs import it.
    """
    if shutil.which("g++") is None:
        pytest.skip("no compiler for the generated interfaces")
    source, out, prefix = folder / "source", folder / "out", Path(sys.prefix)
    for name, text in files.items():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_text(text)
    environment = os.environ | {"AMENT_PREFIX_PATH": str(prefix)}
    command = [sys.executable, "-c", _GENERATE, package, str(source), str(out), *files]
    subprocess.run(command, env=environment, check=True, capture_output=True)
    headers, module = folder / "include" / package, folder / "python" / package
    for part in ("c", "fastrtps_c"):
        shutil.copytree(out / part, headers, dirs_exist_ok=True)
    shutil.copytree(out / "py", module)
    (module / "__init__.py").touch()
    include = [headers.parent, prefix / "include", *(prefix / "include").iterdir()]
    include += [Path(sysconfig.get_path("include")), Path(np.get_include())]
    libraries = folder / "lib"
    libraries.mkdir()

    def compile_to(target: Path, sources: list[Path], *linked: str) -> None:
        compiler = ["g++", "-std=c++17"] if sources[0].suffix == ".cpp" else ["gcc"]
        paths = [f"-I{path}" for path in include] + [f"-L{path}" for path in (libraries, prefix / "lib")]
        words = [
            *compiler,
            "-shared",
            "-fPIC",
            "-O0",
            *paths,
            "-o",
            target,
            *sources,
            *(f"-l{name}" for name in linked),
        ]
        subprocess.run(list(map(str, words)), check=True, capture_output=True)

    own = f"{package}__rosidl_generator_c"
    runtime = ("rosidl_runtime_c", "service_msgs__rosidl_generator_c")
    compile_to(libraries / f"lib{own}.so", sorted(headers.glob("*/detail/*.c")), *runtime)
    for kind, pattern, more in (
        ("rosidl_typesupport_fastrtps_c", "*/detail/*.cpp", ("rosidl_typesupport_fastrtps_cpp", "fastcdr")),
        ("rosidl_typesupport_c", "*/*.cpp", ()),
    ):
        linked = own, kind, f"service_msgs__{kind}", *more
        compile_to(libraries / f"lib{package}__{kind}.so", sorted(headers.glob(pattern)), *linked)
    python = f"{package}__rosidl_generator_py"
    compile_to(libraries / f"lib{python}.so", sorted(module.glob("*/*.c")), own, "service_msgs__rosidl_generator_py")
    for kind in ("rosidl_typesupport_fastrtps_c", "rosidl_typesupport_c"):
        target = module / f"{package}_s__{kind}{sysconfig.get_config_var('EXT_SUFFIX')}"
        linked = python, f"{package}__{kind}", own, "rosidl_runtime_c"
        compile_to(target, [module / f"_{package}_s.ep.{kind}.c"], *linked)
    path = os.pathsep.join((str(libraries), os.environ.get("LD_LIBRARY_PATH", "")))  # the wheels have set their own
    return {"PYTHONPATH": str(module.parent), "LD_LIBRARY_PATH": path}
