# SPDX-License-Identifier: Apache-2.0
"""Bindings of skills and some leaves to ROS actions, services and topics."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import partial

from bt_agents_core.field_types import BindingKind, FieldType, Plain
from bt_agents_language.fields.interfaces import (
    Interfaces,
    MessageFields,
    read_ros_name,
    read_ros_type,
)
from bt_agents_language.fields.scope import RUN_NAMES, NameScope
from bt_agents_language.fields.values import (
    EXPECTED,
    is_plain,
    may_be_sent,
    plain,
    read_condition,
    read_map,
    type_of,
)
from bt_agents_language.model.specs import (
    Binding,
    ErrorCodeSpec,
    FieldSpec,
    HeartbeatSpec,
    MapValue,
    Timeouts,
)
from bt_agents_language.yaml.field_tables import (
    CONDITION,
    DURATION,
    FIELDS,
    NUMBER,
    ROS_NAME,
    ROS_TYPE,
    TEXT,
    FieldDecl,
    KeyTable,
    Several,
)
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Node, Scalar, Sequence, entries_of, several

SENT = {BindingKind.ACTION: "goal", BindingKind.SERVICE: "request", BindingKind.TOPIC: "message"}
"""Key of the sent values, and the section of the type that they fill."""

RECEIVED = {BindingKind.ACTION: "result", BindingKind.SERVICE: "response"}
"""Section of the type that is received; a topic has none."""

FEEDBACK = "feedback"
"""Section of an action's type that arrives during the action, and its word in paths."""

_FIELD_PATH = re.compile(r"[a-z][a-z0-9_]*(\.[a-z0-9_]+)*(#[A-Za-z_]\w*)?")


TIMEOUTS = KeyTable(
    what="'timeouts'",
    fields=(
        FieldDecl("server", DURATION, "longest time to find the server"),
        FieldDecl("accept", DURATION, "longest time for the server to accept or reject the goal"),
        FieldDecl("result", DURATION, "longest time until the result or answer"),
    ),
)

HEARTBEAT = KeyTable(
    what="'heartbeat'",
    fields=(
        FieldDecl("topic", ROS_NAME, "what the server publishes while it is alive", required=True),
        FieldDecl("type", ROS_TYPE, "ROS type of the topic", required=True),
        FieldDecl("within", DURATION, "how long the server may be silent"),
    ),
)


def timeout_keys(kind: BindingKind) -> tuple[str, ...]:
    """Return the keys of ``timeouts``; a service has no key for acceptance."""
    return tuple(one for one in TIMEOUTS.values if one != "accept" or kind is BindingKind.ACTION)


ERROR_CODE = KeyTable(
    what="'error_code'",
    fields=(
        FieldDecl("field", TEXT, "result field with the error code", required=True),
        FieldDecl("success", Several(NUMBER), "code, or codes, that mean success; 0 if left out"),
        FieldDecl("message", TEXT, "result field with the reason in words"),
    ),
)


class Outputs:
    """Sources of an interface's outputs: output name → field path.

    Args:
        kind: Kind of the interface.
        type_name: Its ROS type, if known.
        interfaces: Source of the types.
        declared: Outputs whose declared types their fields must have.

    Attributes:
        kind: Kind of the interface.
        result: Outputs that arrive at the end.
        feedback: Outputs that arrive during an action.
        result_fields: Fields of the received message.
    """

    def __init__(
        self,
        kind: BindingKind,
        type_name: str | None,
        interfaces: Interfaces | None,
        declared: Iterable[FieldSpec] = (),
    ) -> None:
        self._types = {one.name: one.type for one in declared}
        self.result: dict[str, str] = {}
        self.feedback: dict[str, str] = {}
        self.kind = kind
        received = interfaces if kind in RECEIVED else None
        self.result_fields = MessageFields(received, kind, type_name or "", RECEIVED.get(kind, ""))
        self._feedback_fields = MessageFields(interfaces, kind, type_name or "", FEEDBACK)

    def read(self, reading: TypedReader, name: str, node: Node, what: str) -> None:
        """Store the source of an output, or report that it is wrong.

        A source is a path such as ``answer``, ``result.answer`` or ``feedback.progress``.
        """
        fields, message, found = self.result_fields, "result", self.result
        is_action = self.kind is BindingKind.ACTION
        if is_action and isinstance(node, Scalar) and node.text.startswith(f"{FEEDBACK}."):
            fields, message, found = self._feedback_fields, FEEDBACK, self.feedback
        path = read_output(reading, node, what, fields, message)
        if path is None:
            return
        found[name] = path
        wanted = self._types.get(name, FieldType.ANY)
        if not may_be_sent(given := fields.type_of(path), wanted):
            problem = f"output '{name}': expected {EXPECTED[wanted]}, but '{path}' is "
            hint = f"declare it with 'type: {given.value}'"
            reading.error("wrong-value", node, problem + EXPECTED[given], hint)


