# SPDX-License-Identifier: Apache-2.0
"""`scripts/add_types`: compiles a folder with definitions of another package."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from types_project import write_project

from checkout import ROOT

NAV2 = ROOT / "tests" / "interfaces" / "nav2_msgs"


def test_project_requires_packages_its_definitions_use(tmp_path: Path) -> None:
    write_project(NAV2, tmp_path / "project", tmp_path / "prefix")
    project = tomllib.loads((tmp_path / "project" / "pyproject.toml").read_text())
    wheels = [
        f"ros-jazzy-{name}" for name in ("action-msgs", "builtin-interfaces", "geometry-msgs")
    ]
    assert project["project"]["dependencies"] == wheels
    assert set(wheels) < set(project["build-system"]["requires"])
    [generated] = re.findall(
        r"rosidl_generate_interfaces\((.*)\)",
        (tmp_path / "project" / "CMakeLists.txt").read_text(),
    )
    assert generated == (
        "${PROJECT_NAME} action/NavigateToPose.action "
        "DEPENDENCIES action_msgs builtin_interfaces geometry_msgs"
    )
    assert (tmp_path / "project" / "action" / "NavigateToPose.action").is_file()


def test_installed_package_is_not_required(tmp_path: Path) -> None:
    manifest = tmp_path / "prefix" / "share" / "geometry_msgs" / "package.xml"
    manifest.parent.mkdir(parents=True)
    manifest.touch()
    write_project(NAV2, tmp_path / "project", tmp_path / "prefix")
    assert "ros-jazzy-geometry-msgs" not in (tmp_path / "project" / "pyproject.toml").read_text()


@pytest.mark.parametrize(
    ("name", "words"),
    [("nav2_msgs", "has none of msg"), ("Nav2; rm", "is not a name of a ROS package")],
)
def test_a_folder_without_types_is_refused(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(SystemExit, match=words):
        write_project(tmp_path / name, tmp_path / "project", tmp_path)
    assert not (tmp_path / "project").exists()
