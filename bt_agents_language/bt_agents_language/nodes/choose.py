# SPDX-License-Identifier: Apache-2.0
"""``choose``: runs the first of its cases whose ``when`` is true."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from bt_agents_language.fields.scope import NameScope
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.case import CASE
from bt_agents_language.nodes.endings import FAILURE, Outcomes, Unreached, any_of, constant
from bt_agents_language.nodes.node_type import (
    Children,
    Content,
    NodeField,
    NodeReader,
    NodeType,
    RawNode,
    Role,
    wrapped,
)
from bt_agents_language.nodes.when import WHEN


def _read(reader: NodeReader, raw: RawNode, path: str, names: NameScope) -> NodeSpec:
    whens = {
        child: reader.values(WHEN, {"condition": entry.value}, names, "'when'")
        for child in raw.children
        if (entry := child.decorators.get(WHEN.key)) is not None
    }

    def case(child: RawNode, spec: NodeSpec | None, here: str) -> NodeSpec | None:
        label = child.name or "otherwise"
        position = child.key.position
        # A 'when' of the node under 'otherwise' is a decorator with the usual path.
        is_taken = WHEN.key in child.decorators and child not in whens
        suffix = CASE.key if is_taken else WHEN.key
        return wrapped(spec, CASE.key, position, here, whens.get(child, {}), label, suffix=suffix)

    return reader.composite(raw, path, names, case)


def _outcomes(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    fallback = any("condition" not in case.fields for case in spec.children)
    return any_of(children) | (frozenset() if fallback else FAILURE)


def _unreached(spec: NodeSpec, outcomes: Mapping[int, Outcomes]) -> Iterator[Unreached]:
    first: NodeSpec | None = None
    for case in spec.children:
        says = constant(case.fields.get("condition"))
        if first is not None:
            where = f"the 'when' of the case in line {first.position.line} is always true"
            yield Unreached(case, where, "move it before that case, or remove it")
            return
        if says is False:
            yield Unreached(case, "its 'when' is never true", "use a name in it, or remove it")
        first = case if says else None


CHOOSE = NodeType(
    key="choose",
    order=40,
    role=Role.COMPOSITE,
    fields=(
        NodeField(
            name="otherwise",
            content=Content.NODE,
            required=False,
            description="node that runs if no case applies",
        ),
    ),
    children=Children.LIST,
    description="Runs only the first of its named cases whose 'when' is true.",
    child_keys={
        "name": "add 'name: …'",
        WHEN.key: "the node for when no case fits goes under 'otherwise:'",
    },
    read=_read,
    outcomes=_outcomes,
    unreached=_unreached,
    exclusive=True,
    decides=True,
    example="""\
tree:
  choose:
    children:
      - name: in a bad mood
        when: scene.mood < 2
        show: Follow me, please.
      - name: regular guest
        when: scene.familiarity >= 4
        say: Where to?
    otherwise:
      say: Hello. I carry your luggage. Where to?
""",
)
