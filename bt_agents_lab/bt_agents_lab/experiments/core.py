# SPDX-License-Identifier: Apache-2.0
"""Experiments with the nodes' market and learning, but without ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import closing

from bt_agents.host.agent_registry import AgentRegistry
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import LearningRule
from bt_agents_core.scene import MISSING, Origin, Scene, SceneSpace, SceneValue, Vector
from bt_agents_lab.experiments.simulated_world import NOT_SIMULATED
from bt_agents_lab.results import ResultRow, row_of_change, rows_of_decision
from bt_agents_language.files.folder_reader import Trees
from bt_agents_language.model.experiment import ExperimentSpec, FeedbackRecord
from feedback_node.announced_runs import AnnouncedRun
from feedback_node.learning.cards import AgentEntry, LearningCard, LearningEntry
from feedback_node.learning.feedback_controller import FeedbackController
from feedback_node.learning.profiles import Profiles
from feedback_node.ledger import Ledger
from feedback_node.ledger.file import MEMORY
from feedback_node.simulated_feedback import SimulatedFeedback
from marketplace_node.effects import Collect, OpenCall, PublishAuction, SendGoal
from marketplace_node.hosts.host_effects import Effect
from marketplace_node.hosts.registry import Registration
from marketplace_node.interaction.phases import RunEnd
from marketplace_node.market import Market
from marketplace_node.outcomes import RunOutcome
from marketplace_node.round.decision import Bids
from marketplace_node.settings import Settings
from marketplace_node.strategies import STRATEGIES

HOST = "/agents"
_INSTANCE = "core"
_NOW = 0.0
"""Time of every event, because nothing takes any time [s]."""


class Core:
    """One market, one host of all agents in a folder, and one feedback node, as objects.

    Every tree succeeds at once.
    """

    def __init__(
        self,
        folder: Trees,
        spec: ExperimentSpec,
        settings: Settings,
        on_result: Callable[[ResultRow], None],
    ) -> None:
        self.space = folder.scene.space
        self._feedback = spec.feedback
        self._on_result = on_result
        self._market = Market(self.space, "core", settings, secret=b"")
        self._agents = AgentRegistry(self.space, folder.agents)
        self.ledger = Ledger(MEMORY)
        self._controller = FeedbackController(
            Profiles(self.space, self.ledger),
            clock=lambda: _NOW,
            new_id=lambda: "",
            simulated=SimulatedFeedback(spec.feedback),
        )
        self._records: list[FeedbackRecord] = []
        self._execute(self._market.tick(_NOW))
        self._register()

    def play(self, label: str, vector: Vector) -> FeedbackRecord:
        """Put a scene with a unique label on the market and return the record of its round.

        Raises:
            BtAgentsError: It led to no feedback.
        """
        before = len(self._records)
        given = [
            SceneValue(name=name, value=value, origin=Origin.GIVEN)
            for name, value in zip(self.space.names, vector, strict=True)
        ]
        scene = Scene(scene_id=label, label=label, person=True, values=tuple(given))
        self._execute(self._market.scene(scene, _NOW))
        if len(self._records) != before + 1:
            raise BtAgentsError(
                f"{label} led to no feedback, expected some after each; name every agent under "
                "'each' or 'sequences' of the experiment's feedback, and let each list be long "
                "enough, or 'repeat: true'"
            )
        return self._records[-1]

    def _register(self) -> None:
        agents = tuple(member.spec for member in self._agents.members.values())
        names = tuple(agent.name for agent in agents)
        answer, effects = self._market.register(
            Registration(
                host=HOST,
                instance=_INSTANCE,
                run_action=f"{HOST}/run",
                heartbeat=f"{HOST}/heartbeat",
                parameters=self.space.names,
                agents=names,
            ),
            _NOW,
        )
        self._token = answer.token
        self._agents.apply_registration(names, answer.agent_ids, answer.reasons)
        self._execute(effects)
        self._send_heartbeat(0)
        self._controller.register_card(
            LearningCard(
                host=HOST,
                instance=_INSTANCE,
                parameters=self.space.profiles.names,
                agents=tuple(
                    AgentEntry(
                        name=agent.name,
                        profile=agent.profile,
                        revision=0,
                        learning_rate=agent.learning_rate,
                        learning=learning_of(agent.learning, self.space.profiles),
                    )
                    for agent in agents
                ),
            )
        )

    def _execute(self, effects: list[Effect]) -> None:
        waiting = deque(effects)
        while waiting:
            effect = waiting.popleft()
            if isinstance(effect, OpenCall):
                waiting += self._market.called(effect.round, _NOW)
                waiting += self._market.bids(self._bids(effect), _NOW)
            elif isinstance(effect, SendGoal):
                waiting += self._market.goal_accepted(effect.goal, _NOW)
                self._send_heartbeat(effect.goal.round)
                end = RunEnd(outcome=RunOutcome.SUCCEEDED, message="", orphans=(), ticks=1)
                waiting += self._market.run_ended(effect.goal, end, _NOW)
                self._send_heartbeat(0)
            elif isinstance(effect, PublishAuction):
                if effect.decision.ranked.fallback:
                    raise BtAgentsError(effect.decision.ranked.fallback)
                for row in rows_of_decision(effect):
                    self._on_result(row)
            elif isinstance(effect, Collect):
                waiting += self._collect(effect)

    def _bids(self, call: OpenCall) -> Bids:
        answer = self._agents.bids_for(call.scene, call.excluded)
        return Bids(
            epoch=self._market.epoch,
            round=call.round,
            host=HOST,
            instance=_INSTANCE,
            agents=tuple(member.spec.name for member in answer.bidders.members),
            agent_ids=tuple(member.agent_id for member in answer.bidders.members),
            vectors=tuple(value for member in answer.bidders.members for value in member.profile),
            declined=tuple(answer.declined),
            decline_reasons=tuple(one.reason for one in answer.declined.values()),
            unmet=tuple(one.unmet for one in answer.declined.values()),
            token=self._token,
        )

    def _collect(self, effect: Collect) -> list[Effect]:
        goal = effect.goal
        run = AnnouncedRun(
            epoch=self._market.epoch, round=goal.round, agent=goal.agent, scene=effect.scene
        )
        change = self._controller.collect(run)
        if change is not None:
            wrong = self._feedback.is_wrong(len(self._records))
            self._on_result(row_of_change(change, self.space.profiles.names, wrong))
            self._agents.set_profile(goal.agent, change.after, change.revision.revision)
            self._records.append(
                FeedbackRecord(
                    round=goal.round,
                    scene=effect.scene.vector,
                    winner=goal.agent,
                    before=change.before,
                    after=change.after,
                )
            )
        return self._market.collected(goal.round, "", _NOW)

    def _send_heartbeat(self, round_number: int) -> None:
        epoch = self._market.epoch
        self._execute(self._market.heartbeat(HOST, _INSTANCE, epoch, round_number, _NOW))


def learning_of(rule: LearningRule, space: SceneSpace) -> LearningEntry:
    """Return a learning rule in the form of a host card."""

    def ordered(values: Mapping[str, float]) -> Vector:
        return tuple(values.get(name, MISSING) for name in space.names)

    return LearningEntry(
        update=rule.update.value,
        rates=ordered(rule.rates),
        width=ordered(rule.width),
        window=rule.window,
        anneal=rule.anneal,
        drift=ordered(rule.drift),
        retreat=ordered(rule.retreat),
        sources=tuple(rule.weights),
        weights=tuple(rule.weights.values()),
        layers=rule.layers,
        general=rule.general,
    )


def through_core(
    folder: Trees,
    spec: ExperimentSpec,
    settings: Settings | None = None,
    on_result: Callable[[ResultRow], None] = lambda _: None,
) -> list[FeedbackRecord]:
    """Play a whole experiment and return its rounds.

    Without settings, agents are selected as in the paper. Rows of the table of results are passed
    on as they arise.

    Raises:
        BtAgentsError: The strategy needs more than the bids, or a scene led to no feedback.
    """
    settings = settings or Settings(strategy="manhattan")
    if settings.strategy in NOT_SIMULATED:
        known = ", ".join(name for name in STRATEGIES if name not in NOT_SIMULATED)
        raise BtAgentsError(
            f"strategy '{settings.strategy}' is not simulated, as its choice needs more than the "
            f"bids; take one of {known}"
        )
    core = Core(folder, spec, settings, on_result)
    with closing(core.ledger):
        return [
            core.play(f"scene {number}", vector)
            for number, vector in enumerate(spec.order(), start=1)
        ]
