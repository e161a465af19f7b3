# SPDX-License-Identifier: Apache-2.0
"""A small journal in a system's format: rounds, feedback and a run of a tree."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rclpy.serialization import serialize_message

from bt_agents.engine.scripted_environment import ScriptedReply
from bt_agents.host.reload.versions import AgentVersions
from bt_agents.host.run_messages import tree_status
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.scene import Scene
from bt_agents_interfaces.msg import (
    AgentCard,
    AgentFiles,
    CallForBids,
    Feedback,
    HostCard,
    Learning,
    Run,
    TreeStatus,
)
from bt_agents_lab.node import definition_text
from bt_agents_lab.recorder.file import JournalFile, RecordedMessage, RecordedTopic, definition
from bt_agents_lab.recorder.reading import JournalReader
from bt_agents_lab.replay.recording_index import RecordingIndex, index_entries
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros.messages import header_at, scene_to_msg, to_time
from feedback_node.learning.learning_step import step
from marketplace_node.effects import PublishAuction
from marketplace_node.explanation.explanation import explanation
from marketplace_node.explanation.reason import reason_of
from marketplace_node.node.messages import auction_to_msg
from ranked_rounds import bids, decided, terms
from tree_harness import SPACE, VOICE, TreeHarness, agent_text, scene, trees_folder

NAN = math.nan
EPOCH = "e1"
TREE = """sequence:
    - say: Hello
    - {check: live.mood > 2, name: mood}
    - {say: "You are ${answer}", name: reply}
    - wait: 1 s
"""
ANSWERED = "    outputs: {answer: {type: text, description: what is answered}}\n"


@dataclass(frozen=True, kw_only=True)
class PublishedMessage:
    """One message and its topic."""

    topic: str
    message: Any


def write_folder(folder: Path, **profiles: tuple[float, float, float]) -> Path:
    """Make a trees folder with agents of these profiles; return it."""
    texts = {
        name: agent_text(name, TREE, "learning_rate: 0.2", profile)
        for name, profile in profiles.items()
    }
    return trees_folder(folder, texts, VOICE + ANSWERED)


class JournaledSystem:
    """Two agents, a market and a robot without processes; publishes what a journal would record.

    Args:
        folder: Place of the trees folder.
        strategy: Strategy that ranks the bids.
        options: Options of the strategy.
        shadow: Shadow strategy.
    """

    def __init__(
        self,
        folder: Path,
        strategy: str = "manhattan",
        options: Mapping[str, float] | None = None,
        shadow: str = "",
    ) -> None:
        self.published: list[PublishedMessage] = []
        self.profiles = {"anna": (1.0, 1.0, 3.0), "bert": (4.5, 2.1, 3.3)}
        self._strategy = strategy
        self._options = dict(options or {})
        self._shadow = shadow
        self._folder = write_folder(folder, **self.profiles)
        self._trees = read_trees(self._folder)
        self._runs: list[str] = []
        self._revisions = dict.fromkeys(self.profiles, 0)
        self._asked: dict[str, int] = dict.fromkeys(self.profiles, 0)
        texts = AgentVersions(self._trees).texts_in_force()
        files = AgentFiles(
            host="/agents", host_instance="i1", files=list(texts), texts=list(texts.values())
        )
        self.publish("/agents/files", files)
        self.publish("/bt_agents/cards", self._card())

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message."""
        self.published.append(PublishedMessage(topic=topic, message=message))

    def round(self, person: Scene) -> str:
        """Hold a round; return the winner, whose run begins."""
        number = self._number = len(self._rounds) + 1
        of_round = terms(
            person,
            epoch=EPOCH,
            round=number,
            strategy=self._strategy,
            last_run={name: self._last(name) for name in self.profiles},
            runs={name: self._runs.count(name) for name in self.profiles},
            rounds_run=len(self._runs),
            options=self._options,
            shadow=self._shadow,
            seed=f"{EPOCH}/{number}",
        )
        self.publish(
            "/bt_agents/calls", CallForBids(epoch=EPOCH, round=number, scene=scene_to_msg(person))
        )
        decision = decided(of_round, bids(self.profiles), space=SPACE, duration_s=0.1)
        best = decision.ranked.bids[0]
        auction = PublishAuction(
            decision=decision,
            reason_fn=partial(reason_of, decision),
            explanation_fn=partial(explanation, decision, SPACE),
        )
        self.publish("/bt_agents/auctions", auction_to_msg(auction, self._stamp()))
        self._runs.append(best.agent)
        self.publish(
            "/bt_agents/runs",
            Run(
                header=header_at(self._stamp()),
                epoch=EPOCH,
                round=number,
                event=Run.STARTED,
                scene=scene_to_msg(person),
                agent=best.agent,
            ),
        )
        return best.agent

    def run(self, agent: str, person: Scene, mood: float = 3.0) -> str:
        """Tick the tree of the last winner to its end; return how it ended."""
        reply = ScriptedReply(after_s=1.0, result={"message": "", "answer": "kind"})
        [tree] = [one.tree for one in self._trees.agents if one.name == agent]
        played = TreeHarness(tree, answers={"say": [reply]}, awarded=person)
        played.set_mood(mood)
        where = SimpleNamespace(epoch=EPOCH, round=self._number, agent=agent)
        while played.run.result is None:
            if changes := played.run.tick():
                status = tree_status(to_time(0.0), where, "i1", played.run, changes)
                self.publish("/agents/status", status)
            played.environment.clock.advance(0.4)
        return played.outcome

    def give_feedback(self, agent: str, kind: FeedbackKind, target: tuple[float, ...]) -> None:
        """Give feedback about the last run."""
        before = self.profiles[agent]
        changes = self._asked[agent]
        done = step(kind, before, target, rate=0.2, space=SPACE, changes=changes, authored=before)
        self.profiles[agent] = done.after
        self._asked[agent] += 1
        self._revisions[agent] += 1
        self.publish(
            "/bt_agents/feedback",
            Feedback(
                header=header_at(self._stamp()),
                feedback_id=f"f{len(self.published)}",
                agent=agent,
                kind=int(kind),
                source="button",
                epoch=EPOCH,
                round=self._number,
                parameters=list(SPACE.names),
                before=list(before),
                after=list(done.after),
                target=list(target),
                rates=list(done.rates),
                weight=done.weight,
                learning_rate=done.rate,
                revision=self._revisions[agent],
                false_rate=NAN,
            ),
        )

    def write(self, path: Path, alter: Callable[[int, Any], Any] | None = None) -> Path:
        """Write the messages into a journal; ``alter`` may change a message, or drop it (None)."""
        file = JournalFile(path)
        counts: dict[str, int] = {}
        for number, one in enumerate(self.published):
            message = one.message if alter is None else alter(number, one.message)
            counts[one.topic] = counts.get(one.topic, 0) + 1
            if message is None:
                continue
            file.add(
                RecordedMessage(
                    topic=topic_of(type(message), one.topic),
                    data=serialize_message(message),
                    sent_ns=number + 1,
                    received_ns=number + 1,
                ),
                counts[one.topic],
            )
        file.close()
        return path

    @property
    def _rounds(self) -> list[PublishedMessage]:
        return [one for one in self.published if one.topic == "/bt_agents/auctions"]

    def _stamp(self) -> Any:
        return to_time(float(len(self.published)))

    def _last(self, name: str) -> int:
        return max((i for i, ran in enumerate(self._runs, 1) if ran == name), default=0)

    def _card(self) -> HostCard:
        nothing = [NAN] * len(SPACE.names)
        return HostCard(
            host="/agents",
            host_instance="i1",
            parameters=list(SPACE.names),
            agents=[
                AgentCard(
                    name=name,
                    profile=list(profile),
                    current=list(profile),
                    learning_rate=0.2,
                    learning=Learning(
                        rates=nothing,
                        update="plain",
                        width=nothing,
                        window=5,
                        drift=nothing,
                        general=1.0,
                    ),
                )
                for name, profile in self.profiles.items()
            ],
        )


