# SPDX-License-Identifier: Apache-2.0
"""Import of one tree: elements of BehaviorTree.CPP as nodes of our language."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bt_agents_groot.catalogue import (
    BUILTINS,
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
from bt_agents_groot.controls import CONTROLS, is_handler, own_control
from bt_agents_groot.decorators import DECORATORS, own_decorator, unknown_parent
from bt_agents_groot.document import node_id
from bt_agents_groot.expressions import parse_formula
from bt_agents_groot.formulas import Binary, Formula, Untranslatable, negated
from bt_agents_groot.leaves import LEAVES, check
from bt_agents_groot.ports import pointed_at
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.script_nodes import as_condition, as_node, condition_text
from bt_agents_groot.scripts import Statement, parse_script
from bt_agents_groot.skill_nodes import SkillNodes
from bt_agents_groot.subtree_calls import SubtreeCalls
from bt_agents_groot.translation import RemarkLevel, Remarks
from bt_agents_groot.xml_files import Attribute, Element
from bt_agents_groot.yaml_nodes import (
    Data,
    Raw,
    YamlNode,
    can_be_skipped,
    decorated,
    selector,
    sequence,
    with_comments,
)
from bt_agents_language.nodes.sequence import SEQUENCE
from bt_agents_language.nodes.when import WHEN

_MAX_LABEL = 64
_SCRIPTS = (ON_SUCCESS, ON_FAILURE, POST)
_BUILDERS = {**CONTROLS, **DECORATORS, **LEAVES}


@dataclass(frozen=True)
class _Guards:
    """Conditions of an element, which are imported before the element itself."""

    skip: Formula | None
    failure: Formula | None
    success: Formula | None
    hold: Formula | None


class TreeImport:
    """Tree that is being imported; see :class:`~bt_agents_groot.translation.Translation`."""

    def __init__(
        self, names: TreeNames, skills: SkillNodes, calls: SubtreeCalls, remarks: Remarks
    ) -> None:
        self.names = names
        self._skills = skills
        self._calls = calls
        self._remarks = remarks
        # Comments of the elements that are being translated, the innermost last.
        self._comments: list[list[str]] = []

    def node(self, element: Element, *, below_fallback: bool = False) -> YamlNode:
        """Return the node for an element and all below it."""
        self._comments.append([])
        description = element.get("_description")
        if description:
            self._comments[-1].append(description)
        guards = self._guards(element)
        node = self._with_name(element, self._translated(element))
        node = self._with_guards(element, node, guards, below_fallback)
        self._remark_unread(element)
        return with_comments(node, self._comments.pop())

    def decorate(self, element: Element, node: YamlNode, key: str, value: Data) -> YamlNode:
        """Return a node with a decorator around it; remark on differences when it is skipped."""
        whole = decorated(node, key, value)
        if whole.key == SEQUENCE.key and whole.children == (node,) and can_be_skipped(node):
            self.remark(
                RemarkLevel.NOTE,
                element,
                f"when its child is left out, it has succeeded for our '{key}'; Groot's is left "
                "out itself",
            )
        return whole

    def remark(self, level: RemarkLevel, where: Element | Attribute, message: str) -> None:
        """Add a remark, which also becomes a comment above the node being translated."""
        remark = self._remarks.add(level, where.position, message)
        if self._comments and remark.comment not in self._comments[-1]:
            self._comments[-1].append(remark.comment)

    def statements(self, attribute: Attribute) -> list[Statement]:
        """Return the statements of a script."""
        if pointed_at(attribute.value) is not None:
            raise Untranslatable("the script stands in a blackboard entry")
        return parse_script(attribute.value, self.names.rename)

    def condition(self, attribute: Attribute) -> Formula:
        """Return a script as a condition."""
        return as_condition(self.statements(attribute))

    def text(self, condition: Formula) -> Raw:
        """Return a condition as text of our language; its names are recorded as read."""
        return condition_text(condition, self.names)

    def _translated(self, element: Element) -> YamlNode:
        name = node_id(element)
        if element.tag == "SubTree":
            return self._calls.call(element, self.names, self.remark)
        if name in BUILTINS:
            return _BUILDERS[name](self, element)
        if not element.children:
            return self._skills.leaf(element, self.names, self.remark)
        return (
            own_control(self, element)
            or own_decorator(self, element)
            or unknown_parent(self, element)
        )

    def _with_name(self, element: Element, node: YamlNode) -> YamlNode:
        label = " ".join(element.get("name").replace("${", "$ {").split())
        if not label or label == node_id(element) or is_handler(element, node):
            return node
        if len(label) > _MAX_LABEL:
            self.remark(
                RemarkLevel.NOTE, element, f"the name is shortened to {_MAX_LABEL} characters"
            )
            label = f"{label[: _MAX_LABEL - 1]}…"
        if not node.name:
            return replace(node, name=label)
        self.remark(
            RemarkLevel.NOTE,
            element,
            f"the name '{label}' of <{node_id(element)}> is left out; in our language "
            f"'{node.name}' is the name of the same node",
        )
        return node

    def _guards(self, element: Element) -> _Guards:
        # In the order in which BehaviorTree.CPP evaluates them.
        failure, success, skip, hold = (
            self._guard(element, name) for name in (FAILURE_IF, SUCCESS_IF, SKIP_IF, WHILE)
        )
        return _Guards(skip, failure, success, hold)

    def _guard(self, element: Element, name: str) -> Formula | None:
        attribute = element.attributes.get(name)
        if attribute is None:
            return None
        try:
            condition = self.condition(attribute)
            self.text(condition)
        except Untranslatable as error:
            self.remark(
                RemarkLevel.LOST,
                attribute,
                f'{name}="{attribute.value[:80]}" is left out: {error}',
            )
            return None
        return condition

    def _with_guards(
        self, element: Element, node: YamlNode, guards: _Guards, below_fallback: bool
    ) -> YamlNode:
        node, inner = self._without_when(element, node, guards)
        if guards.hold is not None:
            node = self.decorate(element, node, "while", self.text(guards.hold))
            if not below_fallback:
                self.remark(RemarkLevel.NOTE, element.attributes[WHILE], CONDITIONS[WHILE][1])
        if guards.success is not None:
            node = selector(check(self.text(guards.success)), node)
        if guards.failure is not None:
            node = sequence(check(self.text(negated(guards.failure))), node)
        node = self._with_scripts(element, node)
        wanted = [negated(guards.skip)] if guards.skip is not None else []
        wanted += [one for one in (guards.hold, inner) if one is not None]
        if not wanted:
            return node
        whole = wanted[0]
        for one in wanted[1:]:
            whole = Binary("and", whole, one)
        # What decides earlier is never skipped.
        for earlier in (guards.success, guards.failure):
            if earlier is not None:
                whole = Binary("or", earlier, whole)
        return decorated(node, "when", self.text(whole))

    def _without_when(
        self, element: Element, node: YamlNode, guards: _Guards
    ) -> tuple[YamlNode, Formula | None]:
        """Split the ``when`` off a node that gets something around it.

        A node that is skipped has no result, so that its condition must go outside.
        """
        condition = node.decorators.get(WHEN.key)
        conditions = guards.success is not None or guards.failure is not None
        wrapped = conditions or any(name in element.attributes for name in _SCRIPTS)
        if not wrapped or not isinstance(condition, Raw):
            return node, None
        rest = {key: value for key, value in node.decorators.items() if key != WHEN.key}
        return replace(node, decorators=rest), parse_formula(condition.text)

    def _with_scripts(self, element: Element, node: YamlNode) -> YamlNode:
        """Return a node with the scripts that run after its end."""
        after_success = [*self._scripts(element, ON_SUCCESS), *self._scripts(element, POST)]
        after_failure = [*self._scripts(element, ON_FAILURE), *self._scripts(element, POST)]
        self._scripts(element, ON_HALTED, lost=True)
        if after_failure:
            whole = after_failure[0] if len(after_failure) == 1 else sequence(*after_failure)
            node = decorated(node, "on_failure", decorated(whole, "fail", True))
        if after_success and can_be_skipped(node):
            self.remark(RemarkLevel.NOTE, element, "its scripts are run even when it is left out")
        return sequence(node, *after_success) if after_success else node

    def _scripts(self, element: Element, name: str, *, lost: bool = False) -> list[YamlNode]:
        attribute = element.attributes.get(name)
        if attribute is None:
            return []
        try:
            if lost:
                raise Untranslatable("nothing is done when a single node is stopped")
            return [as_node(self.statements(attribute), self.names)]
        except Untranslatable as error:
            self.remark(
                RemarkLevel.LOST,
                attribute,
                f'{name}="{attribute.value[:80]}" is left out: {error}',
            )
            return []

    def _remark_unread(self, element: Element) -> None:
        known = (*CONDITIONS, *OTHER_ATTRIBUTES)
        for name, attribute in element.attributes.items():
            if name.startswith("_") and name not in known:
                self.remark(RemarkLevel.NOTE, attribute, f"the attribute '{name}' is not read")
        if element.text:
            self.remark(
                RemarkLevel.NOTE, element, f"the text inside of <{element.tag}> is not read"
            )
