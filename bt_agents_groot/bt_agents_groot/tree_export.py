# SPDX-License-Identifier: Apache-2.0
"""Export of one tree: nodes of our language as elements of BehaviorTree.CPP."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from bt_agents_core.field_types import FieldType, Plain
from bt_agents_groot.catalogue import SKIP_IF
from bt_agents_groot.export_values import condition_script, milliseconds, number_port, set_script
from bt_agents_groot.formulas import Untranslatable
from bt_agents_groot.models import Models
from bt_agents_groot.naming import port
from bt_agents_groot.ports import JSON, as_port
from bt_agents_groot.translation import Remarks
from bt_agents_groot.xml_files import Xml
from bt_agents_language.model.specs import FieldSpec, SubtreeSpec
from bt_agents_language.nodes.catalogue import DECORATORS
from bt_agents_language.nodes.check import CHECK
from bt_agents_language.nodes.node_type import Content, NodeField, NodeType, RawNode
from bt_agents_language.nodes.parallel import PARALLEL
from bt_agents_language.nodes.random import RANDOM
from bt_agents_language.nodes.set import SET
from bt_agents_language.nodes.when import WHEN
from bt_agents_language.yaml.scalars import boolean, plain_value
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar
from bt_agents_language.yaml.yaml_reader import Sequence as SequenceNode

Subtrees = Callable[[str], tuple[str, SubtreeSpec]]
"""Returns the ID and the interface of a subtree by its name."""

Decorate = Callable[[Node, Xml], Xml | None]
"""Returns an element with a decorator around it, of which only the main field or switch is given.

