# SPDX-License-Identifier: Apache-2.0
"""Registry of hosts and their agents, with the lease that keeps a host alive."""

from __future__ import annotations

import hmac
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from bt_agents_core.errors import Refused
from bt_agents_core.liveness import extended_after_stall, extended_lease
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.ros_names import LONGEST_NAME, is_full_name
from bt_agents_core.text import printable

_AGENT_NAME = re.compile(r"[a-z][a-z0-9_]*")

MOST_HOSTS = 100
"""Most registered hosts; a new one replaces the one that has been gone for longest."""

MOST_AGENTS = 10_000
"""Most agents of one host; more would delay the heartbeats of the market."""

SILENCE_S = 0.3
"""A host sends more than one heartbeat in this time [s]."""

FIRST_HEARTBEAT_S = 3.0
"""Extra lease of a start of a host until its first heartbeat [s].

The middleware needs time to connect the market to the heartbeat of a new host.
"""

MOST_REFUSED = 10
"""Most refused starts of hosts that the status names."""

REFUSED_S = 5.0
"""Time after which a refused start of a host that does not register again is forgotten [s]."""

TOKEN_BYTES = 16
"""Length of a token, as in ``RegisterHost.srv``."""


@dataclass(frozen=True, kw_only=True)
class Registration:
    """Request of a host to register its agents; fields as in ``RegisterHost.srv``.

    Attributes:
        token: Token of the last registration of its process; empty or zeros without one.
    """

    host: str
    instance: str
    run_action: str
    heartbeat: str
    parameters: tuple[str, ...]
    agents: tuple[str, ...]
    token: bytes = field(default=b"", repr=False)


@dataclass(frozen=True, kw_only=True)
class HostEntry:
    """Registered host; ``agents`` maps each of its agents to its id.

    Attributes:
        token: Shared by the market and this start of the host, as proof of who speaks.
    """

    host: str
    instance: str
    run_action: str
    heartbeat: str
    agents: Mapping[str, int]
    token: bytes = field(default=b"", repr=False)

    def check_token(self, token: bytes) -> None:
        """Check that a message in the name of this host carries its token.

        Raises:
            Refused: ``WRONG_TOKEN``.
        """
        if not hmac.compare_digest(token, self.token):
            raise Refused(
                RefusalCode.WRONG_TOKEN,
                f"in the name of {self.host}, without the token of its registration; a host "
                "speaks for itself, from one process",
            )


@dataclass(frozen=True, kw_only=True)
class RegistrationAnswer:
    """Answer to a registration; fields as in ``RegisterHost.srv``."""

    accepted: bool
    message: str
    agent_ids: tuple[int, ...] = ()
    reasons: tuple[str, ...] = ()
    token: bytes = field(default=b"", repr=False)


