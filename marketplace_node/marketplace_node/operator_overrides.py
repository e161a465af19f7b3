# SPDX-License-Identifier: Apache-2.0
"""Operator overrides: the pinned agent, the vetoed agents, and awards of scenes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.round.decision import RefusedBid, RoundKind


class OperatorAction(IntEnum):
    """Action of an operator; the numbers match ``OperateMarket.srv``."""

    PIN = 0
    UNPIN = 1
    VETO = 2
    ALLOW = 3
    AWARD = 4


@dataclass(frozen=True, kw_only=True)
class OperatorCommand:
    """Command of an operator; fields as in ``OperateMarket.srv``.

    ``scene`` is the scene of ``AWARD``; None means the last one.
    """

    action: OperatorAction
    agent: str = ""
    author: str = ""
    reason: str = ""
    scene: Scene | None = None

    @property
    def who(self) -> str:
        """Author of the command, else ``the operator``."""
        return self.author or "the operator"

    @property
    def because(self) -> str:
        """The reason as the end of a sentence; empty without a reason."""
        return f": {self.reason}" if self.reason else ""


@dataclass(frozen=True, kw_only=True)
class ActiveOverride:
    """Operator's pin or award: the agent, and the order in words."""

    agent: str
    text: str


class OperatorOverrides:
    """The operator overrides in force."""

    def __init__(self) -> None:
        self._pin: ActiveOverride | None = None
        self._vetoes: dict[str, str] = {}
        self._awards: dict[str, ActiveOverride] = {}

    @property
    def pinned(self) -> str:
        """The only agent that may bid; empty for all."""
        return self._pin.agent if self._pin else ""

    @property
    def vetoed(self) -> tuple[str, ...]:
        """The vetoed agents, sorted by name."""
        return tuple(sorted(self._vetoes))

    def to_dict(self) -> dict[str, Any]:
        """Return pins and vetoes for :meth:`restore`; awards end with their scenes."""
        pin = {"agent": self._pin.agent, "words": self._pin.text} if self._pin else None
        return {"pinned": pin, "vetoed": dict(self._vetoes)}

    def restore(self, stored: Mapping[str, Any]) -> None:
        """Replace the pins and vetoes in force by an earlier market's.

        Raises:
            KeyError, TypeError, AttributeError: ``stored`` has not the form of :meth:`to_dict`;
                nothing is changed.
        """
        pin, vetoes = stored["pinned"], stored["vetoed"]
        active = None
        if pin is not None:
            active = ActiveOverride(
                agent=_checked_text(pin["agent"]), text=_checked_text(pin["words"])
            )
        texts = {_checked_text(agent): _checked_text(text) for agent, text in vetoes.items()}
        self._pin, self._vetoes = active, texts

    def veto_of(self, agent: str) -> str:
        """Return the veto of an agent as text; empty without one."""
        return self._vetoes.get(agent, "")

    def pin(self, command: OperatorCommand) -> str:
        """Let only one agent bid; return the answer for the operator.

        Raises:
            Refused: ``VETOED``.
        """
        self._check_not_vetoed(command.agent)
        self._pin = ActiveOverride(
            agent=command.agent, text=f"{command.who} pins {command.agent}{command.because}"
        )
        return f"only {command.agent} may bid from the next round on, until it is unpinned"

    def unpin(self) -> str:
        """Let all agents bid again; return the answer for the operator.

        Raises:
            Refused: ``NOT_PINNED``.
        """
        if self._pin is None:
            raise Refused(RefusalCode.NOT_PINNED, "no agent is pinned; all may bid")
        agent, self._pin = self._pin.agent, None
        return f"{agent} is not pinned any more: all agents may bid from the next round on"

    def veto(self, command: OperatorCommand) -> str:
        """Exclude an agent from bidding; return the answer for the operator."""
        self._vetoes[command.agent] = f"{command.who} vetoes {command.agent}{command.because}"
        also = f"; it is pinned, too, so nobody may bid: unpin {command.agent}"
        return f"{command.agent} may not bid" + (also if command.agent == self.pinned else "")

    def allow(self, command: OperatorCommand) -> str:
        """Let an agent bid again; return the answer for the operator.

        Raises:
            Refused: ``NOT_VETOED``.
        """
        if command.agent not in self._vetoes:
            vetoed = f"vetoed: {', '.join(self.vetoed)}" if self._vetoes else "nobody is"
            raise Refused(RefusalCode.NOT_VETOED, f"'{command.agent}' is not vetoed; {vetoed}")
        del self._vetoes[command.agent]
        return f"{command.agent} may bid again from the next round on"

    def check_award(self, command: OperatorCommand) -> None:
        """Check that an agent may be awarded the run for a scene.

        Raises:
            Refused: ``VETOED``, or ``NOT_PINNED`` while another agent is pinned.
        """
        self._check_not_vetoed(command.agent)
        if self.pinned not in ("", command.agent):
            raise Refused(
                RefusalCode.NOT_PINNED,
                f"only {self.pinned} may bid, as it is pinned; unpin it before another agent is "
                "given a run",
            )

    def award(self, command: OperatorCommand, scene_id: str) -> None:
        """Award the run for a queued scene to one agent."""
        self._awards[scene_id] = ActiveOverride(
            agent=command.agent,
            text=f"{command.who} gives the run to {command.agent}{command.because}",
        )

    def award_of(self, scene_id: str) -> ActiveOverride | None:
        """Return the award of a scene; None for none."""
        return self._awards.get(scene_id)

    def restore_award(self, scene_id: str, award: ActiveOverride) -> None:
        """Restore the award of a scene from an earlier market."""
        self._awards[scene_id] = award

    def forget(self, scene_id: str) -> None:
        """Forget the award of a scene that is over."""
        self._awards.pop(scene_id, None)

    def intervention(self, scene_id: str) -> str:
        """Return the overrides that apply to a round as text; empty for none."""
        award = self._awards.get(scene_id)
        active = [one.text for one in (award, self._pin) if one is not None]
        return "; ".join([*active, *(self._vetoes[agent] for agent in self.vetoed)])

    def may_bid(self, agent: str, scene_id: str) -> bool:
        """Return whether the overrides let an agent bid for a scene."""
        return not any(self._exclusions(agent, self._awards.get(scene_id)))

    def excluded(self, hosts: Iterable[HostEntry], scene_id: str) -> tuple[RefusedBid, ...]:
        """Return the agents of these hosts that may not bid in a round, with the reason."""
        award = self._awards.get(scene_id)
        if award is None and self._pin is None and not self._vetoes:
            return ()
        return tuple(
            RefusedBid(
                agent=agent, host=entry.host, kind=RoundKind.REFUSED, code=code, reason=reason
            )
            for entry in hosts
            for agent in entry.agents
            for code, reason in self._exclusions(agent, award)
        )

    def _exclusions(self, agent: str, award: ActiveOverride | None) -> Iterator[tuple[str, str]]:
        if agent in self._vetoes:
            yield RefusalCode.VETOED, self._vetoes[agent]
        elif award is not None and award.agent != agent:
            yield RefusalCode.NOT_AWARDED, award.text
        elif self._pin is not None and self._pin.agent != agent:
            yield RefusalCode.NOT_PINNED, self._pin.text

    def _check_not_vetoed(self, agent: str) -> None:
        if agent in self._vetoes:
            raise Refused(
                RefusalCode.VETOED,
                f"'{agent}' may not bid ({self._vetoes[agent]}); allow it first",
            )


def _checked_text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError("not a text")
    return value
