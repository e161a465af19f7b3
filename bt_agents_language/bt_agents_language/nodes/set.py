# SPDX-License-Identifier: Apache-2.0
"""``set``: gives names values that later nodes can use."""

from __future__ import annotations

from bt_agents_language.fields.scope import NameScope
from bt_agents_language.fields.values import read_value
from bt_agents_language.model.specs import NodeSpec
from bt_agents_language.nodes.endings import always_success
from bt_agents_language.nodes.node_type import (
    LABEL_LENGTH,
    FieldValues,
    NodeReader,
    NodeType,
    RawNode,
)
from bt_agents_language.yaml.yaml_reader import Mapping


def _read(reader: NodeReader, raw: RawNode, path: str, names: NameScope) -> NodeSpec:
    reading = reader.reading
    entries = reading.entries(raw.value, "'set'", "names and values")
    if isinstance(raw.value, Mapping) and not entries:
        reading.error("missing-value", raw.value, "'set' sets nothing", "write set: {name: value}")
    fields: FieldValues = {}
    for entry in entries:
        name = entry.key.text
        value = read_value(reading, entry.value, names.declared_type(name), names, f"'{name}'")
        if value is not None:
            fields[name] = value
    return NodeSpec(
        path=path,
        position=raw.key.position,
        kind=SET.key,
        name=raw.name or f"set {', '.join(fields)}"[:LABEL_LENGTH],
        fields=fields,
    )


SET = NodeType(
    key="set",
    order=70,
    open=True,
    description="Gives names values that later nodes can use.",
    read=_read,
    outcomes=always_success,
    example="""\
tree:
  sequence:
    - set: {place: gate 12, tries: 3}
    - say: We go to ${place}.
    - drive: ${place}
      retry: ${tries}
""",
)
