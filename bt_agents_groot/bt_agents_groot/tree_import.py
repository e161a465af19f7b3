# SPDX-License-Identifier: Apache-2.0
"""Import of one tree: common parts of all elements, such as names, conditions and scripts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial, reduce
from typing import TypeVar

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import (
    CONDITIONS,
    FAILURE_IF,
    ON_FAILURE,
    ON_HALTED,
    ON_SUCCESS,
    OTHER_ATTRIBUTES,
    POST,
    SKIP_IF,
    SUCCESS_IF,
    WHILE,
)
from bt_agents_groot.document import node_id
from bt_agents_groot.expressions import parse_formula
from bt_agents_groot.formulas import Binary, Formula, Untranslatable, negated
from bt_agents_groot.ports import PortError, from_port, names_in, pointed_at
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.script_nodes import as_condition, as_node, condition_text
from bt_agents_groot.scripts import Statement, parse_script
from bt_agents_groot.translation import Remark, Remarks
from bt_agents_groot.xml_files import Attribute, Element
from bt_agents_groot.yaml_nodes import (
    Data,
    Raw,
    YamlNode,
    can_be_skipped,
    check,
    decorated,
    selector,
    sequence,
    with_comments,
)
from bt_agents_language.nodes.on_failure import ON_FAILURE as HANDLER
from bt_agents_language.nodes.sequence import SEQUENCE
from bt_agents_language.nodes.when import WHEN

T = TypeVar("T")

_MAX_LABEL = 64


class TreeImport:
    """Tree during its import, with its name scope."""

    def __init__(
        self, names: TreeNames, remarks: Remarks, translate: Translate, skill: Translate
    ) -> None:
        self.names = names
        self._remarks = remarks
        self._translate = translate
        self._skill = skill
        # Comments of the elements during their translation, the innermost last.
        self._comments: list[list[str]] = []

    def node(self, element: Element, *, below_fallback: bool = False) -> YamlNode:
        """Return the node for an element and its descendants."""
        description = element.get("_description")
        self._comments.append([description] if description else [])
        # This is the order in which BehaviorTree.CPP evaluates them.
        guards = {
            name: condition
            for name in (FAILURE_IF, SUCCESS_IF, SKIP_IF, WHILE)
            for condition in self._read(element, name, self.condition)
        }
        node = self._with_name(element, self._translate(self, element))
        node = self._with_guards(element, node, guards, below_fallback)
        self._remark_unread(element)
        return with_comments(node, self._comments.pop())

    def skill(self, element: Element) -> YamlNode:
        """Return the skill with the name of an element, whatever is below the element."""
        return self._skill(self, replace(element, children=()))

    def branch(self, element: Element, ended: str = "succeeded") -> YamlNode:
        """Return a node that has ``ended`` so when it is left out; remark if it can be."""
        node = self.node(element)
        if can_be_skipped(node):
            self.note_skip(element, "it", ended)
        return node

    def note_skip(self, element: Element, what: str, ended: str) -> None:
        """Remark that a skip of ``what`` ends our node, but not that of BehaviorTree.CPP."""
        self.note(element, f"when {what} is left out, ours has {ended}; Groot's is left out")

    def decorate(self, element: Element, node: YamlNode, key: str, value: Data) -> YamlNode:
        """Return a node with a decorator around it; remark on differences if it can be skipped."""
        whole = decorated(node, key, value)
        if whole.key == SEQUENCE.key and whole.children == (node,) and can_be_skipped(node):
            self.note(
                element,
                f"when its child is left out, it has succeeded for our '{key}'; Groot's is left "
                "out itself",
            )
        return whole

    def lost(self, where: Element | Attribute, message: str) -> None:
        """Remark on a loss, also in a comment above the current node."""
        self._comment(self._remarks.lost(where.position, message))

    def note(self, where: Element | Attribute, message: str) -> None:
        """Remark on a difference, also in a comment above the current node."""
        self._comment(self._remarks.note(where.position, message))

    def _comment(self, remark: Remark) -> None:
        if self._comments and remark.comment not in self._comments[-1]:
            self._comments[-1].append(remark.comment)

    def _statements(self, attribute: Attribute) -> list[Statement]:
        if pointed_at(attribute.value) is not None:
            raise Untranslatable("the script is in a blackboard entry")
        return parse_script(attribute.value, self.names.rename)

    def port(self, where: Element | Attribute, text: str, field_type: FieldType) -> Data:
        """Return the value of a port; record the names in it as read."""
        try:
            data = from_port(text, field_type, self.names.rename)
        except PortError as error:
            self.lost(where, str(error))
            return text
        # A text can hold names of any type.
        whole = pointed_at(text) is not None
        self.names.mention(names_in(data), field_type if whole else FieldType.ANY)
        return data

    def entry(self, text: str, field_type: FieldType) -> str | None:
        """Return the name of the entry that a port points at, if any; record it as read."""
        entry = pointed_at(text)
        if entry is None:
            return None
        name = self.names.rename(entry)
        self.names.read([name], field_type)
        return name

    def constant(self, element: Element, port: str, default: str) -> str:
        """Return the text of a port; if it points at an entry, that is lost for its default."""
        text = element.get(port, default).strip()
        if pointed_at(text) is None:
            return text
        self.lost(element, f"'{port}' is {text}; {default} is assumed")
        return default

    def script(self, attribute: Attribute) -> YamlNode:
        """Return the node for a script; record its names as read and written.

        Raises:
            Untranslatable: Our language has no equivalent of a statement.
        """
        return as_node(self._statements(attribute), self.names)

    def condition(self, attribute: Attribute) -> Formula:
        """Return a script as a condition; record its names as read.

        Raises:
            Untranslatable: It is not a condition, or our language has no such condition.
        """
        condition = as_condition(self._statements(attribute))
        self.text(condition)
        return condition

    def text(self, condition: Formula) -> Raw:
        """Return a condition as text of our language; record its names as read.

        Raises:
            Untranslatable: Our language has no such condition.
        """
        return condition_text(condition, self.names)

    def _with_name(self, element: Element, node: YamlNode) -> YamlNode:
        label = " ".join(element.get("name").replace("${", "$ {").split())
        is_handler = element.get("name") == HANDLER.key and HANDLER.key in node.decorators
        if not label or label == node_id(element) or is_handler:
            return node
        if len(label) > _MAX_LABEL:
            self.note(element, f"the name is shortened to {_MAX_LABEL} characters")
            label = f"{label[: _MAX_LABEL - 1]}…"
        if not node.name:
            return replace(node, name=label)
        self.note(
            element,
            f"the name '{label}' of <{node_id(element)}> is left out; in our language "
            f"'{node.name}' is the name of the same node",
        )
        return node

    def _read(self, element: Element, name: str, read: Callable[[Attribute], T]) -> list[T]:
        """Return the content of an attribute; nothing if it is missing or left out."""
        attribute = element.attributes.get(name)
        if attribute is not None:
            try:
                return [read(attribute)]
            except Untranslatable as error:
                self._leave_out(attribute, str(error))
        return []

    def _leave_out(self, attribute: Attribute, reason: str) -> None:
        shown = f'{attribute.name}="{attribute.value[:80]}"'
        self.lost(attribute, f"{shown} is left out: {reason}")

    def _with_guards(
        self, element: Element, node: YamlNode, guards: dict[str, Formula], below_fallback: bool
    ) -> YamlNode:
        decides_earlier = [guards[name] for name in (SUCCESS_IF, FAILURE_IF) if name in guards]
        scripts = any(name in element.attributes for name in (ON_SUCCESS, ON_FAILURE, POST))
        wanted = [negated(guards[SKIP_IF])] if SKIP_IF in guards else []
        if WHILE in guards:
            wanted.append(guards[WHILE])
        inner = node.decorators.get(WHEN.key)
        if isinstance(inner, Raw) and (decides_earlier or scripts):
            # A skipped node has no result, so its condition must be outside.
            wanted.append(parse_formula(inner.text))
            rest = {key: value for key, value in node.decorators.items() if key != WHEN.key}
            node = replace(node, decorators=rest)
        if decides_earlier and can_be_skipped(node):
            self.note_skip(element, "it", "failed" if SUCCESS_IF in guards else "succeeded")
        if WHILE in guards:
            node = self.decorate(element, node, "while", self.text(guards[WHILE]))
            if not below_fallback:
                self.note(element.attributes[WHILE], CONDITIONS[WHILE][1])
        if SUCCESS_IF in guards:
            node = selector(check(self.text(guards[SUCCESS_IF])), node)
        if FAILURE_IF in guards:
            node = sequence(check(self.text(negated(guards[FAILURE_IF]))), node)
        node = self._with_scripts(element, node)
        if not wanted:
            return node
        whole = reduce(partial(Binary, "and"), wanted)
        # An earlier decision is never skipped.
        for earlier in decides_earlier:
            whole = Binary("or", earlier, whole)
        return decorated(node, "when", self.text(whole))

    def _with_scripts(self, element: Element, node: YamlNode) -> YamlNode:
        """Return a node with scripts that run after its end."""

        def scripts(*names: str) -> list[YamlNode]:
            return [one for name in names for one in self._read(element, name, self.script)]

        after_failure, after_success = self.names.exclusive(
            [partial(scripts, ON_FAILURE, POST), partial(scripts, ON_SUCCESS, POST)]
        )
        halted = element.attributes.get(ON_HALTED)
        if halted is not None:
            self._leave_out(halted, "nothing is done when a single node is stopped")
        if after_success and can_be_skipped(node):
            self.note(element, "its scripts are run even when it is left out")
        if after_failure:
            whole = after_failure[0] if len(after_failure) == 1 else sequence(*after_failure)
            node = decorated(node, HANDLER.key, decorated(whole, "fail", True))
        return sequence(node, *after_success) if after_success else node

    def _remark_unread(self, element: Element) -> None:
        known = (*CONDITIONS, *OTHER_ATTRIBUTES)
        for name, attribute in element.attributes.items():
            if name.startswith("_") and name not in known:
                self.note(attribute, f"the attribute '{name}' is not read")
        if element.text:
            self.note(element, f"the text inside of <{element.tag}> is not read")


Translate = Callable[[TreeImport, Element], YamlNode]
"""Function that returns the node for an element without its name, conditions and scripts."""
