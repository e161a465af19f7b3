# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the distribution, built and installed both ways once for this folder."""

from __future__ import annotations

import os
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

from checkout import ROOT
from locked_packages import UV, make_environment, uv

NOT_OPTIMIZED = [
    f"--config-setting=cmake.define.CMAKE_{language}_FLAGS_RELEASE=-O0"
    for language in ("C", "CXX")
]
"""The speed of the interfaces is measured in the checkout."""


class Installation:
    """One installed copy of the project, whose programs run in an empty folder."""

    def __init__(self, bin_folder: Path, prelude: str, empty: Path) -> None:
        self._bin = bin_folder
        self._prelude = prelude
        self._empty = empty

    def run(self, command: str, *arguments: str) -> str:
        """Return the output of a program of this installation; fail unless it succeeds."""
        script = f'{self._prelude} exec "$@"'
        return run(["bash", "-c", script, "-", command, *arguments], self._bin, self._empty)

    def python(self, code: str, *arguments: str) -> list[str]:
        """Return the lines that some Python code prints."""
        return self.run("python", "-c", code, *arguments).splitlines()

    def data(self, package: str) -> set[str]:
        """Return the YAML files of a package, found through the ament index."""
        code = (
            "import sys; from ament_index_python import get_package_share_directory as share\n"
            "print(share(sys.argv[1]))"
        )
        (share,) = self.python(code, package)
        return {str(path.relative_to(share)) for path in Path(share).rglob("*.yaml")}


@pytest.fixture(scope="session")
def pyproject() -> dict[str, Any]:
    """The project's ``pyproject.toml``."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the checkout without built or hidden files."""
    copy = tmp_path_factory.mktemp("source") / "bt agents"
    unwanted = shutil.ignore_patterns(".*", "__pycache__", "build", "install", "log", "dist")
    return shutil.copytree(ROOT, copy, ignore=unwanted)


@pytest.fixture(scope="session")
def requirements(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with only the project's declared dependencies."""
    folder = tmp_path_factory.mktemp("installed") / "environment"
    make_environment(folder)
    return folder


@pytest.fixture(scope="session")
def tools(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment that can build the project but has not installed it."""
    folder = tmp_path_factory.mktemp("tools") / "environment"
    make_environment(folder, "build", "packaging")
    return folder / "bin"


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """Folder of both builds, so that the C++ of the interfaces is compiled once.

    Raises:
        FileExistsError: Another worker of this test run builds, too.
    """
    of_run = tmp_path_factory.getbasetemp()
    folder = (of_run if worker_id == "master" else of_run.parent) / "workspace"
    folder.mkdir()
    return folder


@pytest.fixture(scope="session")
def wheel(source: Path, tools: Path, build: Path) -> Path:
    """The only wheel of the project."""
    shared = f"--config-setting=build-dir={build / 'build' / 'bt_agents_interfaces'}"
    command = [str(UV), "build", "--wheel", "--no-build-isolation", "--python", "python"]
    run([*command, shared, *NOT_OPTIMIZED, "--out-dir", "dist", str(source)], tools, build)
    (found,) = (build / "dist").glob("*.whl")
    return found


@pytest.fixture(scope="session")
def installed(
    wheel: Path, requirements: Path, tmp_path_factory: pytest.TempPathFactory
) -> Installation:
    """The wheel in an environment of its own."""
    uv("pip", "install", "--python", str(requirements / "bin" / "python"), "--no-deps", str(wheel))
    return Installation(requirements / "bin", "", tmp_path_factory.mktemp("empty"))


@pytest.fixture(scope="session")
def install_space(wheel: Path, source: Path, tools: Path, build: Path) -> Path:
    """Result of ``colcon build`` of the same sources, after the wheel: see ``build``."""
    cmake = [
        "-GNinja",
        f"-DCMAKE_PROJECT_TOP_LEVEL_INCLUDES={source / 'cmake' / 'ros_wheels.cmake'}",
        f"-DPython3_EXECUTABLE={tools / 'python'}",
        "-DBUILD_TESTING=OFF",
    ]
    run(["colcon", "build", "--base-paths", str(source), "--cmake-args", *cmake], tools, build)
    return build / "install"


@pytest.fixture(scope="session")
def sourced(
    install_space: Path, tools: Path, tmp_path_factory: pytest.TempPathFactory
) -> Installation:
    """A shell that has sourced the install space of ``colcon build``."""
    prelude = f'source "{install_space / "setup.bash"}";'
    return Installation(tools, prelude, tmp_path_factory.mktemp("empty"))


def run(command: list[str], programs: Path, cwd: Path) -> str:
    """Return the output of a command, with ``programs`` first on its path; fail if it fails.

    The environment of these tests runs on ROS wheels, too, and would pass on its own paths;
    compiled Python files are kept, as for all users.
    """
    own = {"_ROS_WHEELS_BOOTSTRAP_COMPLETE", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH"}
    own |= {"PYTHONDONTWRITEBYTECODE", "PYTHONPATH"}
    environment = {name: value for name, value in os.environ.items() if name not in own}
    environment |= {"PATH": f"{programs}:/usr/bin:/bin", "XDG_STATE_HOME": str(cwd)}
    done = subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        pytest.fail(f"{command} in {cwd} ended with {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout
