# SPDX-License-Identifier: Apache-2.0
"""Import of built-in leaves of BehaviorTree.CPP as leaves of our language."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from bt_agents_core.field_types import FieldType
from bt_agents_groot.document import node_id
from bt_agents_groot.formulas import Untranslatable
from bt_agents_groot.ports import from_port, names_in, pointed_at
from bt_agents_groot.script_nodes import as_node
from bt_agents_groot.tree_import import Translate, TreeImport
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode, check
from bt_agents_language.nodes.node_type import FOREVER


def count(tree: TreeImport, element: Element, port: str) -> Data:
    """Return the number of attempts or cycles in a port."""
    text = element.get(port).strip()
    entry = pointed_at(text)
    if entry is not None:
        name = tree.names.rename(entry)
        tree.names.read([name], FieldType.INTEGER)
        return Raw(f"${{{name}}}")
    return Raw(FOREVER) if int(text) < 0 else int(text)


def duration(tree: TreeImport, element: Element, port: str) -> Raw:
    """Return the time in a port, which has milliseconds."""
    text = element.get(port).strip()
    entry = pointed_at(text)
    if entry is not None:
        name = tree.names.rename(entry)
        tree.names.read([name], FieldType.NUMBER)
        return Raw(f"${{{name} / 1000}}")
    amount = int(text)
    if amount % 60_000 == 0 and amount > 0:
        return Raw(f"{amount // 60_000} min")
    if amount % 1000 == 0:
        return Raw(f"{amount // 1000} s")
    return Raw(f"{amount / 1000} s" if amount > 1000 else f"{amount} ms")


def _sleep(tree: TreeImport, element: Element) -> YamlNode:
    return YamlNode(key="wait", value=duration(tree, element, "msec"))


def _script(tree: TreeImport, element: Element) -> YamlNode:
    try:
        return as_node(tree.statements(element.attributes["code"]), tree.names)
    except Untranslatable as error:
        return _untranslated(tree, element, f": {error}")


def _constant(result: str) -> Translate:
    return lambda tree, element: check(Raw(result))


def _set_blackboard(tree: TreeImport, element: Element) -> YamlNode:
    key = element.get("output_key")
    value = from_port(element.get("value"), FieldType.ANY, tree.names.rename)
    tree.names.read(names_in(value))
    name = tree.names.rename(pointed_at(key) or key)
    tree.names.write(name)
    return YamlNode(key="set", value={name: value})


def _untranslated(tree: TreeImport, element: Element, because: str = "") -> YamlNode:
    """Return a leaf in place of one that cannot be translated: it logs so, and fails."""
    tree.lost(element, f"{element_text(element)} has no equivalent{because}")
    message = f"not translated: {element_text(element)}".replace("${", "$ {")
    node = YamlNode(key="log", value={"message": message, "level": "error"})
    return replace(node, decorators={"fail": True})


def element_text(element: Element) -> str:
    """Return an element in one line, for messages."""
    ports = [f'{one.name}="{one.value[:60]}"' for one in element.attributes.values()]
    shown = " ".join((node_id(element), *(port for port in ports if port[:3] != "ID=")))
    return f"<{' '.join(shown.split())[:160]}>"


LEAVES: Mapping[str, Translate] = {
    "Sleep": _sleep,
    "Script": _script,
    "ScriptCondition": _script,
    "SetBlackboard": _set_blackboard,
    "AlwaysSuccess": _constant("true"),
    "AlwaysFailure": _constant("false"),
    "UnsetBlackboard": _untranslated,
    "WasEntryUpdated": _untranslated,
}
"""Translator of each built-in leaf."""
