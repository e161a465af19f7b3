# SPDX-License-Identifier: Apache-2.0
"""PostgreSQL database of a fleet; every call ends in time, even if the server hangs."""

from __future__ import annotations

import json
import os
import re
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from threading import Timer
from typing import Any

import psycopg
from psycopg.conninfo import conninfo_to_dict, make_conninfo

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import Share
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import printable_line
from feedback_node.learning.fleet_steps import FleetStep, StepEvent

CHANNEL = "bt_agents_fleet"
"""Channel for notifications of pushes; they are only hints, because robots also poll."""

LIMIT_S = 5.0
"""Longest time of one transaction [s]."""

BATCH = 200
"""Maximum number of steps that one transaction pushes or pulls."""

_MIGRATION = re.compile(r"(\d{4})_[a-z_]+\.sql")
_LOCK = 0x62746167  # "btag"
_LONGEST_TEXT = 300
_LONGEST_TARGET = 8192


class FleetError(Refused):
    """Failed use of the fleet's database; the code gives the reason."""


@dataclass(frozen=True, kw_only=True)
class PushPosition:
    """Position of the database in a robot's ledger.

    Attributes:
        number: Number of the last covered row; 0 for none.
        checksum: Checksum of that row; 0 if it was forgotten.
        ledger: Identity of the ledger: the checksum of its first row; 0 for none.
        shares: What each agent shared at the time of writing, as JSON.
    """

    number: int = 0
    checksum: int = 0
    ledger: int = 0
    shares: str


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """Steps of other robots that a robot takes for one agent.

    Attributes:
        base: Version of the profile in its file, as in :func:`base_of`.
        after: Arrival of the last step that it has.
    """

    agent: str
    share: Share
    base: str
    after: int = 0


@dataclass(frozen=True, kw_only=True)
class RobotRow:
    """Robot as the database knows it.

    Attributes:
        steps: Number of its steps in the database.
        seen_s: Time since its last access [s].
    """

    robot: str
    steps: int
    position: int
    seen_s: float


def checked_address(address: str) -> str:
    """Return a database address, a URI or options of libpq, as options for any working folder.

    The name and certificate of a remote server are verified (``sslmode=verify-full``) unless the
    address specifies another mode.

    Raises:
        FleetError: ``BAD_ADDRESS``, or ``PASSWORD_IN_ADDRESS``.
    """
    try:
        options: dict[str, Any] = conninfo_to_dict(address)
    except psycopg.Error as error:
        raise FleetError(
            RefusalCode.BAD_ADDRESS,
            f"the address of the database: {_line(error)}; expected something like "
            "postgresql://robots@db.example/fleet",
        ) from None
    if options.keys() & {"password", "sslpassword"}:
        raise FleetError(
            RefusalCode.PASSWORD_IN_ADDRESS,
            "the address has a password in it, which the list of processes shows to everybody; "
            "take it out, and write it into ~/.pgpass",
        )
    for option in ("passfile", "sslcert", "sslcrl", "sslcrldir", "sslkey", "sslrootcert"):
        if option in options and options[option] != "system":
            options[option] = str(Path(options[option]).resolve())
    # Without a host in the address, PGHOST may name a remote one; local sockets ignore the mode.
    return make_conninfo(**{"sslmode": "verify-full", **options})


