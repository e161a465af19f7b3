# SPDX-License-Identifier: Apache-2.0
"""Reader of ``scene.yaml``: the parameters of every scene and the sources that feed them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bt_agents_core.field_types import FieldType
from bt_agents_core.person_facts import FACT_TYPES, MOST_FACTS
from bt_agents_core.scene import MAX_VALUE, MAX_WEIGHT, MIN_WIDTH, SceneParameter, SceneSpace
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.fields.interfaces import Interfaces
from bt_agents_language.fields.scene_values import read_values
from bt_agents_language.files.persons_reader import PERSONS, read_persons
from bt_agents_language.files.source_reader import (
    SOURCE,
    TOPIC,
    VALUE_KEYS,
    SourceContext,
    SourceReader,
)
from bt_agents_language.model.scene_specs import (
    PERSON,
    MissingRule,
    SceneSpec,
    SourceSpec,
    TrackedSpec,
)
from bt_agents_language.yaml.field_tables import (
    BOOLEAN,
    NAME,
    NUMBER,
    TEXT,
    Either,
    Entries,
    FieldDecl,
    FileKind,
    Items,
    Key,
    KeyTable,
    Shared,
    WordChoice,
    number,
)
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping, MappingEntry

MAX_PLACE = 64
"""Longest name of a place in characters."""

_PARAMETER = KeyTable(
    fields=(
        FieldDecl("min", number(-MAX_VALUE, MAX_VALUE), "Smallest value.", required=True),
        FieldDecl("max", number(-MAX_VALUE, MAX_VALUE), "Largest value.", required=True),
        FieldDecl("default", NUMBER, "Value that means 'nothing special'.", required=True),
        FieldDecl("description", TEXT, "What it means."),
        FieldDecl(
            "labels",
            Entries(TEXT, "values and words", keys=Key.NUMBER),
            "Words for some values: {1: a child}",
        ),
        FieldDecl(
            "weight",
            number(0, MAX_WEIGHT),
            "Weight of the parameter in weighted distances.",
            default=1,
        ),
        FieldDecl(
            "profile",
            BOOLEAN,
            "true: every profile has a value for the parameter; false: no profile has one, and "
            "the parameter counts in no distance.",
            default=True,
        ),
        FieldDecl(
            "missing",
            WordChoice(tuple(rule.value for rule in MissingRule)),
            "Value while no source measures the parameter: none (leave_out); what is known of the "
            "person, or else of the place (estimate); or the same, with the default if nothing is "
            "known (default).",
            default=MissingRule.LEAVE_OUT.value,
        ),
        FieldDecl(
            "of",
            WordChoice((PERSON,)),
            "How long a given or told value holds: with 'person', as long as the person is there, "
            "also in later interactions; if left out, as long as its interaction.",
        ),
    )
)
SCENE = FileKind(
    name="scene",
    what="scene.yaml",
    title="Scene",
    description="The scene parameters and their sources.",
    fields=(
        FieldDecl(
            "place",
            Either((TEXT, Shared("text_source"))),
            "Place of the robot: a word, or the topic that reports it.",
        ),
        FieldDecl(
            "parameters",
            Entries(_PARAMETER, "names and parameters", empty="there is no parameter"),
            "Parameters that describe every scene and every profile.",
            required=True,
        ),
        FieldDecl(
            "language", NAME, "Language of what agents say, ask and show: texts/<language>.yaml."
        ),
        FieldDecl("mood", TEXT, "The parameter whose change becomes feedback."),
        FieldDecl("no_person", Entries(NUMBER), "Values of a scene without a person."),
        FieldDecl(
            "remembers",
            Entries(WordChoice(tuple(one.value for one in FACT_TYPES)), "names and types"),
            "Values that agents may remember of a person known by name: person.<name>, and its "
            "type.",
        ),
        FieldDecl(
            "persons", PERSONS, "Which persons are tracked, and which of them a scene is about."
        ),
        FieldDecl(
            "sources",
            Entries(
                Either((Shared("source"), Items(Shared("source"), filled=True))),
                "parameters and sources",
                keys=Key.ANY,
            ),
            "Parameter (or person) → its source, or several sources, which are fused.",
        ),
    ),
    shared={"source": SOURCE, "text_source": TOPIC},
)
_KNOWN_OF_A_PERSON = {
    "name": "the name of the person",
    "visits": "how often the person has been here",
}
_TAKEN = {
    PERSON: "whether a person is there",
    "stale": "whether the live scene is too old to count",
    "person_id": "who the person is",
    "persons": "how many persons are there",
    "place": "where the robot is",
}


def read_scene(file: Path | Source, interfaces: Interfaces | None = None) -> SceneSpec:
    """Return the content of a scene file, or raise a ``ReadError`` with all problems."""
    with TypedReader.of(file) as reading:
        fields = reading.file(SCENE)
        entries = fields.entries("parameters")
        missing: dict[str, MissingRule] = {}
        personal: set[str] = set()
        read = {entry.key.text: _parameter(reading, entry, missing, personal) for entry in entries}
        parameters = {name: parameter for name, parameter in read.items() if parameter is not None}
        names = [*read]
        if parameters and not any(one.profiled for one in parameters.values()):
            reading.error(
                "missing-value",
                fields.keys["parameters"],
                "no parameter is part of profiles, so that no agent could be nearer than another",
                "leave out 'profile: false' of one at least",
            )
        space = SceneSpace(
            parameters=tuple(parameters.values()),
            mood=fields.known("mood", names, "there is no scene parameter"),
            remembers=_remembers(reading, fields),
        )
        persons, source_reader = read_persons(reading, fields.get("persons"), interfaces)
        place = _place(reading, fields, source_reader)
        sources, person = _sources(reading, fields, names, parameters, source_reader)
        if (node := fields.get("no_person")) is not None and len(space) == len(names):
            no_person = read_values(reading, node, "'no_person'", space)
            space = replace(
                space,
                parameters=tuple(
                    replace(one, unattended=no_person.get(one.name)) for one in space.parameters
                ),
            )
        spec = SceneSpec(
            space=space,
            sources=tuple(sources),
            person=person,
            persons=persons,
            place=place,
            missing=missing,
            language=fields.name("language") or "",
            personal=frozenset(personal),
        )
        _check_types(reading, spec)
        _check_whose(reading, fields, spec)
        reading.problems.raise_if_any()
        return replace(spec, warnings=reading.problems.warnings)


def _check_whose(reading: TypedReader, fields: MappingReader, spec: SceneSpec) -> None:
    """Warn about values that belong to persons if no source ever detects a person."""
    if not spec.personal or spec.every_source or spec.persons is not None:
        return
    for entry in fields.entries("parameters"):
        whose = entry.value.get("of") if isinstance(entry.value, Mapping) else None
        if whose is not None and entry.key.text in spec.personal:
            reading.warning(
                "nobody-known",
                whose,
                f"no source sees a person, so 'of: person' of '{entry.key.text}' means nothing: "
                "a value belongs to its interaction",
                "add the source 'person', or 'persons'",
            )


def _check_types(reading: TypedReader, spec: SceneSpec) -> None:
    """Report topics with more than one type: a process can subscribe to only one."""
    tracked = (spec.persons.tracked,) if spec.persons is not None else ()
    named = sorted(
        (*spec.every_source, *tracked), key=lambda one: (one.position.line, one.position.column)
    )
    first: dict[str, SourceSpec | TrackedSpec] = {}
    for one in named:
        before = first.setdefault(one.topic, one)
        if one.type != before.type:
            reading.error(
                "wrong-value",
                one.position,
                f"the topic '{one.topic}' has the type {one.type} here, and {before.type} in line "
                f"{before.position.line}",
                "write the type that it has, or name another topic",
            )


def _sources(
    reading: TypedReader,
    fields: MappingReader,
    names: list[str],
    parameters: dict[str, SceneParameter],
    source_reader: SourceReader,
) -> tuple[list[SourceSpec], SourceSpec | None]:
    sources: list[SourceSpec] = []
    person = None
    for entry in fields.entries("sources"):
        name = entry.key.text
        if name == PERSON:
            if "persons" in fields.nodes:
                reading.error(
                    "name-taken",
                    entry.key,
                    "'persons' says already whether somebody is there: when somebody is tracked",
                    "remove this source",
                )
            wanted = SourceContext(name=name, what="source 'person'", may_be_per_person=False)
            person = source_reader.read(entry.value, entry.key, wanted)
        elif name not in names:
            reading.error(
                "unknown-name",
                entry.key,
                f"there is no scene parameter {quote(name)}",
                did_you_mean(name, [PERSON, *names]),
            )
        else:
            wanted = SourceContext(
                name=name, what=f"source '{name}'", keys=VALUE_KEYS, parameter=parameters.get(name)
            )
            sources += source_reader.read_all(entry.value, entry.key, wanted)
    return sources, person


def _remembers(reading: TypedReader, fields: MappingReader) -> dict[str, FieldType]:
    found: dict[str, FieldType] = {}
    for entry in fields.entries("remembers"):
        name = reading.name(entry.key, "the name of what is remembered")
        if name in _KNOWN_OF_A_PERSON:
            reading.error(
                "name-taken",
                entry.key,
                f"'person.{name}' is {_KNOWN_OF_A_PERSON[name]}",
                "choose another name",
            )
        word = reading.choice(
            entry.value, f"the type of '{entry.key.text[:40]}'", [one.value for one in FACT_TYPES]
        )
        if len(found) == MOST_FACTS:
            reading.error(
                "out-of-range",
                entry.key,
                f"at most {MOST_FACTS} values are remembered of a person",
                "remove some",
            )
            break
        if name is not None and word is not None:
            found[name] = FieldType(word)
    return found


def _place(
    reading: TypedReader, fields: MappingReader, source_reader: SourceReader
) -> str | SourceSpec:
    node = fields.get("place")
    if node is None:
        return ""
    if isinstance(node, Mapping):
        wanted = SourceContext(name="place", what="'place'", text=True, may_be_per_person=False)
        return source_reader.read(node, fields.keys["place"], wanted) or ""
    place = fields.text("place")
    if len(place) > MAX_PLACE:
        reading.error(
            "bad-name",
            node,
            f"'place' has {len(place)} characters, at most {MAX_PLACE} are possible",
            "write a shorter name",
        )
    return place


def _parameter(
    reading: TypedReader, entry: MappingEntry, missing: dict[str, MissingRule], personal: set[str]
) -> SceneParameter | None:
    """Return a parameter; note its rule for missing values, and whose it is."""
    name = reading.name(entry.key, "the name of a scene parameter")
    if name in _TAKEN:
        reading.error(
            "name-taken",
            entry.key,
            f"'{name}' has a meaning of its own: {_TAKEN[name]}",
            "choose another name",
        )
    what = f"parameter '{entry.key.text[:40]}'"
    fields = reading.keys(entry.value, _PARAMETER, what)
    if fields is None:
        return None
    minimum, maximum = fields.number("min"), fields.number("max")
    if not fields.check_range(what, minimum, maximum):
        minimum = maximum = None
    elif minimum is not None and maximum is not None and maximum - minimum < MIN_WIDTH:
        reading.error(
            "out-of-range",
            fields.nodes["max"],
            f"'max' of {what} is less than {MIN_WIDTH:g} above 'min', so that shares of the range "
            "cannot be computed",
            "give it in a smaller unit",
        )
    default = fields.number("default", minimum, maximum)
    labels = _labels(reading, fields, minimum, maximum)
    description = fields.text("description")
    weight = fields.number("weight")
    profiled = fields.boolean("profile") is not False
    if not profiled and fields.get("weight") is not None:
        reading.error(
            "contradiction",
            fields.keys["weight"],
            f"{what} has a 'weight', but 'profile: false' says that it counts in no distance",
            "keep one of both",
        )
    rule = fields.choice("missing")
    if fields.choice("of") is not None and name is not None:
        personal.add(name)
    if rule is not None and name is not None:
        missing[name] = MissingRule(rule)
    if name is None or minimum is None or maximum is None or default is None:
        return None
    return SceneParameter(
        name=name,
        minimum=minimum,
        maximum=maximum,
        default=default,
        description=description,
        labels=labels,
        weight=1.0 if weight is None else weight,
        assumed=default if rule == MissingRule.DEFAULT.value else None,
        profiled=profiled,
    )


def _labels(
    reading: TypedReader, fields: MappingReader, minimum: float | None, maximum: float | None
) -> dict[float, str]:
    labels: dict[float, str] = {}
    for entry in fields.entries("labels"):
        value = reading.number(entry.key, "the value of a label", minimum, maximum)
        text = reading.text(entry.value, "a label")
        if value in labels:
            reading.error("duplicate-key", entry.key, f"the value {value:g} has a label already")
        if value is not None and text is not None:
            labels[value] = text
    return labels
