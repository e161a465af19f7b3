# SPDX-License-Identifier: Apache-2.0
"""A name leads to one place: no module of a package and no public class has a namesake."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]

ENTRY_POINTS = ("__init__", "__main__")


def packages() -> list[Path]:
    """Return the folders of Python code, one a ROS package."""
    named = (manifest.parent for manifest in ROOT.glob("*/package.xml"))
    return sorted(folder / folder.name for folder in named if (folder / folder.name).is_dir())


def public_classes(path: Path) -> Iterator[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield node.name


def namesakes(named: Iterable[tuple[str, Path]]) -> dict[str, list[str]]:
    """Return the names that several files have, with those files."""
    files = defaultdict(list)
    for name, path in named:
        files[name].append(str(path.relative_to(ROOT)))
    return {name: sorted(found) for name, found in files.items() if len(found) > 1}


def test_the_packages_are_found():
    names = {package.name for package in packages()}
    assert names >= {"bt_agents", "bt_agents_core", "marketplace_node", "bt_agents_lab"}


def test_no_two_modules_of_a_package_have_the_same_name():
    for package in packages():
        modules = ((path.stem, path) for path in package.rglob("*.py"))
        found = namesakes(one for one in modules if one[0] not in ENTRY_POINTS)
        assert found == {}, package.name


def test_no_two_public_classes_have_the_same_name():
    paths = (path for package in packages() for path in package.rglob("*.py"))
    assert namesakes((name, path) for path in paths for name in public_classes(path)) == {}
