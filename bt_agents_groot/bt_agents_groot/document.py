# SPDX-License-Identifier: Apache-2.0
"""Reader of trees and models in a BehaviorTree.CPP file, with the checks of that library."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bt_agents_core.errors import ReadError
from bt_agents_core.text import join_quoted, quote
from bt_agents_groot.catalogue import BUILTINS, CONDITIONS, EXPLICIT, Builtin, Limits, PortKind
from bt_agents_groot.naming import snake
from bt_agents_groot.ports import pointed_at
from bt_agents_groot.scripts import ScriptError, parse_script
from bt_agents_groot.xml_files import Attribute, Element, Xml, XmlReading
from bt_agents_language.diagnostics.collection import as_error, did_you_mean
from bt_agents_language.nodes.catalogue import NODE_TYPES
from bt_agents_language.yaml.source import Source

_WHOLE = re.compile(r"[-+]?[0-9]{1,9}")
_STATUSES = ("SUCCESS", "FAILURE", "RUNNING", "SKIPPED")
_BOOLEANS = ("true", "false", "1", "0", "True", "False", "TRUE", "FALSE")
_DIRECTIONS = {"input_port": "in", "output_port": "out", "inout_port": "both"}
_KINDS = (*EXPLICIT, "SubTree")
_ROOT = "root"

MAX_FILES = 64
"""Maximum number of files in one project."""

Load = Callable[[Path], Source]
"""Function that returns the text of an included file, or raises a ``ReadError``."""


@dataclass(frozen=True, kw_only=True)
class ModelPort:
    """Declared port: ``in``, ``out`` or ``both``, with its C++ type and default."""

    direction: str
    type: str = ""
    default: str = ""

    @property
    def value(self) -> str:
        """Default value; empty if the default points at an entry of the enclosing tree."""
        return self.default if pointed_at(self.default) is None else ""


@dataclass(frozen=True, kw_only=True)
class Model:
    """Model of a node that a program registers.

    Attributes:
        kind: Element that declares it: ``Action``, ``Condition``, ``Control``, ``Decorator``.
    """

    kind: str
    ports: Mapping[str, ModelPort] = field(default_factory=dict)


@dataclass(kw_only=True)
class Document:
    """Checked content of one file, or of the files of a project.

    Attributes:
        trees: ID → the ``BehaviorTree`` element, which has one child.
        main: ID of the main tree.
        models: ID → model of a custom node.
        subtree_models: ID → model of a subtree.
        unread: Elements of the file that are not imported.
        calls: ID of a tree → its ``SubTree`` elements; each tree comes after those that it calls.
    """

    trees: dict[str, Element] = field(default_factory=dict)
    main: str = ""
    models: dict[str, Model] = field(default_factory=dict)
    subtree_models: dict[str, Model] = field(default_factory=dict)
    unread: list[Element] = field(default_factory=list)
    calls: dict[str, list[Element]] = field(default_factory=dict)


def node_id(element: Element) -> str:
    """Return the type of a node: its ``ID`` in the explicit form, else its element name."""
    return element.get("ID") if element.tag in _KINDS else element.tag


def has_skill(node: Element | Xml) -> bool:
    """Return whether a node or a descendant is a skill or a tree."""
    if node.children:
        return any(map(has_skill, node.children))
    name = node_id(node) if isinstance(node, Element) else node.tag
    return node.tag == "SubTree" or not (name in BUILTINS or name in NODE_TYPES)


def given_ports(element: Element) -> list[Attribute]:
    """Return the attributes of an element that are ports."""
    return [
        attribute
        for name, attribute in element.attributes.items()
        if name not in ("ID", "name") and not name.startswith("_")
    ]


def read_document(
    source: Source, others: Sequence[Source] = (), load: Load | None = None, main: str = ""
) -> Document:
    """Return the trees and models of a file and of others that belong to it.

    Args:
        source: The file.
        others: Other files to read with it.
        load: Reads included files (``<include path="…"/>``); None leaves them unread.
        main: ID of the main tree; only this tree and the trees that it calls are read. If empty,
            the first file names the main tree.

    Raises:
        ReadError: There is a problem; it lists all of them.
    """
    return _DocumentReader([source, *others], load, main).read()


class _DocumentReader:
    def __init__(self, sources: Sequence[Source], load: Load | None, main: str) -> None:
        self._load = load
        self._wanted = main
        self._readings: dict[str, XmlReading] = {}
        self._found = Document()
        for source in sources:
            self._open(source)

    def _open(self, source: Source) -> None:
        # Files may include one file by several paths.
        if Path(source.file).resolve() not in {Path(one).resolve() for one in self._readings}:
            self._readings[source.file] = XmlReading(source)

    def read(self) -> Document:
        taken: set[str] = set()
        # Files read here may include more files.
        while waiting := [one for file, one in self._readings.items() if file not in taken]:
            taken.add(waiting[0].source.file)
            if waiting[0].root is not None:
                self._take(waiting[0].root)
        roots = [one.root for one in self._readings.values()]
        if any(root is None or root.tag != _ROOT for root in roots):
            raise self._problems()
        self._read_trees()
        self._order_trees()
        self._found.main = self._main()
        if any(one.problems for one in self._readings.values()):
            raise self._problems()
        return self._found

    def _read_trees(self) -> None:
        """Read all trees; with a named main tree, only that and those that it calls.

        It also reads ``on_cancel``, the clean-up of an agent, which no tree calls.
        """
        trees = self._found.trees
        starting = [one for one in trees if one == self._wanted or snake(one) == "on_cancel"]
        reached = dict.fromkeys(starting if self._wanted in trees else trees)
        waiting = list(reached)
        for tree_id in waiting:
            calls = self._found.calls[tree_id] = []
            for child in trees[tree_id].children:
                self._node(child, calls)
            called = {call.get("ID"): None for call in calls if call.get("ID") in trees}
            waiting += [one for one in called if one not in reached]
            reached |= called
        self._found.trees = {one: tree for one, tree in trees.items() if one in reached}

    def _take(self, root: Element) -> None:
        if not self._is_root(root):
            return
        for child in root.children:
            match child.tag:
                case "BehaviorTree":
                    self._tree(child, root)
                case "TreeNodesModel":
                    for model in child.children:
                        self._model(model)
                case "include" if self._load is not None and not child.get("ros_pkg"):
                    self._include(child, self._load)
                case _:
                    self._found.unread.append(child)

    def _include(self, element: Element, load: Load) -> None:
        named = element.attributes.get("path")
        if named is None:
            self._missing(element, "path", 'write <include path="…"/>')
            return
        path = Path(named.position.file).parent / named.value
        if len(self._readings) >= MAX_FILES:
            self._error(
                "too-many-values",
                named,
                f"the project has more than {MAX_FILES} files",
                "import a part of it",
            )
            return
        try:
            self._open(load(path))
        except ReadError as error:
            first = error.diagnostics[0]
            self._error("no-file", named, f"{quote(named.value)}: {first.message}", first.hint)

    def _error(self, code: str, where: Element | Attribute, message: str, hint: str = "") -> None:
        self._readings[where.position.file].error(code, where, message, hint)

    def _problems(self) -> ReadError:
        return as_error(
            one for reading in self._readings.values() for one in reading.problems.sorted()
        )

    def _is_root(self, root: Element) -> bool:
        if root.tag != _ROOT:
            self._error(
                "xml-root",
                root,
                f"the outermost element is <{root.tag[:40]}>, expected <root>",
                'trees of Groot2 stand in <root BTCPP_format="4"> … </root>',
            )
            return False
        version = root.attributes.get("BTCPP_format")
        if version is None and any(one.tag == "BehaviorTree" for one in root.children):
            self._found.unread.append(root)
        elif version is not None and version.value != "4":
            self._error(
                "wrong-format",
                version,
                f"the file has BTCPP_format {quote(version.value)}, this program reads format 4",
                "open the file in Groot2 and save it; files of Groot 1 need convert_v3_to_v4.py, "
                "which comes with BehaviorTree.CPP",
            )
        return True

    def _tree(self, element: Element, root: Element) -> None:
        tree_id = element.get("ID")
        if not tree_id:
            if sum(one.tag == "BehaviorTree" for one in root.children) > 1:
                self._missing(element, "ID", "give each tree a name of its own")
            tree_id = "main"
        if tree_id in self._found.trees:
            if "ID" in element.attributes:
                first = self._found.trees[tree_id].position
                self._error(
                    "name-taken",
                    element.attributes["ID"],
                    f"there is a tree {quote(tree_id)} already ({first})",
                    "rename one of them",
                )
            return
        self._check_count(element, (1, 1))
        self._found.trees[tree_id] = element

    def _model(self, element: Element) -> None:
        model_id = element.get("ID")
        if element.tag not in _KINDS:
            self._found.unread.append(element)
            return
        if not model_id:
            self._missing(element, "ID", f'write <{element.tag} ID="…">')
            return
        ports: dict[str, ModelPort] = {}
        for child in element.children:
            if child.tag not in _DIRECTIONS:
                continue
            name = child.get("name")
            if not name:
                self._missing(child, "name", f'write <{child.tag} name="…">')
                continue
            ports[name] = ModelPort(
                direction=_DIRECTIONS[child.tag],
                type=child.get("type"),
                default=child.get("default"),
            )
        models = self._found.subtree_models if element.tag == "SubTree" else self._found.models
        known = models.get(model_id, Model(kind=element.tag))
        models[model_id] = Model(kind=known.kind, ports={**ports, **known.ports})

    def _missing(self, element: Element, name: str, hint: str) -> None:
        self._error(
            "missing-attribute", element, f"<{element.tag}> has no attribute '{name}'", hint
        )

    def _node(self, element: Element, calls: list[Element]) -> None:
        if element.tag in _KINDS and not element.get("ID"):
            self._missing(element, "ID", f'write <{element.tag} ID="…">')
        elif element.tag == "SubTree":
            calls.append(element)
            self._check_count(element, (0, 0))
        elif node_id(element) in BUILTINS:
            self._builtin(element, BUILTINS[node_id(element)])
        else:
            self._custom(element)
        for name in CONDITIONS:
            if name in element.attributes:
                self._script(element.attributes[name])
        for child in element.children:
            self._node(child, calls)

    def _builtin(self, element: Element, builtin: Builtin) -> None:
        self._check_count(element, builtin.children)
        for attribute in given_ports(element):
            if attribute.name in builtin.ports:
                self._port(attribute, builtin.ports[attribute.name], builtin.id)
            else:
                self._error(
                    "unknown-attribute",
                    attribute,
                    f"<{builtin.id}> has no attribute {quote(attribute.name)}",
                    did_you_mean(attribute.name, [*builtin.ports, *CONDITIONS, "name"]),
                )
        for port in builtin.required:
            if port not in element.attributes:
                self._missing(element, port, f"it takes {builtin.ports[port].value}")

    def _custom(self, element: Element) -> None:
        model = self._found.models.get(node_id(element))
        if model is not None:
            limits: dict[str, Limits] = {"Decorator": (1, 1), "Control": (1, None)}
            self._check_count(element, limits.get(model.kind, (0, 0)))

    def _check_count(self, element: Element, limits: Limits) -> None:
        low, high = limits
        count = len(element.children)
        if count >= low and (high is None or count <= high):
            return
        if high is None:
            expected = f"{low} or more"
        else:
            expected = "no" if high == 0 else f"{low}" if low == high else f"{low} to {high}"
        children = "child" if high == 1 else "children"
        self._error(
            "wrong-children",
            element,
            f"<{node_id(element) or element.tag}> has {count or 'no'} "
            f"child{'ren' * (count != 1)}, expected {expected} {children}",
            "put several nodes into a <Sequence>" if high == 1 and count > 1 else "",
        )

    def _script(self, attribute: Attribute) -> None:
        try:
            parse_script(attribute.value, str)
        except ScriptError as error:
            self._readings[attribute.position.file].error_in(
                "bad-script", attribute, error.offset, f"'{attribute.name}': {error.message}"
            )

    def _port(self, attribute: Attribute, kind: PortKind, of: str) -> None:
        value = attribute.value.strip()
        if kind is PortKind.TEXT or pointed_at(value) is not None:
            return
        if kind is PortKind.SCRIPT:
            self._script(attribute)
            return
        number = int(value) if _WHOLE.fullmatch(value) else None
        fits = {
            PortKind.COUNT: number is not None and number >= -1,
            PortKind.THRESHOLD: number is not None and number != 0,
            PortKind.MILLISECONDS: number is not None and number >= 0,
            PortKind.BOOLEAN: value in _BOOLEANS,
            PortKind.STATUS: value in _STATUSES,
        }[kind]
        if not fits:
            self._error(
                "bad-attribute",
                attribute,
                f"'{attribute.name}' of <{of}> is {quote(value)}, expected {kind.value}",
                "or the name of a blackboard entry: {name}",
            )

    def _order_trees(self) -> None:
        """Put each tree after those that it calls; report every tree that contains itself."""
        finished: dict[str, list[Element]] = {}
        for start in self._found.calls:
            chain = {start: iter(self._found.calls[start])}
            while chain:
                current, calls = next(reversed(chain.items()))
                call = next(calls, None)
                called = call.get("ID") if call is not None else ""
                if call is None or current in finished:
                    del chain[current]
                    finished[current] = self._found.calls[current]
                elif called in chain:
                    names = list(chain)
                    loop = " → ".join([*names[names.index(called) :], called])
                    self._error(
                        "recursion",
                        call.attributes["ID"],
                        f"tree {quote(called)} contains itself: {loop[:200]}",
                        "use <Repeat> to do something again",
                    )
                elif called in self._found.calls and called not in finished:
                    chain[called] = iter(self._found.calls[called])
        self._found.calls = finished

    def _main(self) -> str:
        root = next(one.root for one in self._readings.values())
        assert root is not None
        named = None if self._wanted else root.attributes.get("main_tree_to_execute")
        wanted = self._wanted if named is None else named.value
        if wanted:
            if wanted not in self._found.trees:
                hint = did_you_mean(wanted, self._found.trees)
                self._error(
                    "unknown-subtree",
                    named or root,
                    f"there is no <BehaviorTree> {quote(wanted)} to start",
                    hint or "if it is in another file, name that, too",
                )
            return wanted
        called = {call.get("ID") for calls in self._found.calls.values() for call in calls}
        roots = [tree_id for tree_id in self._found.trees if tree_id not in called]
        if not self._found.trees:
            self._error(
                "xml-root",
                root,
                "there is no <BehaviorTree> in the file",
                'write <BehaviorTree ID="…"> around the tree',
            )
        elif len(roots) > 1:
            hint = f"name the tree that starts, here or after --tree: {join_quoted(roots)}"
            self._missing(root, "main_tree_to_execute", hint)
        return roots[0] if roots else ""
