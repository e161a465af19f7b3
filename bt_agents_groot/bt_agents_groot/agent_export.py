# SPDX-License-Identifier: Apache-2.0
"""Export of an agent file as a BehaviorTree.CPP v4 file, which Groot2 can show."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bt_agents_groot.models import Models
from bt_agents_groot.translation import Remark, Remarks
from bt_agents_groot.tree_export import TreeExport
from bt_agents_groot.xml_files import Xml, xml_text
from bt_agents_language.fields.inputs import read_inputs
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.imports import read_imports
from bt_agents_language.files.testing.path_patterns import nodes_of
from bt_agents_language.model.specs import AgentSpec, SubtreeSpec, Tunable, iter_nodes
from bt_agents_language.nodes.subtree import SUBTREE
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.tree.names_read import names_read
from bt_agents_language.tree.raw_nodes import RawNodeReader
from bt_agents_language.yaml.source import Source, read_source
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping, Node

_NOT_IN_TREES = (
    "profile", "learning_rate", "learning", "weights", "requires", "tunables", "feedback", "tags",
    "on_cancel_within",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ExportedAgent:
    """Exported BehaviorTree.CPP file, with remarks on its differences."""

    text: str
    remarks: tuple[Remark, ...]


def export_agent(source: Source, symbols: SymbolTable) -> ExportedAgent:
    """Return the BehaviorTree.CPP file for an agent file and the symbols that it may use.

    Raises:
        ReadError: There is a problem in the file; it lists all of them.
    """
    return _Export(symbols, read_agent(source, symbols)).run(source)


@dataclass
class _TreeFile:
    """Agent file or library whose trees are exported."""

    fields: MappingReader
    structure: RawNodeReader
    subtrees: dict[str, SubtreeSpec]


class _Export:
    def __init__(self, symbols: SymbolTable, agent: AgentSpec) -> None:
        self._symbols = symbols
        self._agent = agent
        self._tunables_of = _tunables_of_subtrees(agent)
        self._models = Models()
        self._remarks = Remarks()
        self._files: dict[str, _TreeFile] = {}
        # (file, name) of the used subtrees.
        self._used: list[tuple[str, str]] = []

    def run(self, source: Source) -> ExportedAgent:
        main = self._open(source)
        # Reserve this first, so that the agent's own tree gets the ID of its name.
        main_id = self._models.tree_id(self._agent.name)
        if self._agent.tunables:
            self._models.declare("SubTree", main_id, self._agent.tunables)
        trees = [self._tree(main, main.fields.get("tree"), main_id)]
        on_cancel = main.fields.get("on_cancel")
        if on_cancel is not None:
            trees.append(self._tree(main, on_cancel, self._models.tree_id("on_cancel")))
        for name, subtree in main.subtrees.items():
            if subtree.position.file == source.file:
                self._use(source.file, name)
        # The list grows during the loop.
        for file, name in self._used:
            trees.append(self._subtree(file, name))
        self._remark_keys(main)
        attributes = {"BTCPP_format": "4", "main_tree_to_execute": main_id}
        root = Xml("root", attributes, (*trees, self._models.xml()))
        return ExportedAgent(text=xml_text(root), remarks=tuple(self._remarks))

    def _use(self, file: str, name: str) -> None:
        if (file, name) not in self._used:
            self._used.append((file, name))

    def _open(self, source: Source) -> _TreeFile:
        reading = TypedReader(source)
        root = reading.root
        assert isinstance(root, Mapping)
        keys = {entry.key.text: entry.key for entry in root.entries}
        nodes = {entry.key.text: entry.value for entry in root.entries}
        fields = MappingReader(reading, root, nodes, keys)
        symbols, imported = read_imports(reading, fields, self._symbols)
        own = {
            entry.key.text: _interface(reading, entry.key.text, entry.value, source.file)
            for entry in fields.entries("subtrees", "names and subtrees")
        }
        structure = RawNodeReader(reading, symbols)
        opened = _TreeFile(fields, structure, {**imported, **own})
        self._files[source.file] = opened
        return opened

    def _tree(self, file: _TreeFile, node: Node | None, tree_id: str) -> Xml:
        assert node is not None
        raw = file.structure.read(node, "the tree")
        assert raw is not None

        def find(name: str) -> tuple[str, SubtreeSpec, list[Tunable]]:
            subtree = file.subtrees[name]
            defined_in = subtree.position.file
            self._use(defined_in, name)
            tunables = self._tunables_of.get((defined_in, name), [])
            return self._models.subtree(defined_in, subtree, tunables), subtree, tunables

        tree = TreeExport(self._models, find, self._remarks).node(raw)
        return Xml("BehaviorTree", {"ID": tree_id}, (tree,))

    def _subtree(self, file: str, name: str) -> Xml:
        opened = self._files.get(file) or self._open(read_source(Path(file)))
        subtrees = opened.fields.get("subtrees")
        assert isinstance(subtrees, Mapping)
        subtree = subtrees.get(name)
        assert isinstance(subtree, Mapping)
        tree_id = self._models.subtree(file, opened.subtrees[name])
        return self._tree(opened, subtree.get("tree"), tree_id)

    def _remark_keys(self, main: _TreeFile) -> None:
        present = [key for key in _NOT_IN_TREES if key in main.fields.keys]
        if present:
            self._remarks.note(
                main.fields.keys[present[0]].position,
                f"a tree of BehaviorTree.CPP has no place for {', '.join(present)}; tunables are "
                "ports of the main tree, and a program would give scene.age as scene__age",
            )


def _tunables_of_subtrees(agent: AgentSpec) -> dict[tuple[str, str], list[Tunable]]:
    """Return the tunables that each called subtree of an agent's own file needs."""
    needed: dict[tuple[str, str], list[Tunable]] = {}
    for call in nodes_of(agent):
        if call.kind != SUBTREE.key:
            continue
        [body] = call.children
        key = agent.file, body.path.removeprefix(f"{call.path}/").partition("@")[0]
        # A library has its own names, which may be the same.
        if body.position.file == agent.file and key not in needed:
            own = (one for one in iter_nodes(body) if one.position.file == agent.file)
            read = {name for one in own for name in names_read(one)}
            needed[key] = [one for one in agent.tunables if one.name in read]
    return needed


def _interface(reading: TypedReader, name: str, node: Node, file: str) -> SubtreeSpec:
    assert isinstance(node, Mapping)
    inputs, outputs = node.get("inputs"), node.get("outputs")
    what = f"subtree '{name}'"
    return SubtreeSpec(
        name=name,
        inputs=read_inputs(reading, inputs, what) if inputs is not None else (),
        outputs=read_inputs(reading, outputs, what) if outputs is not None else (),
        body=None,
        position=node.position,
    )
