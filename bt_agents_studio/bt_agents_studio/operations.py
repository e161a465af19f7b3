# SPDX-License-Identifier: Apache-2.0
"""Operations: changes that a page may make, and their services."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.ros_names import is_full_name
from bt_agents_studio.access import OPERATORS, SessionRole

LIMIT_S = 30.0
"""Longest wait for the answer of a service [s]."""

LONGEST_TEXT = 1000
"""Maximum length of a text of an operation [characters]."""

MOST_VALUES = 500
"""Maximum number of entries of a list of an operation."""

_ABOVE_COUNTS = 2**32


Fields = Mapping[str, str | Mapping[str, int]]
"""Field of a request → ``text``, ``number`` (a count), ``seconds``, ``bool``, ``texts``,
``numbers``, or the numbers of its constants by their names."""

WITH_PERSON = OPERATORS | {SessionRole.PERSON}
"""Roles that may act as the person in front of the robot."""


@dataclass(frozen=True, kw_only=True)
class Operation:
    """One way to change a running system.

    Attributes:
        roles: Roles that may do it.
        service: Name of the service, relative to the namespace of the system; ``{host}`` stands
            for a field of that name, which is not a field of the request.
        fields: Fields of the request.
        person_fields: The same for a person, if a person may set fewer.
        person_values: Values of the other fields in a person's request.
    """

    roles: frozenset[SessionRole] = OPERATORS
    service: str
    fields: Fields
    person_fields: Fields = field(default_factory=dict)
    person_values: Mapping[str, str] = field(default_factory=dict)


OPERATIONS: Mapping[str, Operation] = {
    "cancel": Operation(
        roles=WITH_PERSON,
        service="marketplace/cancel",
        fields={"reason": "text", "round": "number", "by": {"OPERATOR": 1}},
    ),
    "control": Operation(
        service="{host}/control",
        fields={
            "action": {"PAUSE": 0, "RESUME": 1, "STEP": 2, "BREAKPOINTS": 3},
            "author": "text",
            "epoch": "text",
            "round": "number",
            "agent": "text",
            "paths": "texts",
        },
    ),
    "feedback": Operation(
        roles=WITH_PERSON,
        service="feedback/give",
        fields={
            "feedback_id": "text",
            "agent": "text",
            "kind": {"DIRECT": 0, "POSITIVE": 1, "NEGATIVE": 2, "SET": 3},
            "values": "numbers",
            "expected": "numbers",
            "source": "text",
            "reason": "text",
        },
        person_fields={
            "feedback_id": "text",
            "kind": {"DIRECT": 0, "POSITIVE": 1, "NEGATIVE": 2},
            "values": "numbers",
            "reason": "text",
        },
        person_values={"source": "person"},
    ),
    "operate": Operation(
        service="marketplace/operate",
        fields={
            "action": {"PIN": 0, "UNPIN": 1, "VETO": 2, "ALLOW": 3, "AWARD": 4},
            "agent": "text",
            "author": "text",
            "reason": "text",
        },
    ),
    "record": Operation(
        service="journal/record",
        fields={
            "action": {"START": 0, "STOP": 1, "BOOKMARK": 2},
            "author": "text",
            "label": "text",
            "notes": "text",
            "age_s": "seconds",
        },
    ),
    "profiles": Operation(
        service="feedback/manage",
        fields={
            "action": {"UNDO": 1, "RESET": 2},
            "agent": "text",
            "layer": "text",
            "author": "text",
            "reason": "text",
            "expected": "numbers",
        },
    ),
    "scene": Operation(
        roles=WITH_PERSON,
        service="scene_layer/analyze",
        fields={
            "label": "text",
            "names": "texts",
            "values": "numbers",
            "person": {"AS_MEASURED": 0, "PRESENT": 1, "ABSENT": 2},
            "name": "text",
            "urgent": "bool",
            "announce": "bool",
        },
        person_fields={
            "label": "text",
            "names": "texts",
            "values": "numbers",
            "person": {"AS_MEASURED": 0, "PRESENT": 1, "ABSENT": 2},
            "announce": "bool",
        },
    ),
    "tune": Operation(
        service="{host}/tune",
        fields={
            "action": {"SET": 0, "UNDO": 1, "REDO": 2, "APPLY": 3, "SAVE": 4, "FORGET": 5},
            "author": "text",
            "reason": "text",
            "names": "texts",
            "values": "texts",
            "compare": "bool",
            "seen": "number",
            "preset": "text",
            "agents": "texts",
        },
    ),
}
"""Name in the address ``/api/do/<name>`` → operation of a service."""


@dataclass(frozen=True, kw_only=True)
class OwnOperation:
    """Operation of the studio itself, done by modules of the command line.

    Attributes:
        roles: Roles that may do it.
        fields: Fields of the request.
    """

    roles: frozenset[SessionRole] = OPERATORS
    fields: Fields


OWN_OPERATIONS: Mapping[str, OwnOperation] = {
    "answer": OwnOperation(roles=WITH_PERSON, fields={"text": "text"}),
    "dry_run": OwnOperation(
        fields={"names": "texts", "values": "numbers", "across": "text", "up": "text"}
    ),
    "keep": OwnOperation(
        roles=frozenset({SessionRole.AUTHOR}), fields={"profile": "bool", "digest": "text"}
    ),
    "person_link": OwnOperation(fields={}),
    "publish": OwnOperation(fields={"topic": "text", "values": "texts"}),
    "strategy": OwnOperation(fields={"name": "text", "options": "texts", "values": "numbers"}),
}
"""Name in the address ``/api/do/<name>`` → operation of the studio itself."""


def read_request(
    operation: Operation, body: object, role: SessionRole
) -> tuple[str, dict[str, Any]]:
    """Return the service of a request, and the request's fields.

    Raises:
        Refused: ``BAD_FIELD``.
    """
    if not isinstance(body, dict):
        raise Refused(RefusalCode.BAD_FIELD, "expected an object")
    found = dict(body)
    service = operation.service
    if "{host}" in service:
        host = _text("host", found.pop("host", ""))
        if not is_full_name(host):
            raise Refused(
                RefusalCode.BAD_FIELD, f"'host' is '{host[:80]}', expected a name such as /agents"
            )
        service = service.format(host=host)
    is_person = role is SessionRole.PERSON
    fields = (operation.person_fields if is_person else {}) or operation.fields
    read = read_fields(fields, found)
    return service, {**read, **(operation.person_values if is_person else {})}


def read_fields(fields: Fields, body: object) -> dict[str, Any]:
    """Return the fields of a request, without missing ones.

    Raises:
        Refused: ``BAD_FIELD``.
    """
    if not isinstance(body, dict):
        raise Refused(RefusalCode.BAD_FIELD, "expected an object")
    unknown = body.keys() - fields.keys()
    if unknown:
        raise Refused(
            RefusalCode.BAD_FIELD,
            f"'{min(map(str, unknown))[:40]}' is not a field, expected {', '.join(fields)}",
        )
    return {name: _read(name, fields[name], body[name]) for name in body}


def _read(name: str, kind: str | Mapping[str, int], value: object) -> object:
    if not isinstance(kind, str):
        if not isinstance(value, str) or value not in kind:
            names = ", ".join(kind)
            raise Refused(
                RefusalCode.BAD_FIELD, f"'{name}' is '{str(value)[:40]}', expected one of {names}"
            )
        return kind[value]
    match kind:
        case "text":
            return _text(name, value)
        case "number":
            return _count(name, value)
        case "seconds":
            return _number(name, value)
        case "bool":
            if isinstance(value, bool):
                return value
            raise Refused(RefusalCode.BAD_FIELD, f"'{name}' is neither true nor false")
        case "texts":
            return [_text(name, one) for one in _list(name, value)]
        case "numbers":
            # JSON has no NaN, so null means no opinion.
            return [math.nan if one is None else _number(name, one) for one in _list(name, value)]
    raise AssertionError(f"no such kind of field: {kind}")


def _text(name: str, value: object) -> str:
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise Refused(
            RefusalCode.BAD_FIELD, f"'{name}' is not a text of at most {LONGEST_TEXT} characters"
        )
    try:
        value.encode()
    except UnicodeEncodeError:
        raise Refused(RefusalCode.BAD_FIELD, f"'{name}' holds half a character") from None
    return value


def _count(name: str, value: object) -> int:
    number = _number(name, value)
    if not (number.is_integer() and 0 <= number < _ABOVE_COUNTS):
        raise Refused(
            RefusalCode.BAD_FIELD, f"'{name}' is not a whole number from 0 to {_ABOVE_COUNTS - 1}"
        )
    return int(number)


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise Refused(RefusalCode.BAD_FIELD, f"'{name}' is not a finite number")
    return float(value)


def _list(name: str, value: object) -> list[Any]:
    if not isinstance(value, list) or len(value) > MOST_VALUES:
        raise Refused(
            RefusalCode.BAD_FIELD, f"'{name}' is not a list of at most {MOST_VALUES} entries"
        )
    return value
