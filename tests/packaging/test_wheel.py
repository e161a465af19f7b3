# SPDX-License-Identifier: Apache-2.0
"""The wheel: one file with all packages, which works in its own environment."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import Any

import pytest

from checkout import DATA_PACKAGES, PACKAGES, PYTHON_PACKAGES

pytestmark = pytest.mark.packaging


def test_project_builds_one_wheel_with_every_module(wheel: Path, pyproject: dict[str, Any]):
    assert wheel.name.startswith(f"bt_agents-{pyproject['project']['version']}-cp3")
    held = {Path(name) for name in zipfile.ZipFile(wheel).namelist()}
    for package in PYTHON_PACKAGES:
        assert package.modules | package.package_data <= held


def test_wheel_names_its_requirements(wheel: Path, pyproject: dict[str, Any]):
    with zipfile.ZipFile(wheel) as file:
        (metadata,) = (name for name in file.namelist() if name.endswith("/METADATA"))
        lines = file.read(metadata).decode().splitlines()
    named = {line.removeprefix("Requires-Dist: ") for line in lines}
    for requirement in pyproject["project"]["dependencies"]:
        name, *versions = re.split(r"(?=[<>=])", requirement, maxsplit=1)
        assert f"{name}{','.join(sorted(''.join(versions).split(',')))}" in named


def test_the_installed_interfaces_can_be_used(installed: Any):
    code = (
        "from bt_agents_interfaces import action, msg, srv\n"
        "print(action.RunAgent.Goal(scene=msg.Scene(scene_id='hall')).scene.scene_id)\n"
        "print(srv.Analyze.Request().label)"
    )
    assert installed.python(code) == ["hall", ""]


def test_ament_index_lists_every_package_of_wheel(installed: Any):
    code = (
        "import sys; from ament_index_python import get_package_share_directory as share\n"
        "for name in sys.argv[1:]: print(name, share(name).removeprefix(sys.prefix))"
    )
    names = [package.name for package in PACKAGES]
    assert installed.python(code, *names) == [f"{name} /share/{name}" for name in names]


@pytest.mark.usefixtures("installed")
def test_executables_are_installed_where_ros_expects_them(requirements: Path):
    for package in PYTHON_PACKAGES:
        found = (requirements / "lib" / package.name).glob("*")
        assert {path.name for path in found} == set(package.executables())


def test_executable_uses_its_own_python_despite_path(
    installed: Any, requirements: Path, pyproject: dict[str, Any]
):
    command = requirements / "lib" / "bt_agents_tools" / "bt-agents"
    said = installed.run("env", "PATH=/usr/bin:/bin", str(command), "--version")
    assert said == f"bt-agents, version {pyproject['project']['version']}\n"


@pytest.mark.parametrize("package", DATA_PACKAGES, ids=lambda package: package.name)
def test_package_data_is_installed_with_its_folders(installed: Any, package: Any):
    assert installed.data(package.name) == package.data


def test_installed_programs_run_an_experiment_together(installed: Any):
    installed.run("bt-agents", "check", "shipped")
    assert "Experiment 1" in installed.run("bt-agents", "experiment", "run", "1", "--ros")
