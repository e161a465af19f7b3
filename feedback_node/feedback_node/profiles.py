# SPDX-License-Identifier: Apache-2.0
"""The current profiles of all known agents, and the one place where feedback changes them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from bt_agents.errors import Refused
from bt_agents.feedback import Kind
from bt_agents.scene import MISSING, SceneSpace, Vector
from feedback_node import learning
from feedback_node.cards import Agent, Card, read_card
from feedback_node.ledger import Cause, Ledger, Revision
from feedback_node.runs import Run

MOST_HOSTS = 100
"""Hosts whose agents are known at once."""

_LONGEST_TEXT = 1000
_RULES = {
    Kind.DIRECT: learning.direct,
    Kind.POSITIVE: learning.positive,
    Kind.NEGATIVE: learning.negative,
    Kind.SET: learning.assigned,
}


@dataclass(frozen=True, kw_only=True)
class Change:
    """Feedback that is recorded; vectors in the order of the space, NaN for what was not there.

    Attributes:
        revision: Row of the ledger, with agent, cause and time.
        before: Profile before.
        after: Profile after.
        target: Vector moved towards or away from; NaN for no opinion.
        fresh: False when the same feedback had been recorded earlier and was not applied again.
        words: The change in words and numbers.
    """

    revision: Revision
    before: Vector
    after: Vector
    target: Vector
    fresh: bool
    words: str


Table = tuple[tuple[str, int, Vector], ...]
"""Name, revision and profile of every known agent, by name."""


@dataclass(frozen=True, kw_only=True)
class Delivery:
    """A profile that a host is to bid with from now on."""

    host: str
    agent: str
    values: Vector
    revision: int


class Profiles:
    """Knows the agents of all hosts' cards and keeps their profiles in the ledger."""

    def __init__(self, space: SceneSpace, ledger: Ledger) -> None:
        self.space = space
        self._ledger = ledger
        self._agents: dict[str, Agent] = {}
        self._starts: dict[str, str] = {}
        self._current: dict[str, Revision] = {}

    def introduce(self, card: Card) -> tuple[tuple[Delivery, ...], tuple[str, ...]]:
        """Take a host's card.

        One without agents is of a start that the market does not have: it takes nothing away from
        another start of the same name.

        Returns:
            What the host has yet to learn, and the problems of its agents in words.

        Raises:
            Refused: The card as a whole is not taken: ``TOO_MANY_HOSTS``, or see
                :func:`read_card` and :meth:`Ledger.enter`.
        """
        agents, problems = read_card(card, self.space)
        hosts = self.hosts
        if not card.agents and self._starts.get(card.host, card.instance) != card.instance:
            return (), ()
        if card.host not in hosts and len(hosts) >= MOST_HOSTS:
            raise Refused(
                "TOO_MANY_HOSTS",
                f"card of {card.host}: agents of {len(hosts)} hosts are known, expected "
                f"{MOST_HOSTS} at most; restart the feedback node when most of them are gone",
            )
        news = {
            agent.name: self._named(agent.authored)
            for agent in agents
            if agent.name not in self._agents
            or self._agents[agent.name].authored != agent.authored
        }
        entered = self._ledger.enter(news) if news else {}
        listed = {agent.name for agent in agents}
        for name, known in list(self._agents.items()):
            if known.host == card.host and name not in listed:
                del self._agents[name], self._current[name]
        self._starts = {host: start for host, start in self._starts.items() if host in hosts}
        self._starts[card.host] = card.instance
        self._current.update(entered)
        deliveries, more = [], []
        for agent in agents:
            known_host = (
                self._agents[agent.name].host if agent.name in self._agents else agent.host
            )
            if known_host != agent.host:
                more.append(
                    f"TWO_HOSTS: '{agent.name}' was at {known_host}, now it is at {agent.host}; "
                    f"what it learns goes there"
                )
            self._agents[agent.name] = agent
            revision = self._current[agent.name].revision
            if agent.held < revision:
                deliveries.append(self.delivery(agent.name))
            elif agent.held > revision:
                more.append(
                    f"STALE_LEDGER: {agent.host} holds revision {agent.held} of '{agent.name}', "
                    f"the ledger ends at {revision}; restart the host, or put its ledger back"
                )
        return tuple(deliveries), (*problems, *more)

    def agent(self, name: str) -> Agent:
        """Return a known agent.

        Raises:
            Refused: ``UNKNOWN_AGENT``.
        """
        if name not in self._agents:
            known = ", ".join(sorted(self._agents)) or "none yet"
            raise Refused("UNKNOWN_AGENT", f"no agent '{name}'; known are: {known}")
        return self._agents[name]

    @property
    def hosts(self) -> frozenset[str]:
        """The hosts at which agents are known."""
        return frozenset(agent.host for agent in self._agents.values())

    def knows(self, name: str) -> bool:
        """Return True when a card has introduced the agent."""
        return name in self._agents

    def profile(self, name: str) -> Vector:
        """Return the current profile of a known agent."""
        values, authored = self._current[name].profile, self._agents[name].authored
        return self.space.clamp(
            [values.get(key, own) for key, own in zip(self.space.names, authored, strict=True)]
        )

    def delivery(self, name: str) -> Delivery:
        """Return what the host of a known agent is to be told."""
        return Delivery(
            host=self._agents[name].host,
            agent=name,
            values=self.profile(name),
            revision=self._current[name].revision,
        )

    def table(self) -> Table:
        """Return name, revision and profile of every known agent, by name."""
        return tuple(
            (name, self._current[name].revision, self.profile(name))
            for name in sorted(self._agents)
        )

    def recorded_of(self, prefix: str) -> Mapping[str, int]:
        """Return agent → how many of its changes have a feedback id that begins so."""
        return self._ledger.count(prefix)

    def recorded(self, feedback_id: str) -> Change | None:
        """Return the change that a feedback led to; None for a new id."""
        revision = self._ledger.find(feedback_id)
        if revision is None:
            return None
        words = f"recorded before as revision {revision.revision}, not applied again"
        return self._change(revision, self._ledger.before(revision), fresh=False, words=words)

    def apply(
        self,
        name: str,
        kind: Kind,
        target: Vector,
        *,
        feedback_id: str,
        source: str,
        reason: str,
        run: Run | None,
        cancels: bool = False,
    ) -> Change:
        """Move an agent's profile and record it; the same id is applied once.

        Args:
            name: Whose profile.
            kind: Which way.
            target: Wanted profile or scene, NaN for no opinion.
            feedback_id: Unique.
            source: Who gave it.
            reason: Why, in words.
            run: The run that it belongs to, if any.
            cancels: True when the run is stopped because of it.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``TOO_LONG``, or as in :mod:`feedback_node.learning` and
                :meth:`Ledger.append`; nothing has changed.
        """
        if (known := self.recorded(feedback_id)) is not None:
            return known
        agent = self.agent(name)
        for field, text in (("feedback_id", feedback_id), ("source", source), ("reason", reason)):
            if len(text) > _LONGEST_TEXT:
                raise Refused(
                    "TOO_LONG",
                    f"feedback: {field} has {len(text)} characters, "
                    f"expected {_LONGEST_TEXT} at most",
                )
        step = _RULES[kind](self.profile(name), target, agent.rate, self.space)
        cause = Cause(
            kind=kind,
            source=source,
            reason=reason,
            feedback_id=feedback_id,
            epoch=run.epoch if run else "",
            round=run.round if run else 0,
            rate=step.rate,
            target=self._named(step.target),
            scene_id=run.scene.scene_id if run else "",
            cancels=cancels,
        )
        before = self._current[name]
        self._current[name] = self._ledger.append(name, self._named(step.after), cause)
        return self._change(self._current[name], before, fresh=True, words=step.words)

    def _change(self, revision: Revision, before: Revision, *, fresh: bool, words: str) -> Change:
        return Change(
            revision=revision,
            before=self._vector(before.profile),
            after=self._vector(revision.profile),
            target=self._vector(revision.cause.target),
            fresh=fresh,
            words=words,
        )

    def _named(self, vector: Vector) -> dict[str, float]:
        return {
            name: value
            for name, value in zip(self.space.names, vector, strict=True)
            if not math.isnan(value)
        }

    def _vector(self, values: Mapping[str, float]) -> Vector:
        return tuple(values.get(name, MISSING) for name in self.space.names)
