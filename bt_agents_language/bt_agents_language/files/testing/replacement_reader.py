# SPDX-License-Identifier: Apache-2.0
"""Reader of the nodes that replace others in a test: ``"**.drive*": {log: would drive}``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bt_agents_language.expression.expressions import parse_expression
from bt_agents_language.fields.scope import NameScope, scene_labels, tree_names
from bt_agents_language.files.testing.path_patterns import matches
from bt_agents_language.files.testing.scenarios import REPLACED
from bt_agents_language.model.specs import NodeSpec, Tunable, iter_nodes
from bt_agents_language.nodes.check import CHECK
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.tree.raw_nodes import RawNodeReader
from bt_agents_language.tree.subtrees import MAX_NODES
from bt_agents_language.tree.tree_reader import TreeReader
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping, Node

AT_ONCE = {"succeed": "true", "fail": "false"}
"""Word for an immediate end → condition of the check that replaces it."""


class ReplacementReader:
    """Reader of replacements for nodes of one agent."""

    def __init__(
        self,
        reading: TypedReader,
        symbols: SymbolTable,
        nodes: Sequence[NodeSpec],
        tunables: Iterable[Tunable],
    ) -> None:
        self._reading = reading
        self._nodes = nodes
        self._structure = RawNodeReader(reading, symbols)
        self._trees = TreeReader(reading, symbols, {})
        self._tunables = {one.name: one.type for one in tunables}
        self._types = {**tree_names(symbols.space), **self._tunables}
        self._labels = scene_labels(symbols.space)
        self._texts = symbols.texts

    def read(self, node: Node, pattern: str) -> NodeSpec | None:
        """Return the replacement for nodes that match a pattern; None if it is wrong.

        It may name tunables, the scene, and names that it assigns itself.
        """
        if not isinstance(node, Mapping):
            return self._at_once(node)
        before = len(self._reading.problems)
        raw = self._structure.read(node, "its replacement")
        if raw is None:
            return None
        taken = dict.fromkeys(self._tunables, "a tunable")
        written = self._trees.assigned.of_trees([raw], taken, self._types)
        names = NameScope(self._types, written, labels=self._labels, texts=self._texts)
        spec = self._trees.read(raw, REPLACED, names)
        if spec is None or len(self._reading.problems) > before:
            return None
        places = sum(matches(pattern, one.path) for one in self._nodes)
        if places * sum(1 for _ in iter_nodes(spec)) > MAX_NODES:
            self._reading.error(
                "tree-too-large",
                node,
                f"with this node in all places that it is to stand in, {places:,}, the trees "
                f"have more than {MAX_NODES:,} nodes",
                "replace fewer nodes, or by a smaller one",
            )
            return None
        return spec

    def _at_once(self, node: Node) -> NodeSpec | None:
        text = self._reading.text(node, "its replacement")
        if text is None:
            return None
        if text not in AT_ONCE:
            self._reading.error(
                "bad-choice",
                node,
                f"its replacement is '{text[:40]}', expected succeed, fail or a node",
                "write succeed, fail, or a node such as {log: would drive} or {wait: 3 s}",
            )
            return None
        return NodeSpec(
            path=REPLACED,
            position=node.position,
            kind=CHECK.key,
            name=text,
            fields={"condition": parse_expression(AT_ONCE[text])},
        )
