# SPDX-License-Identifier: Apache-2.0
"""Reader of agent files: profile, trees, tunables, learning and mood rules."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bt_agents_core.field_types import FieldType
from bt_agents_core.gc_pause import gc_paused
from bt_agents_language.expression.ranges import Range
from bt_agents_language.fields.inputs import read_new_name
from bt_agents_language.fields.scene_values import read_vector
from bt_agents_language.fields.scope import CLOCK_NAMES, person_names, scene_names, scene_scope
from bt_agents_language.fields.values import read_condition
from bt_agents_language.files.imports import IMPORTS, read_imports
from bt_agents_language.files.learning_reader import (
    LEARNING_FIELDS,
    numbers_by_parameter,
    read_learning,
)
from bt_agents_language.files.mood_rule_reader import MOOD_RULE, read_mood_rules
from bt_agents_language.files.tunable_reader import TUNABLE, read_tunable
from bt_agents_language.model.specs import (
    CLEAN_UP_S,
    MOST_CLEAN_UP_S,
    SHORTEST_CLEAN_UP_S,
    AgentSpec,
    NodeSpec,
    Tunable,
    iter_nodes,
)
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.tree.trees_reader import SUBTREES, TreesReader
from bt_agents_language.yaml.field_tables import (
    CONDITION,
    DURATION,
    NAME,
    NODE,
    TEXT,
    Entries,
    FieldDecl,
    FileKind,
    Items,
    SceneValues,
)
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import entries_of

AGENT = FileKind(
    name="agent",
    what="an agent file",
    title="Agent",
    description="An interaction character: its profile and its behaviour tree.",
    fields=(
        FieldDecl("agent", NAME, "Unique name of the agent.", required=True),
        FieldDecl("title", TEXT, "Name for people."),
        FieldDecl("description", TEXT, "What the agent does and whom it suits."),
        FieldDecl("tags", Items(TEXT), "Words to find it by."),
        IMPORTS,
        FieldDecl(
            "language",
            NAME,
            "Language of what this agent says, asks and shows, whatever other agents use: "
            "texts/<language>.yaml.",
        ),
        FieldDecl(
            "profile",
            SceneValues(every=True, of_profiles=True),
            "The scene that the agent suits best: its bid. Feedback moves the profile.",
            required=True,
        ),
        *LEARNING_FIELDS,
        FieldDecl(
            "requires",
            CONDITION,
            "The agent bids only if this is true of the scene, the person and the time of day: "
            "scene.person",
        ),
        FieldDecl(
            "tunables",
            Entries(TUNABLE, "names and tunables"),
            "Values that may change while the tree runs; each is a ROS parameter and a slider.",
        ),
        FieldDecl(
            "feedback", Items(MOOD_RULE), "What a change of mood during the run teaches the agent."
        ),
        FieldDecl("tree", NODE, "What the agent does.", required=True),
        FieldDecl(
            "on_cancel", NODE, "Tree that cleans up after a stopped run, within a time limit."
        ),
        FieldDecl(
            "on_cancel_within",
            DURATION,
            f"Time limit of 'on_cancel', {MOST_CLEAN_UP_S:g} s at most.",
            default=f"{CLEAN_UP_S:g} s",
        ),
        SUBTREES,
    ),
)


def read_agent(file: Path | Source, symbols: SymbolTable) -> AgentSpec:
    """Return the agent of a file, or raise a ``ReadError`` with all problems."""
    with gc_paused(), TypedReader.of(file) as reading:
        return _read(reading, symbols)


def _read(reading: TypedReader, symbols: SymbolTable) -> AgentSpec:
    fields = reading.file(AGENT)
    space = symbols.space
    language = fields.name("language")
    if language is not None:
        symbols = symbols.speaking(language)
    name = fields.name("agent")
    profile = requires = None
    if (node := fields.get("profile")) is not None:
        profile = read_vector(reading, node, "'profile'", space.profiles)
    rate, learning = read_learning(reading, fields, space.profiles)
    weights = numbers_by_parameter(reading, fields, "weights", space.profiles)
    tunables = _tunables(reading, fields)
    rules = read_mood_rules(reading, fields, space)
    if (node := fields.get("requires")) is not None:
        known = {**scene_names(space, ("scene",)), **CLOCK_NAMES, **person_names(space)}
        requires = read_condition(reading, node, scene_scope(space, known), "'requires'")
    tags = tuple(reading.text(tag, "a tag") or "" for tag in fields.items("tags"))
    title, description = fields.text("title"), fields.text("description")
    trees = _trees(reading, fields, symbols, tunables)
    tree, on_cancel = trees.trees(fields.get("tree"), fields.get("on_cancel"))
    clean_up_s = _clean_up_s(reading, fields)
    reading.problems.raise_if_any()
    assert name is not None
    assert profile is not None
    assert tree is not None
    return AgentSpec(
        name=name,
        title=title or name,
        description=" ".join(description.split()),
        tags=tags,
        profile=profile,
        learning_rate=rate,
        learning=learning,
        weights=weights,
        requires=requires,
        tunables=tuple(tunable for tunable in tunables.values() if tunable is not None),
        rules=rules,
        tree=tree,
        on_cancel=on_cancel,
        clean_up_s=clean_up_s,
        names_cancellation=trees.names_cancellation,
        file=reading.source.file,
        unoffered=_unoffered(tree, on_cancel),
        unused_inputs=tuple(trees.unused_inputs),
        warnings=reading.problems.warnings,
        language=language or "",
    )


def _clean_up_s(reading: TypedReader, fields: MappingReader) -> float:
    key, node = fields.keys.get("on_cancel_within"), fields.get("on_cancel_within")
    if key is None or node is None:
        return CLEAN_UP_S
    if "on_cancel" not in fields.nodes:
        reading.error(
            "missing-key",
            key,
            "'on_cancel_within' is the time of 'on_cancel', which is missing",
            "add 'on_cancel: …', or remove this",
        )
    seconds = fields.duration("on_cancel_within")
    if seconds is None or not reading.in_range(
        node,
        "'on_cancel_within'",
        seconds,
        SHORTEST_CLEAN_UP_S,
        MOST_CLEAN_UP_S,
        FieldType.DURATION,
    ):
        return CLEAN_UP_S
    return seconds


def _tunables(reading: TypedReader, fields: MappingReader) -> dict[str, Tunable | None]:
    """Return the tunables by name; for a wrong one, only the name is known."""
    tunables: dict[str, Tunable | None] = {}
    for entry in fields.entries("tunables"):
        name = read_new_name(reading, entry.key, "a tunable")
        if name == "learning_rate":
            reading.error(
                "name-taken",
                entry.key,
                "'learning_rate' is a key of the agent itself",
                "choose another name for the tunable",
            )
        tunable = read_tunable(reading, entry, name or entry.key.text[:40])
        if name is not None:
            tunables[name] = tunable
    return tunables


def _trees(
    reading: TypedReader,
    fields: MappingReader,
    symbols: SymbolTable,
    tunables: Mapping[str, Tunable | None],
) -> TreesReader:
    symbols, imported = read_imports(reading, fields, symbols)
    declared = fields.get("tunables")
    types = None
    ranges = {
        name: Range(one.minimum, one.maximum)
        for name, one in tunables.items()
        if one is not None and one.minimum is not None and one.maximum is not None
    }
    named = declared is None or isinstance(declared, MappingNode)
    if named and len(entries_of(declared)) == len(tunables):
        types = {
            name: tunable.type if tunable is not None else FieldType.ANY
            for name, tunable in tunables.items()
        }
    return TreesReader(reading, fields.entries("subtrees"), symbols, imported, types, ranges)


def _unoffered(*trees: NodeSpec | None) -> tuple[str, ...]:
    """Return the skills in trees that no robot offers, each with the reason."""
    found: dict[str, str] = {}
    for tree in filter(None, trees):
        for spec in iter_nodes(tree):
            if spec.skill is not None and spec.skill.binding is None:
                found[spec.skill.name] = f"skill '{spec.skill.name}': {spec.skill.unoffered}"
    return tuple(found[name] for name in sorted(found))