None when BehaviorTree.CPP has no decorator for that.
"""

_WEIGHTS = NodeField(name="weights", description="how often each child is chosen")
_VALUES = NodeField(name="values", description="names and values")


class TreeExport:
    """Translator of the trees of one file.

    Args:
        models: Collects the declarations.
        subtrees: Lookup of the subtrees that the file can use.
        remarks: Collects the differences.
    """

    def __init__(self, models: Models, subtrees: Subtrees, remarks: Remarks) -> None:
        self._models = models
        self._subtrees = subtrees
        self._remarks = remarks

    def node(self, raw: RawNode, *, part_of_parent: Sequence[str] = ()) -> Xml:
        """Return the element for a node and all below it.

        Args:
            raw: The node.
            part_of_parent: Decorators that the composite around it takes care of.
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
            fields = {one.name: one.type for one in skill.inputs}
            ports = self._ports(self._fields(raw, skill.main), fields)
            outputs = self._outputs(raw, skill.outputs)
            return Xml(tag=self._models.skill(skill), attributes=ports | outputs)
        assert raw.type is not None
        return NODES.get(raw.type.key, TreeExport.declared_leaf)(self, raw)

    def declared_leaf(self, raw: RawNode) -> Xml:
        """Return a leaf that is not built into BehaviorTree.CPP."""
        own = raw.type
        assert own is not None
        types = {one.name: one.type for one in own.fields}
        verbatim = {one.name for one in own.fields if one.content is Content.CONDITION}
        ports = self._ports(self._fields(raw, own.main), types, verbatim)
        if own.plugin is not None:
            return Xml(tag=self._models.plugin(own), attributes=ports)
        what = "Condition" if own.read_only else "Action"
        return Xml(tag=self._declared_tag(raw.key, what, own.key, own.fields), attributes=ports)

    def _declared_tag(
        self, where: Node | Scalar, kind: str, key: str, fields: Sequence[NodeField]
    ) -> str:
        self._remarks.note(
            where.position,
            f"BehaviorTree.CPP has no node for '{key}' as it stands here; Groot2 shows it as "
            f"<{key}>",
        )
        return self._models.node_key(kind, key, fields)

    def _fields(self, raw: RawNode, main: str | None) -> dict[str, Node]:
        value = raw.value
        if isinstance(value, MappingNode):
            return {entry.key.text: entry.value for entry in value.entries}
        if main is None or (isinstance(value, Scalar) and value.empty):
            return {}
        return {main: value}

    def _ports(
        self,
        fields: Mapping[str, Node],
        types: Mapping[str, FieldType],
        verbatim: set[str] | frozenset[str] = frozenset(),
    ) -> dict[str, str]:
        ports: dict[str, str] = {}
        for name, node in fields.items():
            if name in verbatim and isinstance(node, Scalar):
                ports[port(name)] = node.text
                continue
            ports[port(name)] = as_port(node, types.get(name, FieldType.ANY))
            if "${" in ports[port(name)].replace("$${", ""):
                self._remarks.note(
                    node.position, "BehaviorTree.CPP does not fill in the ${…} inside of a text"
                )
        return ports

    def _outputs(self, raw: RawNode, declared: tuple[FieldSpec, ...]) -> dict[str, str]:
        entry = raw.siblings.get("outputs")
        if entry is None or not isinstance(entry.value, MappingNode):
            return {port(one.name): f"{{{one.name}}}" for one in declared}
        return {
            port(item.value.text): f"{{{item.key.text}}}"
            for item in entry.value.entries
            if isinstance(item.value, Scalar)
        }

    def _children(self, raw: RawNode) -> tuple[Xml, ...]:
        return tuple(map(self.node, raw.children))

    def sequence(self, raw: RawNode) -> Xml:
        """Return the element for ``sequence``."""
        return self._in_turn(raw, "Sequence")

    def selector(self, raw: RawNode) -> Xml:
        """Return the element for ``selector``."""
        return self._in_turn(raw, "Fallback")

    def _in_turn(self, raw: RawNode, name: str) -> Xml:
        memory = _option(raw, "memory")
        reactive = memory is not None and boolean(memory) is False
        tag = f"Reactive{name}" if reactive else name
        return Xml(tag=tag, children=self._children(raw))

    def parallel(self, raw: RawNode) -> Xml:
        """Return the element for ``parallel``."""
        children = self._children(raw)
        entry = raw.options.get("succeed_on")
        if entry is not None and isinstance(entry.value, SequenceNode):
            tag = self._declared_tag(entry.key, "Control", PARALLEL.key, PARALLEL.fields)
            succeed_on = as_port(entry.value, FieldType.ANY)
            return Xml(tag=tag, attributes={"succeed_on": succeed_on}, children=children)
        word = _option(raw, "succeed_on") or "all"
        wanted = len(children) if word == "all" else 1 if word == "one" else int(word)
        every = wanted >= len(children)
        failures = 1 if every else len(children) - wanted + 1
        return Xml(
            tag="Parallel",
            attributes={
                "success_count": "-1" if every else str(wanted),
                "failure_count": str(failures),
            },
            children=children,
        )

    def choose(self, raw: RawNode) -> Xml:
        """Return the elements for ``choose``: one ``IfThenElse`` inside of the other."""
        otherwise = raw.nodes.get("otherwise")
        rest: tuple[Xml, ...] = (self.node(otherwise),) if otherwise is not None else ()
        for case in reversed(raw.children):
            condition_leaf = self._condition(case.decorators[WHEN.key].value)
            then = self.node(case, part_of_parent=(WHEN.key,))
            rest = (Xml(tag="IfThenElse", children=(condition_leaf, then, *rest)),)
        return rest[0]

    def _condition(self, node: Node) -> Xml:
        """Return the leaf that evaluates a condition."""
        try:
            return Xml(tag="ScriptCondition", attributes={"code": condition_script(node)})
        except Untranslatable:
            assert isinstance(node, Scalar)
            tag = self._declared_tag(node, "Condition", CHECK.key, CHECK.fields)
            return Xml(tag=tag, attributes={CHECK.fields[0].name: node.text})

    def random(self, raw: RawNode) -> Xml:
        """Return the element for ``random``."""
        seed = _option(raw, "seed")
        weights = [child.siblings.get("weight") for child in raw.children]
        attributes = {"seed": seed} if seed is not None else {}
        if any(weights):
            values = [1 if one is None else _weight(one.value) for one in weights]
            attributes["weights"] = JSON + json.dumps(values)
        tag = self._declared_tag(raw.key, "Control", RANDOM.key, (*RANDOM.fields, _WEIGHTS))
        return Xml(tag=tag, attributes=attributes, children=self._children(raw))

    def check(self, raw: RawNode) -> Xml:
        """Return the leaf for ``check``."""
        node = self._fields(raw, "condition")["condition"]
        constant = boolean(node.text) if isinstance(node, Scalar) else None
        if constant is not None:
            return Xml(tag="AlwaysSuccess" if constant else "AlwaysFailure")
        return self._condition(node)

    def set(self, raw: RawNode) -> Xml:
        """Return the leaf for ``set``."""
        assert isinstance(raw.value, MappingNode)
        try:
            return Xml(tag="Script", attributes={"code": set_script(raw.value.entries)})
        except Untranslatable:
            values = as_port(raw.value, FieldType.ANY)
            tag = self._declared_tag(raw.key, "Action", SET.key, (_VALUES,))
            return Xml(tag=tag, attributes={"values": values})

    def wait(self, raw: RawNode) -> Xml:
        """Return the leaf for ``wait``."""
        time = milliseconds(self._fields(raw, "duration")["duration"])
        if time is None:
            return self.declared_leaf(raw)
        return Xml(tag="Sleep", attributes={"msec": time})

    def wait_for(self, raw: RawNode) -> Xml:
        """Return the leaf for ``wait_for``."""
        fields = self._fields(raw, "condition")
        if set(fields) != {"condition"}:
            return self.declared_leaf(raw)
        try:
            script = condition_script(fields["condition"])
        except Untranslatable:
            return self.declared_leaf(raw)
        return Xml(
            tag="Precondition",
            attributes={"if": script, "else": "RUNNING"},
            children=(Xml(tag="AlwaysSuccess"),),
        )

    def subtree(self, raw: RawNode) -> Xml:
        """Return the element for ``subtree``."""
        node = self._fields(raw, "name")["name"]
        assert isinstance(node, Scalar)
        tree_id, subtree = self._subtrees(node.text)
        entry = raw.siblings.get("with")
        arguments = entry.value.entries if entry and isinstance(entry.value, MappingNode) else ()
        ports = self._ports({one.key.text: one.value for one in arguments}, {})
        outputs = self._outputs(raw, subtree.outputs)
        return Xml(tag="SubTree", attributes={"ID": tree_id, **ports, **outputs})

    def _decorated(self, raw: RawNode, decorator: NodeType, entry: MappingEntry, xml: Xml) -> Xml:
        """Return an element with a decorator around it."""
        if decorator.handler:
            children = (xml, self.node(raw.nodes[decorator.key]))
            return Xml(tag="Fallback", attributes={"name": decorator.key}, children=children)
        export = DECORATED.get(decorator.key)
        if decorator.main is None:
            on = isinstance(entry.value, Scalar) and boolean(entry.value.text)
            native = export(entry.value, xml) if export is not None else None
            return xml if not on else native or self._own_decorator(decorator, entry, xml)
        fields = _fields_of(entry.value, decorator.main)
        if export is not None and set(fields) == {decorator.main}:
            native = export(fields[decorator.main], xml)
            if native is not None:
                return native
        return self._own_decorator(decorator, entry, xml)

    def _own_decorator(self, decorator: NodeType, entry: MappingEntry, xml: Xml) -> Xml:
        """Return a decorator that BehaviorTree.CPP does not bring along."""
        types = {one.name: one.type for one in decorator.fields}
        verbatim = {one.name for one in decorator.fields if one.content is Content.CONDITION}
        fields = _fields_of(entry.value, decorator.main) if decorator.main is not None else {}
        tag = self._declared_tag(entry.key, "Decorator", decorator.key, decorator.fields)
        return Xml(tag=tag, attributes=self._ports(fields, types, verbatim), children=(xml,))


