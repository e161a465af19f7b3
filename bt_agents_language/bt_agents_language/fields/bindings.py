# SPDX-License-Identifier: Apache-2.0
"""Bindings to ROS actions, services and topics, of skills and of leaves that name one directly."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from bt_agents_core.field_types import BindingKind, Plain
from bt_agents_language.fields.interfaces import (
    Interfaces,
    MessageFields,
    read_ros_name,
    read_ros_type,
)
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.fields.server_timeouts import (
    HEARTBEAT,
    TIMEOUTS,
    read_heartbeat,
    read_timeouts,
    timeout_keys,
)
from bt_agents_language.fields.values import is_plain, plain, read_condition, read_map
from bt_agents_language.model.specs import Binding, MapValue
from bt_agents_language.yaml.field_tables import (
    CONDITION,
    FIELDS,
    ROS_NAME,
    ROS_TYPE,
    FieldDecl,
    KeyTable,
)
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar, Sequence, entries_of

SENT = {BindingKind.ACTION: "goal", BindingKind.SERVICE: "request", BindingKind.TOPIC: "message"}
"""Key of what is sent, and the section of the type that it fills."""

RECEIVED = {BindingKind.ACTION: "result", BindingKind.SERVICE: "response"}
"""Section of the type that comes back; a topic has none."""

FEEDBACK = "feedback"
"""Section of an action's type that comes while it goes on, and the word for it in paths."""

_FIELD_PATH = re.compile(r"[a-z][a-z0-9_]*(\.[a-z0-9_]+)*(#[A-Za-z_]\w*)?")


@dataclass(frozen=True, kw_only=True)
class ReceivedMessages:
    """What comes back from an interface.

    Attributes:
        result: The fields of the result or response.
        feedback: The fields of what comes before that; None where nothing does.
    """

    result: MessageFields
    feedback: MessageFields | None


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """Where the outputs of an interface come from: output name → field path.

    Attributes:
        result: Those that come at the end.
        feedback: Those that come while an action goes on.
    """

    result: dict[str, str] = field(default_factory=dict)
    feedback: dict[str, str] = field(default_factory=dict)

    def read(
        self, reading: TypedReader, name: str, node: Node, what: str, received: ReceivedMessages
    ) -> None:
        """Store where an output comes from, unless it is wrong, which is then reported.

        Args:
            reading: The file.
            name: The output.
            node: What is written: ``answer``, ``result.answer`` or ``feedback.progress``.
            what: The output, for messages.
            received: What it may come from.
        """
        is_feedback = isinstance(node, Scalar) and node.text.startswith(f"{FEEDBACK}.")
        if received.feedback is not None and is_feedback:
            path = read_output(reading, node, what, received.feedback, FEEDBACK)
            if path is not None:
                self.feedback[name] = path
            return
        path = read_output(reading, node, what, received.result)
        if path is not None:
            self.result[name] = path


def _interface(kind: BindingKind) -> KeyTable:
    sent = SENT[kind]
    table = KeyTable(
        what=f"'{kind.value}'",
        fields=(
            FieldDecl(
                "name",
                ROS_NAME,
                "Its ROS name, relative unless it starts with '/'.",
                required=True,
            ),
            FieldDecl("type", ROS_TYPE, "Its ROS type, package/kind/Name.", required=True),
            FieldDecl(sent, FIELDS, f"Fields of the {sent}; ${{input}} fills an input in."),
        ),
    )
    if kind not in RECEIVED:
        return table
    # What comes back can only be read where something does.
    return table.extended(
        FieldDecl(
            "succeed_when",
            CONDITION,
            "Condition over result.*; without it, an answer is a success.",
        ),
        FieldDecl(
            "timeouts",
            TIMEOUTS.only(timeout_keys(kind)),
            "How long the server may take; then the node fails.",
        ),
        FieldDecl(
            "heartbeat",
            HEARTBEAT,
            "What the server publishes while it is alive; its death is noticed by it.",
        ),
    )


INTERFACES: Mapping[BindingKind, KeyTable] = {kind: _interface(kind) for kind in BindingKind}
"""Kind of ROS interface → the keys of a binding to one."""


def binding_keys(kind: BindingKind, name_key: str) -> tuple[str, ...]:
    """Return the keys of a binding of which the ROS name stands behind another key."""
    return tuple(name_key if key == "name" else key for key in INTERFACES[kind].values)


