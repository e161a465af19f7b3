# SPDX-License-Identifier: Apache-2.0
"""Checks of ROS names, types and fields against the interfaces of a machine."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from bt_agents_core.field_types import INTERFACE_FOLDERS, BindingKind, FieldType, Plain
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Node

MAX_ROS_NAME = 255

_ROS_NAME = re.compile(r"(?:~/|/)?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*")
_ROS_TYPE = re.compile(r"[a-z][a-z0-9_]*/(msg|srv|action)/[A-Z][A-Za-z0-9]*")
_IN_BRACKETS = re.compile(r"<([a-z][a-z0-9_]*)>")
_SHORT_TYPE = re.compile(
    r"([a-z][a-z0-9_]*)[/.:]+(?:(?:msgs?|srvs?|actions?)[/.:]+)?([A-Za-z][A-Za-z0-9]*)"
    r"(?:\.(?:msg|srv|action))?"
)


class Interfaces(Protocol):
    """Source of the ROS types of a machine."""

    def has_package(self, package: str) -> bool:
        """Return whether a ROS package is installed."""

    def type_problem(self, kind: BindingKind, type_name: str) -> str | None:
        """Return why a type does not fit this kind of interface; None if it fits."""

    def field_problem(
        self, kind: BindingKind, type_name: str, section: str, path: str
    ) -> str | None:
        """Return why a type has no such field; None if it has.

        A section is ``goal``, ``result``, ``feedback``, ``request``, ``response`` or ``message``;
        a path joins field names by dots, and a number in it picks an item of a list.
        """

    def field_type(self, kind: BindingKind, type_name: str, section: str, path: str) -> FieldType:
        """Return the type of a field's value; ANY for lists, messages and missing fields."""

    def value_problem(
        self, kind: BindingKind, type_name: str, section: str, values: Mapping[str, Plain]
    ) -> str | None:
        """Return why nested values do not fit the fields of a section; None if they fit."""


@dataclass(frozen=True)
class OfInstalledPackages:
    """Types of the installed packages; types of other packages are not checked."""

    _interfaces: Interfaces

    def has_package(self, package: str) -> bool:
        return self._interfaces.has_package(package)

    def type_problem(self, kind: BindingKind, type_name: str) -> str | None:
        known = self._knows(type_name)
        return self._interfaces.type_problem(kind, type_name) if known else None

    def field_problem(
        self, kind: BindingKind, type_name: str, section: str, path: str
    ) -> str | None:
        known = self._knows(type_name)
        return self._interfaces.field_problem(kind, type_name, section, path) if known else None

    def field_type(self, kind: BindingKind, type_name: str, section: str, path: str) -> FieldType:
        if not self._knows(type_name):
            return FieldType.ANY
        return self._interfaces.field_type(kind, type_name, section, path)

    def value_problem(
        self, kind: BindingKind, type_name: str, section: str, values: Mapping[str, Plain]
    ) -> str | None:
        known = self._knows(type_name)
        return self._interfaces.value_problem(kind, type_name, section, values) if known else None

    def _knows(self, type_name: str) -> bool:
        return self.has_package(package_of(type_name))


class Nesting(Enum):
    """Kind of a field that does not hold a single value; the value is its text for people."""

    LIST = "a list"
    MESSAGE = "a message"


