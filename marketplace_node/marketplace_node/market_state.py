# SPDX-License-Identifier: Apache-2.0
"""State shared by all rounds: settings, registered hosts, statistics, pending effects."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from functools import partial

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_language.files.market_reader import MarketRule
from marketplace_node.effects import Alarm, PublishAuction, StoreOverrides
from marketplace_node.explanation.explanation import explanation
from marketplace_node.hosts.host_availability import HostAvailability
from marketplace_node.hosts.host_effects import Effect, RunGoal
from marketplace_node.hosts.registry import HostEntry
from marketplace_node.operator_overrides import OperatorOverrides
from marketplace_node.round.decision import Decision, Terms, UndecidedRule
from marketplace_node.settings import RULES, Settings
from marketplace_node.statistics import MarketStatistics, counts

PREVIEWS = 2**31
"""Numbers of previews begin after this one, so they do not consume numbers of real rounds."""


class MarketState:
    """State shared by all rounds.

    Attributes:
        epoch: Name of this instance of the market.
        effects: Pending effects, in order.
        rounds: Number of rounds so far, which is the number of the last one.
        previews: Number of previews so far.
        last_scene: The latest scene; None before the first.
        hosts: The registered hosts.
    """

    def __init__(
        self,
        space: SceneSpace,
        epoch: str,
        settings: Settings,
        rules: tuple[MarketRule, ...],
        secret: bytes,
    ) -> None:
        self.space = space
        self.epoch = epoch
        self._undecided: tuple[UndecidedRule, ...] = ()
        self.settings = settings
        self.overrides = OperatorOverrides()
        self.effects: list[Effect] = []
        self.hosts = HostAvailability(epoch, space.names, settings, secret, self.effects)
        self.statistics = MarketStatistics()
        self.rounds = 0
        self.previews = 0
        self.last_scene: Scene | None = None
        self._rules = rules
        self._starved: tuple[tuple[str, ...], Collection[str], tuple[str, ...]] | None = None

    def take_effects(self) -> list[Effect]:
        """Return the pending effects, once."""
        taken = list(self.effects)
        self.effects.clear()
        return taken

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
            scene: Scene of the bids.
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
            operator_exclusions=self.overrides.excluded(self.hosts.registry.live(now), awarded),
            intervention=self.overrides.intervention(awarded),
            unasked=self.hosts.absences(now),
            last_run=dict(self.statistics.last_run),
            runs=dict(self.statistics.runs),
            rounds_run=self.statistics.runs.total(),
            earlier_runs=self.statistics.earlier_runs,
            preview=preview is not None,
        )

    def as_published(self, decision: Decision, reason_fn: Callable[[], str]) -> PublishAuction:
        """Return a decision in its published form, with the current statistics."""
        return PublishAuction(
            decision=decision,
            reason_fn=reason_fn,
            explanation_fn=partial(explanation, decision, self.space),
            shadow_rounds=self.statistics.shadow_rounds,
            shadow_disagreements=self.statistics.shadow_disagreements,
        )

    def publish(self, decision: Decision, reason_fn: Callable[[], str]) -> None:
        """Count a decision and publish it with the line that ``reason_fn`` formats."""
        self.statistics.take(decision)
        self._take_undecided(decision)
        self.effects.append(self.as_published(decision, reason_fn))

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
        starved = self.statistics.starvation.starved(self.settings.starvation_rounds)
        if not starved:
            return ()
        agents, known = self.hosts.registry.agents, self._starved
        if known is None or known[0] != starved or known[1] is not agents:
            known = (starved, agents, tuple(agent for agent in starved if agent in agents))
            self._starved = known
        return known[2]

    def count_run(self, agent: str, decision: Decision) -> None:
        """Count and store a run of an agent: the winner, or the next one that accepted."""
        self.statistics.count_run(agent, decision.ranked.bidders)
        newly_starved = self.statistics.starvation.newly_starved(self.settings.starvation_rounds)
        self.effects += [Alarm(message=one) for one in newly_starved]
        self.store()

    def store(self, *, at_once: bool = False) -> None:
        """Store what outlives this start of the market; at once if an operator waits for it."""
        stored = {
            **self.overrides.to_dict(),
            "runs": self.statistics.runs,
            "last_run": self.statistics.last_run,
            "in_vain": self.statistics.starvation.in_vain,
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
                RefusalCode.MALFORMED,
                "the stored pins, vetoes and counts cannot be read, so none counts; set pins and "
                "vetoes again",
            ) from None
        self.statistics.restore(*found)

    def asked(self, excluded: Collection[str], now: float) -> list[HostEntry]:
        """Return the hosts to ask: free ones with an agent that may bid."""
        absent, names = self.hosts.absences(now), set(excluded)
        return [
            entry
            for entry in self.hosts.registry.entries()
            if entry.host not in absent and not entry.agents.keys() <= names
        ]

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
            and not self.hosts.absence(entry, now)
            and self.may_run(entry, scene_id, excluded)
            for entry in self.hosts.registry.entries()
        )

    def may_run(self, entry: HostEntry, scene_id: str, excluded: Collection[str]) -> bool:
        """Return whether a host has an agent that may bid for a scene."""
        return any(
            agent not in excluded and self.overrides.may_bid(agent, scene_id)
            for agent in entry.agents
        )

    def obstacle(self, goal: RunGoal, now: float) -> str:
        """Return why a goal cannot be sent; empty when it can."""
        if not self.hosts.registry.is_live(goal.host, goal.instance, now):
            return f"{goal.host} is gone"
        if veto := self.overrides.veto_of(goal.agent):
            return veto
        reason = self.hosts.blocked(goal.host)
        return f"{goal.host} is not free: {reason}" if reason else ""
