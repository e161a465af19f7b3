# SPDX-License-Identifier: Apache-2.0
"""Reads an agent file: who the agent is, what it bids, what it does, and what it learns from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bt_agents.language.drafts import Draft, read_draft
from bt_agents.language.expressions import Expression
from bt_agents.language.inputs import read_inputs, read_new_name
from bt_agents.language.names import Names, mood_names, scene_names
from bt_agents.language.scene_values import read_vector
from bt_agents.language.shape import Fields, FileReading
from bt_agents.language.source import Source
from bt_agents.language.specs import (
    AgentSpec,
    FeedbackRule,
    FieldSpec,
    FieldType,
    NodeSpec,
    Position,
    Tunable,
)
from bt_agents.language.subtrees import MAX_NODES, Expansion
from bt_agents.language.tree_reader import TreeReader
from bt_agents.language.tunables import read_tunable
from bt_agents.language.values import read_condition
from bt_agents.language.vocabulary import Vocabulary
from bt_agents.language.written_names import written_names
from bt_agents.language.yaml_reader import Mapping as MappingNode
from bt_agents.language.yaml_reader import Node

DEFAULT_LEARNING_RATE = 0.2
"""The paper's Experiment 3."""

_KEYS = (
    "agent", "title", "description", "tags", "profile", "learning_rate", "requires", "tunables",
    "feedback", "tree", "on_cancel", "subtrees",
)  # fmt: skip
_REQUIRED = ("agent", "profile", "tree")


def read_agent(path: Path, vocabulary: Vocabulary) -> AgentSpec:
    """Return the agent of a file.

    Raises:
        ReadError: There is a problem; it lists all of them.
    """
    return _AgentFile(FileReading.of(path), vocabulary).read()


def read_agent_text(text: str, file: str, vocabulary: Vocabulary) -> AgentSpec:
    """Return the agent of a text; ``file`` is what messages call it. As :func:`read_agent`."""
    return _AgentFile(FileReading(Source(file, text)), vocabulary).read()