def morning(folder: Path, **how: Any) -> JournaledSystem:
    """Return a system after four rounds, with runs and feedback."""
    journaled = JournaledSystem(folder, **how)
    for number, (age, mood) in enumerate([(4.0, 3.0), (1.0, 3.0), (3.0, 2.5), (4.4, 1.0)]):
        person = scene(f"s{number}", age=age, familiarity=2.0, mood=mood)
        agent = journaled.round(person)
        journaled.run(agent, person, mood)
        kind = FeedbackKind.POSITIVE if number % 2 else FeedbackKind.DIRECT
        journaled.give_feedback(agent, kind, (age, 2.0, NAN))
    return journaled


def topic_of(kind: Any, name: str) -> RecordedTopic:
    """Return a topic and the definition of its type."""
    type_name = f"bt_agents_interfaces/msg/{kind.__name__}"
    return RecordedTopic(
        name=name, type=type_name, definition=definition(type_name, definition_text)
    )


def recorded(number: int, *, topic: str = "/agents/status", tip: str = "") -> RecordedMessage:
    """Return a small message, identified by its number."""
    message = TreeStatus(tick=number, tip=tip)
    data = serialize_message(message)
    ns = 1_000_000_000 * (number + 1)
    return RecordedMessage(
        topic=topic_of(TreeStatus, topic), data=data, sent_ns=ns, received_ns=ns
    )


def add_messages(file: JournalFile, message: Any, name: str, numbers: Iterable[int]) -> None:
    """Add a message several times; each number is its place, and its time [ns]."""
    topic, data = topic_of(type(message), name), serialize_message(message)
    for one in numbers:
        file.add(RecordedMessage(topic=topic, data=data, sent_ns=one, received_ns=one), one)
    file.flush()


def ticks(path: Path) -> list[int]:
    """Return the numbers of the messages of :func:`recorded` in a journal."""
    return [entry.decode().tick for entry in JournalReader([path]).entries()]


def index_of(path: Path) -> RecordingIndex:
    """Return the contents of a journal."""
    return index_entries(JournalReader([path]).entries())
