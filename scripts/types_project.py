# SPDX-License-Identifier: Apache-2.0
"""A project that compiles the types of one ROS package: types_project.py PACKAGE TARGET PREFIX.

PACKAGE is a folder with the name of the package and at least one of the folders msg, srv and
action; its other contents are ignored. TARGET is made; PREFIX has the packages of earlier calls.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[1]
KINDS = ("msg", "srv", "action")
"""Folders of a package that define types, each also the suffix of its files."""

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_USED = re.compile(r"^\s*([a-z][a-z0-9_]*)/[A-Z]", re.MULTILINE)
_ALWAYS = {"action_msgs", "builtin_interfaces"}
_VERSION = "0.0.1"


def write_project(package: Path, target: Path, prefix: Path) -> None:
    """Write the definitions of a package with the files that build them.

    Raises:
        SystemExit: The folder is not a package with types; the text says why.
    """
    name = package.resolve().name
    if not _NAME.fullmatch(name):
        raise SystemExit(f"'{name}' is not a name of a ROS package")
    files = sorted(path for kind in KINDS for path in package.glob(f"{kind}/*.{kind}"))
    if not files:
        raise SystemExit(f"{package} has none of msg/*.msg, srv/*.srv and action/*.action")
    used = _ALWAYS.union(*(_USED.findall(path.read_text(encoding="utf-8")) for path in files))
    used.discard(name)
    wheels = [
        f"ros-jazzy-{one.replace('_', '-')}"
        for one in sorted(used)
        if not (prefix / "share" / one / "package.xml").exists()
    ]
    for path in files:
        (target / path.parent.name).mkdir(parents=True, exist_ok=True)
        shutil.copy(path, target / path.parent.name)
    (target / "CMakeLists.txt").write_text(_cmake(name, sorted(used), files))
    (target / "package.xml").write_text(_manifest(name, sorted(used)))
    (target / "pyproject.toml").write_text(_pyproject(name, wheels, prefix))


def _cmake(name: str, used: Iterable[str], files: Iterable[Path]) -> str:
    found = "\n".join(f"find_package({one} REQUIRED)" for one in used)
    interfaces = " ".join(f"{path.parent.name}/{path.name}" for path in files)
    return f"""cmake_minimum_required(VERSION 3.24)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
{found}
rosidl_generate_interfaces(${{PROJECT_NAME}} {interfaces} DEPENDENCIES {" ".join(used)})
ament_package()
"""


def _manifest(name: str, used: Iterable[str]) -> str:
    depends = "".join(f"<depend>{one}</depend>" for one in used)
    return f"""<package format="3">
  <name>{name}</name><version>{_VERSION}</version><description>Types</description>
  <maintainer email="nobody@example.org">nobody</maintainer><license>Unknown</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  {depends}<member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


def _pyproject(name: str, wheels: list[str], prefix: Path) -> str:
    own = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]
    includes = str(ROOT / "cmake" / "ros_wheels.cmake")
    # JSON and TOML have the same syntax for texts and lists.
    return f"""[build-system]
build-backend = "scikit_build_core.build"
requires = {json.dumps([*own["requires"], *wheels])}
[project]
name = "{name.replace("_", "-")}-types"
version = "{_VERSION}"
dependencies = {json.dumps(wheels)}
[tool.scikit-build]
experimental = true
wheel.install-dir = "/data"
[tool.scikit-build.cmake.define]
BUILD_TESTING = false
CMAKE_PROJECT_TOP_LEVEL_INCLUDES = {json.dumps(includes)}
CMAKE_PREFIX_PATH = {json.dumps(str(prefix))}
"""


if __name__ == "__main__":
    write_project(*map(Path, sys.argv[1:4]))