def _switch(tag: str) -> Decorate:
    return lambda node, xml: Xml(tag=tag, children=(xml,))


def _with_port(tag: str, name: str, text_of: Callable[[Node], str | None]) -> Decorate:
    def export(node: Node, xml: Xml) -> Xml | None:
        text = text_of(node)
        return None if text is None else Xml(tag=tag, attributes={name: text}, children=(xml,))

    return export


def _skip_unless(node: Node, xml: Xml) -> Xml | None:
    try:
        return xml.having(**{SKIP_IF: condition_script(node, negative=True)})
    except Untranslatable:
        return None


def _while(node: Node, xml: Xml) -> Xml | None:
    try:
        condition_leaf = Xml(tag="ScriptCondition", attributes={"code": condition_script(node)})
    except Untranslatable:
        return None
    return Xml(tag="WhileDoElse", children=(condition_leaf, xml))


def _option(raw: RawNode, name: str) -> str | None:
    entry = raw.options.get(name)
    return entry.value.text if entry is not None and isinstance(entry.value, Scalar) else None


def _fields_of(node: Node, main: str) -> dict[str, Node]:
    if isinstance(node, MappingNode):
        return {entry.key.text: entry.value for entry in node.entries}
    return {main: node}


def _weight(node: Node) -> Plain:
    assert isinstance(node, Scalar)
    return node.text if "${" in node.text else plain_value(node)


NODES: Mapping[str, Callable[[TreeExport, RawNode], Xml]] = {
    "sequence": TreeExport.sequence,
    "selector": TreeExport.selector,
    "parallel": TreeExport.parallel,
    "choose": TreeExport.choose,
    "random": TreeExport.random,
    "check": TreeExport.check,
    "set": TreeExport.set,
    "wait": TreeExport.wait,
    "wait_for": TreeExport.wait_for,
    "subtree": TreeExport.subtree,
}
"""Translator of each node type that has one; the others stay words of our language."""

DECORATED: Mapping[str, Decorate] = {
    "when": _skip_unless,
    "once": _switch("RunOnce"),
    "succeed": _switch("ForceSuccess"),
    "fail": _switch("ForceFailure"),
    "while": _while,
    "retry": _with_port("RetryUntilSuccessful", "num_attempts", number_port),
    "repeat": _with_port("Repeat", "num_cycles", number_port),
    "timeout": _with_port("Timeout", "msec", milliseconds),
    "invert": _switch("Inverter"),
}
"""Translator of each decorator that has one, as :data:`NODES`."""
