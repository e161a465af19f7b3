# SPDX-License-Identifier: Apache-2.0
"""A marketplace without agents: its installation, and no further requirements."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from checkout import PYTHON_PACKAGES, ROOT, needed_by

pytestmark = pytest.mark.packaging

ALONE = needed_by("marketplace_node")
ITS_PACKAGES = [package for package in PYTHON_PACKAGES if package.name in ALONE]
ABSENT = {package.name for package in PYTHON_PACKAGES} - ALONE | {"py_trees", "click", "rich"}

PROGRAM = """
import importlib, pkgutil, sys
from importlib.abc import MetaPathFinder
from pathlib import Path

class Absent(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in absent:
            raise ModuleNotFoundError(f"{name} is not installed here", name=name)

folder, packages, absent, scene = sys.argv[1:]
packages, absent = packages.split(), set(absent.split())
sys.path.insert(0, folder)
sys.meta_path.insert(0, Absent())
assert not absent & sys.modules.keys()

def starts_something(name):
    return name.endswith(".__main__")

for package in map(importlib.import_module, packages):
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if not starts_something(module.name):
            importlib.import_module(module.name)

import rclpy
from bt_agents_language.files.scene_reader import read_scene
from marketplace_node.node import MarketConfiguration, MarketplaceNode

rclpy.init()
node = MarketplaceNode(MarketConfiguration(space=read_scene(Path(scene)).space))
# NumPy's random sources take 6 MB, and only some strategies draw.
print(node.get_fully_qualified_name(), *sorted((absent | {"numpy.random"}) & sys.modules.keys()))
node.destroy_node()
rclpy.shutdown()
"""


def test_marketplace_depends_only_on_shared_packages():
    assert {package.name for package in ITS_PACKAGES} == {
        "bt_agents_core",
        "bt_agents_language",
        "bt_agents_ros",
        "marketplace_node",
    }
    assert not {"py_trees", "python3-click", "python3-rich"} & ALONE


def test_marketplace_starts_with_nothing_else_installed(tmp_path: Path):
    for package in ITS_PACKAGES:
        (tmp_path / package.name).symlink_to(package.folder / package.name)
    names = " ".join(package.name for package in ITS_PACKAGES)
    arguments = [str(tmp_path), names, " ".join(ABSENT), str(ROOT / "trees" / "scene.yaml")]
    done = subprocess.run(
        [sys.executable, "-I", "-c", PROGRAM, *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "/marketplace\n"
