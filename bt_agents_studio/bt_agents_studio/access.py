# SPDX-License-Identifier: Apache-2.0
"""Access to a studio: start tokens, sessions with a role, and checks of requests."""

from __future__ import annotations

import hashlib
import hmac
import json
import math
import re
from collections import OrderedDict
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from ipaddress import ip_address

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode

LARGEST_BODY = 256 * 1024
"""Maximum size of a request's body [bytes]."""

MOST_SESSIONS = 100
"""Maximum number of sessions of one role; the least recently used one is forgotten first."""

SESSION_S = 7 * 24 * 3600.0
"""Time after which an unused session ends [s]."""

TOKEN_S = 30 * 24 * 3600.0
"""A start of the studio replaces start tokens of this age [s]."""

LARGEST_STATE = 256 * 1024
"""Maximum length of the text that stores tokens and sessions [characters]."""

_TOKEN_BYTES = 32
_COOKIE = "bt_agents_studio"
_HEX = re.compile(r"[0-9a-f]{64}")
_PORT = re.compile(r":([0-9]{1,5})$")
_NOTE_S = 3600.0
_JSON = "application/json"


class SessionRole(StrEnum):
    """Rights of a session.

    Attributes:
        VIEW: See everything, change nothing.
        OPERATE: Stop, answer, give feedback, pin, veto, announce scenes and tune.
        AUTHOR: The same, and write files of the trees folder.
        PERSON: See what the robot says and asks, answer, stop, give feedback, begin an encounter.
    """

    VIEW = "view"
    OPERATE = "operate"
    AUTHOR = "author"
    PERSON = "person"


ALL_ROLES = frozenset(SessionRole)
OPERATORS = frozenset({SessionRole.OPERATE, SessionRole.AUTHOR})
OBSERVERS = OPERATORS | {SessionRole.VIEW}

_LINK_IS_FOR = {
    SessionRole.VIEW: "for viewing only",
    SessionRole.PERSON: "for the page Person only",
    SessionRole.OPERATE: "not for writing files",
    SessionRole.AUTHOR: "for authors only",
}
"""Purpose of the link of a role."""


@dataclass(frozen=True, kw_only=True)
class WebRequest:
    """Parts of an HTTP request that decide on access; an empty text stands for a missing part."""

    method: str
    host: str
    origin: str
    fetch_site: str
    content_type: str
    session: str
    key: str = ""
    opens_socket: bool = False

    @property
    def changes(self) -> bool:
        """Whether it may change something."""
        return self.method not in ("GET", "HEAD")


def cookie_name(host: str) -> str:
    """Return the name of the session cookie of the studio at ``host``.

    The name contains the port, because browsers share cookies between the ports of an address.
    """
    port = _PORT.search(host)
    return f"{_COOKIE}_{port[1]}" if port else _COOKIE


