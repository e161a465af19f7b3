# SPDX-License-Identifier: Apache-2.0
"""A market with a manual clock, and short words for the events of a test."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

from bt_agents_core.errors import Refused
from bt_agents_core.scene import Scene
from bt_agents_core.stop_cause import StoppedBy
from bt_agents_language.files.market_reader import MarketRule
from marketplace_node.effects import (
    AnnounceRun,
    Note,
    OpenCall,
    PreviewEnded,
    PublishAuction,
    RequestRanking,
    SceneEnded,
    SendGoal,
    StatusChanged,
)
from marketplace_node.hosts.host_effects import Effect, RunGoal
from marketplace_node.hosts.registry import Registration, RegistrationAnswer
from marketplace_node.interaction.phases import RunEnd, StopRequest
from marketplace_node.market import Market
from marketplace_node.operator_overrides import OperatorAction, OperatorCommand
from marketplace_node.round.decision import Bids, External
from marketplace_node.settings import Settings
from scene_spaces import scene_of, space_of

SPACE = space_of("age", "familiarity", "mood", mood="mood")
GUIDE, EXPRESS, PLAIN = "attentive_guide", "professional_express", "plain"
EffectT = TypeVar("EffectT")
_STEP_S = 1 / 16  # exact in binary, so sums of steps are exact, too


def scene(scene_id: str = "s1", *values: float, label: str = "", urgent: bool = False) -> Scene:
    """Return a scene; NaN marks a missing value, the default is [5, 1, 3]."""
    given = values or (5.0, 1.0, 3.0)
    return scene_of(SPACE, given, scene_id, label=label, urgent=urgent)


def registration(
    host: str = "/agents", agents: tuple[str, ...] = (GUIDE, EXPRESS), **changes: Any
) -> Registration:
    """Return a valid request, apart from ``changes``."""
    values: dict[str, Any] = {
        "host": host,
        "instance": "first",
        "run_action": f"{host}/run",
        "heartbeat": f"{host}/heartbeat",
        "parameters": SPACE.names,
        "agents": agents,
    }
    return Registration(**(values | changes))


class MarketHarness:
    """Drives one market, by default with the paper's rule, and keeps every effect."""

    def __init__(self, rules: tuple[MarketRule, ...] = (), **settings: Any) -> None:
        self.now = 100.0
        settings = {"strategy": "manhattan"} | settings
        self.market = Market(SPACE, "epoch", Settings(**settings), rules, secret=b"secret")
        self.effects: list[Effect] = []
        self.ids: dict[str, dict[str, int]] = {}
        self.busy: dict[str, int] = {}
        self.instances: dict[str, str] = {}
        self.tokens: dict[str, bytes] = {}
        self.do(self.market.tick(self.now))

    def do(self, effects: list[Effect]) -> list[Effect]:
        """Keep the effects, and publish calls for bids at once, as the node does."""
        self.effects += effects
        for effect in effects:
            if isinstance(effect, OpenCall):
                self.do(self.market.called(effect.round, self.now))
        return effects

    def register(self, host: str = "/agents", *agents: str, **changes: Any) -> RegistrationAnswer:
        """Register a host, which has a heartbeat from now on."""
        request = registration(host, agents or (GUIDE, EXPRESS), **changes)
        if self.instances.get(host) == request.instance:
            request = replace(request, token=self.tokens[host])
        answer, effects = self.market.register(request, self.now)
        new = answer.accepted and self.instances.get(host) != request.instance
        if answer.accepted:
            self.ids[host] = dict(zip(request.agents, answer.agent_ids, strict=True))
            self.instances[host] = request.instance
            self.tokens[host] = answer.token
            self.busy[host] = 0
        self.do(effects)
        if new:
            self.beat(host)
        return answer

    def scene(self, scene_id: str = "s1", *values: float, urgent: bool = False) -> None:
        self.do(self.market.scene(scene(scene_id, *values, urgent=urgent), self.now))

    def bid(
        self,
        host: str = "/agents",
        vectors: dict[str, tuple[float, ...]] | None = None,
        declined: dict[str, str] | None = None,
        **changes: Any,
    ) -> None:
        """Answer the current round; by default the guide at 1.5 beats the express at 6.5."""
        vectors = (
            {GUIDE: (4.0, 1.5, 3.0), EXPRESS: (3.0, 5.0, 3.5)} if vectors is None else vectors
        )
        declined = declined or {}
        values: dict[str, Any] = {
            "epoch": "epoch",
            "round": self.status.round,
            "host": host,
            "instance": self.instances.get(host, ""),
            "token": self.tokens.get(host, b""),
            "agents": tuple(vectors),
            "agent_ids": tuple(self.ids.get(host, {}).get(name, 0) for name in vectors),
            "vectors": tuple(value for vector in vectors.values() for value in vector),
            "declined": tuple(declined),
            "decline_reasons": tuple(declined.values()),
        }
        self.do(self.market.bids(Bids(**(values | changes)), self.now))

    def accept(self, goal: RunGoal | None = None) -> None:
        goal = goal or self.goal
        self.busy[goal.host] = goal.round
        self.do(self.market.goal_accepted(goal, self.now))

    def refuse(self, goal: RunGoal | None = None, reason: str = "busy") -> None:
        self.do(self.market.goal_refused(goal or self.goal, reason, self.now))

    def end(
        self,
        outcome: int = 1,
        message: str = "done",
        goal: RunGoal | None = None,
        *,
        host_reason: bool = True,
    ) -> None:
        goal = goal or self.goal
        self.busy[goal.host] = 0
        end = RunEnd(
            outcome=outcome,
            message=message,
            host_reason=host_reason,
            orphans=("tree/0.say",),
            ticks=7,
        )
        self.do(self.market.run_ended(goal, end, self.now))

    def collect(self, message: str = "nothing to learn") -> None:
        self.do(self.market.collected(self.status.round, message, self.now))

    def finish(self, outcome: int = 1, goal: RunGoal | None = None) -> None:
        """End a run, and collect its feedback."""
        self.end(outcome, goal=goal)
        self.collect()

    def perform(self) -> None:
        """Let the host run its goal to the end."""
        self.accept()
        self.finish()

    def cancel(
        self,
        reason: str = "enough",
        again: bool = False,
        scene: Scene | None = None,
        epoch: str = "",
        round_number: int = 0,
        by: StoppedBy = StoppedBy.NOT_SAID,
    ) -> tuple[bool, str]:
        stop = StopRequest(reason=reason, by=by, again=again, scene=scene)
        accepted, message, effects = self.market.cancel(epoch, round_number, stop, self.now)
        self.do(effects)
        return accepted, message

    def configure(self, **settings: Any) -> None:
        """Replace the settings; what is not named has its default."""
        self.do(self.market.configure(Settings(**settings), self.now))

    def shut_down(self, reason: str = "shutting down") -> None:
        self.do(self.market.shut_down(reason, self.now))

    def operate(self, action: OperatorAction, agent: str = "", **fields: Any) -> str:
        """Act as an operator; return the answer, or the code of the refusal."""
        command = OperatorCommand(action=action, agent=agent, **fields)
        try:
            message, effects = self.market.operate(command, self.now)
        except Refused as refused:
            return refused.code
        self.do(effects)
        return message

    def preview(self, *values: float, strategy: str = "", last: bool = False) -> int:
        """Request a preview; return its number."""
        asked = None if last else scene("preview", *values)
        number, effects = self.market.preview(asked, strategy, self.now)
        self.do(effects)
        return number

    def ranked(self, *agents: str, failure: str = "", round_number: int = 0) -> None:
        """Answer a request for an external ranking, by default the last one."""
        external = External(ranking=agents, message="it fits", failure=failure)
        number = round_number or self.questions[-1].round
        self.do(self.market.ranked(number, external, self.now))

    def wait(self, seconds: float) -> None:
        """Let time pass in steps of a heartbeat; hosts in ``busy`` stay alive."""
        for _ in range(round(seconds / _STEP_S)):
            self.now += _STEP_S
            for host in list(self.busy):
                self.beat(host)
            self.do(self.market.tick(self.now))

    def beat(self, host: str = "/agents", epoch: str = "epoch", **changes: Any) -> None:
        number = changes.get("round_number", self.busy.get(host, 0))
        instance = changes.get("instance", self.instances[host])
        self.do(self.market.heartbeat(host, instance, epoch, number, self.now))

    def die(self, host: str = "/agents") -> None:
        """Let a host fall silent."""
        self.busy.pop(host)

    def lose(self, host: str = "/agents", away_s: float = 1.0) -> None:
        """Let a host fall silent for some time."""
        self.die(host)
        self.wait(away_s)

    def stall(self, lasted_s: float) -> None:
        """Let time pass without the market."""
        since, self.now = self.now, self.now + lasted_s
        self.do(self.market.extend_after_stall(since, self.now))

    def award(self, scene_id: str = "s1") -> None:
        """Announce a scene, and let the host bid for it; by default the guide wins."""
        self.scene(scene_id)
        self.bid()

    def run(self, scene_id: str = "s1") -> RunGoal:
        """Start a run of the guide."""
        if not self.ids:
            self.register()
        self.award(scene_id)
        self.accept()
        return self.goal

    def all(self, kind: type[EffectT]) -> list[EffectT]:
        return [effect for effect in self.effects if isinstance(effect, kind)]

    @property
    def notes(self) -> list[str]:
        return [note.message for note in self.all(Note)]

    @property
    def status(self) -> StatusChanged:
        return self.all(StatusChanged)[-1]

    @property
    def goal(self) -> RunGoal:
        return self.all(SendGoal)[-1].goal

    @property
    def auction(self) -> PublishAuction:
        return self.all(PublishAuction)[-1]

    @property
    def questions(self) -> list[RequestRanking]:
        return self.all(RequestRanking)

    @property
    def previews(self) -> list[PreviewEnded]:
        return self.all(PreviewEnded)

    @property
    def calls(self) -> list[OpenCall]:
        return self.all(OpenCall)

    @property
    def ends(self) -> list[tuple[str, str]]:
        """Ends of scenes so far: id and code of each."""
        return [(effect.scene_id, effect.code) for effect in self.all(SceneEnded)]

    @property
    def over(self) -> list[str]:
        """Scenes that have ended, in order."""
        return [effect.scene_id for effect in self.all(SceneEnded)]

    @property
    def end_words(self) -> str:
        """Message of the last end."""
        return self.all(SceneEnded)[-1].message

    @property
    def events(self) -> list[str]:
        """Run events so far: ``"1 attentive_guide ENDED SUCCEEDED"``."""
        return [
            f"{run.goal.round} {run.goal.agent} {run.event.name}"
            + (f" {run.outcome.name}" if run.outcome else "")
            for run in self.all(AnnounceRun)
        ]


def with_host(**settings: Any) -> MarketHarness:
    """Return a market with one host, of the guide and the express."""
    market = MarketHarness(**settings)
    market.register()
    return market
