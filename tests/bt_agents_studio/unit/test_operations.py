# SPDX-License-Identifier: Apache-2.0
"""Operations: the page's requests become service requests, or are refused."""

from __future__ import annotations

import math

import pytest

from bt_agents_core.errors import Refused
from bt_agents_interfaces.msg import Feedback, Run
from bt_agents_ros.system_topics import service_called
from bt_agents_ros.types import load_type
from bt_agents_studio.access import SessionRole
from bt_agents_studio.operations import (
    LONGEST_TEXT,
    MOST_VALUES,
    OPERATIONS,
    OWN_OPERATIONS,
    read_request,
)


def _read(name: str, body: object, role: SessionRole = SessionRole.OPERATE):
    return read_request(OPERATIONS[name], body, role)


@pytest.mark.parametrize("name", OPERATIONS)
def test_operations_use_fields_and_constants_of_their_service(name: str) -> None:
    operation = OPERATIONS[name]
    service = service_called(operation.service.format(host="/agents"))
    request = load_type(service.type).Request
    fields = request.get_fields_and_field_types()
    assert operation.person_fields.keys() <= operation.fields.keys()
    for field, kind in operation.fields.items():
        assert field in fields
        if not isinstance(kind, str):
            declared = next(
                one for one in (request, Run, Feedback) if hasattr(one, next(iter(kind)))
            )
            assert {one: getattr(declared, one) for one in kind} == kind


def test_host_is_part_of_service_name_not_field() -> None:
    body = {"host": "/robot_1/agents", "action": "SET", "names": ["a.b"], "values": ["2 s"]}
    assert _read("tune", body) == (
        "/robot_1/agents/tune",
        {"action": 0, "names": ["a.b"], "values": ["2 s"]},
    )


def test_null_means_no_opinion() -> None:
    _, fields = _read("feedback", {"kind": "DIRECT", "values": [1, None]})
    assert fields["values"][0] == 1.0
    assert math.isnan(fields["values"][1])


@pytest.mark.parametrize(
    ("name", "body"),
    [
        ("cancel", None),
        ("cancel", {"scene": {}}),
        ("cancel", {"reason": 3}),
        ("cancel", {"reason": "a" * (LONGEST_TEXT + 1)}),
        ("cancel", {"round": "1"}),
        ("cancel", {"round": math.inf}),
        ("cancel", {"round": True}),
        ("cancel", {"round": -1}),
        ("cancel", {"round": 1.5}),
        ("cancel", {"round": 2**32}),
        ("cancel", {"reason": "\ud800"}),
        ("cancel", {"by": "MOOD_RULE"}),
        ("feedback", {"kind": "__class__"}),
        ("feedback", {"values": 1}),
        ("feedback", {"values": [1] * (MOST_VALUES + 1)}),
        ("operate", {"action": ["PIN"]}),
        ("scene", {"urgent": 1}),
        ("tune", {"action": "SET"}),
        ("tune", {"host": "agents"}),
        ("tune", {"host": "/agents/../marketplace"}),
        ("tune", {"host": {"a": 1}}),
        ("tune", {"host": "/é"}),
    ],
)
def test_malformed_request_is_rejected(name: str, body: object) -> None:
    with pytest.raises(Refused) as refused:
        _read(name, body)
    assert refused.value.code == "BAD_FIELD"


def test_person_may_only_answer_cancel_rate_and_arrive() -> None:
    every = {**OPERATIONS, **OWN_OPERATIONS}
    allowed = {name for name, one in every.items() if SessionRole.PERSON in one.roles}
    assert allowed == {"answer", "cancel", "feedback", "scene"}
    assert not any(SessionRole.VIEW in one.roles for one in every.values())
    # Only authors write files.
    assert OWN_OPERATIONS["keep"].roles == {SessionRole.AUTHOR}


def test_feedback_of_person_names_person_as_source() -> None:
    _, fields = _read("feedback", {"kind": "POSITIVE"}, SessionRole.PERSON)
    assert fields == {"kind": 1, "source": "person"}


@pytest.mark.parametrize(
    ("name", "body"),
    [
        ("feedback", {"kind": "SET", "values": [1]}),
        ("feedback", {"kind": "POSITIVE", "agent": "attentive_guide"}),
        ("feedback", {"kind": "POSITIVE", "source": "operator"}),
        ("scene", {"names": ["age"], "values": [1], "urgent": True}),
    ],
)
def test_person_may_set_fewer_fields_than_operator(name: str, body: object) -> None:
    _read(name, body)
    with pytest.raises(Refused, match=r"BAD_FIELD|expected"):
        _read(name, body, SessionRole.PERSON)
