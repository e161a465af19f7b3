# SPDX-License-Identifier: Apache-2.0
"""Calls of skills and subtrees: checks of inputs and outputs against the declaration."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.diagnostic import Position
from bt_agents_core.field_types import Plain
from bt_agents_core.text import ellipsize, join_quoted, quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.fields.bindings import SENT
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.fields.values import ONE_OF, is_plain, plain, read_value, read_variants
from bt_agents_language.model.specs import (
    NOTHING,
    Binding,
    FieldSpec,
    Literal,
    NodeSpec,
    Reference,
    SkillSpec,
    SubtreeSpec,
    Value,
)
from bt_agents_language.nodes.catalogue import SIBLING_KEYS
from bt_agents_language.nodes.node_type import LABEL_LENGTH, FieldValues, RawNode, short
from bt_agents_language.nodes.skill import takes_variants
from bt_agents_language.nodes.subtree import SUBTREE
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.scalars import quoted
from bt_agents_language.yaml.typed_reader import TypedReader, found
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import Node, Scalar, Sequence, entries_of, several


class CallReader:
    """Reader of skill nodes and subtree nodes in one file.

    Attributes:
        calls: Place of each ``subtree`` node → name of the subtree.
    """

    def __init__(
        self, reading: TypedReader, subtrees: Mapping[str, SubtreeSpec], symbols: SymbolTable
    ) -> None:
        self._symbols = symbols
        self.calls: dict[Position, str] = {}
        self._reading = reading
        self._subtrees = subtrees

    def skill(self, raw: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        """Return the node of a skill; None if it is unusable."""
        skill = raw.skill
        assert skill is not None
        nodes = self._skill_fields(raw.value, skill)
        if nodes is None:
            return None
        outputs, feedback = self._skill_outputs(raw, skill)
        fields = self._skill_inputs(skill, nodes, names, raw)
        return NodeSpec(
            path=path,
            position=raw.key.position,
            kind=skill.name,
            name=raw.name or _skill_label(skill, nodes, fields),
            fields=fields,
            skill=skill,
            outputs=outputs,
            feedback=feedback,
        )

    def _skill_inputs(
        self, skill: SkillSpec, nodes: Mapping[str, Node], names: NameScope, raw: RawNode
    ) -> FieldValues:
        fields = self._inputs(skill.inputs, nodes, names, raw)
        written = nodes.get(ONE_OF) if takes_variants(skill) else None
        if written is not None:
            assert skill.main is not None
            fields.pop(skill.main, None)
            variants = read_variants(self._reading, written, names, f"'{ONE_OF}'")
            if variants is not None:
                fields[skill.main] = variants
        for one in skill.inputs:
            value = fields.get(one.name)
            if one.name in nodes and value is not None and not isinstance(value, Expression):
                self._check_sent(skill.binding, one.name, nodes[one.name], value)
        return fields

    def _check_sent(self, binding: Binding | None, name: str, node: Node, value: Value) -> None:
        """Report a plain input that does not fit the fields that it fills."""
        interfaces = self._symbols.interfaces
        if binding is None or interfaces is None or not is_plain(value):
            return
        filled = [key for key, of in binding.fields.items.items() if of == Reference(name=name)]

        def problem(sent: Plain) -> str | None:
            nested = dict.fromkeys(filled, sent)
            return interfaces.value_problem(binding.kind, binding.type, SENT[binding.kind], nested)

        unfit = problem(plain(value))
        if unfit:
            items = several(node)
            words = tuple(item.text for item in items if isinstance(item, Scalar))
            fits = len(words) == len(items) and problem(words) is None
            if isinstance(node, Scalar):
                words = tuple(word.strip() for word in node.text.split(","))
            hint = f"write [{', '.join(map(quoted, words))}]" if fits else ""
            self._reading.error(
                "wrong-value", node, f"the robot does not take this: {unfit}", hint
            )

    def _skill_outputs(
        self, raw: RawNode, skill: SkillSpec
    ) -> tuple[Mapping[str, str], Mapping[str, str]]:
        """Return the names assigned from the result, and those from the feedback."""
        if not skill.outputs and "outputs" not in raw.siblings:
            return NOTHING, NOTHING
        # Without a binding, the answers of a rehearsal have the outputs by their own names.
        unbound = {output.name: output.name for output in skill.outputs}
        paths = skill.binding.outputs if skill.binding is not None else unbound
        feedback = skill.binding.feedback if skill.binding is not None else NOTHING
        written = self._outputs(raw, skill.outputs, f"skill '{skill.name}'")
        return (
            {name: paths[of] for name, of in written.items() if of in paths},
            {name: feedback[of] for name, of in written.items() if of in feedback} or NOTHING,
        )

    def subtree(self, raw: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        """Return the node of a subtree, before its expansion."""
        name_node = raw.value
        if isinstance(name_node, MappingNode):
            if name_node.entries and self._refuse_inputs(name_node):
                return None
            fields = self._reading.fields(
                name_node, "'subtree'", ("name",), ("name",), beside=SIBLING_KEYS
            )
            written = fields.get("name") if fields is not None else None
            if written is None or len(name_node.entries) > 1:
                return None
            name_node = written
        called = self._reading.text(name_node, "the name of a subtree")
        if called is None:
            return None
        if called not in self._subtrees:
            if not self._symbols.incomplete:
                message = f"there is no subtree {quote(called)}"
                self._reading.error("unknown-subtree", name_node, message, self._missing(called))
            return None
        subtree = self._subtrees[called]
        if not subtree.complete:
            return None
        self.calls[raw.key.position] = called
        return NodeSpec(
            path=path,
            position=raw.key.position,
            kind=SUBTREE.key,
            name=raw.name or f"subtree {called}",
            fields=self._inputs(subtree.inputs, self._given(raw, subtree), names),
            outputs=self._outputs(raw, subtree.outputs, f"subtree '{called}'"),
        )

    def _refuse_inputs(self, call: MappingNode) -> bool:
        """Return whether inputs stand in a node ``subtree``, which is reported."""
        named = call.get("name")
        inputs = [one for one in call.entries if one.value is not named]
        given = inputs[0] if inputs else call.entries[0]
        called = named.text if isinstance(named, Scalar) else given.key.text
        if called not in self._subtrees or given.key.text in SIBLING_KEYS:
            return False
        if isinstance(given.value, MappingNode) or named is None:
            inputs = [*entries_of(given.value)]
        source = self._reading.source.text
        pairs = [source[one.key.start : one.value.end] for one in inputs]
        written = ellipsize(" ".join(", ".join(pairs).split())) or "…"
        self._reading.error(
            "unknown-key",
            given.key,
            f"'subtree' has no key {quote(given.key.text)}",
            f"write 'subtree: {called}', and 'with: {{{written}}}' beside it",
        )
        return True

    def _missing(self, called: str) -> str:
        """Return how to get a subtree that the file does not have."""
        libraries = self._symbols.libraries
        having = libraries.with_subtree(called) if libraries is not None else []
        if having:
            return f"add imports: [{having[0]}], which has it"
        return (
            did_you_mean(called, self._subtrees)
            or "declare it under 'subtrees:', or import a library that has it"
        )

    def _skill_fields(self, value: Node, skill: SkillSpec) -> Mapping[str, Node] | None:
        required = skill.required
        if isinstance(value, MappingNode):
            known = skill.input_names
            if takes_variants(skill):
                known = (*known, ONE_OF)
                if any(entry.key.text == ONE_OF for entry in value.entries):
                    required = tuple(name for name in required if name != skill.main)
            fields = self._reading.fields(
                value, f"'{skill.name}'", known, required, beside=SIBLING_KEYS
            )
            if fields is not None and {ONE_OF, skill.main} <= fields.nodes.keys():
                self._reading.error(
                    "contradiction",
                    fields.keys[ONE_OF],
                    f"'{skill.name}' has '{skill.main}' and '{ONE_OF}', which replaces it",
                    "keep one of them",
                )
            return fields.nodes if fields is not None else None
        if isinstance(value, Scalar) and value.empty and not required:
            return {}
        if not skill.inputs:
            message = f"'{skill.name}' has no inputs, found {found(value)}"
            self._reading.error("wrong-type", value, message, "remove it")
            return None
        if skill.main is None:
            words = ", ".join(f"{one.name}: …" for one in skill.inputs)
            self._reading.wrong_type(value, f"'{skill.name}'", f"its fields {{{words}}}")
            return None
        missing = [name for name in required if name != skill.main]
        if missing:
            more = ", ".join(f"{name}: …" for name in missing)
            self._reading.error(
                "missing-key",
                value,
                f"'{skill.name}' needs also {join_quoted(missing)}",
                f"write {skill.name}: {{{skill.main}: …, {more}}}",
            )
        return {skill.main: value}

    def _inputs(
        self,
        inputs: tuple[FieldSpec, ...],
        nodes: Mapping[str, Node],
        names: NameScope,
        raw: RawNode | None = None,
    ) -> FieldValues:
        fields: FieldValues = {}
        for one in inputs:
            node = nodes.get(one.name)
            if node is None:
                if not one.required:
                    fields[one.name] = one.default_value
                continue
            what = raw.key_meant if raw is not None and node is raw.value else one.name
            skill = raw.skill if raw is not None else None
            value = read_value(
                self._reading,
                node,
                one.type,
                names,
                f"'{what}'",
                variants=skill is not None and one.name == skill.main,
            )
            if value is not None:
                fields[one.name] = value
        return fields

    def _given(self, raw: RawNode, subtree: SubtreeSpec) -> Mapping[str, Node]:
        required = [one.name for one in subtree.inputs if one.required]
        entry = raw.siblings.get("with")
        if entry is None:
            if required:
                more = ", ".join(f"{name}: …" for name in required)
                self._reading.error(
                    "missing-key",
                    raw.value,
                    f"subtree '{subtree.name}' needs the inputs {join_quoted(required)}",
                    f"add 'with: {{{more}}}' beside 'subtree'",
                )
            return {}
        known = [one.name for one in subtree.inputs]
        if not known:
            message = f"subtree '{subtree.name}' has no inputs"
            self._reading.error("unknown-key", entry.key, message, "remove 'with'")
            return {}
        what = f"'with' of subtree '{subtree.name}'"
        fields = self._reading.fields(entry.value, what, known, required)
        return fields.nodes if fields is not None else {}

    def _outputs(self, raw: RawNode, declared: tuple[FieldSpec, ...], what: str) -> dict[str, str]:
        """Return the output for each assigned name."""
        entry = raw.siblings.get("outputs")
        known = [one.name for one in declared]
        if entry is None:
            return {name: name for name in known}
        outputs: dict[str, str] = {}
        for item in self._reading.entries(entry.value, "'outputs'", "names and outputs"):
            output = self._reading.text(item.value, f"the output after '{item.key.text[:40]}'")
            if output in known:
                outputs[item.key.text] = output
            elif output is not None:
                message = f"{what} has no output {quote(output)}"
                hint = did_you_mean(output, known) or "remove it"
                self._reading.error("unknown-name", item.value, message, hint)
        return outputs


def _skill_label(skill: SkillSpec, nodes: Mapping[str, Node], fields: FieldValues) -> str:
    if skill.main not in nodes and isinstance(nodes.get(ONE_OF), Sequence):
        return f"{skill.name} {ONE_OF} …"
    main = skill.main or ""
    shortened = short(nodes.get(main))
    match fields.get(main):
        # For a named text, such as ${t.bye}, people see its words.
        case Literal(value=str() as words) if "${" in shortened:
            shortened = ellipsize(" ".join(words.split()), LABEL_LENGTH)
    if shortened and skill.main_is_text:
        shortened = f'"{shortened}"'
    return f"{skill.name} {shortened}".rstrip()
