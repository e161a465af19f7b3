# SPDX-License-Identifier: Apache-2.0
"""Reads ``persons`` of ``scene.yaml``: who is tracked, who is known, whom a scene is about."""

from __future__ import annotations

from bt_agents_language.files.source_reader import MAP_KEYS, TRACKED, SourceContext, SourceReader
from bt_agents_language.model.interfaces import Interfaces, MessageFields
from bt_agents_language.model.scene_specs import (
    HOLD_S,
    LOST_AFTER_S,
    PERSON,
    AddresseeRule,
    AddresseeSpec,
    PersonsSpec,
    SourceSpec,
    TrackedSpec,
)
from bt_agents_language.model.specs import FieldType
from bt_agents_language.yaml.mapping_reader import MappingReader
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Node, Scalar

_NO_IDS = {FieldType.NUMBER: "a number with a fraction", FieldType.BOOLEAN: "true or false"}
_ADDRESSEE_KEYS = ("rule", "source", "better_by", "for")


def read_persons(
    reading: TypedReader, node: Node | None, interfaces: Interfaces | None
) -> tuple[PersonsSpec | None, SourceReader]:
    """Return what ``persons`` says, and a reader of sources that may be about one person.

    Args:
        reading: The file.
        node: What stands behind ``persons``; None when there is no such key.
        interfaces: The installed ROS types; None leaves types and fields unchecked.
    """
    plain = SourceReader(reading, interfaces)
    if node is None:
        return None, plain
    known = (TRACKED, "parts", "known", "addressee")
    fields = reading.fields(node, "'persons'", known, (TRACKED,))
    if fields is None:
        return None, plain
    tracked = _tracked(reading, fields.get(TRACKED), plain)
    persons = SourceReader(reading, interfaces, tracked, (PERSON,))
    parts: list[SourceSpec] = []
    names = [PERSON]
    for entry in fields.entries("parts", "names of parts and the sources of their ids"):
        name = reading.name(entry.key, "the name of a part")
        if name == PERSON:
            reading.error(
                "name-taken", entry.key, f"<{PERSON}> is the whole person", "choose another name"
            )
        names.append(entry.key.text)
        wanted = SourceContext(
            name=entry.key.text,
            what=f"part '{entry.key.text[:40]}'",
            text=True,
            must_be_per_person=True,
        )
        part = persons.read(entry.value, entry.key, wanted)
        if part is not None:
            parts.append(part)
    sources = SourceReader(reading, interfaces, tracked, names)
    known_by = None
    if (node := fields.get("known")) is not None:
        wanted = SourceContext(name="known", what="'known'", must_be_per_person=True)
        known_by = sources.read(node, fields.keys["known"], wanted)
    addressee = _addressee(reading, fields.get("addressee"), sources)
    if tracked is None:
        return None, sources
    spec = PersonsSpec(tracked=tracked, parts=tuple(parts), known=known_by, addressee=addressee)
    return spec, sources


def _tracked(reading: TypedReader, node: Node | None, sources: SourceReader) -> TrackedSpec | None:
    if node is None:
        return None
    fields = sources.topic_fields(node, f"'{TRACKED}'", ("id", "lost_after"))
    if fields is None:
        return None
    topic = sources.topic(
        fields, SourceContext(name=TRACKED, what=f"'{TRACKED}'", may_be_per_person=False)
    )
    type_name = sources.type_name(fields)
    whole = sources.message(type_name)
    nodes = fields.nodes
    field = id_path = None
    if "field" in nodes:
        field = sources.path(nodes["field"], "'field'", whole)
    if field is not None:
        item = sources.message(type_name, f"{field}.0")
        problem = whole.problem(f"{field}.0")
        if problem:
            reading.error(
                "unknown-ros-field",
                nodes["field"],
                f"'field' is no list: {problem}",
                "name the list of ids, or of items with an id each",
            )
        elif "id" in nodes:
            id_path = sources.path(nodes["id"], "'id'", item)
            if id_path is not None:
                _check_ids(reading, nodes["id"], f"'id' ({id_path})", item, id_path)
        else:
            _check_ids(reading, nodes["field"], "an item of 'field'", whole, f"{field}.0")
    stale_after_s = sources.stale_after(fields)
    lost_after_s = fields.duration("lost_after")
    if topic is None or type_name is None or field is None or stale_after_s is None:
        return None
    return TrackedSpec(
        topic=topic,
        type=type_name,
        field=field,
        id=id_path or "",
        stale_after_s=stale_after_s,
        latched=fields.boolean("latched") or False,
        lost_after_s=LOST_AFTER_S if lost_after_s is None else lost_after_s,
        position=node.position,
    )


