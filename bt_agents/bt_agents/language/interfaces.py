# SPDX-License-Identifier: Apache-2.0
"""What the readers ask about ROS: whether a type and a field exist, and how names are written."""

from __future__ import annotations

import re
from typing import Protocol

from bt_agents.language.shape import FileReading
from bt_agents.language.specs import BindingKind
from bt_agents.language.yaml_reader import Node

MAX_ROS_NAME = 255

_ROS_NAME = re.compile(r"(?:~/|/)?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*")
_ROS_TYPE = re.compile(r"[a-z][a-z0-9_]*/(msg|srv|action)/[A-Z][A-Za-z0-9]*")
_SHORT_TYPE = re.compile(
    r"([a-z][a-z0-9_]*)[/.:]+(?:(?:msg|srv|action)[/.:]+)?([A-Z][A-Za-z0-9]*)"
)
FOLDERS = {
    BindingKind.ACTION: "action",
    BindingKind.SERVICE: "srv",
    BindingKind.TOPIC: "msg",
}
"""The middle part of a type's name for each kind of interface."""


class Interfaces(Protocol):
    """Knows the ROS types of a machine."""

    def type_problem(self, kind: BindingKind, type_name: str) -> str | None:
        """Return why a type cannot be used for an interface of this kind; None when it can."""

    def field_problem(
        self, kind: BindingKind, type_name: str, section: str, path: str
    ) -> str | None:
        """Return why a type has no such field; None when it has.

        Args:
            kind: Action, service or topic.
            type_name: Full name of the type.
            section: ``goal``, ``result``, ``request``, ``response`` or ``message``.
            path: Field names joined by dots; a number picks an item of a list.
        """


def read_ros_name(reading: FileReading, node: Node, what: str) -> str | None:
    """Return the name of a topic, service or action, checked by the rules of ROS."""
    text = reading.text(node, what)
    if text is None:
        return None
    if _ROS_NAME.fullmatch(text) and "__" not in text and len(text) <= MAX_ROS_NAME:
        return text
    meant = re.sub(r"_+", "_", re.sub(r"[^A-Za-z0-9_/~]+", "_", text.strip()))
    meant = re.sub(r"/+", "/", meant).rstrip("/_")
    hint = f"write {meant}" if _ROS_NAME.fullmatch(meant) and len(meant) <= MAX_ROS_NAME else ""
    reading.error(
        "bad-ros-name",
        node,
        f"{what} is '{text[:60]}', expected words of letters, digits and single '_' "
        "joined by '/', none starting with a digit",
        hint,
    )
    return None


def read_ros_type(
    reading: FileReading, node: Node, kind: BindingKind, interfaces: Interfaces | None
) -> str | None:
    """Return the name of a ROS type; with ``interfaces`` it must be installed."""
    what = f"the type of the {kind.value}"
    text = reading.text(node, what)
    if text is None:
        return None
    folder = FOLDERS[kind]
    match = _ROS_TYPE.fullmatch(text)
    if match is None or match[1] != folder:
        short = _SHORT_TYPE.fullmatch(text)
        hint = f"write {short[1]}/{folder}/{short[2]}" if short else ""
        reading.error(
            "bad-ros-type", node, f"{what} is '{text[:60]}', expected package/{folder}/Name", hint
        )
        return None
    problem = interfaces.type_problem(kind, text) if interfaces is not None else None
    if problem:
        reading.error("unknown-ros-type", node, problem)
        return None
    return text
