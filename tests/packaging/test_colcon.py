# SPDX-License-Identifier: Apache-2.0
"""``colcon build`` of the same sources: the packages, executables and data of a workspace."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from checkout import DATA_PACKAGES, PACKAGES, PYTHON_PACKAGES

pytestmark = pytest.mark.packaging


def test_every_package_is_built(install_space: Path):
    built = {path.parent.name for path in install_space.glob("*/share/*/package.xml")}
    assert built == {package.name for package in PACKAGES}


def test_executables_are_installed_where_ros_expects_them(install_space: Path):
    for package in PYTHON_PACKAGES:
        found = (install_space / package.name / "lib" / package.name).glob("*")
        assert {path.name for path in found} == set(package.executables())


@pytest.mark.parametrize("package", PYTHON_PACKAGES, ids=lambda package: package.name)
def test_every_module_is_installed_with_its_package_data(install_space: Path, package: Any):
    (folder,) = (install_space / package.name).glob("lib/python3.*/site-packages")
    for path in package.modules | package.package_data:
        assert (folder / path).is_file()


def test_workspace_programs_run_an_experiment_together(
    sourced: Any, install_space: Path, pyproject: dict[str, Any]
):
    command = str(install_space / "bt_agents_tools" / "lib" / "bt_agents_tools" / "bt-agents")
    assert pyproject["project"]["version"] in sourced.run(command, "--version")
    sourced.run(command, "check", "shipped")
    assert "Experiment 1" in sourced.run(command, "experiment", "run", "1", "--ros")


@pytest.mark.parametrize("package", PYTHON_PACKAGES, ids=lambda package: package.name)
def test_every_executable_finds_its_function_in_the_workspace(
    sourced: Any, install_space: Path, package: Any
):
    code = (
        "import importlib.metadata, sys\n"
        "entry = importlib.metadata.EntryPoint('', sys.argv[1], '')\n"
        "print(entry.load().__code__.co_filename)"
    )
    for target in package.executables().values():
        (path,) = sourced.python(code, target)
        assert Path(path).is_relative_to(install_space / package.name)


@pytest.mark.parametrize("package", DATA_PACKAGES, ids=lambda package: package.name)
def test_package_data_is_installed_with_its_folders(sourced: Any, package: Any):
    assert sourced.data(package.name) == package.data


def test_colcon_test_runs_the_tests_of_a_package(sourced: Any, source: Path, build: Path):
    folders = [f"--{name}-base={build / name}" for name in ("build", "install")]
    results = build / "build" / "bt_agents_core" / "pytest.xml"
    sourced.run(
        *("colcon", "test", "--return-code-on-test-failure", *folders),
        *("--paths", str(source / "bt_agents_core")),
    )
    (suite,) = ElementTree.parse(results).iter("testsuite")
    assert int(suite.get("tests", 0)) > 200
    assert suite.get("failures") == suite.get("errors") == suite.get("skipped") == "0"
