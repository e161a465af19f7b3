# SPDX-License-Identifier: Apache-2.0
"""Import of a BehaviorTree.CPP v4 file as an agent file of our language."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from bt_agents_core.field_types import FieldType
from bt_agents_groot.catalogue import BUILTINS, CONDITIONS, PortKind
from bt_agents_groot.controls import CONTROLS
from bt_agents_groot.custom_nodes import CustomNodes, MissingSkill
from bt_agents_groot.document import Document, Load, Model, ModelPort, node_id, read_document
from bt_agents_groot.naming import Renaming, snake
from bt_agents_groot.nav2_nodes import NAV2_NODES
from bt_agents_groot.ports import PortError, from_port, pointed_at
from bt_agents_groot.scopes import TreeNames
from bt_agents_groot.simple_nodes import SIMPLE_NODES
from bt_agents_groot.subtree_calls import (
    Callee,
    declared_port,
    ports_of_call,
    remaps_all,
    stated_type,
    subtree_call,
    type_of_port,
)
from bt_agents_groot.translation import Remark, RemarkLevel, Remarks
from bt_agents_groot.tree_import import TreeImport
from bt_agents_groot.xml_files import Element
from bt_agents_groot.yaml_nodes import (
    Data,
    Raw,
    YamlNode,
    can_be_skipped,
    comment_lines,
    sequence,
    with_comments,
    yaml_lines,
)
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import FORMAT

_BUILDERS = {**CONTROLS, **SIMPLE_NODES, **NAV2_NODES}
_SCRIPT_NAME = re.compile(r"[A-Za-z_@]\w*")
_INITIAL_COMMENT = (
    "What a program gave in BehaviorTree.CPP; write what fits, or make tunables of it."
)

_NO_FORMAT = "there is no BTCPP_format: read as 4; files of Groot 1 need convert_v3_to_v4.py"


@dataclass(frozen=True, kw_only=True)
class ImportedAgent:
    """Imported agent file, with remarks in the order of the XML file."""

    text: str
    remarks: tuple[Remark, ...]
    missing: tuple[MissingSkill, ...]


def import_agent(
    source: Source,
    agent: str,
    symbols: SymbolTable,
    others: Sequence[Source] = (),
    load: Load | None = None,
    main: str = "",
) -> ImportedAgent:
    """Return the agent file for a BehaviorTree.CPP file or project.

    Args:
        source: The file, or the project file of Groot2.
        agent: Name of the agent.
        symbols: The scene parameters, for the profile, and the known skills and plug-ins.
        others: As for :func:`read_document`.
        load: As for :func:`read_document`.
        main: As for :func:`read_document`.

    Raises:
        ReadError: There is a problem in a file; it lists all of them.
    """
    document = read_document(source, others, load, main)
    return _Import(document, source.file, agent, symbols).run()


class _Import:
    def __init__(self, document: Document, file: str, agent: str, symbols: SymbolTable) -> None:
        self._document = document
        self._file_name = file.rpartition("/")[2]
        self._agent = agent
        self._space = symbols.space
        self._custom = CustomNodes(self._document, symbols)
        # Already imported trees by ID.
        self._callees: dict[str, Callee] = {}
        self._remarks = Remarks()
        self._subtree_name = Renaming()

    def run(self) -> ImportedAgent:
        document, main = self._document, self._document.main
        unused = (i for i in document.trees if i != main and not self._callers(i))
        on_cancel = next((i for i in unused if snake(i) == "on_cancel"), None)
        for element in document.unread:
            self._remark_unread(element)
        subtrees = {
            tree_id: self._subtree(tree_id)
            for tree_id in document.calls
            if tree_id not in (main, on_cancel)
        }
        names = TreeNames(self._mentions(main) + self._mentions(on_cancel), ())
        tree = self._tree(main, names)
        clean_up = self._tree(on_cancel, names) if on_cancel is not None else None
        initial = {name: self._initial_value(names, name) for name in names.needed}
        entries: dict[str, Data] = {
            "format": FORMAT,
            "agent": self._agent,
            "title": self._agent.replace("_", " ").capitalize(),
            "description": f"Made from {self._file_name}.",
            "profile": {one.name: one.default for one in self._space.profiles.parameters},
            "tree": _with_initial_values(tree, initial, _INITIAL_COMMENT),
        }
        if clean_up is not None:
            entries["on_cancel"] = clean_up
        if subtrees:
            entries["subtrees"] = {
                self._subtree_name(i): subtrees[i] for i in document.trees if i in subtrees
            }
        return self._file(entries)

    def _file(self, entries: dict[str, Data]) -> ImportedAgent:
        remarks = tuple(self._remarks)
        missing = tuple(self._custom.missing[name] for name in sorted(self._custom.missing))
        lines = list(self._head(remarks))
        for key, value in entries.items():
            if key in ("profile", "tree", "on_cancel", "subtrees"):
                lines.append("")
            lines += yaml_lines({key: value})
        skeleton = skills_file(missing)
        if skeleton:
            lines += [
                "",
                "# Skills that no file declares yet. Put this into a file of its own in the",
                "# folder 'skills', and bind it to a robot there:",
                "#",
                *comment_lines(skeleton.rstrip("\n")),
            ]
        return ImportedAgent(text="\n".join(lines) + "\n", remarks=remarks, missing=missing)

    def _head(self, remarks: tuple[Remark, ...]) -> Iterator[str]:
        yield from comment_lines(
            f"Made from {self._file_name} by 'bt-agents import groot'. Write the profile of the "
            "scenes that the\nagent suits; these values describe an ordinary scene."
        )
        lost = [remark for remark in remarks if remark.level is RemarkLevel.LOST]
        if lost:
            yield from comment_lines(
                f"Not everything could be translated; {len(lost)} "
                f"{'things are' if len(lost) > 1 else 'thing is'} missing:"
            )
        for remark in lost:
            name = remark.position.file.rpartition("/")[2]
            place = "" if name == self._file_name else f"{name}, "
            yield from comment_lines(f"  {place}line {remark.position.line}: {remark.message}")

    def _remark_unread(self, element: Element) -> None:
        if element.tag == "include":
            path = element.get("path")
            self._remarks.lost(
                element.position,
                f'<include path="{path[:120]}"> is not followed; name that file, too',
            )
        else:
            unread = f"<{element.tag[:40]}> is not read here"
            self._remarks.note(element.position, _NO_FORMAT if element.tag == "root" else unread)

    def _callers(self, tree_id: str) -> list[Element]:
        calls = (call for of_tree in self._document.calls.values() for call in of_tree)
        return [call for call in calls if call.get("ID") == tree_id]

    def _mentions(self, tree_id: str | None) -> Counter[str]:
        """Return how often a tree mentions each blackboard entry."""
        if tree_id is None:
            return Counter()
        return Counter(_mentioned_entries(self._document.trees[tree_id]))

    def _tree(self, tree_id: str, names: TreeNames) -> YamlNode:
        element = self._document.trees[tree_id]
        reading = TreeImport(names, self._remarks, self._node, self._custom.skill)
        tree = reading.node(element.children[0])
        for entry in sorted(names.shared):
            remark = self._remarks.lost(
                element.position,
                f"the entry '{entry}' of all trees together; here every tree has its own, so pass "
                "it under 'with' and 'outputs'",
            )
            tree = with_comments(tree, [remark.comment])
        names.shared.clear()
        description = element.get("_description")
        return with_comments(tree, [description]) if description else tree

    def _node(self, tree: TreeImport, element: Element) -> YamlNode:
        if element.tag == "SubTree":
            return subtree_call(tree, element, self._callees)
        return _BUILDERS.get(node_id(element), self._custom.node)(tree, element)

    def _initial_value(self, names: TreeNames, name: str) -> Data:
        model = self._document.subtree_models.get(self._document.main, Model(kind="SubTree"))
        declared = declared_port(model, names, name)
        return _plain_default(declared, names, name) if declared.value else names.default(name)

    def _subtree(self, tree_id: str) -> Data:
        callers = self._callers(tree_id)
        mentions = self._mentions(tree_id)
        shared = any(map(remaps_all, callers))
        model = self._document.subtree_models.get(tree_id, Model(kind="SubTree"))
        passed = [ports_of_call(call, model) for call in callers]
        given = set(mentions) if shared else set().union(*passed)
        names = TreeNames(mentions, given)
        tree = self._tree(tree_id, names)
        used = {
            names.rename(name)
            for ports in passed
            for name, text in ports.items()
            if pointed_at(text) is not None
        }
        outputs = tuple(
            name
            for name in sorted(names.written)
            if name in used or (shared and not names.original(name).startswith("_"))
        )
        inputs = {f"{name}_in" if name in names.written else name: name for name in names.needed}
        declared = {name: declared_port(model, names, name) for name in (*names.needed, *outputs)}
        copied_inputs: dict[str, Data] = {
            inside: Raw(f"${{{outer}}}") for outer, inside in inputs.items() if outer != inside
        }
        self._callees[tree_id] = Callee(
            name=self._subtree_name(tree_id),
            model=model,
            names=names,
            inputs=inputs,
            outputs=outputs,
            can_be_skipped=can_be_skipped(tree),
        )
        entries: dict[str, Data] = {
            "inputs": {
                outer: _declaration(declared[inside], names, inside)
                for outer, inside in inputs.items()
            },
            "outputs": {
                name: Raw(stated_type(declared[name], names, name).value) for name in outputs
            },
            "tree": _with_initial_values(tree, copied_inputs, ""),
        }
        return {key: value for key, value in entries.items() if value}


def _plain_default(declared: ModelPort, names: TreeNames, name: str) -> Data:
    """Return the default of a port; without a type it is a text if the tree uses it as one."""
    try:
        return from_port(declared.value, type_of_port(declared, names, name), names.rename)
    except PortError:
        return declared.value


def _declaration(declared: ModelPort, names: TreeNames, name: str) -> Data:
    default = _plain_default(declared, names, name) if declared.value else None
    return _input(stated_type(declared, names, name), default)


def _input(field_type: FieldType, default: Data | None = None) -> Data:
    """Return the declaration of an input."""
    if default is None:
        return Raw(field_type.value)
    return {"type": Raw(field_type.value), "default": default}


def _with_initial_values(tree: YamlNode, values: Mapping[str, Data], comment: str) -> YamlNode:
    """Return a tree that first sets names to values from outside."""
    if not values:
        return tree
    first = YamlNode(key="set", value=dict(values), comments=(comment,) if comment else ())
    plain = replace(tree, children=(), comments=())
    if plain == YamlNode(key="sequence"):
        return replace(tree, children=(first, *tree.children))
    return sequence(first, tree)


def _mentioned_entries(element: Element) -> Iterator[str]:
    """Return the blackboard entries that an element and its descendants mention."""
    builtin = BUILTINS.get(node_id(element))
    for name, attribute in element.attributes.items():
        entry = pointed_at(attribute.value)
        script = builtin is not None and builtin.ports.get(name) is PortKind.SCRIPT
        if name in CONDITIONS or script:
            yield from _SCRIPT_NAME.findall(attribute.value)
        elif entry is not None:
            yield name if entry == "=" else entry
    for child in element.children:
        yield from _mentioned_entries(child)


def skills_file(missing: tuple[MissingSkill, ...]) -> str:
    """Return a skills file that declares some skills; empty if there are none."""
    if not missing:
        return ""
    skills: dict[str, Data] = {}
    for skill in missing:
        entries: dict[str, Data] = {"description": "Say here what it does."}
        if len(skill.inputs) == 1:
            entries["main"] = Raw(next(iter(skill.inputs)))
        if skill.inputs:
            entries["inputs"] = {
                name: _input(one, skill.default(name)) for name, one in skill.inputs.items()
            }
        if skill.outputs:
            entries["outputs"] = {
                name: {"type": Raw(one.value)} for name, one in skill.outputs.items()
            }
        skills[skill.name] = entries
    return "\n".join(yaml_lines({"format": FORMAT, "skills": skills})) + "\n"
