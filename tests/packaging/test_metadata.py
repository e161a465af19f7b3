# SPDX-License-Identifier: Apache-2.0
"""One version, one licence and complete metadata in every package."""

from __future__ import annotations

import ast
import re
import sys
from configparser import ConfigParser
from importlib.metadata import files
from pathlib import Path
from typing import Any

import pytest
import yaml

from checkout import DATA_PACKAGES, PACKAGES, PYTHON_PACKAGES, ROOT, RosPackage

pytestmark = pytest.mark.packaging

KEYS = {
    "aiohttp": ("python3-aiohttp", "aiohttp>=3.8.4"),
    "click": ("python3-click", "click>=8.1.3"),
    "matplotlib": ("python3-matplotlib", "matplotlib>=3.6.3"),
    "mcap": ("", "mcap>=1.6"),
    "mcap_ros2": ("", "mcap-ros2-support>=0.5"),
    "numpy": ("python3-numpy", "numpy>=1.24.2"),
    "psycopg": ("", "psycopg[binary]>=3.2.1,<4"),
    "py_trees": ("py_trees", "py_trees>=2.4,<3"),
    "pyarrow": ("", "pyarrow>=14"),
    "rich": ("python3-rich", "rich>=13.3.1"),
    "yaml": ("python3-yaml", "pyyaml>=6.0"),
    "zstandard": ("", "zstandard>=0.20"),
}
"""Module outside ROS → its names for rosdep, if it has one, and on PyPI."""

ROSDEP = Path(__file__).with_name("rosdep_keys.yaml")
"""Keys of rosdistro for Jazzy that packages of a distribution satisfy, and ROS packages in it."""

LAUNCH_FILES = sorted(
    path for package in PACKAGES for path in package.folder.rglob("*.launch.yaml")
)

PYTEST = {"pytest", "_pytest"}

every_package = pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
every_python_package = pytest.mark.parametrize(
    "package", PYTHON_PACKAGES, ids=lambda package: package.name
)


@every_package
def test_manifest_is_complete_and_matches_distribution(
    package: RosPackage, pyproject: dict[str, Any]
):
    project = pyproject["project"]
    manifest = package.manifest
    assert manifest.get("format") == "3"
    assert manifest.findtext("version") == project["version"]
    assert manifest.findtext("license") == project["license"]
    assert (manifest.findtext("description") or "").endswith(".")
    assert manifest.find("maintainer") is not None
    by_python = package.build_type == "ament_python"
    assert by_python or package.build_type == "ament_cmake"
    assert (package.folder / "setup.py").exists() == by_python
    assert (package.folder / "CMakeLists.txt").exists() != by_python


@every_package
def test_package_has_matching_readme_and_changelog(package: RosPackage):
    manifest = package.manifest
    readme = (package.folder / "README.md").read_text(encoding="utf-8")
    assert readme.startswith(f"# {package.name}\n\n{manifest.findtext('description')}\n")
    for link in re.findall(r"\]\(([^)#]*)[^)]*\)", readme):
        assert (package.folder / link).exists(), link
    for name in re.findall(r"`([\w./-]+(?:/|\.py|\.yaml))`", readme.partition("|---|---|")[2]):
        assert list(package.folder.glob(name)) or list(package.folder.glob(f"*/{name}")), name
    log = (package.folder / "CHANGELOG.rst").read_text(encoding="utf-8").splitlines()
    title = f"Changelog for package {package.name}"
    assert log[:3] == ["^" * len(title), title, "^" * len(title)]
    assert log[4] == "Forthcoming" or log[4].startswith(f"{manifest.findtext('version')} (")
    assert log[5] == "-" * len(log[4])
    assert log[6:] == ["* All packages share CHANGELOG.md in the root of the repository."]
    version = manifest.findtext("version")
    assert f"\n## {version}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_every_source_file_names_its_licence():
    folders = [package.folder for package in PACKAGES]
    folders += [ROOT / name for name in ("benchmarks", "scripts", "tests")]
    found = (file for folder in folders for file in folder.rglob("*.py"))
    files = [file for file in found if "node_modules" not in file.parts]
    assert len(files) > 800
    bare = [file for file in files if "SPDX-License-Identifier: Apache-2.0" not in _head(file)]
    assert not bare


def _head(file: Path) -> str:
    with file.open(encoding="utf-8") as lines:
        return lines.readline() + lines.readline()


@every_python_package
def test_setup_py_matches_manifest(package: RosPackage):
    setup, manifest = package.setup(), package.manifest
    maintainer = manifest.find("maintainer")
    assert maintainer is not None
    assert setup["name"] == package.name
    assert setup["version"] == manifest.findtext("version")
    assert setup["description"] == manifest.findtext("description")
    assert setup["license"] == manifest.findtext("license")
    assert setup["maintainer"] == maintainer.text
    assert setup["maintainer_email"] == maintainer.get("email")