@dataclass(frozen=True)
class MessageFields:
    """Fields of a message that a condition or an output may name.

    Attributes:
        interfaces: Source of the types; without it, or for an unknown type, every path is valid.
        kind: Action, service or topic.
        type_name: Full name of the type; empty if unknown.
        section: ``result``, ``response`` or ``message``.
        inside: Path of the part whose fields are named; empty for the whole message.
    """

    interfaces: Interfaces | None
    kind: BindingKind
    type_name: str
    section: str
    inside: str = ""

    def problem(self, path: str) -> str | None:
        """Return why a path leads to no field; None if it leads to one."""
        known = self._known()
        if known is None:
            return None
        return known.field_problem(self.kind, self.type_name, self.section, self._whole(path))

    def type_of(self, path: str) -> FieldType:
        """Return the type of a field, if known."""
        known = self._known()
        # Fields in a JSON text have no type.
        if known is None or "#" in path:
            return FieldType.ANY
        return known.field_type(self.kind, self.type_name, self.section, self._whole(path))

    def nested(self, path: str) -> Nesting | None:
        """Return the kind of a field without a single value; None for all others."""
        # No field has such a name: it is refused, even for an unknown type.
        if self.type_of(path) is not FieldType.ANY or self.problem(f"{path}.-") is None:
            return None
        return Nesting.MESSAGE if self.problem(f"{path}.0") else Nesting.LIST

    def _whole(self, path: str) -> str:
        return f"{self.inside}.{path}" if self.inside else path

    def _known(self) -> Interfaces | None:
        found = self.interfaces
        sound = found is not None and not found.type_problem(self.kind, self.type_name)
        return found if sound else None


def package_of(type_name: str) -> str:
    """Return the package of a ROS type, empty if it does not have the form package/kind/Name."""
    return type_name.partition("/")[0] if _ROS_TYPE.fullmatch(type_name) else ""


def read_ros_name(
    reading: TypedReader, node: Node, what: str, *, brackets: bool = False
) -> str | None:
    """Return the name of a topic, service or action, checked against the rules of ROS.

    With ``brackets``, its words may be names in angle brackets: ``persons/<person>/age``.
    """
    text = reading.text(node, what)
    if text is None:
        return None
    bare = _IN_BRACKETS.sub(r"\1", text) if brackets else text
    if _ROS_NAME.fullmatch(bare) and "__" not in bare and len(text) <= MAX_ROS_NAME:
        return text
    if len(text) > MAX_ROS_NAME:
        message = f"{what} has {len(text)} characters, at most {MAX_ROS_NAME} are possible"
        reading.error("bad-ros-name", node, message, "write a shorter name")
        return None
    meant = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9_/~]+", "_", text.strip()))
    meant = re.sub(r"/+", "/", meant).rstrip("/_")
    hint = f"write {meant}" if _ROS_NAME.fullmatch(meant) and len(meant) <= 80 else ""
    lowered = _IN_BRACKETS.search(text.lower()) if brackets else None
    if lowered is not None:
        hint = f"write {lowered[0][:40]}"
    elif "{" in text and brackets:
        hint = f"write <{re.sub(r'[^a-z_]', '', text.partition('{')[2].partition('}')[0])[:40]}>"
    elif "{" in text:
        hint = "ROS names are fixed here; remap them when the robot starts"
    elif not text.isascii():
        hint = "use the letters a-z and A-Z"
    elif text.startswith("~") and not text.startswith("~/"):
        hint = f"write ~/{text[1:60] or 'name'}"
    reading.error(
        "bad-ros-name",
        node,
        f"{what} is '{text[:60]}', expected words of letters, digits and single '_' "
        "joined by '/', none starting with a digit",
        hint,
    )
    return None


def read_ros_type(
    reading: TypedReader, node: Node, kind: BindingKind, interfaces: Interfaces | None
) -> str | None:
    """Return the name of a ROS type; with ``interfaces`` it must be installed."""
    what = f"the type of the {kind.value}"
    text = reading.text(node, what)
    if text is None:
        return None
    folder = INTERFACE_FOLDERS[kind]
    match = _ROS_TYPE.fullmatch(text)
    if match is None or match[1] != folder:
        short = _SHORT_TYPE.fullmatch(text)
        hint = f"write {short[1]}/{folder}/{short[2][0].upper()}{short[2][1:]}" if short else ""
        if match is not None:
            other = next(one for one, its in INTERFACE_FOLDERS.items() if its == match[1])
            hint = f"this is the type of a {other.value}, which is used in another way"
        reading.error(
            "bad-ros-type", node, f"{what} is '{text[:60]}', expected package/{folder}/Name", hint
        )
        return None
    problem = interfaces.type_problem(kind, text) if interfaces is not None else None
    if problem:
        reading.error("unknown-ros-type", node, problem)
        return None
    return text