class Registry:
    """Registry of hosts by name, with unique agents.

    Ids count from 1 and are never reused. An agent keeps its id as long as a registered host, dead
    or alive, lists the agent. A host is alive for ``lease_s`` [s] after its last heartbeat or
    registration; see :data:`FIRST_HEARTBEAT_S` for a host without a heartbeat yet. The tokens of
    hosts depend on ``secret``, which no other process knows.
    """

    def __init__(self, parameters: tuple[str, ...], lease_s: float, secret: bytes) -> None:
        self.lease_s = lease_s
        self._secret = secret
        self._parameters = parameters
        self._entries: dict[str, HostEntry] = {}
        self._seen: dict[str, float] = {}
        self._heartbeat_of: dict[str, str] = {}
        # Last heartbeat, or the end of a stall of this process; not renewed like a lease.
        self._heard: dict[str, float] = {}
        self._back_since: dict[str, float] = {}
        # Host and instance → time of the refusal and its description.
        self._refused: dict[tuple[str, str], tuple[float, str]] = {}
        self._last_id = 0
        self._agents: dict[str, HostEntry] | None = None

    def register(self, registration: Registration, now: float) -> RegistrationAnswer:
        """Add, refresh or replace a host, or refuse it without any change."""
        start = registration.host[:LONGEST_NAME], registration.instance[:LONGEST_NAME]
        self._refused.pop(start, None)
        try:
            self._check_host(registration, now)
        except Refused as refused:
            if len(self._refused) < MOST_REFUSED:
                self._refused[start] = now, printable(f"{start[0]}: {refused}")
            return RegistrationAnswer(accepted=False, message=str(refused))
        held = self.agents
        agents: dict[str, int] = {}
        ids, reasons = [], []
        for name in registration.agents:
            try:
                self._check_agent(name, registration.host, agents, now)
            except Refused as refused:
                ids.append(0)
                reasons.append(f"{refused.code}: {refused.reason}")
                continue
            if name in held:
                agents[name] = held[name].agents[name]
            else:
                self._last_id += 1
                agents[name] = self._last_id
            ids.append(agents[name])
            reasons.append("")
        self._take_from_the_dead(agents, registration.host)
        token = self._token_of(registration)
        self._entries[registration.host] = HostEntry(
            host=registration.host,
            instance=registration.instance,
            run_action=registration.run_action,
            heartbeat=registration.heartbeat,
            agents=agents,
            token=token,
        )
        self._agents = None
        known = self._heartbeat_of.get(registration.host) == registration.instance
        self._seen[registration.host] = now if known else now + FIRST_HEARTBEAT_S
        refused_count = len(registration.agents) - len(agents)
        message = f"{registration.host} is registered with {len(agents)} agents"
        if refused_count:
            message += f"; {refused_count} refused"
        return RegistrationAnswer(
            accepted=True,
            agent_ids=tuple(ids),
            reasons=tuple(reasons),
            message=message,
            token=token,
        )

    def _token_of(self, registration: Registration) -> bytes:
        """Return the token of a start of a host, the same in every answer to it."""
        start = f"{registration.host} {registration.instance}".encode()
        return hmac.digest(self._secret, start, "sha256")[:TOKEN_BYTES]

    def replaceable(self, now: float) -> str:
        """Return the host to forget before another one can be added; empty for none."""
        if len(self._entries) < MOST_HOSTS:
            return ""
        longest = min(self._entries.values(), key=lambda entry: self._seen[entry.host])
        return "" if self.is_live(longest.host, longest.instance, now) else longest.host

    def remove(self, host: str) -> None:
        """Forget a host and the ids of its agents."""
        self._entries.pop(host, None)
        self._agents = None
        self._seen.pop(host, None)
        self._heartbeat_of.pop(host, None)
        self._heard.pop(host, None)
        self._back_since.pop(host, None)

    def heartbeat(self, host: str, instance: str, now: float) -> bool:
        """Take a heartbeat; return False when it is not from a registered start of a host."""
        entry = self._entries.get(host)
        if entry is None or entry.instance != instance:
            return False
        if now - self._heard.get(host, now) >= SILENCE_S:
            self._back_since[host] = now
        self._seen[host] = self._heard[host] = now
        self._heartbeat_of[host] = instance
        return True

    def extend_after_stall(self, since: float, now: float) -> None:
        """Renew the leases valid at ``since``, because heartbeats after it were not read.

        For a host that was gone by then, the stall does not count as absence.
        """
        for host, seen in self._seen.items():
            valid = since - seen < self.lease_s
            renewed = extended_after_stall(seen, self.lease_s, since, now)
            self._seen[host] = renewed if valid else seen + now - since
            if valid and host in self._heard:
                self._heard[host] = now

    def extend_leases(self, checked_at: float, now: float) -> None:
        """Extend all leases by a delay of this process since the last check."""
        for host, seen in self._seen.items():
            self._seen[host] = extended_lease(seen, self.lease_s, checked_at, now)

    def gone_s(self, host: str, now: float) -> float:
        """Return how long ago the lease of a host expired [s]; 0 or less while it is valid."""
        return now - self._seen[host] - self.lease_s

    def was_silent(self, host: str, since: float, now: float) -> bool:
        """Return whether a host was silent for a while that ended after ``since`` or still lasts.

        The while is :data:`SILENCE_S`, or the whole time since ``since`` if that is shorter.
        """
        entry = self._entries.get(host)
        if entry is None or self._heartbeat_of.get(host) != entry.instance:
            return True
        is_silent = now - self._heard[host] > min(now - since, SILENCE_S)
        return is_silent or self._back_since.get(host, -math.inf) >= since

    def entries(self) -> tuple[HostEntry, ...]:
        """Return all registered hosts, dead or alive, in order of registration."""
        return tuple(self._entries.values())

    def refused(self, now: float) -> tuple[str, ...]:
        """Return the hosts that are refused, each with "code: reason"."""
        self._refused = {one: at for one, at in self._refused.items() if now - at[0] < REFUSED_S}
        return tuple(sorted(text for _, text in self._refused.values()))

    def get(self, host: str) -> HostEntry | None:
        """Return the entry of a host; None when it is not registered."""
        return self._entries.get(host)

    @property
    def agents(self) -> Mapping[str, HostEntry]:
        """The agents of all registered hosts, dead or alive, with their hosts."""
        if self._agents is None:
            entries = self._entries.values()
            self._agents = {name: entry for entry in entries for name in entry.agents}
        return self._agents

    def is_live(self, host: str, instance: str, now: float) -> bool:
        """Return True when this start of the host is registered and within its lease."""
        entry = self._entries.get(host)
        return (
            entry is not None
            and entry.instance == instance
            and now - self._seen[host] < self.lease_s
        )

    def live(self, now: float) -> tuple[HostEntry, ...]:
        """Return the hosts within their lease."""
        return tuple(e for e in self._entries.values() if self.is_live(e.host, e.instance, now))

    def with_heartbeat(self, now: float) -> tuple[HostEntry, ...]:
        """Return the hosts within their lease that have sent a heartbeat."""
        return tuple(e for e in self.live(now) if self._heartbeat_of.get(e.host) == e.instance)

    def _check_host(self, registration: Registration, now: float) -> None:
        for what, name in (
            ("host", registration.host),
            ("run_action", registration.run_action),
            ("heartbeat", registration.heartbeat),
        ):
            if not is_full_name(name):
                raise Refused(
                    RefusalCode.BAD_NAME,
                    f"{what} is '{name[:LONGEST_NAME]}', expected a fully qualified ROS name of "
                    f"at most {LONGEST_NAME} characters such as /agents/run",
                )
        if registration.host not in self._entries and len(self._entries) >= MOST_HOSTS:
            raise Refused(
                RefusalCode.TOO_MANY_HOSTS,
                f"{len(self._entries)} hosts are alive, at most {MOST_HOSTS} may be; let one host "
                "have more agents",
            )
        if len(registration.agents) > MOST_AGENTS:
            raise Refused(
                RefusalCode.TOO_MANY_AGENTS,
                f"{registration.host} has {len(registration.agents)} agents, at most "
                f"{MOST_AGENTS} may be in one host; start more hosts",
            )
        if not registration.instance:
            raise Refused(
                RefusalCode.EMPTY,
                "host_instance is empty; give every start of the host another one",
            )
        if registration.parameters != self._parameters:
            raise Refused(
                RefusalCode.OTHER_PARAMETERS,
                f"{registration.host} has the scene parameters "
                f"{', '.join(registration.parameters) or '(none)'}, the market has "
                f"{', '.join(self._parameters)}; both must read the same scene.yaml",
            )
        held = self._entries.get(registration.host)
        if held is not None and self.is_live(held.host, held.instance, now):
            self._check_owner(held, registration)

    def _check_owner(self, held: HostEntry, registration: Registration) -> None:
        """Check that a registration is from the process of a live host of the same name."""
        is_same_start = held.instance == registration.instance
        if is_same_start and self._heartbeat_of.get(held.host) != held.instance:
            return  # it may not have read the answer with its token
        try:
            held.check_token(registration.token)
        except Refused:
            if is_same_start:
                raise
            raise Refused(
                RefusalCode.HOST_EXISTS,
                f"another {registration.host} is alive (instance {held.instance}); "
                "start one host of a name, or give this one another name",
            ) from None

    def _check_agent(self, name: str, host: str, accepted: Mapping[str, int], now: float) -> None:
        if len(name) > LONGEST_NAME or not _AGENT_NAME.fullmatch(name):
            raise Refused(
                RefusalCode.BAD_NAME,
                f"'{name[:LONGEST_NAME]}' is not an agent name; it starts with a small letter and "
                f"goes on with small letters, digits and _, {LONGEST_NAME} characters at most",
            )
        if name in accepted:
            raise Refused(RefusalCode.DUPLICATE, f"'{name}' stands twice in the list of {host}")
        holder = self.agents.get(name)
        if (
            holder is not None
            and holder.host != host
            and self.is_live(holder.host, holder.instance, now)
        ):
            raise Refused(
                RefusalCode.AGENT_EXISTS,
                f"'{name}' is held by {holder.host}, which is alive; agent names are unique",
            )

    def _take_from_the_dead(self, agents: Mapping[str, int], host: str) -> None:
        for other in tuple(self._entries.values()):
            if other.host != host and not agents.keys().isdisjoint(other.agents):
                left = {n: i for n, i in other.agents.items() if n not in agents}
                self._entries[other.host] = replace(other, agents=left)