class FleetDatabase:
    """Connection to the database of a fleet, made on demand and dropped on failure.

    All methods but :meth:`close` raise :class:`FleetError`: ``DATABASE_AWAY``, ``SCHEMA_NEWER``,
    ``SCHEMA_OLD``, ``NOT_JOINED`` or ``DATABASE_FAILED``.

    Args:
        address: Address from :func:`checked_address`.
        robot: Name of this robot.
        limit_s: Longest time of one transaction [s].
    """

    def __init__(self, address: str, robot: str, *, limit_s: float = LIMIT_S) -> None:
        self._address = address
        self._robot = robot
        self._limit_s = limit_s
        self._connection: psycopg.Connection[Any] | None = None

    @property
    def is_connected(self) -> bool:
        """True if the last call succeeded."""
        return self._connection is not None

    def close(self) -> None:
        """Drop the connection; the next call makes a new one."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(psycopg.Error, OSError):
                connection.close()

    def connect(self) -> None:
        """Connect, and check that the tables match this version."""
        with self._transaction() as connection:
            _check_version(connection)
        with self._bounded() as connection:
            connection.execute(f"LISTEN {CHANNEL}")

    def join(self) -> None:
        """Create or update the tables, and add this robot."""
        with self._transaction() as connection:
            connection.execute("SELECT pg_advisory_xact_lock(%s)", (_LOCK,))
            found = _version(connection)
            if not found:
                connection.execute(_CREATE)
            for version, statements in sorted(_migrations().items()):
                if version > found:
                    connection.execute(statements.encode())
                    connection.execute("INSERT INTO schema_version VALUES (%s)", (version,))
            _check_version(connection)
            connection.execute(
                "INSERT INTO robot (robot) VALUES (%s) ON CONFLICT DO NOTHING", (self._robot,)
            )

    def erase(self) -> None:
        """Remove this robot and its steps."""
        with self._transaction() as connection:
            _check_version(connection)
            connection.execute("DELETE FROM step WHERE robot = %s", (self._robot,))
            connection.execute("DELETE FROM robot WHERE robot = %s", (self._robot,))

    def position(self) -> PushPosition:
        """Return the covered position in the ledger of this robot."""
        with self._transaction() as connection:
            return self._position(connection)

    def push(self, before: PushPosition, steps: Sequence[FleetStep], after: PushPosition) -> None:
        """Add steps and the new position, unless another process has done so meanwhile.

        Raises:
            FleetError: ``ROBOT_TAKEN`` or ``LEDGER_TAKEN``.
        """
        with self._transaction() as connection:
            connection.execute("SELECT pg_advisory_xact_lock(%s)", (_LOCK + 1,))
            if self._position(connection) != before:
                raise FleetError(
                    RefusalCode.ROBOT_TAKEN,
                    f"somebody else pushes as '{self._robot}', too; give each robot a name of its "
                    "own, and run 'bt-agents fleet run' once",
                )
            if steps:
                with connection.cursor() as cursor:
                    cursor.executemany(_INSERT, [_row(step) for step in steps])
                agents = [one.agent for one in steps if one.event is StepEvent.FORGET]
                numbers = [one.number for one in steps]
                connection.execute(_FORGET, (agents, self._robot, numbers))
                connection.execute("SELECT pg_notify(%s, %s)", (CHANNEL, self._robot))
            values = (after.ledger, after.number, after.checksum, after.shares, self._robot)
            try:
                connection.execute(_COVER, values)
            except psycopg.errors.UniqueViolation:
                raise FleetError(
                    RefusalCode.LEDGER_TAKEN,
                    f"this ledger has been pushed under another name than '{self._robot}'; join "
                    "under that one, else the fleet would count its steps twice",
                ) from None

    def pull(self, wanted: Sequence[Wanted]) -> list[dict[str, Any]]:
        """Return unknown steps of other robots, unchecked, in order of arrival.

        Values that are too long are cut to a length that no step has.
        """
        with self._transaction() as connection:
            found = connection.execute(_PULL, (*_columns(wanted), self._robot, BATCH)).fetchall()
            connection.execute("UPDATE robot SET seen = now() WHERE robot = %s", (self._robot,))
        names = (*FleetStep.__dataclass_fields__,)
        return [dict(zip(names, row, strict=True)) for row in found]

    def count(self, wanted: Sequence[Wanted]) -> dict[str, int]:
        """Return the number of other robots' steps for each agent."""
        with self._transaction() as connection:
            found = connection.execute(_COUNT, (*_columns(wanted), self._robot)).fetchall()
        return {str(agent): int(count) for agent, count in found}

    def robots(self) -> list[RobotRow]:
        """Return all robots of the fleet, sorted by name."""
        with self._transaction() as connection:
            _check_version(connection)
            found = connection.execute(_ROBOTS).fetchall()
        return [
            RobotRow(robot=printable_line(str(name)), steps=steps, position=at, seen_s=float(seen))
            for name, steps, at, seen in found
        ]

    def wait(self, seconds: float) -> None:
        """Wait for a push by any robot, for a limited time."""
        with self._bounded(seconds + self._limit_s) as connection:
            for _ in connection.notifies(timeout=seconds, stop_after=1):
                break

    def _position(self, connection: psycopg.Connection[Any]) -> PushPosition:
        found = connection.execute(_POSITION, (self._robot,)).fetchone()
        if found is None:
            raise FleetError(
                RefusalCode.NOT_JOINED,
                f"the database knows no robot '{self._robot}'; 'bt-agents fleet join' adds it",
            )
        number, checksum, ledger, shares = found
        return PushPosition(number=number, checksum=checksum, ledger=ledger or 0, shares=shares)

    @contextmanager
    def _transaction(self) -> Iterator[psycopg.Connection[Any]]:
        with self._bounded() as connection, connection.transaction():
            yield connection

    @contextmanager
    def _bounded(self, seconds: float | None = None) -> Iterator[psycopg.Connection[Any]]:
        """Use the connection; after the time limit, close its socket, which ends any call."""
        descriptor = -1
        timer: Timer | None = None
        try:
            connection = self._connection or self._open()
            self._connection = connection
            descriptor = os.dup(connection.fileno())
            timer = Timer(seconds or self._limit_s, _shut, (descriptor,))
            timer.daemon = True
            timer.start()
            yield connection
        except (psycopg.Error, OSError) as error:
            self.close()
            raise _failed(error) from error
        except BaseException:
            self.close()
            raise
        finally:
            if timer is not None:
                timer.cancel()
                timer.join()
            if descriptor >= 0:
                os.close(descriptor)

    def _open(self) -> psycopg.Connection[Any]:
        limit_ms = int(self._limit_s * 1000)
        return psycopg.connect(
            self._address,
            autocommit=True,
            client_encoding="UTF8",  # a cluster that was made in the locale C has no encoding
            connect_timeout=max(2, int(self._limit_s)),
            application_name=f"bt-agents {self._robot}",
            keepalives=1,
            keepalives_idle=10,
            keepalives_interval=2,
            keepalives_count=3,
            tcp_user_timeout=limit_ms,
            options=f"-c statement_timeout={limit_ms} -c lock_timeout={limit_ms} "
            f"-c idle_in_transaction_session_timeout={2 * limit_ms}",
        )


