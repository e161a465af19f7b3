# SPDX-License-Identifier: Apache-2.0
"""Node types: their record alone defines them, and no code depends on their key."""

from __future__ import annotations

import ast
import keyword
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from bt_agents.engine import nodes
from bt_agents.host.tree_streams import tree_snapshot
from bt_agents_core.diagnostic import Position
from bt_agents_groot import tree_export
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes import catalogue
from bt_agents_language.nodes.catalogue import BRANCHES, DECORATORS, NODE_TYPES, SIBLINGS, type_of
from bt_agents_language.nodes.node_type import Children, Resources, Role
from bt_agents_language.nodes.plugin import PLUGIN
from bt_agents_language.nodes.skill import SKILL
from checkout import ROOT
from tree_harness import SYMBOLS, agent

ALL = {**NODE_TYPES, **DECORATORS, **BRANCHES}
NODES_FOLDER = Path(catalogue.__file__).parent
ENGINE_FOLDER = Path(nodes.__file__).parent
FOREIGN_FORMATS = (Path(tree_export.__file__), Path(tree_snapshot.__file__))
OF_TEST_FILES = {"succeed", "fail"}
"""Words for the stand-in of a node in a test file, which are also two decorators."""

NAMES_OF_KINDS = {"kind", "key", "key_meant", "text"}
HERE = Position(file="a.yaml", line=1, column=1)


def modules() -> Iterator[Path]:
    """Yield the product's modules, except modules of a single node type or behaviour."""
    for manifest in sorted(ROOT.glob("*/package.xml")):
        for path in sorted(manifest.parent.rglob("*.py")):
            if NODES_FOLDER not in path.parents and ENGINE_FOLDER not in path.parents:
                yield path


def keys_in(*nodes: ast.AST | None) -> set[str]:
    """Return the keys of node types among literals, and in tuples, lists and sets of them."""
    found: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Tuple | ast.List | ast.Set):
            found |= keys_in(*node.elts)
        elif isinstance(node, ast.Constant) and node.value in ALL:
            found.add(str(node.value))
    return found


def names_kind(node: ast.AST) -> bool:
    return isinstance(node, ast.Attribute) and node.attr in NAMES_OF_KINDS


def compared(tree: ast.Module) -> Iterator[tuple[int, set[str]]]:
    """Yield the lines that compare a kind or key with a node type's."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            if any(map(names_kind, sides)):
                yield node.lineno, keys_in(*sides)
        elif isinstance(node, ast.Match) and names_kind(node.subject):
            inner = (one for case in node.cases for one in ast.walk(case.pattern))
            values = [one.value for one in inner if isinstance(one, ast.MatchValue)]
            yield node.lineno, keys_in(*values)


def tables(tree: ast.Module) -> Iterator[tuple[int, set[str]]]:
    """Yield the lines of constants that list several node types, or have an entry for each."""
    for node in tree.body:
        value = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
        parts = value.keys if isinstance(value, ast.Dict) else getattr(value, "elts", [])
        found = keys_in(*parts)
        if len(parts) > 1 and len(found) == len(parts) and found != OF_TEST_FILES:
            yield node.lineno, found


def test_only_node_types_and_behaviours_branch_on_keys() -> None:
    found = []
    for path in modules():
        tree = ast.parse(path.read_text())
        lines = [*compared(tree), *(() if path in FOREIGN_FORMATS else tables(tree))]
        found += [f"{path}:{line}: {', '.join(sorted(keys))}" for line, keys in lines if keys]
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "def f(spec):\n    return spec.kind == 'wait'",
        "def f(raw):\n    return raw.type.key in ('wait', 'wait_for')",
        "def f(spec):\n    match spec.kind:\n        case 'when' | 'once':\n            return 1",
        "_LIMITS = ('timeout', 'while')",
        "_COUNTS = {'retry': 'attempts', 'repeat': 'times'}",
    ],
)
def test_branch_on_node_key_is_detected(text: str) -> None:
    tree = ast.parse(text)
    assert any(keys for _, keys in (*compared(tree), *tables(tree)))


@pytest.mark.parametrize("key", [*ALL, "skill", "plugin"])
def test_each_node_type_has_file_of_same_name(key: str) -> None:
    name = f"{key}_" if keyword.iskeyword(key) else key
    module = import_module(f"{catalogue.__name__.rpartition('.')[0]}.{name}")
    assert getattr(module, key.upper()).key == key


def test_node_types_refer_only_to_existing_types() -> None:
    for one in ALL.values():
        assert (one.role is Role.COMPOSITE) == (one.children is Children.LIST)
        assert {*one.siblings, *one.child_siblings} <= SIBLINGS.keys()
        assert set(one.child_keys) <= {*DECORATORS, *SIBLINGS}
        names = [field.name for field in one.fields]
        assert one.rounds in ("", *names)
        assert one.role is Role.BRANCH or one.main in (None, *names)
        if one.contrary:
            assert DECORATORS[one.contrary].contrary == one.key


def test_skill_named_like_branch_is_still_skill() -> None:
    skill = replace(SYMBOLS.skills["say"], name="case")
    spec = NodeSpec(path="tree", position=HERE, kind="case", name="case", skill=skill)
    assert type_of(spec) is SKILL
    assert type_of(replace(spec, skill=None, plugin=object)) is PLUGIN


def test_groot_translates_only_existing_node_types() -> None:
    assert tree_export.NODES.keys() <= NODE_TYPES.keys()
    assert tree_export.DECORATED.keys() <= DECORATORS.keys()


def resources_of(node: str) -> Resources:
    spec = agent(node).tree
    return type_of(spec).resources(spec)


def test_node_type_declares_external_resources() -> None:
    topic = "{topic: t, type: std_msgs/msg/Bool"
    wanted = ("t", "std_msgs/msg/Bool")
    assert resources_of(f"wait_for: {topic}}}") == Resources(topic=wanted)
    latched = Resources(topic=wanted, latched=True)
    assert resources_of(f"wait_for: {topic}, latched: true}}") == latched
    assert resources_of("wait_for: live.person") == Resources()
    assert resources_of("give_feedback: positive") == Resources(feedback=True)
    assert resources_of("wait: 1 s") == Resources()
    say = SYMBOLS.skills["say"].binding
    assert resources_of("say: Hello.") == Resources(binding=say)
    raw = resources_of(f"publish: {topic}, message: {{data: true}}}}").binding
    assert (raw.name, raw.type) == wanted
