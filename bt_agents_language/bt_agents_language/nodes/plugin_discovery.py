# SPDX-License-Identifier: Apache-2.0
"""Node types of other packages, found by their entry points."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TypeGuard

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.field_types import FieldType
from bt_agents_core.text import printable_line
from bt_agents_language.model.specs import SkillSpec
from bt_agents_language.nodes.catalogue import WORDS
from bt_agents_language.nodes.node_type import Content, NodeField, NodeType

GROUP = "bt_agents.nodes"
"""Entry point group; the name of an entry point is the key of the node, its object the class."""

_KEY = re.compile(r"[a-z][a-z0-9_]{0,63}")
_CONTENTS = (Content.VALUE, Content.CONSTANT)


class PluginProblem(BtAgentsError):
    """Invalid node of a package."""


@dataclass(frozen=True, kw_only=True)
class Plugins:
    """Nodes of the installed packages.

    Attributes:
        kinds: Node types by key.
        origins: Key → words for the node and where it comes from.
        problems: Why the others are not valid nodes.
    """

    kinds: Mapping[str, NodeType]
    origins: Mapping[str, str]
    problems: tuple[str, ...]

    def without(self, skills: Mapping[str, SkillSpec]) -> Plugins:
        """Return the plug-ins without nodes named like a skill, which become problems.

        Authors see skills and can rename them; an installed package must not change the behaviour
        of their trees.
        """
        clashes = tuple(
            f"{self.origins[key]} has the name of the skill '{key}' "
            f"({skills[key].position}), which stays"
            for key in self.kinds
            if key in skills
        )
        return replace(
            self,
            kinds={key: kind for key, kind in self.kinds.items() if key not in skills},
            problems=self.problems + clashes,
        )


@cache
def installed_plugins() -> Plugins:
    """Return the node types of all installed packages."""
    return read_plugins(entry_points(group=GROUP))


def read_plugins(points: Iterable[EntryPoint]) -> Plugins:
    """Return the node types of entry points; a wrong one does not affect others.

    A node is a ``py_trees.behaviour.Behaviour`` with a class attribute ``fields``, a tuple of
    :class:`NodeField`, and if a scalar may set one of them, ``main`` with its name. Each run makes
    one object, ``cls(name=…, **values)``. ``reads`` maps blackboard keys to the fields whose
    values they hold, which are then not arguments, and ``writes`` maps the keys that give names
    their values to a :class:`NodeField` each. The first paragraph of the docstring describes the
    node.
    """
    kinds: dict[str, NodeType] = {}
    origins: dict[str, str] = {}
    problems: list[str] = []
    for point in sorted(points, key=lambda one: (one.name, one.value)):
        package = point.dist.name if point.dist is not None else "a package"
        whose = f"node '{point.name}' of {package} ({point.value})"
        try:
            kind = _kind(point, whose)
            if kind.key in kinds:
                raise PluginProblem(f"{whose}: there is a node '{kind.key}' already")
        except PluginProblem as problem:
            problems.append(str(problem))
        else:
            kinds[kind.key] = kind
            origins[kind.key] = whose
    return Plugins(kinds=kinds, origins=origins, problems=tuple(problems))


def _kind(point: EntryPoint, whose: str) -> NodeType:
    if not _KEY.fullmatch(point.name):
        raise PluginProblem(
            f"{whose}: '{point.name}' cannot be the key of a node; expected small letters, digits "
            "and '_'"
        )
    if point.name in WORDS:
        raise PluginProblem(
            f"{whose} has the name of '{point.name}', a word of the language, which stays"
        )
    try:
        # Some packages print when they are imported; standard output may be for programs.
        with redirect_stdout(sys.stderr):
            behaviour = point.load()
    except (Exception, SystemExit) as error:
        raise PluginProblem(
            f"{whose} cannot be loaded: {type(error).__name__}: {printable_line(str(error))}"
        ) from error
    if not _is_behaviour(behaviour):
        raise PluginProblem(f"{whose} is not a py_trees.behaviour.Behaviour class")
    fields = getattr(behaviour, "fields", ())
    if not isinstance(fields, tuple) or not all(_is_field(field) for field in fields):
        raise PluginProblem(
            f"{whose}: 'fields' must be a tuple of NodeField with names of their own, whose "
            "type is a FieldType and content VALUE or CONSTANT"
        )
    names = [field.name for field in fields]
    main = getattr(behaviour, "main", None)
    if main is not None and main not in names:
        raise PluginProblem(f"{whose}: 'main' is {main!r}, expected one of {', '.join(names)}")
    if len(set(names)) < len(names):
        raise PluginProblem(f"{whose}: two fields have the same name")
    reads, writes = _blackboard(behaviour, whose, names)
    arguments = [name for name in names if name not in reads.values()]
    try:
        inspect.signature(behaviour).bind(name="", **dict.fromkeys(arguments))
    except TypeError as error:
        raise PluginProblem(
            f"{whose} cannot be made with the arguments {', '.join(['name', *arguments])}: {error}"
        ) from None
    summary = (inspect.getdoc(behaviour) or "").partition("\n\n")[0]
    return NodeType(
        key=point.name,
        main=main,
        fields=fields,
        description=" ".join(summary.split()),
        plugin=behaviour,
        gives=writes,
    )


def _blackboard(
    behaviour: type, whose: str, fields: list[str]
) -> tuple[Mapping[str, str], Mapping[str, NodeField]]:
    """Return the keys that a behaviour reads, each with its field, and those that it writes."""
    reads, writes = getattr(behaviour, "reads", {}), getattr(behaviour, "writes", {})
    if not isinstance(reads, Mapping) or not all(
        isinstance(key, str) and name in fields for key, name in reads.items()
    ):
        raise PluginProblem(
            f"{whose}: 'reads' must be a mapping from keys of the blackboard to its fields "
            f"({', '.join(fields) or 'none'})"
        )
    if not isinstance(writes, Mapping) or not all(
        isinstance(key, str) and _is_field(one) for key, one in writes.items()
    ):
        raise PluginProblem(
            f"{whose}: 'writes' must be a mapping from keys of the blackboard to NodeField, whose "
            "name gets the value"
        )
    return reads, writes


def _is_behaviour(loaded: object) -> TypeGuard[type]:
    """Return whether an object is a behaviour class, without an import of py_trees."""
    return isinstance(loaded, type) and any(
        (base.__module__, base.__qualname__) == ("py_trees.behaviour", "Behaviour")
        for base in loaded.__mro__
    )


def _is_field(field: object) -> bool:
    return (
        isinstance(field, NodeField)
        and field.content in _CONTENTS
        and isinstance(field.type, FieldType)
        and _KEY.fullmatch(field.name) is not None
        and field.name != "name"
    )