_CREATE = """
CREATE TABLE IF NOT EXISTS schema_version
(version integer PRIMARY KEY, applied timestamptz NOT NULL DEFAULT now())
"""

_INSERT = """
INSERT INTO step (robot, number, agent, layer, base, event, kind, target, weight, changes, stamp)
VALUES (%s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s) ON CONFLICT DO NOTHING
"""

_FORGET = """
DELETE FROM step AS s USING step AS t
WHERE t.event = 'forget' AND s.event <> 'forget' AND s.agent = t.agent
    AND (s.agent = ANY(%s) OR (s.robot = %s AND s.number = ANY(%s)))
    AND (s.stamp, s.robot COLLATE "C", s.number) < (t.stamp, t.robot COLLATE "C", t.number)
    AND t.layer = split_part(s.layer, '/', 1) || '/sha256:'
        || encode(sha256(convert_to(s.layer, 'UTF8')), 'hex')
"""

_POSITION = "SELECT position, checksum, ledger, shares FROM robot WHERE robot = %s"

_COVER = """
UPDATE robot SET ledger = %s, position = %s, checksum = %s, shares = %s, seen = now()
WHERE robot = %s
"""

_OF_WANTED = """
FROM step AS s JOIN unnest(%s::text[], %s::text[], %s::bool[], %s::bigint[])
    AS w (agent, base, places, after)
    ON s.agent = w.agent AND (s.base = w.base OR s.event = 'forget') AND s.arrival > w.after
WHERE (NOT w.places OR s.layer LIKE 'place/%%')
    AND s.layer NOT LIKE 'person/%%' AND s.robot <> %s
"""

_PULL = f"""
SELECT s.robot, s.number, s.agent, left(s.layer, {_LONGEST_TEXT}), s.base,
    left(s.event, {_LONGEST_TEXT}), s.kind,
    CASE WHEN length(s.target::text) <= {_LONGEST_TARGET} THEN s.target::text ELSE '' END,
    s.weight, s.changes, s.stamp, s.arrival
{_OF_WANTED} ORDER BY s.arrival LIMIT %s
"""

_COUNT = f"SELECT s.agent, count(*) {_OF_WANTED} GROUP BY s.agent"

_ROBOTS = """
SELECT r.robot, (SELECT count(*) FROM step AS s WHERE s.robot = r.robot), r.position,
    extract(epoch FROM now() - r.seen)
FROM robot AS r ORDER BY r.robot LIMIT 10000
"""


def _row(step: FleetStep) -> tuple[Any, ...]:
    fields = {**step.fields(), "target": json.dumps(dict(step.target), allow_nan=False)}
    return tuple(value for name, value in fields.items() if name != "arrival")


def _columns(wanted: Sequence[Wanted]) -> tuple[list[Any], ...]:
    return (
        [one.agent for one in wanted],
        [one.base for one in wanted],
        [one.share is Share.PLACE for one in wanted],
        [one.after for one in wanted],
    )


def _migrations() -> dict[int, str]:
    """Return the statements of each version of the tables, by version number from 1."""
    found = {}
    for file in files("bt_agents_fleet").joinpath("migrations").iterdir():
        if number := _MIGRATION.fullmatch(file.name):
            found[int(number[1])] = file.read_text(encoding="utf-8")
    assert sorted(found) == list(range(1, len(found) + 1))
    return found


def _version(connection: psycopg.Connection[Any]) -> int:
    """Return the version of the tables; 0 if there are none."""
    there = connection.execute("SELECT to_regclass('schema_version') IS NOT NULL").fetchone()
    if not (there and there[0]):
        return 0
    found = connection.execute("SELECT coalesce(max(version), 0) FROM schema_version").fetchone()
    return int(found[0]) if found else 0


def _check_version(connection: psycopg.Connection[Any]) -> None:
    found = _version(connection)
    known = len(_migrations())
    if found > known:
        raise FleetError(
            RefusalCode.SCHEMA_NEWER,
            f"the tables are of version {found}, this program knows {known}; install the version "
            "of bt-agents that the rest of the fleet has",
        )
    if found < known:
        raise FleetError(
            RefusalCode.SCHEMA_OLD,
            f"the tables are of version {found}, expected {known}; 'bt-agents fleet join' brings "
            "them up to date",
        )


def _shut(descriptor: int) -> None:
    with suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as sock:
        sock.shutdown(socket.SHUT_RDWR)


def _failed(error: Exception) -> FleetError:
    if isinstance(error, psycopg.OperationalError | OSError):
        return FleetError(RefusalCode.DATABASE_AWAY, f"the database of the fleet: {_line(error)}")
    return FleetError(RefusalCode.DATABASE_FAILED, f"the database of the fleet: {_line(error)}")


def _line(error: Exception) -> str:
    return printable_line(" ".join(str(error).split()))[:_LONGEST_TEXT]
