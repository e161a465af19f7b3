# SPDX-License-Identifier: Apache-2.0
"""Access: tokens, sessions, and which requests are answered."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_studio.access import (
    ALL_ROLES,
    LARGEST_STATE,
    MOST_SESSIONS,
    OBSERVERS,
    OPERATORS,
    SESSION_S,
    TOKEN_S,
    AccessControl,
    SessionRole,
    WebRequest,
    is_loopback,
)
from bt_agents_studio.access_file import AccessFile
from bt_agents_studio.service import Address

HOST = "127.0.0.1:8770"
OWN = f"http://{HOST}"


class _Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def _access(clock: _Clock | None = None, first: int = 1, **more: Any) -> AccessControl:
    numbers = count(first)
    return AccessControl(
        frozenset({HOST, "localhost:8770"}),
        scheme="http",
        random_bytes=lambda length: next(numbers).to_bytes(length, "big"),
        clock=clock or _Clock(),
        **more,
    )


def _signed_in(role: SessionRole) -> tuple[AccessControl, str]:
    access = _access()
    return access, access.log_in(access.token(role))


def _request(**fields: str) -> WebRequest:
    plain = WebRequest(
        method="GET", host=HOST, origin="", fetch_site="", content_type="", session=""
    )
    return replace(plain, **fields)


def _code(call: Callable[[], object]) -> str:
    with pytest.raises(Refused) as refused:
        call()
    return refused.value.code


@pytest.mark.parametrize("token", ["", "0" * 64, "ä" * 64, "\ud800"])
def test_wrong_token_grants_nothing(token: str) -> None:
    assert _code(lambda: _access().log_in(token)) == "BAD_TOKEN"


def test_session_id_and_token_are_not_interchangeable() -> None:
    access = _access()
    token = access.token(SessionRole.OPERATE)
    session = access.log_in(token)
    assert _code(lambda: access.log_in(session)) == "BAD_TOKEN"
    assert _code(lambda: access.check(_request(session=token), ALL_ROLES)) == "NO_SESSION"


def test_session_ends_after_logout_or_inactivity() -> None:
    clock = _Clock()
    access = _access(clock)
    left = access.log_in(access.token(SessionRole.VIEW))
    access.log_out(left)
    assert _code(lambda: access.check(_request(session=left), ALL_ROLES)) == "NO_SESSION"
    used = access.log_in(access.token(SessionRole.VIEW))
    for _ in range(3):
        clock.now += SESSION_S - 1
        access.check(_request(session=used), ALL_ROLES)
    clock.now += SESSION_S + 1
    assert _code(lambda: access.check(_request(session=used), ALL_ROLES)) == "NO_SESSION"


def test_session_limit_evicts_least_recently_used_session() -> None:
    access = _access()
    first, second = (access.log_in(access.token(SessionRole.VIEW)) for _ in range(2))
    access.check(_request(session=first), ALL_ROLES)
    for _ in range(MOST_SESSIONS - 1):
        access.log_in(access.token(SessionRole.VIEW))
    access.check(_request(session=first), ALL_ROLES)
    assert _code(lambda: access.check(_request(session=second), ALL_ROLES)) == "NO_SESSION"


def test_session_limits_are_separate_per_role() -> None:
    access = _access()
    operator = access.log_in(access.token(SessionRole.OPERATE))
    for _ in range(2 * MOST_SESSIONS):
        access.log_in(access.token(SessionRole.VIEW))
    assert access.check(_request(session=operator), ALL_ROLES) is SessionRole.OPERATE


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        # The tests of the server send more names and origins.
        ({"host": "evil.example:8770"}, "FOREIGN_HOST"),
        ({"origin": "http://localhost:8770"}, "FOREIGN_ORIGIN"),
        ({"fetch_site": "same-site"}, "FOREIGN_ORIGIN"),
    ],
)
def test_possible_cross_site_request_is_rejected(fields: dict[str, str], code: str) -> None:
    access, session = _signed_in(SessionRole.OPERATE)
    request = _request(session=session, **fields)
    assert _code(lambda: access.check(request, ALL_ROLES)) == code
    assert _code(lambda: access.check_sender(request)) == code


@pytest.mark.parametrize(("fields", "code"), [({}, "NO_ORIGIN"), ({"origin": OWN}, "NOT_JSON")])
def test_change_requires_origin_and_json(fields: dict[str, str], code: str) -> None:
    access, session = _signed_in(SessionRole.OPERATE)
    request = _request(method="POST", session=session, key=access.key(session), **fields)
    assert _code(lambda: access.check(request, OPERATORS)) == code
    assert _code(lambda: access.check_sender(request)) == code
    kind = "application/json; charset=utf-8"
    fitting = replace(request, origin=OWN, content_type=kind)
    assert access.check(fitting, OPERATORS) is SessionRole.OPERATE


def test_change_without_body_requires_only_origin() -> None:
    access, session = _signed_in(SessionRole.PERSON)
    request = _request(method="DELETE", session=session, key=access.key(session))
    assert _code(lambda: access.check(request, ALL_ROLES)) == "NO_ORIGIN"
    assert access.check(replace(request, origin=OWN), ALL_ROLES) is SessionRole.PERSON


def test_change_requires_key_of_its_role() -> None:
    access = _access()
    sessions = {role: access.log_in(access.token(role)) for role in SessionRole}
    for role, session in sessions.items():
        change = _request(method="DELETE", session=session, origin=OWN)
        keys = {other: access.key(its) for other, its in sessions.items()}
        assert access.check(replace(change, key=keys.pop(role)), ALL_ROLES) is role
        for key in ("", *keys.values()):
            wrong = replace(change, key=key)
            assert _code(lambda one=wrong: access.check(one, ALL_ROLES)) == "NO_KEY"


def test_later_session_has_the_same_key() -> None:
    access = _access()
    first, second = (access.log_in(access.token(SessionRole.OPERATE)) for _ in range(2))
    change = _request(method="DELETE", session=second, origin=OWN, key=access.key(first))
    assert access.check(change, ALL_ROLES) is SessionRole.OPERATE


def test_key_is_exposed_nowhere_else() -> None:
    access, session = _signed_in(SessionRole.OPERATE)
    assert access.key(session) not in access.text()
    assert access.key(session) not in (session, access.token(SessionRole.OPERATE))


@pytest.mark.parametrize("allowed", [ALL_ROLES, OBSERVERS, OPERATORS, {SessionRole.PERSON}])
def test_operation_is_allowed_only_for_its_roles(allowed: frozenset[SessionRole]) -> None:
    access = _access()
    for role in SessionRole:
        request = _request(session=access.log_in(access.token(role)))
        if role in allowed:
            assert access.check(request, allowed) is role
        else:
            assert _code(lambda r=request: access.check(r, allowed)) == "FORBIDDEN"


def test_tokens_and_sessions_survive_restart_until_expiry() -> None:
    clock = _Clock()
    access = _access(clock)
    session = access.log_in(access.token(SessionRole.PERSON))
    kept = access.text()
    assert session not in kept
    clock.now = SESSION_S - 1
    again = _access(clock, 1000, kept=kept)
    assert again.check(_request(session=session), ALL_ROLES) is SessionRole.PERSON
    assert again.token(SessionRole.VIEW) == access.token(SessionRole.VIEW)
    clock.now = SESSION_S + 1
    late = _access(clock, 1000, kept=kept)
    assert _code(lambda: late.check(_request(session=session), ALL_ROLES)) == "NO_SESSION"
    clock.now = TOKEN_S + 1
    later = _access(clock, 1000, kept=kept)
    assert later.token(SessionRole.VIEW) != access.token(SessionRole.VIEW)


def test_changes_are_saved_and_session_use_only_hourly() -> None:
    clock, kept = _Clock(), list[str]()
    access = _access(clock, keep=kept.append)
    session = access.log_in(access.token(SessionRole.VIEW))
    for _ in range(100):
        access.check(_request(session=session), ALL_ROLES)
    assert len(kept) == 2
    clock.now = 3601.0
    access.check(_request(session=session), ALL_ROLES)
    access.log_out(session)
    assert len(kept) == 4
    assert kept[-1] == access.text()


def _changed(change: Callable[[dict[str, Any]], object]) -> str:
    found = json.loads(_access().text())
    change(found)
    return json.dumps(found)


@pytest.mark.parametrize(
    "kept",
    [
        "{",
        "[]",
        "[" * 100_000,
        " " * (LARGEST_STATE + 1),
        _changed(lambda found: found.pop("tokens")),
        _changed(lambda found: found["tokens"].update(view="0")),
        _changed(lambda found: found["tokens"].update(view=found["tokens"]["author"])),
        _changed(lambda found: found.update(made_at=float("nan"))),
        _changed(lambda found: found.update(made_at=1e9)),
        _changed(lambda found: found.update(sessions=[["0" * 64, "owner", 0]])),
        _changed(lambda found: found.update(sessions=[[1, "view", 0]])),
        _changed(lambda found: found.update(sessions={"a": 1})),
    ],
)
def test_damaged_access_file_is_replaced(kept: str) -> None:
    access = _access(first=1000, kept=kept)
    old = _access()
    assert len({access.token(role) for role in SessionRole}) == len(SessionRole)
    assert all(access.token(role) != old.token(role) for role in SessionRole)
    assert json.loads(access.text())["sessions"] == []


def test_loopback_addresses_are_distinguished_from_others() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "127.9.9.9", "::1", "localhost")))
    assert not any(map(is_loopback, ("0.0.0.0", "192.168.1.2", "::", "robot", "")))


@pytest.mark.parametrize(
    ("host", "port", "named"),
    [
        ("::1", 8770, "[::1]:8770"),
        ("Robot.local", 8770, "robot.local:8770"),
        ("localhost", 80, "localhost"),
    ],
)
def test_studio_has_the_name_that_browsers_send(host: str, port: int, named: str) -> None:
    assert named in Address(host=host).hosts(port)
    assert "localhost" not in Address(host="127.0.0.1").hosts(8770)


@pytest.mark.parametrize(
    "address",
    [Address(host="0.0.0.0", certificate=Path("studio.pem")), Address(key=Path("studio.key"))],
)
def test_address_that_nobody_can_open_is_refused(address: Address) -> None:
    with pytest.raises(BtAgentsError, match="--"):
        address.context()


# --- the file of the tokens and sessions -----------------------------------------------------


def test_written_state_is_private_and_read_back(tmp_path: Path) -> None:
    path = tmp_path / "studio-8770.json"
    assert AccessFile(path).read() == ""
    for text in ("one", "two"):
        AccessFile(path).write(text)
        assert AccessFile(path).read() == text
        assert path.stat().st_mode & 0o777 == 0o600
        path.chmod(0o644)


def test_oversized_file_is_read_only_to_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "studio-8770.json"
    path.write_text("x" * (3 * LARGEST_STATE))
    assert len(AccessFile(path).read()) == LARGEST_STATE + 1


def test_unusable_path_is_reported_once_and_nothing_saved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    file = AccessFile(tmp_path / "file" / "studio-8770.json")
    for _ in range(3):
        file.write("text")
    assert capsys.readouterr().err.count("not kept over its restart") == 1
    broken = tmp_path / "broken.json"
    broken.write_bytes(b"\xff")
    assert AccessFile(broken).read() == ""
    assert AccessFile(None).read() == ""
