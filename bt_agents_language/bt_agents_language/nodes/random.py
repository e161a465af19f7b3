# SPDX-License-Identifier: Apache-2.0
"""``random``: runs one of its children, chosen by their weights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from bt_agents_core.field_types import FieldType
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.fields.values import read_value
from bt_agents_language.model.specs import Literal, NodeSpec
from bt_agents_language.nodes.endings import Outcomes, Unreached, any_of
from bt_agents_language.nodes.node_type import (
    Children,
    Content,
    FieldValues,
    NodeField,
    NodeReader,
    NodeType,
    RawNode,
    Role,
    short,
    wrapped,
)
from bt_agents_language.nodes.weight import WEIGHT, WEIGHT_KEY


def _read(reader: NodeReader, raw: RawNode, path: str, names: NameScope) -> NodeSpec:
    def weighted(child: RawNode, spec: NodeSpec | None, here: str) -> NodeSpec | None:
        label = "weight 1"
        fields: FieldValues = {"weight": Literal(value=1.0)}
        entry = child.siblings.get(WEIGHT_KEY.key)
        if entry is not None:
            reading = reader.reading
            value = read_value(reading, entry.value, FieldType.NUMBER, names, "'weight'", 0.0)
            if value is not None:
                label = f"weight {short(entry.value)}"
                fields["weight"] = value
        return wrapped(spec, WEIGHT.key, child.key.position, here, fields, label)

    spec = reader.composite(raw, path, names, weighted)
    if spec.children and all(map(_never_chosen, spec.children)):
        reader.reading.error(
            "out-of-range",
            raw.key,
            "every weight is 0, so no child can ever be chosen",
            "give one of them a weight above 0",
        )
    return spec


def _never_chosen(child: NodeSpec) -> bool:
    return child.fields.get("weight") == Literal(value=0.0)


def _unreached(spec: NodeSpec, outcomes: Mapping[int, Outcomes]) -> Iterator[Unreached]:
    for child in filter(_never_chosen, spec.children):
        yield Unreached(child, "its 'weight' is 0", "give it a weight above 0")


RANDOM = NodeType(
    key="random",
    order=50,
    role=Role.COMPOSITE,
    fields=(
        NodeField(
            name="seed",
            content=Content.CONSTANT,
            type=FieldType.INTEGER,
            required=False,
            description="makes the choices the same in every run",
        ),
        NodeField(
            name="repeats",
            content=Content.CONSTANT,
            type=FieldType.BOOLEAN,
            required=False,
            description="false: no child is chosen again before every other child has been chosen",
        ),
    ),
    children=Children.LIST,
    description="Runs one child at random; a larger 'weight' makes a child more likely.",
    child_siblings=(WEIGHT_KEY.key,),
    read=_read,
    outcomes=lambda spec, children: any_of(children),
    unreached=_unreached,
    exclusive=True,
    example="""\
tree:
  random:
    - say: Hello.
      weight: 3
    - say: Good day to you.
""",
)
