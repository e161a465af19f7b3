# SPDX-License-Identifier: Apache-2.0
"""Export of one tree: nodes of our language as elements of BehaviorTree.CPP."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import SKIP_IF
from bt_agents_groot.document import has_skill
from bt_agents_groot.expressions import condition_script, set_script
from bt_agents_groot.formulas import Untranslatable
from bt_agents_groot.models import Field, Models
from bt_agents_groot.naming import output_name, port
from bt_agents_groot.ports import (
    JSON,
    as_port,
    milliseconds,
    number_port,
    plain_data,
    variants_port,
)
from bt_agents_groot.translation import Remarks
from bt_agents_groot.xml_files import Xml
from bt_agents_language.fields.values import ONE_OF
from bt_agents_language.model.specs import FieldSpec, SubtreeSpec, Tunable
from bt_agents_language.nodes.catalogue import DECORATORS
from bt_agents_language.nodes.check import CHECK
from bt_agents_language.nodes.node_type import Content, NodeField, NodeType, RawNode
from bt_agents_language.nodes.parallel import PARALLEL
from bt_agents_language.nodes.random import RANDOM
from bt_agents_language.nodes.skill import takes_variants
from bt_agents_language.nodes.when import WHEN
from bt_agents_language.yaml.scalars import boolean
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar
from bt_agents_language.yaml.yaml_reader import Sequence as SequenceNode

Subtrees = Callable[[str], tuple[str, SubtreeSpec, Sequence[Tunable]]]
"""Function that returns the ID, interface and used tunables of a subtree by its name."""

Decorate = Callable[[Node, Xml], Xml]
"""Function that wraps an element in a decorator, given only its main field or switch.