def _check_ids(
    reading: TypedReader, node: Node, what: str, message: MessageFields, path: str
) -> None:
    """Report ids that are neither texts nor whole numbers, as far as their type is known."""
    found = message.nested(path) or _NO_IDS.get(message.type_of(path), "")
    if not found:
        return
    hint = "name the field that holds the id of a person"
    if what.startswith("an item") and found == "a message":
        hint = "add 'id: …', the field of an item that holds the id of a person"
    reading.error(
        "wrong-value", node, f"{what} is {found}, expected a text or a whole number", hint
    )


def _addressee(reading: TypedReader, node: Node | None, sources: SourceReader) -> AddresseeSpec:
    first = AddresseeSpec(rule=AddresseeRule.FIRST)
    if node is None:
        return first
    words = [rule.value for rule in AddresseeRule]
    if isinstance(node, Scalar):
        word = reading.choice(node, "'addressee'", words)
        if word in (None, AddresseeRule.FIRST.value):
            return first
        reading.error(
            "missing-key",
            node,
            f"'addressee: {word}' needs a source that says how {_meaning(word)} a person is",
            f"write addressee: {{rule: {word}, source: {{…}}}}",
        )
        return first
    fields = reading.fields(node, "'addressee'", _ADDRESSEE_KEYS, ("rule",))
    if fields is None:
        return first
    word = fields.choice("rule", words)
    better_by = _better_by(reading, fields, word)
    hold_s = fields.duration("for")
    source = None
    if (written := fields.get("source")) is not None:
        wanted = SourceContext(
            name="addressee",
            what="the source of 'addressee'",
            keys=MAP_KEYS,
            must_be_per_person=True,
        )
        source = sources.read(written, written, wanted)
        if word == AddresseeRule.FIRST.value:
            reading.error(
                "unknown-key",
                fields.keys["source"],
                "who came first is known without a source",
                "remove 'source', or choose 'engaged' or 'nearest'",
            )
    elif word is not None and word != AddresseeRule.FIRST.value:
        reading.error(
            "missing-key",
            node,
            f"rule '{word}' needs the key 'source', which says how {_meaning(word)} a person is",
            "add 'source: {…}'",
        )
    if word is None:
        return first
    return AddresseeSpec(
        rule=AddresseeRule(word),
        source=source,
        better_by=better_by or 0.0,
        hold_s=HOLD_S if hold_s is None else hold_s,
    )


def _better_by(reading: TypedReader, fields: MappingReader, rule: str | None) -> float | None:
    """Return how much better somebody else must be; of distances it may be written as a length."""
    node = fields.get("better_by")
    if node is None:
        return None
    if rule == AddresseeRule.FIRST.value:
        reading.error(
            "unknown-key",
            fields.keys["better_by"],
            "nobody is better than who came first",
            "remove 'better_by', or choose 'engaged' or 'nearest'",
        )
        return None
    if rule != AddresseeRule.NEAREST.value:
        return fields.number("better_by", 0.0)
    what = "'better_by'"
    metres = reading.length(node, what)
    sound = metres is not None and reading.in_range(
        node, what, metres, 0.0, None, FieldType.LENGTH
    )
    return metres if sound else None


def _meaning(rule: str | None) -> str:
    return "far away" if rule == AddresseeRule.NEAREST.value else "engaged"
