# SPDX-License-Identifier: Apache-2.0
"""``remember``: keeps values about a person who is known by name, between visits."""

from __future__ import annotations

from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import nearest
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.fields.values import read_value
from bt_agents_language.model.specs import Binding, MapValue, NodeSpec
from bt_agents_language.nodes.node_type import (
    LABEL_LENGTH,
    FieldValues,
    NodeReader,
    NodeType,
    RawNode,
    Resources,
)
from bt_agents_language.yaml.yaml_reader import Mapping, MappingEntry, Scalar

BINDING = Binding(
    kind=BindingKind.SERVICE,
    name="scene_layer/remember",
    type="bt_agents_interfaces/srv/Remember",
    fields=MapValue(items={}),
)
"""Service of the scene layer that remembers values about persons."""

_GROUP = "person."
_MEASURED = ("name", "visits")


def _read(reader: NodeReader, raw: RawNode, path: str, names: NameScope) -> NodeSpec:
    reading = reader.reading
    entries: tuple[MappingEntry, ...] = ()
    if isinstance(raw.value, Scalar) and raw.value.text.isidentifier():
        word = raw.value.text[:40]
        reading.error(
            "wrong-type",
            raw.value,
            "'remember': expected names and values, found a word",
            f'write remember: {{{word}: "${{answer}}"}}',
        )
    else:
        entries = reading.entries(raw.value, "'remember'", "names and values")
    if isinstance(raw.value, Mapping) and not entries:
        reading.error(
            "missing-value",
            raw.value,
            "'remember' remembers nothing",
            "write remember: {name: value}",
        )
    known = [name for name in names.members(_GROUP) if name not in _MEASURED]
    fields: FieldValues = {}
    for entry in entries:
        key = entry.key.text
        if key not in known:
            word = key.removeprefix(_GROUP)
            near = nearest(word, known)
            reading.error(
                "unknown-name",
                entry.key,
                f"scene.yaml has no {quote(key[:40])} under remembers",
                f"did you mean '{near}'?"
                if near is not None
                else f"declare it there: remembers: {{{word[:40]}: text}}",
            )
            continue
        wanted = names.type_of(_GROUP + key) or FieldType.ANY
        value = read_value(reading, entry.value, wanted, names, f"'{key}'")
        if value is not None:
            fields[key] = value
    return NodeSpec(
        path=path,
        position=raw.key.position,
        kind=REMEMBER.key,
        name=raw.name or f"remember {', '.join(fields)}"[:LABEL_LENGTH],
        fields=fields,
    )


REMEMBER = NodeType(
    key="remember",
    order=75,
    open=True,
    declared=lambda space: space.remembers,
    description="Remembers values of the person for later visits: person.<name>.",
    read=_read,
    idle=True,
    resources=lambda spec: Resources(binding=BINDING),
    example="""\
tree:
  sequence:
    - when: not known(person.favourite)
      sequence:
        - ask: What do you like to drink?
        - remember: {favourite: "${answer}"}
    - say: ${person.name}, one ${person.favourite} as always!
      when: person.visits > 1
""",
)
