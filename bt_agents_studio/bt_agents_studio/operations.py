# SPDX-License-Identifier: Apache-2.0
"""Operations: what a page may change, and by which service."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bt_agents_core.errors import Refused

LIMIT_S = 30.0
"""Longest time for the answer of a service [s]."""

LONGEST_TEXT = 1000
"""Characters of a text of an operation."""

MOST_VALUES = 500
"""Entries of a list of an operation."""


@dataclass(frozen=True, kw_only=True)
class Operation:
    """One way to change a running system.

    Attributes:
        service: Name of the service, relative to the namespace of the system; ``{host}`` stands
            for a field of that name, which is no field of the request.
        kind: Type of the service in ``bt_agents_interfaces``.
        fields: Field of the request → ``text``, ``number``, ``bool``, ``texts``, ``numbers``, or
            the numbers of its constants by their names.
    """

    service: str
    kind: str
    fields: Mapping[str, str | Mapping[str, int]]


OPERATIONS: Mapping[str, Operation] = {
    "cancel": Operation(
        service="marketplace/cancel",
        kind="CancelRun",
        fields={"reason": "text", "round": "number", "by": {"OPERATOR": 1}},
    ),
    "feedback": Operation(
        service="feedback/give",
        kind="GiveFeedback",
        fields={
            "feedback_id": "text",
            "agent": "text",
            "kind": {"DIRECT": 0, "POSITIVE": 1, "NEGATIVE": 2, "SET": 3},
            "values": "numbers",
            "source": "text",
            "reason": "text",
        },
    ),
    "operate": Operation(
        service="marketplace/operate",
        kind="OperateMarket",
        fields={
            "action": {"PIN": 0, "UNPIN": 1, "VETO": 2, "ALLOW": 3, "AWARD": 4},
            "agent": "text",
            "author": "text",
            "reason": "text",
        },
    ),
    "profiles": Operation(
        service="feedback/manage",
        kind="ManageProfiles",
        fields={
            "action": {"UNDO": 1, "RESET": 2},
            "agent": "text",
            "layer": "text",
            "author": "text",
            "reason": "text",
        },
    ),
    "scene": Operation(
        service="scene_layer/analyze",
        kind="Analyze",
        fields={
            "label": "text",
            "names": "texts",
            "values": "numbers",
            "person": {"AS_MEASURED": 0, "PRESENT": 1, "ABSENT": 2},
            "urgent": "bool",
            "announce": "bool",
        },
    ),
    "tune": Operation(
        service="{host}/tune",
        kind="Tune",
        fields={
            "action": {"SET": 0, "UNDO": 1, "REDO": 2, "APPLY": 3, "SAVE": 4, "FORGET": 5},
            "author": "text",
            "reason": "text",
            "names": "texts",
            "values": "texts",
            "preset": "text",
            "agents": "texts",
        },
    ),
}
"""Name in the address ``/api/do/<name>`` → operation."""


def read_request(operation: Operation, body: object) -> tuple[str, dict[str, Any]]:
    """Return the service that is asked, and the fields of its request.

    Raises:
        Refused: ``BAD_FIELD``.
    """
    if not isinstance(body, dict):
        raise Refused("BAD_FIELD", "expected an object")
    found = dict(body)
    service = operation.service
    if "{host}" in service:
        host = _text("host", found.pop("host", ""))
        if not host.startswith("/") or not host.replace("/", "").replace("_", "").isalnum():
            raise Refused("BAD_FIELD", f"'host' is '{host[:80]}', expected a name such as /agents")
        service = service.format(host=host)
    unknown = found.keys() - operation.fields.keys()
    if unknown:
        raise Refused(
            "BAD_FIELD",
            f"'{min(map(str, unknown))[:40]}' is no field, expected {', '.join(operation.fields)}",
        )
    return service, {name: _read(name, operation.fields[name], found[name]) for name in found}


def _read(name: str, kind: str | Mapping[str, int], value: object) -> object:
    if not isinstance(kind, str):
        if not isinstance(value, str) or value not in kind:
            names = ", ".join(kind)
            raise Refused("BAD_FIELD", f"'{name}' is '{str(value)[:40]}', expected one of {names}")
        return kind[value]
    match kind:
        case "text":
            return _text(name, value)
        case "number":
            return int(_number(name, value))
        case "bool":
            if isinstance(value, bool):
                return value
            raise Refused("BAD_FIELD", f"'{name}' is neither true nor false")
        case "texts":
            return [_text(name, one) for one in _list(name, value)]
        case "numbers":
            # JSON has no NaN, so null says that there is no opinion.
            return [math.nan if one is None else _number(name, one) for one in _list(name, value)]
    raise AssertionError(f"no such kind of field: {kind}")


def _text(name: str, value: object) -> str:
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise Refused("BAD_FIELD", f"'{name}' is no text of at most {LONGEST_TEXT} characters")
    return value


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise Refused("BAD_FIELD", f"'{name}' is no finite number")
    return float(value)


def _list(name: str, value: object) -> list[Any]:
    if not isinstance(value, list) or len(value) > MOST_VALUES:
        raise Refused("BAD_FIELD", f"'{name}' is no list of at most {MOST_VALUES} entries")
    return value
