# SPDX-License-Identifier: Apache-2.0
"""Protocol between studio and browser: JSON texts, whose type is in the field ``type``."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any, ClassVar

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_studio.records import BookmarkRecord, EventRecord, ParameterRecord
from bt_agents_studio.store import NewValue

VERSION = 1
"""Version of the protocol; a client of another version gets an error and reloads the page."""

LARGEST_MESSAGE = 4096
"""Maximum size of a message from a client [bytes]."""

LATEST_S = 2**40
"""Latest moment that a client may request [s since 1970]."""


@dataclass(frozen=True, kw_only=True)
class Hello:
    """First message to a client.

    Attributes:
        version: :data:`VERSION`.
        studio: Identifier of this start of the studio; sequence numbers of others are invalid.
        now_s: Clock of the studio [s since 1970]; all times refer to it.
        role: Role of the client's session.
        parameters: The scene parameters of the trees folder.
        namespace: Namespace of the system.
        span_s: Length of a running system's history [s].
    """

    type: ClassVar[str] = "hello"
    version: int
    studio: str
    now_s: float
    role: str
    parameters: tuple[ParameterRecord, ...]
    namespace: str
    span_s: float


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """All entries: collection → key → value.

    Attributes:
        sequence: Number of the last change in it.
        at_s: The requested moment [s since 1970]; None for now.
        source: Name of the journal file; empty for the running system.
        first_s: Earliest available moment [s since 1970]; None if there is none.
        last_s: Latest available moment.
        bookmarks: All bookmarks of the source, including later ones.
        is_whole: Whether the source has been read to its end; otherwise further snapshots of the
            same moment follow.
    """

    type: ClassVar[str] = "snapshot"
    sequence: int
    at_s: float | None
    source: str
    first_s: float | None
    last_s: float | None
    bookmarks: tuple[BookmarkRecord, ...]
    is_whole: bool
    entries: Mapping[str, Mapping[str, object]]


@dataclass(frozen=True, kw_only=True)
class Moment:
    """Snapshot of an earlier moment.

    Attributes:
        snapshot: The snapshot without its entries.
        entries: Its entries as JSON; a page keeps the events that it has.
    """

    snapshot: Snapshot
    entries: str


@dataclass(frozen=True, kw_only=True)
class Delta:
    """Newest change of each entry since the last message; a value of None removes it.

    Attributes:
        sequence: Number of the last change in it.
        changes: Collection, key and value of each.
    """

    type: ClassVar[str] = "delta"
    sequence: int
    changes: tuple[NewValue, ...]


@dataclass(frozen=True, kw_only=True)
class Present:
    """Current changes of ``OF_THE_PRESENT`` for a client at an earlier moment.

    Attributes:
        changes: As in :class:`Delta`.
        is_whole: The changes are all entries; a client removes all others.
    """

    type: ClassVar[str] = "present"
    changes: tuple[NewValue, ...]
    is_whole: bool


@dataclass(frozen=True, kw_only=True)
class Beat:
    """Sign of life of the studio in the absence of other messages."""

    type: ClassVar[str] = "beat"


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Refusal of a client's message, with a code and a text."""

    type: ClassVar[str] = "failure"
    code: str
    message: str


@dataclass(frozen=True, kw_only=True)
class Events:
    """Timeline of a recording: the answer to ``GET /api/journals/NAME/events``.

    Attributes:
        events: The events of the part that has been read.
        is_whole: As in :class:`Snapshot`.
    """

    type: ClassVar[str] = "events"
    events: tuple[EventRecord, ...]
    is_whole: bool


@dataclass(frozen=True, kw_only=True)
class Resume:
    """First message of a client: the state that it already has.

    Attributes:
        version: Version of the protocol.
        studio: From :class:`Hello` of the previous connection; empty without one.
        sequence: Sequence number of the last received message; 0 for none.
    """

    type: ClassVar[str] = "resume"
    version: int = field(metadata={"minimum": 0, "maximum": 2**31})
    studio: str = field(metadata={"longest": 64})
    sequence: int = field(metadata={"minimum": 0, "maximum": 2**53})


@dataclass(frozen=True, kw_only=True)
class Seek:
    """Request to see an earlier moment, until :class:`Follow`.

    Attributes:
        source: Name of a journal file; empty for the running system.
        at_s: The moment [s since 1970].
    """

    type: ClassVar[str] = "seek"
    source: str = field(metadata={"longest": 255})
    at_s: float = field(metadata={"minimum": 0, "maximum": LATEST_S})


@dataclass(frozen=True, kw_only=True)
class Follow:
    """Request to return to now."""

    type: ClassVar[str] = "follow"


ServerMessage = Hello | Snapshot | Delta | Present | Beat | Failure
ClientMessage = Resume | Seek | Follow

_CLIENT_MESSAGES: Mapping[str, type[Resume] | type[Seek] | type[Follow]] = {
    one.type: one for one in (Resume, Seek, Follow)
}


def encode(message: ServerMessage | Events | Moment) -> str:
    """Return a message as JSON; records become objects with the names of their fields.

    Raises:
        ValueError: A number is not finite.
    """
    if isinstance(message, Moment):
        # The entries are the last field of a snapshot.
        return f"{encode(message.snapshot).removesuffix('{}}')}{message.entries}}}"
    found = {"type": message.type, **vars(message)}
    return json.dumps(
        found, default=vars, allow_nan=False, ensure_ascii=False, separators=(",", ":")
    )


def decode(text: str) -> ClientMessage:
    """Return the message of a client.

    Raises:
        Refused: ``TOO_LARGE``, ``NOT_JSON``, ``UNKNOWN_TYPE`` or ``BAD_FIELD``.
    """
    if len(text) > LARGEST_MESSAGE:
        raise Refused(
            RefusalCode.TOO_LARGE,
            f"the message has {len(text)} characters, at most {LARGEST_MESSAGE} may be",
        )
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        raise Refused(RefusalCode.NOT_JSON, "the message is not JSON") from None
    kind = _CLIENT_MESSAGES.get(str(found.get("type"))) if isinstance(found, dict) else None
    if kind is None:
        names = ", ".join(_CLIENT_MESSAGES)
        raise Refused(RefusalCode.UNKNOWN_TYPE, f"expected an object with a 'type' of {names}")
    declared = {one.name: one for one in fields(kind)}
    unknown = found.keys() - declared.keys() - {"type"}
    if unknown:
        raise Refused(RefusalCode.BAD_FIELD, f"'{kind.type}' has no field '{min(unknown)[:40]}'")
    return kind(**{name: _checked(found.get(name), one) for name, one in declared.items()})


_CHECKS: Mapping[str, tuple[str, Callable[[Any], bool]]] = {
    "int": ("whole number", lambda value: type(value) is int),
    "float": ("number", lambda value: type(value) in (int, float) and math.isfinite(value)),
    "str": ("text", lambda value: isinstance(value, str)),
}


def _checked(value: Any, declared: Field[Any]) -> Any:
    expected, check = _CHECKS[str(declared.type)]
    name, limits = declared.name, declared.metadata
    if not check(value):
        raise Refused(RefusalCode.BAD_FIELD, f"'{name}' is not a {expected}")
    if isinstance(value, str):
        if len(value) > limits["longest"]:
            raise Refused(
                RefusalCode.BAD_FIELD, f"'{name}' is longer than {limits['longest']} characters"
            )
    elif not limits["minimum"] <= value <= limits["maximum"]:
        allowed = f"{limits['minimum']} to {limits['maximum']}"
        raise Refused(RefusalCode.BAD_FIELD, f"'{name}' is {value}, expected {allowed}")
    return value
