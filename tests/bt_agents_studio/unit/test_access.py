# SPDX-License-Identifier: Apache-2.0
"""Access: tokens, sessions, and which requests are answered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import count

import pytest

from bt_agents_core.errors import Refused
from bt_agents_studio.access import (
    MOST_SESSIONS,
    SESSION_S,
    AccessControl,
    SessionRole,
    WebRequest,
    is_loopback,
)

HOST = "127.0.0.1:8770"
OWN = f"http://{HOST}"


class _Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def _bytes() -> Callable[[int], bytes]:
    numbers = count(1)
    return lambda length: next(numbers).to_bytes(length, "big")


def _access(clock: _Clock | None = None) -> AccessControl:
    hosts = frozenset({HOST, "localhost:8770"})
    return AccessControl(hosts, scheme="http", random_bytes=_bytes(), clock=clock or _Clock())


def _request(**fields: str) -> WebRequest:
    plain = WebRequest(
        method="GET", host=HOST, origin="", fetch_site="", content_type="", session=""
    )
    return replace(plain, **fields)


def _code(call: Callable[[], object]) -> str:
    with pytest.raises(Refused) as refused:
        call()
    return refused.value.code


@pytest.mark.parametrize("role", SessionRole)
def test_a_token_gives_the_role_that_it_was_made_for(role: SessionRole) -> None:
    access = _access()
    session = access.log_in(access.token(role))
    assert len(access.token(role)) == 64
    assert access.check(_request(session=session), SessionRole.VIEW) is role


@pytest.mark.parametrize("token", ["", "0" * 64, "ä" * 64, "\ud800"])
def test_a_wrong_token_gives_nothing(token: str) -> None:
    assert _code(lambda: _access().log_in(token)) == "BAD_TOKEN"


def test_a_session_id_is_no_token_and_a_token_no_session_id() -> None:
    access = _access()
    token = access.token(SessionRole.OPERATE)
    session = access.log_in(token)
    assert _code(lambda: access.log_in(session)) == "BAD_TOKEN"
    assert _code(lambda: access.check(_request(session=token), SessionRole.VIEW)) == "NO_SESSION"


def test_a_session_ends_when_it_is_left_or_not_used_for_long() -> None:
    clock = _Clock()
    access = _access(clock)
    left = access.log_in(access.token(SessionRole.VIEW))
    access.log_out(left)
    assert _code(lambda: access.check(_request(session=left), SessionRole.VIEW)) == "NO_SESSION"
    used = access.log_in(access.token(SessionRole.VIEW))
    for _ in range(3):
        clock.now += SESSION_S - 1
        access.check(_request(session=used), SessionRole.VIEW)
    clock.now += SESSION_S + 1
    assert _code(lambda: access.check(_request(session=used), SessionRole.VIEW)) == "NO_SESSION"


def test_of_too_many_sessions_the_one_used_longest_ago_is_forgotten() -> None:
    access = _access()
    first, second = (access.log_in(access.token(SessionRole.VIEW)) for _ in range(2))
    access.check(_request(session=first), SessionRole.VIEW)
    for _ in range(MOST_SESSIONS - 1):
        access.log_in(access.token(SessionRole.VIEW))
    access.check(_request(session=first), SessionRole.VIEW)
    assert _code(lambda: access.check(_request(session=second), SessionRole.VIEW)) == "NO_SESSION"


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"host": ""}, "FOREIGN_HOST"),
        ({"host": "evil.example"}, "FOREIGN_HOST"),
        ({"host": "evil.example:8770"}, "FOREIGN_HOST"),
        ({"host": "127.0.0.1"}, "FOREIGN_HOST"),
        ({"host": "127.0.0.1:8771"}, "FOREIGN_HOST"),
        ({"host": "127.0.0.1:8770.evil.example"}, "FOREIGN_HOST"),
        ({"origin": "http://evil.example"}, "FOREIGN_ORIGIN"),
        ({"origin": "https://127.0.0.1:8770"}, "FOREIGN_ORIGIN"),
        ({"origin": "http://localhost:8770"}, "FOREIGN_ORIGIN"),
        ({"origin": "null"}, "FOREIGN_ORIGIN"),
        ({"fetch_site": "cross-site"}, "FOREIGN_ORIGIN"),
        ({"fetch_site": "same-site"}, "FOREIGN_ORIGIN"),
    ],
)
def test_a_request_that_a_foreign_page_may_have_made_is_refused(
    fields: dict[str, str], code: str
) -> None:
    access = _access()
    session = access.log_in(access.token(SessionRole.OPERATE))
    request = _request(session=session, **fields)
    assert _code(lambda: access.check(request, SessionRole.VIEW)) == code
    assert _code(lambda: access.check_socket(request)) == code


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({}, "NO_ORIGIN"),
        ({"origin": OWN}, "NOT_JSON"),
        ({"origin": OWN, "content_type": "text/plain"}, "NOT_JSON"),
        ({"origin": OWN, "content_type": "application/x-www-form-urlencoded"}, "NOT_JSON"),
    ],
)
def test_a_change_needs_an_origin_and_json(fields: dict[str, str], code: str) -> None:
    access = _access()
    session = access.log_in(access.token(SessionRole.OPERATE))
    request = _request(method="POST", session=session, **fields)
    assert _code(lambda: access.check(request, SessionRole.OPERATE)) == code
    kind = "application/json; charset=utf-8"
    fitting = replace(request, origin=OWN, content_type=kind)
    assert access.check(fitting, SessionRole.OPERATE) is SessionRole.OPERATE


def test_a_role_may_do_what_the_lesser_ones_may_and_no_more() -> None:
    access = _access()
    for role in SessionRole:
        request = _request(session=access.log_in(access.token(role)))
        for needed in SessionRole:
            if needed <= role:
                assert access.check(request, needed) is role
            else:
                assert _code(lambda r=request, n=needed: access.check(r, n)) == "FORBIDDEN"


def test_a_socket_needs_an_origin() -> None:
    access = _access()
    session = access.log_in(access.token(SessionRole.VIEW))
    assert _code(lambda: access.check_socket(_request(session=session))) == "NO_ORIGIN"
    role = access.check_socket(_request(session=session, origin=OWN))
    assert role is SessionRole.VIEW


def test_addresses_of_this_machine_are_told_from_others() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "127.9.9.9", "::1", "localhost")))
    assert not any(map(is_loopback, ("0.0.0.0", "192.168.1.2", "::", "robot", "")))
