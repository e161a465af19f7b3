# SPDX-License-Identifier: Apache-2.0
"""ROS packages of the checkout, and their metadata."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True, kw_only=True)
class RosPackage:
    """One directory with a ``package.xml``."""

    folder: Path
    name: str
    manifest: ElementTree.Element

    @property
    def build_type(self) -> str | None:
        """``ament_python`` or ``ament_cmake``."""
        return self.manifest.findtext("export/build_type")

    @property
    def dependencies(self) -> set[str]:
        """Keys of the dependencies that the package needs at run time."""
        found = [*self.manifest.iter("depend"), *self.manifest.iter("exec_depend")]
        return {element.text or "" for element in found}

    @property
    def data(self) -> set[str]:
        """Installed YAML files, relative to the folder."""
        return {str(path.relative_to(self.folder)) for path in self.folder.rglob("*.yaml")}

    @property
    def modules(self) -> set[Path]:
        """The Python modules, relative to the folder."""
        found = (self.folder / self.name).rglob("*.py")
        return {path.relative_to(self.folder) for path in found}

    @property
    def package_data(self) -> set[Path]:
        """Other files installed with the Python modules, relative to the same folder."""
        found = (path for path in (self.folder / self.name).rglob("*.*") if path.is_file())
        other = {path.relative_to(self.folder) for path in found if path.suffix != ".pyc"}
        return other - self.modules

    def setup(self) -> dict[str, Any]:
        """Return the literal arguments of ``setup()`` in ``setup.py``."""
        tree = ast.parse((self.folder / "setup.py").read_text(encoding="utf-8"))
        (call,) = (
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "setup"
        )
        return {
            keyword.arg: ast.literal_eval(keyword.value)
            for keyword in call.keywords
            if keyword.arg and not isinstance(keyword.value, ast.Call)
        }

    def executables(self) -> dict[str, str]:
        """Return the names of the executables and the functions they call."""
        return self.entry_points().get("console_scripts", {})

    def entry_points(self) -> dict[str, dict[str, str]]:
        """Return the package's entry points: group → name → function or module."""
        groups = self.setup().get("entry_points", {}).items()
        return {group: dict(line.split(" = ") for line in lines) for group, lines in groups}


def ros_packages() -> list[RosPackage]:
    """Return all ROS packages of the checkout, by name."""
    found = []
    for path in ROOT.glob("*/package.xml"):
        manifest = ElementTree.parse(path).getroot()
        found.append(
            RosPackage(folder=path.parent, name=manifest.findtext("name", ""), manifest=manifest)
        )
    return sorted(found, key=lambda package: package.name)


def needed_by(name: str) -> set[str]:
    """Return the keys that a package needs, directly or through other packages."""
    packages = {package.name: package for package in PACKAGES}
    found: set[str] = set()
    new = {name}
    while new:
        found |= new
        new = {key for one in new & packages.keys() for key in packages[one].dependencies} - found
    return found


PACKAGES = ros_packages()
PYTHON_PACKAGES = [package for package in PACKAGES if package.build_type == "ament_python"]
DATA_PACKAGES = [
    package for package in PACKAGES if package.build_type == "ament_cmake" and package.data
]