It raises :class:`Untranslatable` if BehaviorTree.CPP has no such decorator.
"""

_WEIGHTS = NodeField(name="weights", description="how often each child is chosen")
_VALUES = NodeField(name="values", description="names and values")


class TreeExport:
    """Translator for the trees of one file; it collects their declarations and remarks."""

    def __init__(self, models: Models, subtrees: Subtrees, remarks: Remarks) -> None:
        self._models = models
        self._subtrees = subtrees
        self._remarks = remarks

    def node(self, raw: RawNode, *, part_of_parent: Sequence[str] = ()) -> Xml:
        """Return the element for a node and all below it.

        Args:
            raw: The node.
            part_of_parent: Decorators that the enclosing composite handles.
        """
        xml = self._with_name(raw, self._undecorated(raw))
        for decorator in reversed([*DECORATORS.values()]):
            entry = raw.decorators.get(decorator.key)
            if entry is not None and decorator.key not in part_of_parent:
                xml = self._decorated(raw, decorator, entry, xml)
        return xml

    def _with_name(self, raw: RawNode, xml: Xml) -> Xml:
        if not raw.name:
            return xml
        first = {key: value for key, value in xml.attributes.items() if key == "ID"}
        return replace(xml, attributes={**first, "name": raw.name, **xml.attributes})

    def _undecorated(self, raw: RawNode) -> Xml:
        if raw.skill is not None:
            skill = raw.skill
            values = _fields(raw.value, skill.main)
            variants = values.pop(ONE_OF, None) if takes_variants(skill) else None
            ports = self._ports(values, skill.inputs)
            if variants is not None and skill.main is not None:
                ports[port(skill.main)] = variants_port(variants)
            inputs = [one.name for one in skill.inputs]
            outputs = self._outputs(raw, skill.outputs, inputs)
            tag = self._models.leaf(skill.name, skill.inputs, skill.outputs)
            return Xml(tag, ports | outputs)
        assert raw.type is not None
        return NODES.get(raw.type.key, TreeExport._declared_leaf)(self, raw)

    def _declared_leaf(self, raw: RawNode) -> Xml:
        """Return a leaf that is not built into BehaviorTree.CPP."""
        own = raw.type
        assert own is not None
        ports = self._ports(_fields(raw.value, own.main), own.fields)
        if own.plugin is not None:
            return Xml(self._models.leaf(own.key, own.fields), ports)
        kind = "Condition" if own.read_only else "Action"
        return Xml(self._declared_tag(raw.key, kind, own.key, own.fields), ports)

    def _declared_tag(self, where: Node, kind: str, key: str, fields: Iterable[NodeField]) -> str:
        self._remarks.note(
            where.position,
            f"BehaviorTree.CPP has no node for '{key}' as it stands here; Groot2 shows it as "
            f"<{key}>",
        )
        return self._models.declare(kind, key, fields)

    def _ports(self, values: Mapping[str, Node], fields: Iterable[Field]) -> dict[str, str]:
        declared = {one.name: one for one in fields}
        ports: dict[str, str] = {}
        for name, node in values.items():
            one = declared.get(name)
            if (
                isinstance(one, NodeField)
                and one.content is Content.CONDITION
                and isinstance(node, Scalar)
            ):
                ports[port(name)] = node.text
                continue
            text = ports[port(name)] = as_port(node, FieldType.ANY if one is None else one.type)
            if "${" in text.replace("$${", ""):
                self._remarks.note(
                    node.position, "BehaviorTree.CPP does not fill in the ${…} inside of a text"
                )
        return ports

    def _outputs(
        self, raw: RawNode, declared: tuple[FieldSpec, ...], inputs: Sequence[str] = ()
    ) -> dict[str, str]:
        entry = raw.siblings.get("outputs")
        if entry is None or not isinstance(entry.value, MappingNode):
            return {port(output_name(one.name, inputs)): f"{{{one.name}}}" for one in declared}
        ports: dict[str, str] = {}
        for name, output in ((one.key, one.value) for one in entry.value.entries):
            assert isinstance(output, Scalar)
            filled = ports.setdefault(port(output_name(output.text, inputs)), f"{{{name.text}}}")
            if filled != f"{{{name.text}}}":
                message = f"'{name.text}' gets no value, as a port fills one entry, here {filled}"
                self._remarks.note(name.position, message)
        return ports

    def _children(self, raw: RawNode) -> tuple[Xml, ...]:
        return tuple(map(self.node, raw.children))

    def _in_turn(self, raw: RawNode, *, tag: str) -> Xml:
        children = self._children(raw)
        memory = _option(raw, "memory")
        if memory is None or boolean(memory) is not False:
            return Xml(tag, children=children)
        if any(map(has_skill, children[:-1])):
            # That library ticks the node again at each tick, while ours starts it again.
            assert raw.type is not None
            own = self._declared_tag(raw.key, "Control", raw.type.key, raw.type.fields)
            return Xml(own, {"memory": "false"}, children)
        return Xml(f"Reactive{tag}", children=children)

    def _parallel(self, raw: RawNode) -> Xml:
        children = self._children(raw)
        entry = raw.options.get("succeed_on")
        if entry is not None and isinstance(entry.value, SequenceNode):
            tag = self._declared_tag(entry.key, "Control", PARALLEL.key, PARALLEL.fields)
            return Xml(tag, {"succeed_on": as_port(entry.value, FieldType.ANY)}, children)
        word = _option(raw, "succeed_on") or "all"
        wanted = len(children) if word == "all" else 1 if word == "one" else int(word)
        every = wanted >= len(children)
        counts = {
            "success_count": "-1" if every else str(wanted),
            "failure_count": "1" if every else str(len(children) - wanted + 1),
        }
        return Xml("Parallel", counts, children)

    def _choose(self, raw: RawNode) -> Xml:
        """Return nested ``IfThenElse`` nodes."""
        otherwise = raw.nodes.get("otherwise")
        rest: tuple[Xml, ...] = (self.node(otherwise),) if otherwise is not None else ()
        for case in reversed(raw.children):
            condition_leaf = self._condition(case.decorators[WHEN.key].value)
            then = self.node(case, part_of_parent=(WHEN.key,))
            rest = (Xml("IfThenElse", children=(condition_leaf, then, *rest)),)
        return rest[0]

    def _condition(self, node: Node) -> Xml:
        try:
            return Xml("ScriptCondition", {"code": condition_script(node)})
        except Untranslatable:
            assert isinstance(node, Scalar)
            tag = self._declared_tag(node, "Condition", CHECK.key, CHECK.fields)
            return Xml(tag, {CHECK.fields[0].name: node.text})

    def _random(self, raw: RawNode) -> Xml:
        weights = [child.siblings.get("weight") for child in raw.children]
        options = ((one.name, _option(raw, one.name)) for one in RANDOM.fields)
        attributes = {name: text for name, text in options if text is not None}
        if any(weights):
            values = [1 if one is None else plain_data(one.value) for one in weights]
            attributes["weights"] = JSON + json.dumps(values)
        tag = self._declared_tag(raw.key, "Control", RANDOM.key, (*RANDOM.fields, _WEIGHTS))
        return Xml(tag, attributes, self._children(raw))

    def _check(self, raw: RawNode) -> Xml:
        node = _fields(raw.value, "condition")["condition"]
        constant = boolean(node.text) if isinstance(node, Scalar) else None
        if constant is not None:
            return Xml("AlwaysSuccess" if constant else "AlwaysFailure")
        return self._condition(node)

    def _set(self, raw: RawNode) -> Xml:
        assert isinstance(raw.value, MappingNode)
        try:
            return Xml("Script", {"code": set_script(raw.value.entries)})
        except Untranslatable:
            return self._open(raw)

    def _open(self, raw: RawNode) -> Xml:
        values = as_port(raw.value, FieldType.ANY)
        tag = self._declared_tag(raw.key, "Action", raw.key.text, (_VALUES,))
        return Xml(tag, {"values": values})

    def _wait(self, raw: RawNode) -> Xml:
        try:
            time = milliseconds(_fields(raw.value, "duration")["duration"])
        except Untranslatable:
            return self._declared_leaf(raw)
        return Xml("Sleep", {"msec": time})

    def _wait_for(self, raw: RawNode) -> Xml:
        fields = _fields(raw.value, "condition")
        if set(fields) != {"condition"}:
            return self._declared_leaf(raw)
        try:
            script = condition_script(fields["condition"])
        except Untranslatable:
            return self._declared_leaf(raw)
        ports = {"if": script, "else": "RUNNING"}
        return Xml("Precondition", ports, (Xml("AlwaysSuccess"),))

    def _subtree(self, raw: RawNode) -> Xml:
        node = _fields(raw.value, "name")["name"]
        assert isinstance(node, Scalar)
        tree_id, subtree, tunables = self._subtrees(node.text)
        entry = raw.siblings.get("with")
        arguments = entry.value.entries if entry and isinstance(entry.value, MappingNode) else ()
        ports = self._ports({one.key.text: one.value for one in arguments}, ())
        ports |= {port(one.name): f"{{{one.name}}}" for one in tunables}
        # BehaviorTree.CPP refuses calls without all ports.
        ports |= {port(one.name): f"{{unused_{one.name}}}" for one in subtree.outputs}
        outputs = self._outputs(raw, subtree.outputs)
        return Xml("SubTree", {"ID": tree_id, **ports, **outputs})

    def _decorated(self, raw: RawNode, decorator: NodeType, entry: MappingEntry, xml: Xml) -> Xml:
        if decorator.handler:
            children = (xml, self.node(raw.nodes[decorator.key]))
            return Xml("Fallback", {"name": decorator.key}, children)
        values = _fields(entry.value, decorator.main)
        main: Node | None = entry.value
        if decorator.main is None:
            if not (isinstance(entry.value, Scalar) and boolean(entry.value.text)):
                return xml
        else:
            main = values[decorator.main] if list(values) == [decorator.main] else None
        if main is not None and decorator.key in DECORATED:
            with suppress(Untranslatable):
                return DECORATED[decorator.key](main, xml)
        tag = self._declared_tag(entry.key, "Decorator", decorator.key, decorator.fields)
        attributes = self._ports(values, decorator.fields)
        return Xml(tag, attributes, (xml,))


def _around(
    tag: str, port_name: str = "", text_of: Callable[[Node], str] = number_port
) -> Decorate:
    def export(node: Node, xml: Xml) -> Xml:
        attributes = {port_name: text_of(node)} if port_name else {}
        return Xml(tag, attributes, (xml,))

    return export


def _skip_unless(node: Node, xml: Xml) -> Xml:
    skip = {SKIP_IF: condition_script(node, opposite=True)}
    return replace(xml, attributes={**xml.attributes, **skip})


def _while(node: Node, xml: Xml) -> Xml:
    condition_leaf = Xml("ScriptCondition", {"code": condition_script(node)})
    return Xml("WhileDoElse", children=(condition_leaf, xml))


def _option(raw: RawNode, name: str) -> str | None:
    entry = raw.options.get(name)
    return entry.value.text if entry is not None and isinstance(entry.value, Scalar) else None


def _fields(value: Node, main: str | None) -> dict[str, Node]:
    if isinstance(value, MappingNode):
        return {entry.key.text: entry.value for entry in value.entries}
    if main is None or (isinstance(value, Scalar) and value.empty):
        return {}
    return {main: value}


NODES: Mapping[str, Callable[[TreeExport, RawNode], Xml]] = {
    "sequence": partial(TreeExport._in_turn, tag="Sequence"),
    "selector": partial(TreeExport._in_turn, tag="Fallback"),
    "parallel": TreeExport._parallel,
    "choose": TreeExport._choose,
    "random": TreeExport._random,
    "check": TreeExport._check,
    "remember": TreeExport._open,
    "set": TreeExport._set,
    "wait": TreeExport._wait,
    "wait_for": TreeExport._wait_for,
    "subtree": TreeExport._subtree,
}
"""Translators of node types; others stay words of our language."""

DECORATED: Mapping[str, Decorate] = {
    "when": _skip_unless,
    "once": _around("RunOnce"),
    "succeed": _around("ForceSuccess"),
    "fail": _around("ForceFailure"),
    "while": _while,
    "retry": _around("RetryUntilSuccessful", "num_attempts", number_port),
    "repeat": _around("Repeat", "num_cycles", number_port),
    "timeout": _around("Timeout", "msec", milliseconds),
    "invert": _around("Inverter"),
}
"""Translators of decorators, like :data:`NODES`."""
