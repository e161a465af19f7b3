# SPDX-License-Identifier: Apache-2.0
"""Candidates for the binding of a skill, one per robot."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bt_agents_core.field_types import BindingKind
from bt_agents_core.text import join_quoted, quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.fields.bindings import INTERFACES, RECEIVED, Outputs, read_binding
from bt_agents_language.fields.interfaces import Interfaces, package_of
from bt_agents_language.fields.scope import PLACE_NAMES, NameScope
from bt_agents_language.model.specs import Binding, SkillSpec
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import Node, Scalar, entries_of

_NAME_PLACE = "say which input names the place: 'place: destination' beside the interface"

NOTHING = "nothing"
"""Word in place of a field: the robot has no value for this output."""


@dataclass(frozen=True, kw_only=True)
class BindingCandidate:
    """Offer of a robot for a skill; without a binding, the problem in words."""

    robot: str
    binding: Binding | None
    problem: str = ""


def read_candidate(
    reading: TypedReader,
    fields: MappingReader,
    key: Scalar,
    what: str,
    skill: SkillSpec,
    robot: str,
    interfaces: Interfaces | None,
    inline: bool = False,
    lenient: bool = False,
) -> BindingCandidate | None:
    """Return the offer of one robot, or report that it is wrong and return None.

    ``inline`` means that it is in the declaration of the skill, whose outputs then name their
    sources with ``from``; ``lenient`` means that the inputs were unreadable, so that any name may
    be an input.
    """
    kinds = [kind for kind in BindingKind if fields.get(kind.value) is not None]
    if len(kinds) != 1:
        second = fields.keys[kinds[1].value] if kinds else key
        reading.error(
            "bad-binding",
            second,
            f"{what} names {'more than one' if kinds else 'no'} ROS interface",
            "bind it to exactly one: 'action', 'service' or 'topic'",
        )
        return None
    kind = kinds[0]
    bound = reading.keys(fields.nodes[kind.value], INTERFACES[kind])
    if bound is None:
        return None
    type_node = bound.get("type")
    type_name = type_node.text if isinstance(type_node, Scalar) else None
    package = package_of(type_name or "")
    absent = interfaces is not None and package != "" and not interfaces.has_package(package)
    known = None if absent else interfaces
    outputs = _outputs(reading, fields, kind, type_name, skill, known, what, inline)
    place = _place(fields, skill, lenient=lenient)
    inputs = {one.name: one.type for one in skill.inputs}
    names = NameScope(inputs, hidden=dict.fromkeys(PLACE_NAMES, _NAME_PLACE), lenient=lenient)
    binding = read_binding(
        reading,
        kind,
        bound,
        names if fields.get("place") is None else names.and_names(PLACE_NAMES),
        NameScope({}),
        known,
        outputs,
    )
    if binding is None:
        return None
    if absent:
        problem = f"the ROS package '{package}' is not installed"
        return BindingCandidate(robot=robot, binding=None, problem=problem)
    return BindingCandidate(robot=robot, binding=replace(binding, place=place))


def _place(fields: MappingReader, skill: SkillSpec, *, lenient: bool) -> str:
    """Return the input that names a place; empty if missing or wrong."""
    if lenient:
        return fields.text("place")
    problem, hint = f"skill '{skill.name}' has no input", "write the name of one of its inputs"
    return fields.known("place", skill.input_names, problem, hint) or ""


def _outputs(
    reading: TypedReader,
    fields: MappingReader,
    kind: BindingKind,
    type_name: str | None,
    skill: SkillSpec,
    interfaces: Interfaces | None,
    what: str,
    inline: bool,
) -> Outputs:
    outputs = Outputs(kind, type_name, interfaces, skill.outputs)
    sources = [entry.value for entry in entries_of(fields.get("outputs"))]
    if kind not in RECEIVED and sources and (inline or not all(map(_is_nothing, sources))):
        reading.error(
            "unknown-key",
            fields.keys["outputs"],
            "a skill that is a topic has no outputs: nothing comes back from it",
            "remove 'outputs'" if inline else "write 'nothing' for each output",
        )
    elif inline:
        _read_declared(reading, fields, outputs)
    else:
        _read_bound(reading, fields, outputs, skill, what)
    return outputs


def _read_declared(reading: TypedReader, fields: MappingReader, outputs: Outputs) -> None:
    for entry in fields.entries("outputs"):
        source: Node = entry.key
        if isinstance(entry.value, MappingNode):
            source = entry.value.get("from") or entry.key
        outputs.read(reading, entry.key.text, source, "'from'")


def _read_bound(
    reading: TypedReader, fields: MappingReader, outputs: Outputs, skill: SkillSpec, what: str
) -> None:
    declared = [one.name for one in skill.outputs]
    for entry in fields.entries("outputs"):
        name = entry.key.text
        if name in declared and _is_nothing(entry.value):
            continue
        if name in declared:
            outputs.read(reading, name, entry.value, f"output '{name}'")
            continue
        message = f"skill '{skill.name}' has no output {quote(name)}"
        hint = did_you_mean(name, declared) or "remove it"
        reading.error("unknown-name", entry.key, message, hint)
    written = {entry.key.text for entry in entries_of(fields.get("outputs"))}
    missing = [name for name in declared if name not in written]
    if missing and written <= {*declared}:
        proposed = "…" if outputs.kind in RECEIVED else NOTHING
        reading.error(
            "missing-key",
            fields.mapping.position,
            f"{what} says nothing about the output{'s' * (len(missing) > 1)} "
            f"{join_quoted(missing)}",
            "add 'outputs: {" + ", ".join(f"{name}: {proposed}" for name in missing) + "}'",
        )


def _is_nothing(source: Node) -> bool:
    return isinstance(source, Scalar) and source.text == NOTHING