def _interface(kind: BindingKind) -> KeyTable:
    sent = SENT[kind]
    table = KeyTable(
        what=f"'{kind.value}'",
        fields=(
            FieldDecl(
                "name", ROS_NAME, "ROS name, relative unless it starts with '/'.", required=True
            ),
            FieldDecl("type", ROS_TYPE, "ROS type, package/kind/Name.", required=True),
            FieldDecl(sent, FIELDS, f"Fields of the {sent}; ${{input}} fills an input in."),
        ),
    )
    if kind not in RECEIVED:
        return table
    # Received values exist only if the interface sends something back.
    return table.extended(
        FieldDecl(
            "succeed_when",
            CONDITION,
            "Condition over the result, result.*; without it, any result is a success.",
        ),
        FieldDecl(
            "timeouts",
            TIMEOUTS.only(timeout_keys(kind)),
            "How long the server may take before the node fails.",
        ),
        FieldDecl(
            "heartbeat",
            HEARTBEAT,
            "What the server publishes while it is alive; if the server falls silent, the node "
            "fails.",
        ),
        FieldDecl(
            "error_code",
            ERROR_CODE,
            "Result field in which the server reports a failure; the node then fails with the "
            "code and the reason.",
        ),
    )


INTERFACES: Mapping[BindingKind, KeyTable] = {kind: _interface(kind) for kind in BindingKind}
"""Kind of ROS interface → the keys of a binding to one."""


def binding_keys(kind: BindingKind, name_key: str) -> tuple[str, ...]:
    """Return the keys of a binding whose ROS name is the value of another key."""
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
    """Return a binding, or report that it is wrong and return None.

    ``names`` are for the sent values, in addition to ``run.*``, and ``result_names`` for
    ``succeed_when``, in addition to ``result.*``; without ``interfaces`` types are not checked.
    """
    name = fields.read(name_key, partial(read_ros_name, reading))
    type_name = fields.read("type", lambda node, _: read_ros_type(reading, node, kind, interfaces))
    sent_node = fields.get(SENT[kind])
    sent = MapValue(items={})
    if sent_node is not None:
        sent = read_map(reading, sent_node, names.and_names(RUN_NAMES), f"'{SENT[kind]}'")
        if interfaces is not None and type_name is not None:
            _check_sent(reading, sent_node, sent, kind, type_name, interfaces)
    succeed_node = fields.get("succeed_when")
    succeed_when = None
    if succeed_node is not None:
        names = result_names.and_message("result", outputs.result_fields)
        succeed_when = read_condition(reading, succeed_node, names, "'succeed_when'")
    timeouts = _timeouts(reading, fields, kind)
    heartbeat = _heartbeat(reading, fields, interfaces)
    error_code = _error_code(reading, fields, outputs.result_fields)
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
        error_code=error_code,
    )


def read_output(
    reading: TypedReader, node: Node, what: str, fields: MessageFields, message: str = "result"
) -> str | None:
    """Return the path of a field in the received message, without the word for the message."""
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


