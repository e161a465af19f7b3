# SPDX-License-Identifier: Apache-2.0
"""State shared by all rounds: settings, registered hosts, statistics, pending effects."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial

from bt_agents_core.errors import Refused
from bt_agents_core.health import PartHealth
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_language.files.market_reader import MarketRule
from marketplace_node.effects import (
    Alarm,
    CancelAll,
    CancelGoal,
    Disconnect,
    Effect,
    PublishAuction,
    RunGoal,
    StoreOverrides,
)
from marketplace_node.explanation.explanation import explanation
from marketplace_node.goal_takeover import GoalTakeover
from marketplace_node.health import hosts_health
from marketplace_node.operator_overrides import OperatorOverrides
from marketplace_node.registry import HostEntry, Registry
from marketplace_node.round.decision import Decision, Terms, UndecidedRule
from marketplace_node.settings import RULES, Settings
from marketplace_node.statistics import MarketStatistics, counts

PREVIEWS = 2**31
"""Numbers of previews begin after this one, so they do not consume numbers of real rounds."""

_CANCEL_AGAIN_S = 1.0
_CONFIRMED_S = 0.3  # the heartbeat of a run may arrive after its end
_OF_ANOTHER = "it still runs a tree for another market"


@dataclass(eq=False, kw_only=True)
class _OrphanRun:
    """Orphan: a tree that runs at a host without an award of this market.

    Attributes:
        instance: The start of its host.
        reason: Why its host is not free.
        goal: Its goal; None when unknown.
        blocks: True when its host must not be asked, because it is certainly not free.
        running_since: When the host first reported it, steady time [s]; None before.
        cancelled_at: When it was last cancelled, steady time [s]; None before.
    """

    instance: str
    reason: str
    goal: RunGoal | None = None
    blocks: bool = True
    running_since: float | None = None
    cancelled_at: float | None = None


class MarketState:
    """State shared by all rounds, and the hosts that orphaned runs block.

    Attributes:
        epoch: Name of this instance of the market.
        effects: Pending effects, in order.
        rounds: Number of rounds so far, which is the number of the last one.
        previews: Number of previews so far.
        last_scene: The latest scene; None before the first.
        takeover: Goals that hosts have open at servers.
        earlier_hosts: Hosts that were alive at the end of the earlier market; empty for unknown.
    """

    def __init__(
        self,
        space: SceneSpace,
        epoch: str,
        settings: Settings,
        rules: tuple[MarketRule, ...],
        new_key: Callable[[], bytes],
    ) -> None:
        self.space = space
        self.epoch = epoch
        self._undecided: tuple[UndecidedRule, ...] = ()
        self.settings = settings
        self.registry = Registry(space.names, settings.host_lease_s, new_key)
        self.overrides = OperatorOverrides()
        self.effects: list[Effect] = []
        self.record = MarketStatistics()
        self.rounds = 0
        self.previews = 0
        self.last_scene: Scene | None = None
        self.takeover = GoalTakeover()
        self.earlier_hosts: frozenset[str] = frozenset()
        self._rules = rules
        self._orphans: dict[str, _OrphanRun] = {}
        self._unheard: set[str] = set()
        self._starved: tuple[tuple[str, ...], Collection[str], tuple[str, ...]] | None = None

    def terms(
        self,
        scene: Scene,
        now: float,
        *,
        follows: int,
        excluded: Mapping[str, str],
        preview: str | None = None,
        drawn: int = 0,
    ) -> Terms:
        """Count a new round and return its fixed terms.

        Args:
            scene: What the bids are for.
            now: Steady time [s].
            follows: The round that this one continues; 0 for none.
            excluded: Agents that may not bid, with the reason.
            preview: Strategy of a preview of the next round, which uses the same random draw;
                None for a real round.
            drawn: Number of the round whose random draw it reuses; 0 for a draw of its own.
        """
        if preview is None:
            self.rounds += 1
            number = self.rounds
            drawn = drawn or number
        else:
            self.previews += 1
            number, drawn = PREVIEWS + self.previews, self.rounds + 1
        settings = self.settings
        strategy = settings.strategy if preview is None else preview
        # An award by an operator covers the first run; if that is lost, any agent may take over.
        awarded = "" if follows else scene.scene_id
        return Terms(
            epoch=self.epoch,
            round=number,
            follows=follows,
            scene=scene,
            strategy=strategy,
            options=settings.options_of(strategy),
            shadow=settings.shadow_strategy,
            shadow_options=settings.options_of(settings.shadow_strategy),
            seed=f"{self.epoch}/{drawn}",
            tie_break=settings.tie_break,
            rules=self._rules,
            excluded=dict(excluded),
            operator_exclusions=self.overrides.excluded(self.registry.live(now), awarded),
            intervention=self.overrides.intervention(awarded),
            unasked=self._unasked(now),
            last_run=dict(self.record.last_run),
            runs=dict(self.record.runs),
            rounds_run=self.record.runs.total(),
            earlier_runs=self.record.earlier_runs,
            preview=preview is not None,
        )

    def outcome(self, decision: Decision, reason_fn: Callable[[], str]) -> PublishAuction:
        """Return a decision in its published form, with the current statistics."""
        return PublishAuction(
            decision=decision,
            reason_fn=reason_fn,
            explanation_fn=partial(explanation, decision, self.space),
            shadow_rounds=self.record.shadow_rounds,
            shadow_disagreements=self.record.shadow_disagreements,
        )

    def publish(self, decision: Decision, reason_fn: Callable[[], str]) -> None:
        """Count a decision and publish it with the line that ``reason_fn`` formats."""
        self.record.take(decision)
        self._take_undecided(decision)
        self.effects.append(self.outcome(decision, reason_fn))

    def _take_undecided(self, decision: Decision) -> None:
        """Store the undecided rules, if the round has evaluated rules."""
        looked_at = RULES in (decision.terms.strategy, decision.terms.shadow)
        if not looked_at or not decision.ranked.bidders:
            return
        before, self._undecided = self._undecided, decision.ranked.undecided
        new = (one for one in self._undecided if one not in before)
        self.effects += [Alarm(message=one.message) for one in new]

    def undecided(self) -> tuple[UndecidedRule, ...]:
        """Return the rules that were undecided when they were last evaluated."""
        in_force = RULES in (self.settings.strategy, self.settings.shadow_strategy)
        return self._undecided if in_force else ()

    def starved(self) -> tuple[str, ...]:
        """Return the registered agents that bid repeatedly and never run."""
        starved = self.record.starvation.starved(self.settings.starvation_rounds)
        if not starved:
            return ()
        agents, known = self.registry.agents, self._starved
        if known is None or known[0] != starved or known[1] is not agents:
            known = (starved, agents, tuple(agent for agent in starved if agent in agents))
            self._starved = known
        return known[2]

    def count_run(self, agent: str, decision: Decision) -> None:
        """Count and store a run of an agent: the winner, or the next one that accepted."""
        self.record.count_run(agent, decision.ranked.bidders)
        newly_starved = self.record.starvation.newly_starved(self.settings.starvation_rounds)
        self.effects += [Alarm(message=one) for one in newly_starved]
        self.store()

    def store(self, *, at_once: bool = False) -> None:
        """Store what outlives this start of the market; at once if an operator waits for it."""
        stored = {
            **self.overrides.to_dict(),
            "runs": self.record.runs,
            "last_run": self.record.last_run,
            "in_vain": self.record.starvation.in_vain,
        }
        text = json.dumps(stored, ensure_ascii=False)
        self.effects.append(StoreOverrides(text=text, at_once=at_once))

    def restore(self, text: str) -> None:
        """Restore what an earlier start of the market stored.

        Raises:
            Refused: ``MALFORMED``; nothing is changed.
        """
        try:
            stored = json.loads(text)
            found = [counts(stored.get(name, {})) for name in ("runs", "last_run", "in_vain")]
            self.overrides.restore(stored)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise Refused(
                "MALFORMED",
                "the stored pins, vetoes and counts cannot be read, so none counts; set pins and "
                "vetoes again",
            ) from None
        self.record.restore(*found)

    def asked(self, excluded: Collection[str], now: float) -> list[HostEntry]:
        """Return the hosts to ask: free ones with an agent that may bid."""
        unasked, names = self._unasked(now), set(excluded)
        return [
            entry
            for entry in self.registry.entries()
            if entry.host not in unasked and not entry.agents.keys() <= names
        ]

    def earlier_hosts_back(self, now: float) -> bool:
        """Return whether all hosts of the earlier market are known to be back."""
        if not self.earlier_hosts:
            return False
        return self.earlier_hosts <= {one.host for one in self.registry.with_heartbeat(now)}

    def health(self, now: float) -> PartHealth:
        """Return the health of the registered hosts."""
        agents = {entry.host: len(entry.agents) for entry in self.registry.entries()}
        return hosts_health(agents, self._unasked(now))

    def _unasked(self, now: float) -> dict[str, str]:
        """Return the hosts that cannot be asked, with the reason."""
        reasons = ((entry.host, self._absence(entry, now)) for entry in self.registry.entries())
        return {host: reason for host, reason in reasons if reason}

    def _absence(self, entry: HostEntry, now: float) -> str:
        """Return why a host cannot be asked; empty when it can."""
        if not self.registry.is_live(entry.host, entry.instance, now):
            return "it has no heartbeat"
        if entry.host in self._unheard:
            return "it has not answered, and had no heartbeat since"
        return self._blocked(entry.host)

    def unheard(self, host: str) -> None:
        """Do not ask a host that left a call or goal unanswered before its next heartbeat."""
        self._unheard.add(host)

    def expected(self, now: float) -> dict[str, str]:
        """Return the hosts that cannot be asked but soon may be, with the reason.

        A host that is gone is expected back within ``host_wait_s``; the tree of a busy host is
        expected to end within ``cancel_deadline_s``. With a ``host_wait_s`` of 0 no host is
        expected.
        """
        expected: dict[str, str] = {}
        if self.settings.host_wait_s == 0:
            return expected
        for entry in self.registry.entries():
            reason = self._absence(entry, now)
            if reason and self._may_return(entry, now):
                expected[entry.host] = reason
        return expected

    def _may_return(self, entry: HostEntry, now: float) -> bool:
        if not self.registry.is_live(entry.host, entry.instance, now):
            return self.registry.gone_s(entry.host, now) < self.settings.host_wait_s
        orphan = self._orphans.get(entry.host)
        since = orphan.running_since if orphan is not None else None
        return since is None or now - since < self.settings.cancel_deadline_s

    def can_ask(
        self,
        scene_id: str,
        excluded: Collection[str],
        but: Collection[tuple[str, str]],
        now: float,
    ) -> bool:
        """Return whether a host outside ``but`` can be asked about a scene."""
        return any(
            (entry.host, entry.instance) not in but
            and not self._absence(entry, now)
            and self.may_run(entry, scene_id, excluded)
            for entry in self.registry.entries()
        )

    def may_run(self, entry: HostEntry, scene_id: str, excluded: Collection[str]) -> bool:
        """Return whether a host has an agent that may bid for a scene."""
        return any(
            agent not in excluded and self.overrides.may_bid(agent, scene_id)
            for agent in entry.agents
        )

    def obstacle(self, goal: RunGoal, now: float) -> str:
        """Return why a goal cannot be sent; empty when it can."""
        if not self.registry.is_live(goal.host, goal.instance, now):
            return f"{goal.host} is gone"
        if veto := self.overrides.veto_of(goal.agent):
            return veto
        reason = self._blocked(goal.host)
        return f"{goal.host} is not free: {reason}" if reason else ""

    def hold(self, host: str, now: float) -> str:
        """Return why no run may start at a host yet; empty when one may.

        The wait is bounded: a tree that does not stop holds others up no longer than
        ``cancel_deadline_s``, and a host without a heartbeat only by the goals that it left open.
        """
        self.take_over_goals(now)
        return self.takeover.obstacle() or self._other_host_busy(host, now)

    def take_over_goals(self, now: float) -> None:
        """Cancel the goals that lost hosts left open."""
        self.effects += self.takeover.lost(
            lambda host, instance: self.registry.is_live(host, instance, now),
            self.settings.takeover_deadline_s,
            now,
        )

    def lose_goals(self, goal: RunGoal) -> tuple[str, ...]:
        """Cancel the goals that a lost run left open; return the nodes that sent them."""
        self.effects += self.takeover.lose(
            goal.host, goal.instance, self.settings.takeover_deadline_s
        )
        return self.takeover.orphans(goal.host, goal.instance)

    def _other_host_busy(self, host: str, now: float) -> str:
        for other, orphan in self._orphans.items():
            if (
                other != host
                and orphan.running_since is not None
                and now - orphan.running_since < self.settings.cancel_deadline_s
                and self.registry.is_live(other, orphan.instance, now)
            ):
                return f"{other} has not stopped: {orphan.reason}"
        return ""

    def give_up(self, goal: RunGoal, reason: str, now: float, *, runs: bool) -> None:
        """Cancel a goal that is no longer awaited, and block its host until the tree has ended.

        ``reason`` says why the host is not free; ``runs`` is True when it has accepted the goal.
        """
        entry = self.registry.get(goal.host)
        if entry is not None and entry.instance == goal.instance:
            self._orphans[goal.host] = _OrphanRun(
                instance=goal.instance,
                reason=reason,
                goal=goal,
                running_since=now if runs else None,
                cancelled_at=now,
            )
        self.effects.append(CancelGoal(goal=goal))

    def ended(self, goal: RunGoal) -> None:
        """Free the host of a given-up goal that has ended."""
        orphan = self._orphans.get(goal.host)
        if orphan is not None and orphan.goal == goal:
            del self._orphans[goal.host]

    def free(self, host: str) -> None:
        """Free a host."""
        self._orphans.pop(host, None)
        self._unheard.discard(host)

    def forget(self, host: str) -> None:
        """Forget a host and disconnect from it."""
        self.registry.remove(host)
        self.free(host)
        self.effects.append(Disconnect(host=host))

    def extend_after_stall(self, since: float, now: float) -> None:
        """Renew leases and move deadlines, because the market was stalled since ``since``."""
        self.registry.extend_after_stall(since, now)
        self.takeover.extend_after_stall(now - since)
        for orphan in self._orphans.values():
            if orphan.running_since is not None:
                orphan.running_since += now - since

    def heartbeat(
        self, host: str, epoch: str, round_number: int, award: RunGoal | None, now: float
    ) -> None:
        """Compare the run that a host reports with its award; round 0 means no run."""
        self._unheard.discard(host)
        of_this = epoch == self.epoch
        awarded = award is not None and (award.host, award.round) == (host, round_number)
        if round_number == 0 or (of_this and awarded):
            self.free(host)
            return
        orphan = self._orphans.get(host)
        if orphan is None:
            entry = self.registry.get(host)
            orphan = self._orphans[host] = _OrphanRun(
                instance=entry.instance if entry is not None else "",
                reason=f"it runs a tree of round {round_number} that nobody waits for",
                blocks=False,
            )
        if orphan.running_since is None:
            orphan.running_since = now
        if not of_this:
            # Its host stops it by itself, because the heartbeat of that market is missing.
            orphan.reason, orphan.goal, orphan.blocks = _OF_ANOTHER, None, True
        elif _is_due(orphan, now):
            orphan.blocks, orphan.cancelled_at = True, now
            self.effects.append(CancelAll(host=host))

    def _blocked(self, host: str) -> str:
        orphan = self._orphans.get(host)
        return orphan.reason if orphan is not None and orphan.blocks else ""


def _is_due(orphan: _OrphanRun, now: float) -> bool:
    """Whether to cancel an orphan now: once it is confirmed, and then repeatedly."""
    if orphan.cancelled_at is not None:
        return now - orphan.cancelled_at >= _CANCEL_AGAIN_S
    return orphan.running_since is not None and now - orphan.running_since >= _CONFIRMED_S
