# SPDX-License-Identifier: Apache-2.0
"""Reader of skills: the authors' symbols, and each robot's bindings to ROS interfaces."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath

from bt_agents_core.errors import ReadError
from bt_agents_core.field_types import BindingKind, FieldType
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean, joined
from bt_agents_language.fields.bindings import INTERFACES
from bt_agents_language.fields.inputs import INPUT, TYPES, read_inputs, read_new_name, read_type
from bt_agents_language.fields.interfaces import Interfaces
from bt_agents_language.files.skill_bindings import BindingCandidate, read_candidate
from bt_agents_language.model.specs import FieldSpec, Place, SkillSpec
from bt_agents_language.nodes.catalogue import WORDS
from bt_agents_language.yaml.field_tables import (
    ANGLE,
    LENGTH,
    TEXT,
    Either,
    Entries,
    FieldDecl,
    Form,
    Key,
    KeyTable,
    Single,
    WordChoice,
)
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader, found
from bt_agents_language.yaml.yaml_reader import MappingEntry, Scalar

_TURN = 2.0 * math.pi
"""Largest heading of a place; a larger number without a unit probably means degrees [rad]."""

_OUTPUT = KeyTable(
    fields=(
        FieldDecl("type", WordChoice(TYPES), "Type."),
        FieldDecl(
            "from", TEXT, "Field of the result, or feedback.x; the name of the output if left out."
        ),
        FieldDecl("description", TEXT, "What it means."),
    )
)
_INTERFACES = tuple(
    FieldDecl(kind.value, INTERFACES[kind], f"The ROS {kind.value} that carries out the skill.")
    for kind in BindingKind
)
_PLACE_OF = FieldDecl(
    "place", TEXT, "The input that names a place; place.x and so on then give its position."
)
_SKILL = KeyTable(
    fields=(
        FieldDecl("description", TEXT, "What the skill does, for authors."),
        FieldDecl("main", TEXT, "The input that a single value after the skill sets."),
        FieldDecl("inputs", Entries(INPUT), "Inputs and their types."),
        FieldDecl(
            "outputs",
            Entries(
                Either((WordChoice(TYPES), _OUTPUT, Single(Form.NOTHING))), "names and fields"
            ),
            "Names that later nodes can use.",
        ),
        _PLACE_OF,
        *_INTERFACES,
    )
)
_BINDING = KeyTable(
    fields=(
        FieldDecl(
            "outputs",
            Entries(TEXT, "outputs and fields"),
            "Output → field of the result, or feedback.x; 'nothing' for no value.",
        ),
        _PLACE_OF,
        *_INTERFACES,
    )
)
_PLACE = KeyTable(
    fields=(
        FieldDecl("x", LENGTH, "Position along the first axis of the frame.", required=True),
        FieldDecl("y", LENGTH, "Position along the second axis.", required=True),
        FieldDecl(
            "heading", ANGLE, "Heading of the robot there, from the first axis; 0 deg if left out."
        ),
        FieldDecl("frame", TEXT, "The frame of the position.", default="map"),
    )
)
SKILLS = KeyTable(
    what="a skills file",
    fields=(
        FieldDecl("description", TEXT, "What the library is for."),
        FieldDecl("robot", TEXT, "The robot that the bindings are for."),
        FieldDecl(
            "skills",
            Entries(_SKILL, "names and skills"),
            "What the robot can do, in authors' words.",
        ),
        FieldDecl(
            "bindings",
            Entries(_BINDING, "skills and their bindings"),
            "How the robot carries out skills that other files declare: skill → ROS interface.",
        ),
        FieldDecl(
            "places",
            Entries(_PLACE, "names and places", keys=Key.ANY),
            "Positions of the places that skills name, for bindings with 'place'.",
        ),
    ),
)


def read_skills(
    files: Iterable[Path | Source], interfaces: Interfaces | None = None, robot: str = ""
) -> Mapping[str, SkillSpec]:
    """Return the skills of all files by name, each bound to the robot that takes precedence.

    That is the first robot in the comma-separated list ``robot``, or else the first in the order
    of the files. Only robots with installed ROS types count; without ``interfaces``, all do. A
    file may bind skills of another file.

    Raises:
        ReadError: There is a problem; it lists the problems of all files.
    """
    reader = SkillsReader(interfaces, robot)
    errors: list[ReadError] = []
    opened: list[tuple[TypedReader, MappingReader]] = []
    for file in files:
        try:
            with TypedReader.of(file) as reading:
                opened.append((reading, reading.file(SKILLS)))
        except ReadError as error:
            errors.append(error)
    for reading, fields in opened:
        with reading.guarded():
            reader.declare(reading, fields)
    for reading, fields in opened:
        with reading.guarded():
            reader.bind(reading, fields)
    errors += (reading.problems.error() for reading, _ in opened if reading.problems)
    if errors:
        raise joined(errors)
    return reader.skills()


class SkillsReader:
    """Collector of declarations and bindings of skills from several files."""

    def __init__(self, interfaces: Interfaces | None, robot: str = "") -> None:
        self._interfaces = interfaces
        self._preferred = [name.strip() for name in robot.split(",")]
        self._declared: dict[str, SkillSpec] = {}
        self._offers: dict[str, list[BindingCandidate]] = {}
        self._places: dict[str, Place] = {}

    def declare(self, reading: TypedReader, fields: MappingReader) -> None:
        """Read the sections ``skills`` and ``places``."""
        robot = _robot(reading, fields)
        if all(fields.get(key) is None for key in ("skills", "bindings", "places")):
            reading.error(
                "missing-key",
                fields.mapping.position,
                "a skills file needs the key 'skills', 'bindings' or 'places'",
                "add 'skills: …'",
            )
        for entry in fields.entries("places"):
            self._read_place(reading, entry)
        for entry in fields.entries("skills"):
            name = read_new_name(reading, entry.key, "a skill")
            free = name is not None and self._is_free(reading, entry)
            skill, offers = self._declaration(reading, entry, name or "skill", robot)
            if free and name is not None and skill is not None:
                self._declared[name], self._offers[name] = skill, offers

    def bind(self, reading: TypedReader, fields: MappingReader) -> None:
        """Read the section ``bindings``, for skills that are declared in any file."""
        robot = _robot(reading, fields)
        for entry in fields.entries("bindings"):
            name = entry.key.text
            skill = self._declared.get(name)
            if skill is None:
                reading.error(
                    "unknown-name",
                    entry.key,
                    f"there is no skill {quote(name)} that could be bound",
                    did_you_mean(name, self._declared) or "declare it under 'skills:'",
                )
                continue
            what = f"the binding of '{name}'"
            bound = reading.keys(entry.value, _BINDING, what)
            if bound is None:
                continue
            offer = read_candidate(reading, bound, entry.key, what, skill, robot, self._interfaces)
            if offer is not None:
                self._offers[name].append(offer)

    def skills(self) -> dict[str, SkillSpec]:
        """Return the declared skills by name, each with the binding that takes precedence."""
        return {name: self._bound(skill) for name, skill in self._declared.items()}

    def _bound(self, skill: SkillSpec) -> SkillSpec:
        offers = self._offers[skill.name]
        skill = replace(skill, robots={one.robot: one.problem for one in offers})
        installed = [offer for offer in offers if offer.binding is not None]
        for offer in sorted(installed, key=self._rank):
            assert offer.binding is not None
            places = self._places if offer.binding.place else {}
            return replace(skill, binding=replace(offer.binding, places=places))
        why = "; ".join(f"{one.robot}: {one.problem}" for one in offers)
        return replace(skill, unoffered=why or "no robot is bound to it")

    def _rank(self, offer: BindingCandidate) -> int:
        """Return the rank of a robot among the preferred ones; others come last."""
        known = offer.robot in self._preferred
        return self._preferred.index(offer.robot) if known else len(self._preferred)

    def _is_free(self, reading: TypedReader, entry: MappingEntry) -> bool:
        name = entry.key.text
        if name in WORDS:
            reading.error(
                "name-taken",
                entry.key,
                f"'{name}' is a word of the tree language",
                "rename the skill",
            )
            return False
        if name in self._declared:
            reading.error(
                "duplicate-skill",
                entry.key,
                f"there is a skill '{name}' already: {self._declared[name].position}",
                "rename or remove one of them; another robot's interface for the same skill "
                "goes under 'bindings:'",
            )
            return False
        return True

    def _read_place(self, reading: TypedReader, entry: MappingEntry) -> None:
        name = entry.key.text
        fields = reading.keys(entry.value, _PLACE, f"place {quote(name)}")
        if name in self._places:
            reading.error(
                "name-taken",
                entry.key,
                f"there is a place {quote(name)} already",
                "rename or remove one of them",
            )
        if fields is None:
            return
        x, y = (_amount(reading, fields, key, FieldType.LENGTH) for key in ("x", "y"))
        heading = _amount(reading, fields, "heading", FieldType.ANGLE)
        if heading:
            reading.in_range(
                fields.nodes["heading"], "'heading'", heading, -_TURN, _TURN, FieldType.ANGLE
            )
        frame = fields.text("frame", "map")
        if x is not None and y is not None:
            self._places[name] = Place(frame=frame, x=x, y=y, heading=heading or 0.0)

    def _declaration(
        self, reading: TypedReader, entry: MappingEntry, name: str, robot: str
    ) -> tuple[SkillSpec | None, list[BindingCandidate]]:
        what = f"skill '{name}'"
        fields = reading.keys(entry.value, _SKILL, what)
        if fields is None:
            return None, []
        before = len(reading.problems)
        inputs = fields.read("inputs", lambda node, _: read_inputs(reading, node, what)) or ()
        lenient = len(reading.problems) > before
        skill = SkillSpec(
            name=name,
            description=fields.text("description"),
            main=fields.known("main", [one.name for one in inputs], "there is no input"),
            inputs=inputs,
            outputs=_outputs(reading, fields),
            binding=None,
            position=entry.key.position,
        )
        offer = None
        if any(fields.get(kind.value) is not None for kind in BindingKind):
            offer = read_candidate(
                reading,
                fields,
                entry.key,
                what,
                skill,
                robot,
                self._interfaces,
                inline=True,
                lenient=lenient,
            )
        return skill, [offer] if offer is not None else []


def _amount(
    reading: TypedReader, fields: MappingReader, key: str, field_type: FieldType
) -> float | None:
    return fields.read(key, lambda node, what: reading.amount(node, what, field_type))


def _robot(reading: TypedReader, fields: MappingReader) -> str:
    return fields.name("robot") or PurePosixPath(reading.source.file).stem


def _outputs(reading: TypedReader, fields: MappingReader) -> tuple[FieldSpec, ...]:
    outputs: list[FieldSpec] = []
    for entry in fields.entries("outputs"):
        name = read_new_name(reading, entry.key, "an output")
        what = f"output '{entry.key.text[:40]}'"
        if isinstance(entry.value, Scalar) and not entry.value.empty:
            reading.error(
                "wrong-type",
                entry.value,
                f"{what} needs a type and where it comes from, found {found(entry.value)}",
                f"write {entry.key.text[:40]}: {{type: text, from: {entry.value.text[:40]}}}",
            )
            continue
        one = reading.keys(entry.value, _OUTPUT, what)
        if name is None or one is None:
            continue
        field_type = one.read("type", lambda node, _: read_type(reading, node))
        outputs.append(
            FieldSpec(
                name=name,
                type=field_type or FieldType.ANY,
                required=False,
                description=one.text("description"),
            )
        )
    return tuple(outputs)
