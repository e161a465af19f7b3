# SPDX-License-Identifier: Apache-2.0
"""Reader of the trees and subtrees of an agent or library; it expands subtrees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from bt_agents_core.field_types import FieldType
from bt_agents_language.expression.ranges import Range
from bt_agents_language.fields.inputs import INPUT, OUTPUT, read_inputs
from bt_agents_language.fields.scope import (
    CANCEL_NAMES,
    Assigned,
    NameScope,
    scene_labels,
    scene_ranges,
    tree_names,
)
from bt_agents_language.model.specs import NOTHING, FieldSpec, NodeSpec, SubtreeSpec, UnusedInput
from bt_agents_language.nodes.node_type import RawNode
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.tree.raw_nodes import RawNodeReader
from bt_agents_language.tree.subtrees import MAX_NODES, Expansion
from bt_agents_language.tree.tree_reader import TreeReader
from bt_agents_language.yaml.field_tables import NODE, TEXT, Entries, FieldDecl, Key, KeyTable
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, entries_of

_SUBTREE = KeyTable(
    fields=(
        FieldDecl("description", TEXT, "What it does."),
        FieldDecl("inputs", Entries(INPUT), "Inputs, which callers set with 'with'."),
        FieldDecl(
            "outputs",
            Entries(OUTPUT),
            "Names that the subtree sets for its callers, with their types.",
        ),
        FieldDecl("tree", NODE, "What it does.", required=True),
    )
)
# The name of a subtree may look like a node; the reader checks it.
SUBTREES = FieldDecl(
    "subtrees",
    Entries(_SUBTREE, "names and subtrees", keys=Key.ANY),
    "Trees that 'subtree' nodes run.",
)


class TreesReader:
    """Reader of all trees in one file.

    Args:
        tunables: Type of each tunable; None if their declaration is unreadable.
        ranges: Ranges of the tunables.

    Attributes:
        unused_inputs: Inputs of the file's subtrees, as far as these have been read.
        names_cancellation: Whether ``on_cancel`` names who stopped the run, or why.
    """

    def __init__(
        self,
        reading: TypedReader,
        entries: tuple[MappingEntry, ...],
        symbols: SymbolTable,
        imported: Mapping[str, SubtreeSpec],
        tunables: Mapping[str, FieldType] | None,
        ranges: Mapping[str, Range] = NOTHING,
    ) -> None:
        self.unused_inputs: list[UnusedInput] = []
        self.names_cancellation = False
        self._subtrees: dict[str, SubtreeSpec] = {}
        self._bodies: dict[str, NodeSpec] = {}
        self._of_trees: Mapping[str, Assigned] = {}
        self._reading = reading
        self._imported = imported
        self._tunables = tunables or {}
        self._lenient = tunables is None
        self._fields: dict[str, MappingReader] = {}
        for entry in entries:
            self._declare(entry)
        known = {**imported, **self._subtrees}
        self._structure = RawNodeReader(reading, symbols, known)
        self._reader = TreeReader(reading, symbols, known)
        self._types = {**tree_names(symbols.space), **self._tunables}
        self._ranges = {**scene_ranges(symbols.space), **ranges}
        self._labels = scene_labels(symbols.space)
        self._texts = symbols.texts

    def trees(
        self, tree: Node | None, on_cancel: Node | None
    ) -> tuple[NodeSpec | None, NodeSpec | None]:
        """Return an agent's trees with expanded subtrees; None for a wrong one."""
        first, last = self._raw(tree, "the tree"), self._raw(on_cancel, "'on_cancel'")
        taken = dict.fromkeys(self._tunables, "a tunable")
        bodies = self._raw_bodies()
        self._of_trees = self._reader.assigned.of_trees([first, last], taken, self._types)
        hidden = {
            name: f"subtree '{subtree}' writes it; add 'outputs: {{{name}: any}}' to that"
            for subtree, raw in bodies.items()
            for name in (self._reader.assigned.below(raw) if raw is not None else ())
        }
        only_there = dict.fromkeys(CANCEL_NAMES, "only 'on_cancel' knows why a run was stopped")
        names = self._scope(self._types, self._of_trees, {**hidden, **only_there})
        first_spec = self._reader.read(first, "tree", names) if first is not None else None
        names = self._scope({**self._types, **CANCEL_NAMES}, self._of_trees, hidden)
        names.give_all()
        last_spec = self._reader.read(last, "on_cancel", names) if last is not None else None
        self.names_cancellation = not names.used.isdisjoint(CANCEL_NAMES)
        expansion = self._expansion(bodies)
        if expansion is None:
            return None, None
        expanded, size = expansion.expand(first_spec)
        return expanded, expansion.expand(last_spec, MAX_NODES - size)[0]

    def library(self) -> dict[str, SubtreeSpec]:
        """Return the file's own subtrees in expanded form."""
        expansion = self._expansion(self._raw_bodies())
        if expansion is None:
            return {}
        bodies = {name: expansion.expand(body)[0] for name, body in self._bodies.items()}
        return {
            name: replace(self._subtrees[name], body=body)
            for name, body in bodies.items()
            if body is not None
        }

    def _scope(
        self,
        types: Mapping[str, FieldType],
        written: Mapping[str, Assigned],
        hidden: Mapping[str, str],
        *,
        lenient: bool = False,
    ) -> NameScope:
        return NameScope(
            types,
            written,
            hidden=hidden,
            lenient=self._lenient or lenient,
            ranges=self._ranges,
            labels=self._labels,
            texts=self._texts,
        )

    def _declare(self, entry: MappingEntry) -> None:
        name = self._reading.name(entry.key, "the name of a subtree")
        what = f"subtree '{entry.key.text[:40]}'"
        fields = self._reading.keys(entry.value, _SUBTREE, what)
        if name is None:
            return
        place = entry.key.position
        subtree = SubtreeSpec(
            name=name, inputs=(), outputs=(), body=None, position=place, complete=False
        )
        self._subtrees[name] = subtree
        if fields is None:
            return
        description = fields.text("description")
        before = len(self._reading.problems)
        if name in self._imported:
            self._reading.error(
                "name-taken",
                entry.key,
                f"there is a subtree '{name}' in {self._imported[name].position.file} already, "
                "which this file imports",
                "rename this one",
            )
        self._fields[name] = fields
        inputs = self._declared(fields, "inputs", what)
        outputs = self._declared(fields, "outputs", what)
        self._subtrees[name] = replace(
            subtree,
            inputs=inputs,
            outputs=outputs,
            complete=len(self._reading.problems) == before,
            description=" ".join(description.split()),
        )

    def _declared(self, fields: MappingReader, key: str, what: str) -> tuple[FieldSpec, ...]:
        kind = key.removesuffix("s")
        return fields.read(key, lambda node, _: read_inputs(self._reading, node, what, kind)) or ()

    def _raw(self, node: Node | None, where: str) -> RawNode | None:
        return None if node is None else self._structure.read(node, where)

    def _body(self, name: str, raw: RawNode | None) -> NodeSpec | None:
        subtree, fields = self._subtrees[name], self._fields[name]
        if raw is None:
            return None
        before = len(self._reading.problems)
        inputs = {one.name: one.type for one in subtree.inputs}
        self._refuse_shadows(fields)
        taken = {
            **dict.fromkeys(self._tunables, "a tunable"),
            **dict.fromkeys(inputs, "an input of this subtree"),
        }
        outputs = {one.name: one.type for one in subtree.outputs}
        types = {**self._types, **inputs}
        written = self._reader.assigned.of_trees([raw], taken, types, outputs)
        hidden = {
            **dict.fromkeys(
                self._of_trees,
                f"the tree has it; declare it under 'inputs:' of subtree '{name}', and give it "
                "with 'with:' where the subtree is used",
            ),
            **dict.fromkeys(
                CANCEL_NAMES,
                f"only 'on_cancel' knows it; give it to an input of subtree '{name}' with 'with:'",
            ),
        }
        names = self._scope(types, written, hidden, lenient=not subtree.complete)
        body = self._reader.read(raw, name, names)
        if len(self._reading.problems) == before:
            keys = {entry.key.text: entry.key for entry in entries_of(fields.get("inputs"))}
            self.unused_inputs += (
                UnusedInput(name=one, subtree=name, position=keys[one].position)
                for one in inputs
                if one not in names.used
            )
            self._refuse_unwritten(subtree, fields, written)
        return body

    def _refuse_shadows(self, fields: MappingReader) -> None:
        for entry in entries_of(fields.get("inputs")):
            if entry.key.text in self._tunables:
                self._reading.error(
                    "name-taken",
                    entry.key,
                    f"there is a tunable '{entry.key.text}' already",
                    "rename the input",
                )

    def _refuse_unwritten(
        self, subtree: SubtreeSpec, fields: MappingReader, written: Mapping[str, object]
    ) -> None:
        keys = {entry.key.text: entry.key for entry in entries_of(fields.get("outputs"))}
        for one in subtree.outputs:
            if one.name not in written:
                self._reading.error(
                    "unwritten-output",
                    keys[one.name],
                    f"no node of subtree '{subtree.name}' gives its output '{one.name}' a value",
                    f"give it one, for example with set: {{{one.name}: …}}",
                )

    def _raw_bodies(self) -> dict[str, RawNode | None]:
        return {
            name: self._raw(fields.get("tree"), f"subtree '{name}'")
            for name, fields in self._fields.items()
        }

    def _expansion(self, bodies: Mapping[str, RawNode | None]) -> Expansion | None:
        """Read the bodies; return their expander, or None if one contains itself."""
        read = {name: self._body(name, raw) for name, raw in bodies.items()}
        self._bodies = {name: body for name, body in read.items() if body is not None}
        imported = {n: one.body for n, one in self._imported.items() if one.body is not None}
        expansion = Expansion(self._reading, {**imported, **self._bodies}, self._reader.calls)
        return None if expansion.refuse_recursion() else expansion
