# SPDX-License-Identifier: Apache-2.0
"""Style sheets of the pages: modules scope the classes, and components use all of them."""

from __future__ import annotations

import re

import pytest

from checkout import ROOT

SOURCES = {
    path.name: path.read_text(encoding="utf-8")
    for path in (ROOT / "bt_agents_studio" / "frontend" / "src").iterdir()
}
MODULES = sorted(name for name in SOURCES if name.endswith(".module.css"))


def classes(sheet: str) -> set[str]:
    """Return the class names in a style sheet."""
    without_texts = re.sub(r'/\*.*?\*/|"[^"]*"', "", SOURCES[sheet], flags=re.DOTALL)
    return set(re.findall(r"\.([A-Za-z]\w*)", without_texts))


def used(module: str) -> set[str]:
    """Return the classes of a module that components refer to."""
    found: set[str] = set()
    for text in SOURCES.values():
        imported = re.search(rf'import (\w+) from "\./{module}"', text)
        if imported:
            found |= set(re.findall(rf"\b{imported[1]}\.(?!module)(\w+)", text))
    return found


@pytest.mark.parametrize("module", MODULES)
def test_components_use_all_classes_of_a_module(module: str) -> None:
    assert classes(module) == used(module) != set()


def test_only_modules_have_classes() -> None:
    sheets = {name for name in SOURCES if name.endswith(".css")}
    assert sheets - set(MODULES) == {"base.css"}
    assert classes("base.css") == set()
    assert not [name for name, text in SOURCES.items() if 'className="' in text]
