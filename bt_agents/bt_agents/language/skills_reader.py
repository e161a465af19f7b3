# SPDX-License-Identifier: Apache-2.0
"""Reads ``skills/*.yaml``: the authors' vocabulary and how this robot carries it out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from bt_agents.errors import ReadError
from bt_agents.language.bindings import (
    RECEIVED,
    binding_keys,
    read_binding,
    read_output,
    result_check,
)
from bt_agents.language.diagnostics import did_you_mean
from bt_agents.language.inputs import read_inputs, read_new_name, read_type
from bt_agents.language.interfaces import Interfaces
from bt_agents.language.names import Names
from bt_agents.language.nodes import BESIDE, KINDS, MODIFIERS
from bt_agents.language.shape import Fields, FileReading
from bt_agents.language.source import Source
from bt_agents.language.specs import Binding, BindingKind, FieldSpec, FieldType, SkillSpec
from bt_agents.language.yaml_reader import Entry, Scalar

_KEYS = ("description", "main", "inputs", "outputs", *(kind.value for kind in BindingKind))


def read_skills(
    paths: Iterable[Path], interfaces: Interfaces | None = None
) -> Mapping[str, SkillSpec]:
    """Return the skills of all files by name.

    Raises:
        ReadError: There is a problem; it lists those of all files.
    """
    skills: dict[str, SkillSpec] = {}
    errors: list[ReadError] = []
    for path in paths:
        try:
            _read_file(FileReading.of(path), interfaces, skills)
        except ReadError as error:
            errors.append(error)
    if errors:
        raise joined(errors)
    return skills


def read_skills_text(
    text: str, file: str, interfaces: Interfaces | None = None
) -> Mapping[str, SkillSpec]:
    """Return the skills of one text; as :func:`read_skills`."""
    skills: dict[str, SkillSpec] = {}
    _read_file(FileReading(Source(file, text)), interfaces, skills)
    return skills


def joined(errors: Iterable[ReadError]) -> ReadError:
    """Return the problems of several files as one exception."""
    listed = list(errors)
    lines = tuple(line for error in listed for line in error.lines)
    return ReadError("\n".join(error.report for error in listed), lines)


def _read_file(
    reading: FileReading, interfaces: Interfaces | None, skills: dict[str, SkillSpec]
) -> None:
    fields = reading.document("a skills file", ("skills",), ("skills",))
    for entry in fields.entries("skills", "names and skills"):
        name = read_new_name(reading, entry.key, "a skill")
        if name is not None and not _is_free(reading, entry, skills):
            name = None
        skill = _read_skill(reading, entry, name or "skill", interfaces)
        if name is not None and skill is not None:
            skills[name] = skill
    reading.problems.raise_if_any()


def _is_free(reading: FileReading, entry: Entry, skills: Mapping[str, SkillSpec]) -> bool:
    name = entry.key.text
    if name in KINDS or name in MODIFIERS or name in (*BESIDE, "children"):
        reading.error(
            "name-taken", entry.key, f"'{name}' is a word of the tree language", "rename the skill"
        )
        return False
    if name in skills:
        reading.error(
            "duplicate-skill",
            entry.key,
            f"there is a skill '{name}' already: {skills[name].position}",
            "rename or remove one of them",
        )
        return False
    return True


def _read_skill(
    reading: FileReading, entry: Entry, name: str, interfaces: Interfaces | None
) -> SkillSpec | None:
    what = f"skill '{name}'"
    fields = reading.fields(entry.value, what, _KEYS)
    if fields is None:
        return None
    inputs_node = fields.get("inputs")
    inputs = read_inputs(reading, inputs_node, what) if inputs_node is not None else ()
    main = _read_main(reading, fields, inputs)
    kinds = [kind for kind in BindingKind if fields.get(kind.value) is not None]
    if len(kinds) != 1:
        second = fields.keys[kinds[1].value] if kinds else entry.key
        reading.error(
            "bad-binding",
            second,
            f"{what} is bound to {'more than one' if kinds else 'no'} ROS interface",
            "bind it to exactly one: 'action', 'service' or 'topic'",
        )
        return None
    bound = _read_bound(reading, fields, kinds[0], inputs, interfaces)
    if bound is None:
        return None
    binding, outputs = bound
    return SkillSpec(
        name=name,
        description=fields.text("description"),
        main=main,
        inputs=inputs,
        outputs=outputs,
        binding=binding,
        position=entry.key.position,
    )


def _read_main(reading: FileReading, fields: Fields, inputs: tuple[FieldSpec, ...]) -> str | None:
    node = fields.get("main")
    main = reading.text(node, "'main'") if node is not None else None
    known = [one.name for one in inputs]
    if node is None or main is None or main in known:
        return main
    reading.error(
        "unknown-name", node, f"there is no input '{main[:40]}'", did_you_mean(main, known)
    )
    return None


def _read_bound(
    reading: FileReading,
    fields: Fields,
    kind: BindingKind,
    inputs: tuple[FieldSpec, ...],
    interfaces: Interfaces | None,
) -> tuple[Binding, tuple[FieldSpec, ...]] | None:
    node = fields.get(kind.value)
    assert node is not None
    bound = reading.fields(node, f"'{kind.value}'", binding_keys(kind), ("name", "type"))
    if bound is None:
        return None
    type_node = bound.get("type")
    type_name = type_node.text if isinstance(type_node, Scalar) else None
    outputs, paths = _read_outputs(reading, fields, kind, type_name, interfaces)
    binding = read_binding(
        reading,
        kind,
        bound,
        Names({one.name: one.type for one in inputs}),
        Names({}),
        interfaces,
        paths,
    )
    return None if binding is None else (binding, outputs)


def _read_outputs(
    reading: FileReading,
    fields: Fields,
    kind: BindingKind,
    type_name: str | None,
    interfaces: Interfaces | None,
) -> tuple[tuple[FieldSpec, ...], dict[str, str]]:
    if fields.get("outputs") is not None and kind not in RECEIVED:
        reading.error(
            "unknown-key",
            fields.keys["outputs"],
            "a skill that is a topic has no outputs: nothing comes back from it",
            "remove 'outputs'",
        )
        return (), {}
    known_type = (
        type_name
        if interfaces is None or not type_name or not interfaces.type_problem(kind, type_name)
        else None
    )
    check = result_check(kind, known_type, interfaces)
    outputs: list[FieldSpec] = []
    paths: dict[str, str] = {}
    for entry in fields.entries("outputs", "names and fields"):
        name = read_new_name(reading, entry.key, "an output")
        one = reading.fields(
            entry.value, f"output '{entry.key.text[:40]}'", ("type", "from", "description")
        )
        if name is None or one is None:
            continue
        type_node, from_node = one.get("type"), one.get("from")
        field_type = read_type(reading, type_node) if type_node is not None else None
        path = read_output(reading, from_node or entry.key, "'from'", check)
        if path is not None:
            paths[name] = path
        outputs.append(
            FieldSpec(
                name=name,
                type=field_type or FieldType.ANY,
                required=False,
                description=one.text("description"),
            )
        )
    return tuple(outputs), paths
