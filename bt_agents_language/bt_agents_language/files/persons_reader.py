# SPDX-License-Identifier: Apache-2.0
"""Reader of ``persons`` in ``scene.yaml``: tracked persons, known ones, and the addressee."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType
from bt_agents_language.fields.interfaces import Interfaces, MessageFields, Nesting
from bt_agents_language.files.source_reader import (
    MAP_KEYS,
    TOPIC,
    TRACKED,
    SourceContext,
    SourceReader,
)
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
from bt_agents_language.yaml.field_tables import (
    DURATION,
    LENGTH,
    TEXT,
    Either,
    Entries,
    FieldDecl,
    KeyTable,
    Shared,
    WordChoice,
)
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader
from bt_agents_language.yaml.yaml_reader import Node, Scalar

_NAME_THE_ID = "name the field that holds the id of a person"
_NO_IDS = {FieldType.NUMBER: "a number with a fraction", FieldType.BOOLEAN: "true or false"}
_TRACKED = TOPIC.extended(
    FieldDecl("field", TEXT, "Path of the list of ids, or of items.", required=True),
    FieldDecl("id", TEXT, "Path of a person's id in an item of the list."),
    FieldDecl(
        "lost_after",
        DURATION,
        "A person who is not in the list for this long is gone.",
        default="1 s",
    ),
    what=f"'{TRACKED}'",
)
_ADDRESSEE = KeyTable(
    what="'addressee'",
    fields=(
        FieldDecl(
            "rule",
            WordChoice(tuple(rule.value for rule in AddresseeRule)),
            "The most engaged, the nearest or the first.",
            required=True,
        ),
        FieldDecl(
            "source",
            Shared("source"),
            "How engaged a person is (more is better), or how far away (less is better).",
        ),
        FieldDecl(
            "better_by",
            LENGTH,
            "How much better another person must be, in the unit of the source; a distance may be "
            "written as a length.",
            default=0,
        ),
        FieldDecl("for", DURATION, "How long the other person must be better.", default="1 s"),
    ),
)
PERSONS = KeyTable(
    what="'persons'",
    fields=(
        FieldDecl(TRACKED, _TRACKED, "Topic that lists the persons who are there.", required=True),
        FieldDecl(
            "parts",
            Entries(Shared("text_source"), "names of parts and the sources of their ids"),
            "Parts of a person that have their own ids, such as the face.",
        ),
        FieldDecl(
            "known",
            Shared("source"),
            "Source that says whether the id of a person is a name: 0.5 or more.",
        ),
        FieldDecl(
            "addressee",
            Either((WordChoice((AddresseeRule.FIRST.value,)), _ADDRESSEE)),
            "Which of several persons a scene is about.",
        ),
    ),
)


def read_persons(
    reading: TypedReader, node: Node | None, interfaces: Interfaces | None
) -> tuple[PersonsSpec | None, SourceReader]:
    """Return the content of ``persons``, and a reader of sources that may be about one person."""
    plain = SourceReader(reading, interfaces)
    fields = reading.keys(node, PERSONS) if node is not None else None
    if fields is None:
        return None, plain
    tracked = _tracked(reading, fields.get(TRACKED), plain)
    persons = SourceReader(reading, interfaces, tracked, (PERSON,))
    parts: list[SourceSpec] = []
    names = [PERSON]
    for entry in fields.entries("parts"):
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
    fields = sources.topic_fields(node, _TRACKED.what, _TRACKED)
    if fields is None:
        return None
    topic = sources.topic(
        fields, SourceContext(name=TRACKED, what=f"'{TRACKED}'", may_be_per_person=False)
    )
    type_name = sources.type_name(fields)
    whole = sources.message(type_name)
    nodes = fields.nodes
    id_path = None
    field = sources.path(nodes["field"], "'field'", whole) if "field" in nodes else None
    if field is not None:
        item = sources.message(type_name, f"{field}.0")
        problem = whole.problem(f"{field}.0")
        if problem:
            reading.error(
                "unknown-ros-field",
                nodes["field"],
                f"'field' is not a list: {problem}",
                "name the list of ids, or of items with an id each",
            )
        elif "id" in nodes:
            id_path = sources.path(nodes["id"], "'id'", item)
            if id_path is not None:
                _check_ids(reading, nodes["id"], f"'id' ({id_path})", item, id_path)
        else:
            what = "an item of 'field'"
            hint = "add 'id: …', the field of an item that holds the id of a person"
            _check_ids(reading, nodes["field"], what, whole, f"{field}.0", hint)
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
    reading: TypedReader,
    node: Node,
    what: str,
    message: MessageFields,
    path: str,
    of_message: str = _NAME_THE_ID,
) -> None:
    """Report ids that are known to be neither texts nor integers."""
    nested = message.nested(path)
    found = _NO_IDS.get(message.type_of(path), "") if nested is None else nested.value
    if not found:
        return
    hint = of_message if nested is Nesting.MESSAGE else _NAME_THE_ID
    reading.error(
        "wrong-value", node, f"{what} is {found}, expected a text or a whole number", hint
    )


def _addressee(reading: TypedReader, node: Node | None, sources: SourceReader) -> AddresseeSpec:
    first = AddresseeSpec(rule=AddresseeRule.FIRST)
    if node is None:
        return first
    if isinstance(node, Scalar):
        word = reading.choice(node, "'addressee'", [rule.value for rule in AddresseeRule])
        if word not in (None, AddresseeRule.FIRST.value):
            reading.error(
                "missing-key",
                node,
                f"'addressee: {word}' needs a source that says how {_meaning(word)} a person is",
                f"write addressee: {{rule: {word}, source: {{…}}}}",
            )
        return first
    fields = reading.keys(node, _ADDRESSEE)
    if fields is None:
        return first
    word = fields.choice("rule")
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
    """Return by how much another person must be better; a distance may be written as a length."""
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
    what = "'better_by'"
    if rule != AddresseeRule.NEAREST.value:
        return reading.number(node, what, 0.0)
    metres = reading.amount(node, what, FieldType.LENGTH)
    if metres is None:
        return None
    sound = reading.in_range(node, what, metres, 0.0, None, FieldType.LENGTH)
    return metres if sound else None


def _meaning(rule: str | None) -> str:
    return "far away" if rule == AddresseeRule.NEAREST.value else "engaged"
