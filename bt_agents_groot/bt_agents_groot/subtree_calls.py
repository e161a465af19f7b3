# SPDX-License-Identifier: Apache-2.0
"""Import of ``SubTree`` elements: arguments that are passed in, outputs that come back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import CONDITIONS, OTHER_ATTRIBUTES
from bt_agents_groot.naming import entry_of, snake
from bt_agents_groot.own_nodes import RemarkFunction
from bt_agents_groot.ports import from_port, names_in, pointed_at
from bt_agents_groot.scopes import Interface, TreeNames
from bt_agents_groot.translation import RemarkLevel
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import Data, Raw, YamlNode


@dataclass(frozen=True, kw_only=True)
class Callee:
    """Tree that was imported as a subtree."""

    name: str
    names: TreeNames
    interface: Interface


def ports_of_call(element: Element) -> dict[str, str]:
    """Return the arguments of a ``SubTree`` element: entry → text, with ``{=}`` resolved."""
    return {
        entry_of(name): f"{{{name}}}" if attribute.value == "{=}" else attribute.value
        for name, attribute in element.attributes.items()
        if name not in (*CONDITIONS, *OTHER_ATTRIBUTES) and not name.startswith("_")
    }


def remaps_all(element: Element) -> bool:
    """Return whether a ``SubTree`` element shares all entries of the same name."""
    return element.get("_autoremap").strip().lower() in ("true", "1")


class SubtreeCalls:
    """Translator of ``SubTree`` elements.

    Attributes:
        callees: Trees that are imported already, by their ID.
    """

    def __init__(self) -> None:
        self.callees: dict[str, Callee] = {}

    def call(self, element: Element, names: TreeNames, remark: RemarkFunction) -> YamlNode:
        """Return the node that calls a subtree."""
        tree_id = element.get("ID")
        ports = ports_of_call(element)
        callee = self.callees.get(tree_id)
        if callee is None:
            remark(
                RemarkLevel.LOST,
                element,
                f"tree '{tree_id}' stands in an included file; import that one too, and put its "
                "subtree below 'subtrees:'",
            )
            arguments = {snake(port): _argument(text, names) for port, text in ports.items()}
            return _subtree(snake(tree_id), arguments, {})
        entries = {callee.names.rename(port): text for port, text in ports.items()}
        arguments = self._inputs(element, callee, entries, names, remark)
        outputs: dict[str, Data] = {}
        for name in callee.interface.outputs:
            entry = pointed_at(entries.get(name, ""))
            if entry is None and name not in entries and remaps_all(element):
                entry = callee.names.original(name)
            if entry is not None:
                outputs[names.rename(entry)] = name
        for written in outputs:
            names.write(written)
        used = {*callee.interface.inputs.values(), *callee.interface.outputs}
        for name in entries:
            if name not in used:
                text = f"'{name}' is not passed on: '{callee.name}' never uses it"
                remark(RemarkLevel.NOTE, element, text)
        return _subtree(callee.name, arguments, outputs)

    def _inputs(
        self,
        element: Element,
        callee: Callee,
        entries: Mapping[str, str],
        names: TreeNames,
        remark: RemarkFunction,
    ) -> dict[str, Data]:
        arguments: dict[str, Data] = {}
        for declared, inside in callee.interface.inputs.items():
            text = entries.get(inside)
            if text is None and remaps_all(element):
                text = f"{{{callee.names.original(inside)}}}"
            if text is None and declared in callee.interface.optional:
                continue
            if text is None:
                remark(
                    RemarkLevel.LOST,
                    element,
                    f"nothing says what '{inside}' is for '{callee.name}'; write it behind 'with'",
                )
                arguments[declared] = callee.names.default(inside)
                continue
            arguments[declared] = _argument(text, names)
        return arguments


def _argument(text: str, names: TreeNames) -> Data:
    data = from_port(text, FieldType.ANY, names.rename)
    names.read(names_in(data))
    return data


def _subtree(name: str, arguments: dict[str, Data], outputs: dict[str, Data]) -> YamlNode:
    siblings: dict[str, Data] = {}
    if arguments:
        siblings["with"] = arguments
    if outputs:
        siblings["outputs"] = outputs
    return YamlNode(key="subtree", value=Raw(name), siblings=siblings)