class _AgentFile:
    """One agent file while it is read."""

    def __init__(self, reading: FileReading, vocabulary: Vocabulary) -> None:
        self._reading = reading
        self._vocabulary = vocabulary
        self._space = vocabulary.space
        self._fields = reading.document("an agent file", _KEYS, _REQUIRED)

    def read(self) -> AgentSpec:
        """Return the agent."""
        fields = self._fields
        name = fields.name("agent")
        profile_node = fields.get("profile")
        profile = (
            read_vector(self._reading, profile_node, "'profile'", self._space)
            if profile_node is not None
            else None
        )
        rate = fields.number("learning_rate", 0.0, 1.0)
        tunables = self._tunables()
        rules = self._rules()
        requires = self._requires()
        tags = tuple(self._reading.text(tag, "a tag") or "" for tag in fields.items("tags"))
        title, description = fields.text("title"), fields.text("description")
        tree, on_cancel = self._trees(tunables)
        self._reading.problems.raise_if_any()
        assert name is not None
        assert profile is not None
        assert tree is not None
        return AgentSpec(
            name=name,
            title=title or name,
            description=" ".join(description.split()),
            tags=tags,
            profile=profile,
            learning_rate=DEFAULT_LEARNING_RATE if rate is None else rate,
            requires=requires,
            tunables=tuple(tunable for tunable in tunables.values() if tunable is not None),
            rules=rules,
            tree=tree,
            on_cancel=on_cancel,
            file=self._reading.source.file,
        )

    def _tunables(self) -> dict[str, Tunable | None]:
        """Return the tunables by name; of one that is wrong only the name is known."""
        tunables: dict[str, Tunable | None] = {}
        for entry in self._fields.entries("tunables", "names and tunables"):
            name = read_new_name(self._reading, entry.key, "a tunable")
            if name == "learning_rate":
                self._reading.error(
                    "name-taken",
                    entry.key,
                    "'learning_rate' is a key of the agent itself",
                    "choose another name for the tunable",
                )
            tunable = read_tunable(self._reading, entry, name or "a tunable")
            if name is not None:
                tunables[name] = tunable
        return tunables

    def _requires(self) -> Expression | None:
        node = self._fields.get("requires")
        if node is None:
            return None
        names = Names(scene_names(self._space, ("scene",)))
        return read_condition(self._reading, node, names, "'requires'")

    def _rules(self) -> tuple[FeedbackRule, ...]:
        rules = (self._rule(node) for node in self._fields.items("feedback"))
        return tuple(rule for rule in rules if rule is not None)

    def _rule(self, node: Node) -> FeedbackRule | None:
        fields = self._reading.fields(
            node, "a feedback rule", ("when", "for", "give", "then"), ("when", "give")
        )
        if fields is None:
            return None
        names = Names({**scene_names(self._space), **mood_names(self._space)})
        when_node = fields.get("when")
        when = (
            read_condition(self._reading, when_node, names, "'when'")
            if when_node is not None
            else None
        )
        hold_s = fields.duration("for")
        give = fields.choice("give", ("positive", "negative"))
        then = fields.choice("then", ("cancel",))
        if when is None or give is None:
            return None
        return FeedbackRule(
            when=when,
            hold_s=hold_s or 0.0,
            positive=give == "positive",
            cancel=then == "cancel",
            position=node.position,
        )

    def _trees(
        self, tunables: Mapping[str, Tunable | None]
    ) -> tuple[NodeSpec | None, NodeSpec | None]:
        subtrees = self._subtree_entries()
        roots = {
            key: self._draft(self._fields.get(key), "the tree" if key == "tree" else f"'{key}'")
            for key in ("tree", "on_cancel")
        }
        inputs = {name: self._inputs(name, fields) for name, fields in subtrees.items()}
        bodies = {
            name: self._draft(fields.get("tree"), f"subtree '{name}'")
            for name, fields in subtrees.items()
        }
        names = self._names(tunables, [*roots.values(), *bodies.values()])
        self._refuse_shadows(subtrees, tunables, names)
        reader = TreeReader(self._reading, self._vocabulary, inputs)
        specs = {
            key: reader.read(draft, key, names) if draft is not None else None
            for key, draft in roots.items()
        }
        read_bodies = {
            name: self._body(reader, name, draft, subtrees[name], inputs[name], names)
            for name, draft in bodies.items()
        }
        return self._expanded(reader.calls, specs, read_bodies)

    def _expanded(
        self,
        calls: Mapping[Position, str],
        specs: Mapping[str, NodeSpec | None],
        bodies: Mapping[str, NodeSpec | None],
    ) -> tuple[NodeSpec | None, NodeSpec | None]:
        sound = {name: body for name, body in bodies.items() if body is not None}
        expansion = Expansion(self._reading, sound, calls)
        tree, on_cancel = specs["tree"], specs["on_cancel"]
        if expansion.refuse_recursion():
            return None, None
        left = MAX_NODES
        if tree is not None:
            expanded = expansion.expand(tree)
            tree, size = expanded if expanded is not None else (None, 0)
            left -= size
        if on_cancel is not None:
            expanded = expansion.expand(on_cancel, left)
            on_cancel = expanded[0] if expanded is not None else None
        return tree, on_cancel

    def _subtree_entries(self) -> dict[str, Fields]:
        subtrees: dict[str, Fields] = {}
        for entry in self._fields.entries("subtrees", "names and subtrees"):
            name = self._reading.name(entry.key, "the name of a subtree")
            fields = self._reading.fields(
                entry.value,
                f"subtree '{entry.key.text[:40]}'",
                ("description", "inputs", "tree"),
                ("tree",),
            )
            if name is not None and fields is not None:
                fields.text("description")
                subtrees[name] = fields
        return subtrees

    def _inputs(self, name: str, fields: Fields) -> tuple[FieldSpec, ...]:
        node = fields.get("inputs")
        return () if node is None else read_inputs(self._reading, node, f"subtree '{name}'")

    def _draft(self, node: Node | None, where: str) -> Draft | None:
        if node is None:
            return None
        return read_draft(self._reading, node, self._vocabulary.skills, where)

    def _body(
        self,
        reader: TreeReader,
        name: str,
        draft: Draft | None,
        fields: Fields,
        inputs: tuple[FieldSpec, ...],
        names: Names,
    ) -> NodeSpec | None:
        if draft is None:
            return None
        before = len(self._reading.problems)
        inner = names.and_these({one.name: one.type for one in inputs})
        body = reader.read(draft, name, inner)
        if len(self._reading.problems) == before:
            self._refuse_unused(name, fields, inputs, inner)
        return body

    def _refuse_unused(
        self, name: str, fields: Fields, inputs: tuple[FieldSpec, ...], inner: Names
    ) -> None:
        declared = fields.entries("inputs", "names and types")
        keys = {entry.key.text: entry.key for entry in declared}
        for one in inputs:
            if one.name not in inner.used:
                self._reading.error(
                    "unused-input",
                    keys[one.name],
                    f"subtree '{name}' never uses its input '{one.name}'",
                    f"write ${{{one.name}}} where it is needed, or remove the input",
                )

    def _names(self, tunables: Mapping[str, Tunable | None], drafts: list[Draft | None]) -> Names:
        """Return what every node may name."""
        types = {
            **scene_names(self._space, ("scene", "live", "profile")),
            **mood_names(self._space),
        }
        for name, tunable in tunables.items():
            types[name] = tunable.type if tunable is not None else FieldType.ANY
        written = written_names(self._reading, drafts, tunables)
        return Names({**written, **types})

    def _refuse_shadows(
        self,
        subtrees: Mapping[str, Fields],
        tunables: Mapping[str, Tunable | None],
        names: Names,
    ) -> None:
        for fields in subtrees.values():
            node = fields.get("inputs")
            for entry in node.entries if isinstance(node, MappingNode) else ():
                name = entry.key.text
                if name in tunables or ("." not in name and names.type_of(name) is not None):
                    kind = "tunable" if name in tunables else "value that a node writes"
                    self._reading.error(
                        "name-taken",
                        entry.key,
                        f"there is a {kind} '{name}' already",
                        "rename the input",
                    )
