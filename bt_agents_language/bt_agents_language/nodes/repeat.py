# SPDX-License-Identifier: Apache-2.0
"""``repeat``: runs its node again after a success."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bt_agents_core.field_types import FieldType
from bt_agents_language.model.specs import Literal, NodeSpec
from bt_agents_language.nodes.endings import ENDLESS, SUCCESS, Outcomes
from bt_agents_language.nodes.node_type import (
    FOREVER,
    PAUSE,
    Content,
    FieldValues,
    NodeField,
    NodeType,
    Role,
)
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import Node, Scalar


def _complete(
    reading: TypedReader, node: Node, written: Mapping[str, Node], fields: FieldValues
) -> None:
    empty = isinstance(node, Scalar) and node.empty
    if (empty or isinstance(node, MappingNode)) and not {"times", "until"} & written.keys():
        reading.error(
            "missing-key",
            node,
            "'repeat' needs the key 'times' or 'until'",
            "write how often, or what ends it: {until: answer == 'yes'}",
        )
    fields.setdefault("times", Literal(value=FOREVER))


def _outcomes(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    inner = children[0]
    if spec.fields.get("times") != Literal(value=FOREVER):
        return inner
    return inner | ENDLESS if "until" in spec.fields else (inner - SUCCESS) | ENDLESS


REPEAT = NodeType(
    key="repeat",
    order=90,
    role=Role.DECORATOR,
    main="times",
    fields=(
        NodeField(
            name="times",
            type=FieldType.INTEGER,
            required=False,
            minimum=1,
            words=(FOREVER,),
            description="total number of times",
        ),
        NodeField(
            name="until",
            content=Content.CONDITION,
            required=False,
            description="condition that ends the repetition; checked after each time, and after "
            "the pause",
        ),
        PAUSE,
    ),
    description="Repeats the node after each success, up to a total number of times.",
    complete=_complete,
    outcomes=_outcomes,
    rounds="times",
    example="""\
tree:
  repeat: {times: 10, until: live.mood >= 4, pause: 5 s}
  say: Smile, please.
""",
)