@every_python_package
def test_colcon_test_finds_the_tests_of_a_package(package: RosPackage, pyproject: dict[str, Any]):
    settings = ConfigParser()
    settings.read(package.folder / "setup.cfg", encoding="utf-8")
    own, everywhere = settings["tool:pytest"], pyproject["tool"]["pytest"]["ini_options"]
    (tests,) = own["testpaths"].split()
    # Code outside nodes is tested with the nodes.
    assert Path(tests).name == {"bt_agents_ros": "ros"}.get(package.name, package.name)
    assert (package.folder / tests).is_dir()
    assert own["pythonpath"].split() == [f"../{path}" for path in everywhere["pythonpath"]]
    assert own["addopts"].split() == everywhere["addopts"]
    assert {line for line in own["markers"].splitlines() if line} <= {*everywhere["markers"]}
    assert package.setup()["extras_require"] == {"test": ["pytest", "hypothesis"]}


@every_python_package
def test_python_package_is_registered_in_ament_index(package: RosPackage):
    marker = f"resource/{package.name}"
    assert (package.folder / marker).is_file()
    data = dict(package.setup()["data_files"])
    assert data["share/ament_index/resource_index/packages"] == [marker]
    assert data[f"share/{package.name}"] == ["package.xml"]
    assert all((package.folder / file).is_file() for files in data.values() for file in files)


def test_packages_include_types_and_foxglove_layout():
    held = set().union(*(package.package_data for package in PYTHON_PACKAGES))
    assert {Path(package.name) / "py.typed" for package in PYTHON_PACKAGES} <= held
    layout = Path("bt_agents_lab/foxglove/bt_agents.json")
    assert layout in held
    [lab] = (package for package in PYTHON_PACKAGES if package.name == "bt_agents_lab")
    assert (f"share/{layout.parent}", [str(layout)]) in lab.setup()["data_files"]


@every_python_package
def test_manifest_dependencies_match_imports_exactly(package: RosPackage):
    imported = {KEYS.get(module, (module,))[0] for module in _imports(package)}
    assert package.dependencies == imported - {""}


@every_package
def test_rosdep_resolves_every_key_without_pip(package: RosPackage):
    known = yaml.safe_load(ROSDEP.read_text(encoding="utf-8"))
    own = {one.name for one in PACKAGES}
    tools = {element.text or "" for element in package.manifest.iter("buildtool_depend")}
    tests = {element.text or "" for element in package.manifest.iter("test_depend")}
    needed = package.dependencies | tools | tests
    assert needed - own <= {*known["jazzy"], *known["ubuntu"]}


def test_the_wheel_requires_what_the_packages_import(pyproject: dict[str, Any]):
    imported = {module for package in PYTHON_PACKAGES for module in _imports(package)}
    own = {package.name for package in PACKAGES}
    project = pyproject["project"]
    extras = project["optional-dependencies"]
    required = {*project["dependencies"], *extras["lab"], *extras["fleet"]}
    for module in imported - own:
        ros_wheel = f"ros-jazzy-{module.replace('_', '-')}"
        assert KEYS.get(module, ("", ros_wheel))[1] in required


def test_import_rules_cover_every_python_package(pyproject: dict[str, Any]):
    covered = pyproject["tool"]["importlinter"]["root_packages"]
    assert set(covered) == {package.name for package in PYTHON_PACKAGES}


def test_wheel_declares_entry_points_of_packages(pyproject: dict[str, Any]):
    found: dict[str, dict[str, str]] = {}
    for package in PYTHON_PACKAGES:
        for group, names in package.entry_points().items():
            found.setdefault(group, {}).update(names)
    executables = found.pop("console_scripts")
    project = pyproject["project"]
    assert project["entry-points"] == found
    assert project["scripts"].items() <= executables.items()


@pytest.mark.parametrize("launch", LAUNCH_FILES, ids=lambda path: path.name)
def test_launch_files_use_only_declared_dependencies(launch: Path):
    (owner,) = (package for package in PACKAGES if launch.is_relative_to(package.folder))
    text = launch.read_text(encoding="utf-8")
    started = {entry["node"]["pkg"] for entry in yaml.safe_load(text)["launch"] if "node" in entry}
    shares = set(re.findall(r"\$\(find-pkg-share (\w+)\)", text))
    assert started
    assert started | shares <= owner.dependencies | {owner.name}


def test_the_scripts_link_every_data_package():
    script = (ROOT / "scripts" / "setup.bash").read_text(encoding="utf-8")
    folders = " ".join(sorted(package.folder.name for package in DATA_PACKAGES))
    assert f"for folder in {folders}; do" in script


def test_uninstalling_removes_nothing_from_checkout():
    installed = [Path(str(file.locate())).resolve() for file in files("bt-agents") or ()]
    assert len(installed) > 500
    assert all(file.is_relative_to(sys.prefix) for file in installed)


def _imports(package: RosPackage) -> set[str]:
    """Return the top-level modules that a package imports from elsewhere."""
    found: set[str] = set()
    for module in package.modules:
        imported = _imports_of(package.folder / module)
        # Only pytest loads its plug-in.
        found |= imported - PYTEST if module.name == "pytest_plugin.py" else imported
    return found - sys.stdlib_module_names - {package.name}


def _imports_of(path: Path) -> set[str]:
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    plain = [name.name for node in nodes if isinstance(node, ast.Import) for name in node.names]
    named = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    return {module.partition(".")[0] for module in plain + named}


def test_colcon_ignores_interfaces_compiled_for_tests():
    """Otherwise colcon and rosdep would use them instead of the real ones."""
    assert (ROOT / "tests" / "interfaces" / "COLCON_IGNORE").exists()