class AccessControl:
    """Tokens, sessions and the rules for requests.

    Args:
        hosts: Names and addresses with port under which the studio may be requested, for example
            ``127.0.0.1:8770``; requests under another name are refused.
        scheme: ``http`` or ``https``.
        random_bytes: Source of secrets.
        clock: Time of day [s since 1970], because sessions outlive the process.
        kept: Result of :meth:`text` from an earlier start; invalid parts are ignored.
        keep: Called with the result of :meth:`text` after a significant change.
    """

    def __init__(
        self,
        hosts: Collection[str],
        *,
        scheme: str,
        random_bytes: Callable[[int], bytes],
        clock: Callable[[], float],
        kept: str = "",
        keep: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self._hosts = hosts
        self._scheme = scheme
        self._random_bytes = random_bytes
        self._clock = clock
        self._keep = keep
        self._made_at, self._tokens, self._sessions = self._read(kept)
        self._noted_at = clock()
        self._keep(self.text())

    def token(self, role: SessionRole) -> str:
        """Return the start token of a role: 256 bits in hexadecimal digits."""
        return self._tokens[role]

    def text(self) -> str:
        """Return tokens and sessions as JSON, with only the digest of each session's id."""
        sessions = [[digest.hex(), role, used] for digest, (role, used) in self._sessions.items()]
        kept = {"made_at": self._made_at, "tokens": self._tokens, "sessions": sessions}
        return json.dumps(kept)

    def log_in(self, token: str) -> str:
        """Return the id of a new session with the role of a start token.

        Raises:
            Refused: ``BAD_TOKEN``.
        """
        # Compare all of them, so that the time reveals nothing.
        fitting = [
            role
            for role, own in self._tokens.items()
            if hmac.compare_digest(own.encode(), token.encode("utf-8", "replace"))
        ]
        if not fitting:
            raise Refused(
                RefusalCode.BAD_TOKEN,
                "this address is not, or no longer, the one of this studio; take the one that "
                "'bt-agents studio' or 'bt-agents up' has printed",
            )
        session = self._random_bytes(_TOKEN_BYTES).hex()
        self._sessions[_digest(session)] = (fitting[0], self._clock())
        own = [digest for digest, (role, _) in self._sessions.items() if role is fitting[0]]
        for digest in own[:-MOST_SESSIONS]:
            del self._sessions[digest]
        self._keep(self.text())
        return session

    def knows(self, session: str) -> bool:
        """Return whether a session has begun and not ended."""
        return _digest(session) in self._sessions

    def key(self, session: str) -> str:
        """Return the key of a session, which a page sends with every change.

        Browsers send the cookie to all ports of an address, which may belong to other servers.

        Raises:
            Refused: ``NO_SESSION``.
        """
        token = self._tokens[self._role(session)]
        return hmac.new(bytes.fromhex(token), _COOKIE.encode(), hashlib.sha256).hexdigest()

    def log_out(self, session: str) -> None:
        """End a session."""
        self._sessions.pop(_digest(session), None)
        self._keep(self.text())

    def check_sender(self, request: WebRequest) -> None:
        """Refuse a request that a foreign page may have made.

        A request that changes something or opens a WebSocket must have an origin, which browsers
        send; a ``POST`` must be JSON, which forms cannot send.

        Raises:
            Refused: ``FOREIGN_HOST``, ``FOREIGN_ORIGIN``, ``NO_ORIGIN`` or ``NOT_JSON``.
        """
        if request.host not in self._hosts:
            raise Refused(
                RefusalCode.FOREIGN_HOST, f"this studio is not called '{request.host[:80]}'"
            )
        own = f"{self._scheme}://{request.host}"
        if request.origin and request.origin != own:
            raise Refused(
                RefusalCode.FOREIGN_ORIGIN, f"a page of '{request.origin[:80]}' may not ask this"
            )
        if request.fetch_site not in ("", "same-origin", "none"):
            raise Refused(RefusalCode.FOREIGN_ORIGIN, "a page of another site may not ask this")
        if (request.changes or request.opens_socket) and not request.origin:
            raise Refused(RefusalCode.NO_ORIGIN, "a change and a WebSocket need the header Origin")
        media_type = request.content_type.partition(";")[0].strip().lower()
        if request.method == "POST" and media_type != _JSON:
            raise Refused(RefusalCode.NOT_JSON, f"expected the content type {_JSON}")

    def check(self, request: WebRequest, allowed: Collection[SessionRole]) -> SessionRole:
        """Return the role of a request, which must be one of the allowed roles.

        Raises:
            Refused: As by :meth:`check_sender`; ``NO_SESSION``, ``FORBIDDEN`` or ``NO_KEY``.
        """
        self.check_sender(request)
        role = self._role(request.session)
        if role not in allowed:
            raise Refused(
                RefusalCode.FORBIDDEN,
                f"this link is {_LINK_IS_FOR[role]}; for everything else, open the first address "
                "that 'bt-agents up' or 'bt-agents studio' printed",
            )
        if request.changes and not hmac.compare_digest(
            self.key(request.session).encode(), request.key.encode("utf-8", "replace")
        ):
            raise Refused(
                RefusalCode.NO_KEY,
                "this page can look on only; to change something, open the first address that "
                "'bt-agents up' or 'bt-agents studio' printed",
            )
        return role

    def _role(self, session: str) -> SessionRole:
        digest = _digest(session)
        role, used = self._sessions.get(digest, (None, 0.0))
        now = self._clock()
        if role is None or now - used > SESSION_S:
            self._sessions.pop(digest, None)
            raise Refused(
                RefusalCode.NO_SESSION,
                "open the address that 'bt-agents studio' or 'bt-agents up' has printed",
            )
        self._sessions[digest] = (role, now)
        self._sessions.move_to_end(digest)
        if now - self._noted_at > _NOTE_S:
            self._noted_at = now
            self._keep(self.text())
        return role

    def _read(
        self, kept: str
    ) -> tuple[float, dict[SessionRole, str], OrderedDict[bytes, tuple[SessionRole, float]]]:
        now = self._clock()
        new = {role: self._random_bytes(_TOKEN_BYTES).hex() for role in SessionRole}
        sessions: OrderedDict[bytes, tuple[SessionRole, float]] = OrderedDict()
        try:
            found = json.loads(kept) if len(kept) <= LARGEST_STATE else {}
            made_at = float(found["made_at"])
            tokens = {role: str(found["tokens"][role]) for role in SessionRole}
            for digest, role, used in found["sessions"][-MOST_SESSIONS * len(SessionRole) :]:
                if _HEX.fullmatch(digest) and 0 <= now - float(used) <= SESSION_S:
                    sessions[bytes.fromhex(digest)] = (SessionRole(role), float(used))
        except (KeyError, RecursionError, TypeError, ValueError):
            return now, new, OrderedDict()
        sound = math.isfinite(made_at) and all(map(_HEX.fullmatch, tokens.values()))
        different = len(set(tokens.values())) == len(tokens)
        if not (sound and different and 0 <= now - made_at <= TOKEN_S):
            return now, new, sessions
        return made_at, tokens, sessions


def security_headers(*, secure: bool) -> Mapping[str, str]:
    """Return the headers of every answer: no foreign content, no frames, no type sniffing."""
    policy = (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
        "font-src 'self'; connect-src 'self'; media-src 'self'; manifest-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    headers = {
        "Content-Security-Policy": policy,
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "DENY",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
        "Cache-Control": "no-store",
    }
    if secure:
        headers["Strict-Transport-Security"] = "max-age=31536000"
    return headers


def is_loopback(address: str) -> bool:
    """Return whether only this machine can reach an address."""
    try:
        return ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"


def _digest(session: str) -> bytes:
    return hashlib.sha256(session.encode("utf-8", "replace")).digest()