def _check_sent(
    reading: TypedReader,
    node: Node,
    sent: MapValue,
    kind: BindingKind,
    type_name: str,
    interfaces: Interfaces,
) -> None:
    """Report fields that the type lacks, and values that do not fit its fields."""
    open_nodes: list[tuple[Node, tuple[str, ...], MapValue]] = [(node, (), sent)]
    while open_nodes:
        current, around, values = open_nodes.pop()
        if isinstance(current, Sequence):
            for i, item in enumerate(current.items):
                open_nodes.append((item, (*around, str(i)), MapValue(items={})))
        for entry in entries_of(current):
            path = (*around, entry.key.text)
            problem = interfaces.field_problem(kind, type_name, SENT[kind], ".".join(path))
            if problem:
                reading.error("unknown-ros-field", entry.key, f"{type_name}: {problem}")
                continue
            value = values.items.get(entry.key.text)
            if isinstance(value, MapValue):
                open_nodes.append((entry.value, path, value))
                continue
            open_nodes.append((entry.value, path, MapValue(items={})))
            if value is None:
                continue
            if not is_plain(value):
                given = type_of(value)
                wanted = interfaces.field_type(kind, type_name, SENT[kind], ".".join(path))
                if not may_be_sent(given, wanted):
                    problem = f"expected {EXPECTED[wanted]}, but this is {EXPECTED[given]}"
                    problem = f"{type_name}: '{'.'.join(path)}': {problem}"
                    reading.error("wrong-value", entry.value, problem, "use a name that fits")
                continue
            nested: Plain = plain(value)
            for part in reversed(path):
                nested = {part: nested}
            assert isinstance(nested, Mapping)
            problem = interfaces.value_problem(kind, type_name, SENT[kind], nested)
            if problem:
                reading.error("wrong-value", entry.value, f"{type_name}: {problem}")


def _timeouts(reading: TypedReader, fields: MappingReader, kind: BindingKind) -> Timeouts:
    """Return the timeouts of the server; missing or wrong ones have their defaults."""
    usual = Timeouts()
    node = fields.get("timeouts")
    table = TIMEOUTS.only(timeout_keys(kind))
    written = reading.keys(node, table) if node is not None else None
    if written is None:
        return usual
    server, accept, result = (_limit(reading, written, key) for key in TIMEOUTS.values)
    return Timeouts(
        server_s=server or usual.server_s, accept_s=accept or usual.accept_s, result_s=result
    )


def _heartbeat(
    reading: TypedReader, fields: MappingReader, interfaces: Interfaces | None
) -> HeartbeatSpec | None:
    """Return the heartbeat of the server; None if missing or wrong."""
    node = fields.get("heartbeat")
    if node is None:
        return None
    written = reading.keys(node, HEARTBEAT)
    if written is None:
        return None
    topic = written.read("topic", partial(read_ros_name, reading))
    type_name = written.read(
        "type", lambda one, _: read_ros_type(reading, one, BindingKind.TOPIC, interfaces)
    )
    within_s = _limit(reading, written, "within") or HeartbeatSpec.within_s
    if topic is None or type_name is None:
        return None
    return HeartbeatSpec(topic=topic, type=type_name, within_s=within_s)


def _error_code(
    reading: TypedReader, fields: MappingReader, result_fields: MessageFields
) -> ErrorCodeSpec | None:
    """Return the error code of a result; None if missing or wrong."""
    node = fields.get("error_code")
    written = reading.keys(node, ERROR_CODE) if node is not None else None
    if written is None:
        return None

    def path(node: Node, what: str) -> str | None:
        return read_output(reading, node, what, result_fields)

    code, message = written.read("field", path), written.read("message", path)
    success = written.get("success")
    codes = several(success) if success is not None else ()
    known = readable(reading.number(one, "'success'") for one in codes)
    if code is None or len(known) < len(codes):
        return None
    return ErrorCodeSpec(field=code, success=known or (0,), message=message or "")


def _limit(reading: TypedReader, fields: MappingReader, key: str) -> float | None:
    """Return a time greater than zero [s]."""
    seconds = fields.duration(key)
    if seconds == 0:
        reading.error(
            "out-of-range",
            fields.nodes[key],
            f"'{key}' is 0 s, expected a time that a server can keep",
            "write a longer time, or leave it out",
        )
        return None
    return seconds