def read_binding(
    reading: TypedReader,
    kind: BindingKind,
    fields: MappingReader,
    names: NameScope,
    result_names: NameScope,
    interfaces: Interfaces | None,
    outputs: Outputs,
    name_key: str = "name",
) -> Binding | None:
    """Return a binding; None when it is wrong, which is then reported.

    Args:
        reading: The file.
        kind: Action, service or topic.
        fields: Keys as in :func:`binding_keys`.
        names: What the values that are sent may name.
        result_names: What ``succeed_when`` may name besides ``result.*``.
        interfaces: Installed types, None to leave them unchecked.
        outputs: Where outputs come from, read before.
        name_key: Key of the ROS name.
    """
    name_node, type_node = fields.get(name_key), fields.get("type")
    name = read_ros_name(reading, name_node, f"'{name_key}'") if name_node is not None else None
    type_name = (
        read_ros_type(reading, type_node, kind, interfaces) if type_node is not None else None
    )
    sent_node = fields.get(SENT[kind])
    sent = MapValue(items={})
    if sent_node is not None:
        sent = read_map(reading, sent_node, names, f"'{SENT[kind]}'")
        if interfaces is not None and type_name is not None:
            _check_fields(reading, sent_node, kind, type_name, interfaces)
            _check_values(reading, sent_node, sent, kind, type_name, interfaces)
    succeed_node = fields.get("succeed_when")
    succeed_when = None
    if succeed_node is not None:
        result = result_fields(kind, type_name, interfaces)
        names = result_names.and_message("result", result)
        succeed_when = read_condition(reading, succeed_node, names, "'succeed_when'")
    timeouts = read_timeouts(reading, fields, kind)
    heartbeat = read_heartbeat(reading, fields, interfaces)
    if name is None or type_name is None:
        return None
    return Binding(
        kind=kind,
        name=name,
        type=type_name,
        fields=sent,
        outputs=outputs.result,
        feedback=outputs.feedback,
        succeed_when=succeed_when,
        timeouts=timeouts,
        heartbeat=heartbeat,
    )


def result_fields(
    kind: BindingKind, type_name: str | None, interfaces: Interfaces | None
) -> MessageFields:
    """Return the fields of what comes back."""
    known = interfaces if kind in RECEIVED else None
    return MessageFields(known, kind, type_name or "", RECEIVED.get(kind, ""))


def received_messages(
    kind: BindingKind, type_name: str | None, interfaces: Interfaces | None
) -> ReceivedMessages:
    """Return all that an output may come from."""
    feedback = MessageFields(interfaces, kind, type_name or "", FEEDBACK)
    return ReceivedMessages(
        result=result_fields(kind, type_name, interfaces),
        feedback=feedback if kind is BindingKind.ACTION else None,
    )


def read_output(
    reading: TypedReader, node: Node, what: str, fields: MessageFields, message: str = "result"
) -> str | None:
    """Return the path of a field of what comes back, the word for the message left out."""
    text = reading.text(node, what)
    if text is None:
        return None
    path = text.removeprefix(f"{message}.")
    if path == message:
        reading.error(
            "bad-name",
            node,
            f"{what}: '{message}' is the whole {'message' if message == 'msg' else message}",
            f"name a field: {message}.data",
        )
        return None
    if not _FIELD_PATH.fullmatch(path) or len(path) > 255:
        reading.error(
            "bad-name",
            node,
            f"{what} is '{text[:60]}', expected the path of a field such as {message}.data",
            "write field names joined by points",
        )
        return None
    problem = fields.problem(path.partition("#")[0])
    if problem:
        reading.error("unknown-ros-field", node, problem)
        return None
    return path


def _check_fields(
    reading: TypedReader, node: Node, kind: BindingKind, type_name: str, interfaces: Interfaces
) -> None:
    open_nodes: list[tuple[Node, str]] = [(node, "")]
    while open_nodes:
        current, prefix = open_nodes.pop()
        if isinstance(current, Sequence):
            open_nodes += [(item, f"{prefix}{i}.") for i, item in enumerate(current.items)]
        elif isinstance(current, MappingNode):
            open_nodes += _checked(reading, current.entries, prefix, kind, type_name, interfaces)


def _checked(
    reading: TypedReader,
    entries: tuple[MappingEntry, ...],
    prefix: str,
    kind: BindingKind,
    type_name: str,
    interfaces: Interfaces,
) -> list[tuple[Node, str]]:
    """Report entries that are no fields and return what is behind the others."""
    behind: list[tuple[Node, str]] = []
    for entry in entries:
        path = f"{prefix}{entry.key.text}"
        problem = interfaces.field_problem(kind, type_name, SENT[kind], path)
        if problem:
            reading.error("unknown-ros-field", entry.key, f"{type_name}: {problem}")
        else:
            behind.append((entry.value, f"{path}."))
    return behind


def _check_values(
    reading: TypedReader,
    node: Node,
    sent: MapValue,
    kind: BindingKind,
    type_name: str,
    interfaces: Interfaces,
) -> None:
    """Report values that their ROS fields cannot take, as far as they are plain."""
    open_fields: list[tuple[tuple[str, ...], Node, MapValue]] = [
        ((entry.key.text,), entry.value, sent) for entry in entries_of(node)
    ]
    while open_fields:
        path, written, around = open_fields.pop()
        value = around.items.get(path[-1])
        if isinstance(value, MapValue):
            below = [((*path, e.key.text), e.value, value) for e in entries_of(written)]
            open_fields += below
        elif value is not None and is_plain(value):
            nested: Plain = plain(value)
            for part in reversed(path):
                nested = {part: nested}
            assert isinstance(nested, Mapping)
            unknown = interfaces.field_problem(kind, type_name, SENT[kind], ".".join(path))
            problem = interfaces.value_problem(kind, type_name, SENT[kind], nested)
            if problem and not unknown:
                reading.error("wrong-value", written, f"{type_name}: {problem}")
