# SPDX-License-Identifier: Apache-2.0
"""``set``: assigns values to names for later nodes, and puts told values into the scene."""

from __future__ import annotations

from collections.abc import Sequence

from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.fields.inputs import read_new_name
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.fields.values import read_value
from bt_agents_language.model.scene_specs import PERSON
from bt_agents_language.model.specs import Binding, Literal, MapValue, NodeSpec, Value
from bt_agents_language.nodes.endings import EITHER, Outcomes, always_success
from bt_agents_language.nodes.node_type import (
    LABEL_LENGTH,
    FieldValues,
    NodeReader,
    NodeType,
    RawNode,
    Resources,
)
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping, MappingEntry

SCENE = "scene."
"""Prefix of names for values of the scene."""

BINDING = Binding(
    kind=BindingKind.SERVICE,
    name="scene_layer/analyze",
    type="bt_agents_interfaces/srv/Analyze",
    fields=MapValue(items={}),
)
"""The service of the scene layer that takes values for the live scene."""


def sets_scene(spec: NodeSpec) -> bool:
    """Return whether a node puts values into the scene."""
    return any(name.startswith(SCENE) for name in spec.fields)


def _read(reader: NodeReader, raw: RawNode, path: str, names: NameScope) -> NodeSpec:
    reading = reader.reading
    entries = reading.entries(raw.value, "'set'", "names and values")
    if isinstance(raw.value, Mapping) and not entries:
        reading.error("missing-value", raw.value, "'set' sets nothing", "write set: {name: value}")
    fields: FieldValues = {}
    for entry in entries:
        name = entry.key.text
        if "." in name:
            value = _scene_value(reading, entry, names)
        elif "=" in name:
            continue  # The reader of names reports it, with the line to type.
        else:
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


def _scene_value(reading: TypedReader, entry: MappingEntry, names: NameScope) -> Value | None:
    """Return a value that a person has told, for a parameter of the scene."""
    name = entry.key.text
    group, _, member = name.partition(".")
    known = {SCENE + one for one in names.members(SCENE) if one != PERSON}
    if name not in known:
        if group in ("scene", "live"):
            hint = did_you_mean(SCENE + member, known)
            message = f"'set' cannot set '{name[:80]}', only the scene's parameters"
            reading.error("unknown-name", entry.key, message, hint)
        elif group == "person":
            message = f"'set' cannot set '{name[:80]}'"
            hint = f"write remember: {{{member[:40]}: …}}"
            reading.error("unknown-name", entry.key, message, hint)
        else:
            read_new_name(reading, entry.key, "a value")
        return None
    value = read_value(reading, entry.value, FieldType.NUMBER, names, f"'{name}'")
    limits = names.range_of(name)
    if limits is not None and isinstance(value, Literal):
        assert isinstance(value.value, (int, float))
        if not reading.in_range(entry.value, f"'{name}'", value.value, limits.low, limits.high):
            return None
    return value


def _outcomes(spec: NodeSpec, children: Sequence[Outcomes]) -> Outcomes:
    return EITHER if sets_scene(spec) else always_success(spec, children)


SET = NodeType(
    key="set",
    order=70,
    open=True,
    assigns=True,
    declared=lambda space: {SCENE + name: FieldType.NUMBER for name in space.names},
    description="Sets names to values that later nodes can use. A name that starts with 'scene.' "
    "puts a value that the person has told into the live scene.",
    read=_read,
    outcomes=_outcomes,
    idle=True,
    resources=lambda spec: Resources(binding=BINDING if sets_scene(spec) else None),
    example="""\
tree:
  sequence:
    - set: {place: gate 12, tries: 3}
    - say: We go to ${place}.
    - drive: ${place}
      retry: ${tries}
    - ask: {text: "How do you feel, from 1 to 5?", choices: ["1", "2", "3", "4", "5"]}
    - set: {scene.mood: "${number(answer)}"}
""",
)
