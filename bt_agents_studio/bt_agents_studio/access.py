# SPDX-License-Identifier: Apache-2.0
"""Access to a studio: start tokens, sessions with a role, and which requests are answered."""

from __future__ import annotations

import hashlib
import hmac
from collections import OrderedDict
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from enum import IntEnum
from ipaddress import ip_address

from bt_agents_core.errors import Refused

COOKIE = "bt_agents_studio"
"""Name of the cookie that holds the id of a session."""

LARGEST_BODY = 256 * 1024
"""Bytes of the body of a request."""

MOST_SESSIONS = 200
"""Sessions that are known; the one that was used longest ago is forgotten first."""

SESSION_S = 7 * 24 * 3600.0
"""Time after which a session that is not used ends [s]."""

_TOKEN_BYTES = 32
_JSON = "application/json"


class SessionRole(IntEnum):
    """What a session may do; one that may more has the larger number."""

    VIEW = 1
    """See everything, change nothing."""
    OPERATE = 2
    """Stop, give feedback, pin, veto, announce scenes and tune."""


@dataclass(frozen=True, kw_only=True)
class WebRequest:
    """What of an HTTP request decides whether it is answered; empty texts for what is not sent."""

    method: str
    host: str
    origin: str
    fetch_site: str
    content_type: str
    session: str


class AccessControl:
    """Tokens, sessions and the rules for requests.

    Args:
        hosts: Names and addresses with port by which the studio may be called, for example
            ``127.0.0.1:8770``; a browser that was led to the studio by another name is refused.
        scheme: ``http`` or ``https``.
        random_bytes: Source of secrets.
        clock: A clock that never goes back [s].
    """

    def __init__(
        self,
        hosts: Collection[str],
        *,
        scheme: str,
        random_bytes: Callable[[int], bytes],
        clock: Callable[[], float],
    ) -> None:
        self._hosts = hosts
        self._scheme = scheme
        self._random_bytes = random_bytes
        self._clock = clock
        self._tokens: dict[SessionRole, str] = {
            role: random_bytes(_TOKEN_BYTES).hex() for role in SessionRole
        }
        # Digest of the id of a session → its role and when it was used last.
        self._sessions: OrderedDict[bytes, tuple[SessionRole, float]] = OrderedDict()

    def token(self, role: SessionRole) -> str:
        """Return the start token of a role, 256 bit in hexadecimal digits."""
        return self._tokens[role]

    def log_in(self, token: str) -> str:
        """Return the id of a new session with the role of a start token.

        Raises:
            Refused: ``BAD_TOKEN``.
        """
        # All are compared, so that the time says nothing.
        fitting = [
            role
            for role, own in self._tokens.items()
            if hmac.compare_digest(own.encode(), token.encode("utf-8", "replace"))
        ]
        if not fitting:
            raise Refused(
                "BAD_TOKEN",
                "this address is not, or no longer, the one of this studio; take the one that "
                "'bt-agents studio' or 'bt-agents up' has printed",
            )
        session = self._random_bytes(_TOKEN_BYTES).hex()
        self._sessions[_digest(session)] = (fitting[0], self._clock())
        while len(self._sessions) > MOST_SESSIONS:
            self._sessions.popitem(last=False)
        return session

    def log_out(self, session: str) -> None:
        """End a session."""
        self._sessions.pop(_digest(session), None)

    def check_address(self, request: WebRequest) -> None:
        """Refuse a request that a foreign page may have made.

        Raises:
            Refused: ``FOREIGN_HOST`` or ``FOREIGN_ORIGIN``.
        """
        if request.host not in self._hosts:
            raise Refused("FOREIGN_HOST", f"this studio is not called '{request.host[:80]}'")
        own = f"{self._scheme}://{request.host}"
        if request.origin and request.origin != own:
            raise Refused("FOREIGN_ORIGIN", f"a page of '{request.origin[:80]}' may not ask this")
        if request.fetch_site not in ("", "same-origin", "none"):
            raise Refused("FOREIGN_ORIGIN", "a page of another site may not ask this")

    def check(self, request: WebRequest, needed: SessionRole) -> SessionRole:
        """Return the role of a request; it has to have at least the one that is needed.

        Raises:
            Refused: As by :meth:`check_address`; ``NO_SESSION``, ``FORBIDDEN``, and for what
                changes something ``NO_ORIGIN`` or ``NOT_JSON``.
        """
        self.check_address(request)
        role = self._role(request.session)
        if role < needed:
            raise Refused(
                "FORBIDDEN",
                f"this needs the role {needed.name.lower()}, the session has {role.name.lower()}",
            )
        if request.method not in ("GET", "HEAD"):
            if not request.origin:
                raise Refused("NO_ORIGIN", "a change needs the header Origin")
            if request.content_type.partition(";")[0].strip().lower() != _JSON:
                raise Refused("NOT_JSON", f"expected the content type {_JSON}")
        return role

    def check_socket(self, request: WebRequest) -> SessionRole:
        """Return the role of a request for a WebSocket.

        Raises:
            Refused: As by :meth:`check`; a browser always sends ``Origin`` here.
        """
        self.check_address(request)
        if not request.origin:
            raise Refused("NO_ORIGIN", "a WebSocket needs the header Origin")
        return self._role(request.session)

    def _role(self, session: str) -> SessionRole:
        digest = _digest(session)
        role, used = self._sessions.get(digest, (None, 0.0))
        now = self._clock()
        if role is None or now - used > SESSION_S:
            self._sessions.pop(digest, None)
            raise Refused(
                "NO_SESSION",
                "open the address that 'bt-agents studio' or 'bt-agents up' has printed",
            )
        self._sessions[digest] = (role, now)
        self._sessions.move_to_end(digest)
        return role


def security_headers(*, secure: bool) -> Mapping[str, str]:
    """Return the headers of every answer: no foreign content, no frames, no guessing of types."""
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
    """Return whether an address is one of this machine only."""
    try:
        return ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"


def _digest(session: str) -> bytes:
    return hashlib.sha256(session.encode("utf-8", "replace")).digest()
