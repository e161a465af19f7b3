# SPDX-License-Identifier: Apache-2.0
"""What a journal holds, sorted by what it is about."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_lab.recorder.reading import JournalEntry, JournalReader
from bt_agents_lab.replay.texts import Making, TextFiles
from marketplace_node.effects import RunEventKind

_TYPES = "bt_agents_interfaces/msg/"

_SHADOW_1 = "shadow."
_EARLIER_RUNS_1 = "market.earlier_runs"

NO_MAKING = "there is no scene.yaml, as no host has sent its texts before"
"""Why a round cannot be decided again whose ``making`` is not known."""

RunKey = tuple[str, str, int, str]
"""Start of the host, market, round and agent of a run."""


@dataclass(kw_only=True)
class RunStory:
    """What is known of one run of a tree.

    Attributes:
        key: Which one.
        records: Its notes, in the order in which they were sent.
        statuses: Changes of its ticks, the same.
        texts: What the trees of its host were made from before it began, newest first.
        torn: Whether messages around it are lost.
    """

    key: RunKey
    records: list[Any] = field(default_factory=list)
    statuses: list[Any] = field(default_factory=list)
    texts: tuple[TextFiles, ...] = ()
    torn: bool = False


@dataclass(kw_only=True)
class Round:
    """One round of a market.

    Attributes:
        auction: Its outcome.
        runs: How many runs this start of the market had begun before it; None when the journal
            does not tell.
        making: What the scene and the rules of the market were made from; None for unknown.
        format: Format of its message, see :func:`_migrate_options`. In format 1 the change by
            which the runner-up would have won, and the sentence about it, come from another
            search, so they are not compared.
    """

    auction: Any
    runs: int | None
    making: Making | None
    format: int

    @property
    def earlier(self) -> int:
        """How many runs there were before this start of the market, as far as it knows."""
        return int(self.auction.earlier_runs)

    @property
    def least(self) -> int:
        """How many runs there were before it at least, by what its bids tell."""
        ranking = self.auction.ranking
        last = max((bid.last_run for bid in ranking), default=0)
        return max(int(last), sum(int(bid.runs) for bid in ranking))


@dataclass(kw_only=True)
class RecordedFeedback:
    """One change of a profile.

    Attributes:
        feedback: What was recorded.
        card: The agent as its host introduced it last; None for unknown.
        parameters: Order of the values of the card.
        making: What the scene parameters were made from; None for unknown.
    """

    feedback: Any
    card: Any
    parameters: tuple[str, ...]
    making: Making | None


@dataclass(kw_only=True)
class RecordingIndex:
    """What a journal holds.

    Attributes:
        rounds: The rounds of all markets, in order.
        lessons: The changes of profiles, in order.
        runs: The runs of trees, in order.
        counts: Topic → messages.
        lost: Topic → messages that the journal found no room for.
        first_ns: When the first message was sent [ns since 1970]; 0 for none.
        last_ns: When the last one was.
        problems: What cannot be read, in words.
        hints: What else is to be said before, in words.
    """

    rounds: list[Round] = field(default_factory=list)
    lessons: list[RecordedFeedback] = field(default_factory=list)
    runs: dict[RunKey, RunStory] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    lost: Counter[str] = field(default_factory=Counter)
    first_ns: int = 0
    last_ns: int = 0
    problems: list[str] = field(default_factory=list)
    hints: list[str] = field(default_factory=list)

    @property
    def whole(self) -> bool:
        """Whether everything could be read and nothing is lost."""
        return not self.problems and not self.lost


def tell(entries: Iterable[JournalEntry]) -> RecordingIndex:
    """Return what messages hold.

    Args:
        entries: In the order in which they were sent.
    """
    return _Teller().tell(entries)


def read(paths: Sequence[Path]) -> RecordingIndex:
    """Return what some files hold; messages that nothing is made of are only counted.

    Args:
        paths: The files.

    Raises:
        BtAgentsError: A file cannot be opened.
    """
    reader = JournalReader(paths)
    story = tell(reader.entries(frozenset(_TYPES + name for name in _TAKES)))
    for topic, counted in reader.counted.items():
        story.counts[topic] += counted.messages
        if counted.lost:
            story.lost[topic] += counted.lost
        story.first_ns = min(story.first_ns or counted.first_ns, counted.first_ns)
        story.last_ns = max(story.last_ns, counted.last_ns)
    story.problems[:0] = reader.problems
    return story


class _Teller:
    def __init__(self) -> None:
        self.story = RecordingIndex()
        self._cards: dict[str, tuple[Any, tuple[str, ...]]] = {}
        self._texts: defaultdict[str, list[TextFiles]] = defaultdict(list)
        self._newest: TextFiles | None = None
        self._begun: Counter[str] = Counter()
        self._whole: set[str] = set()
        self._last_runs: dict[str, RunStory] = {}

    def tell(self, entries: Iterable[JournalEntry]) -> RecordingIndex:
        story = self.story
        for entry in entries:
            story.counts[entry.topic] += 1
            story.first_ns = story.first_ns or entry.sent_ns
            story.last_ns = max(story.last_ns, entry.sent_ns)
            if entry.lost:
                story.lost[entry.topic] += entry.lost
            take = _TAKES.get(entry.type.removeprefix(_TYPES))
            if take is None or not entry.type.startswith(_TYPES):
                continue
            try:
                message = entry.decode()
                take(self, message)
                if entry.type in _OF_RUNS:
                    self._note_gap(entry.topic, self._run_of(message), entry.lost > 0)
            except (BtAgentsError, AttributeError, ValueError, LookupError, TypeError) as error:
                reason = error.reason if isinstance(error, Refused) else str(error)
                words = f"a message on {entry.topic} cannot be read: {reason}"
                if words not in story.problems:
                    story.problems.append(words)
        return story

    def _note_gap(self, topic: str, run: RunStory, gap: bool) -> None:
        """Note that messages are lost between two runs, of which both may miss some."""
        if gap:
            run.torn = True
            if topic in self._last_runs:
                self._last_runs[topic].torn = True
        self._last_runs[topic] = run

    def _files(self, message: Any) -> None:
        texts = TextFiles.of(message)
        known = self._texts[message.host_instance]
        if texts not in known:
            known.append(texts)
        self._newest = texts

    def _card(self, message: Any) -> None:
        for card in message.agents:
            self._cards[card.name] = (card, tuple(message.parameters))

    def _run(self, message: Any) -> None:
        if message.event == RunEventKind.STARTED:
            self._begun[message.epoch] += 1

    def _auction(self, message: Any) -> None:
        if message.preview:
            return
        written = _migrate_options(message)
        epoch = message.epoch
        if message.round == 1:
            self._whole.add(epoch)
        one = Round(
            auction=message,
            runs=self._begun[epoch] if epoch in self._whole else None,
            making=self._newest.making if self._newest is not None else None,
            format=written,
        )
        if one.runs is not None and one.runs + one.earlier < one.least:
            # A run of which the journal has not heard.
            self._whole.discard(epoch)
            one = replace(one, runs=None)
        self.story.rounds.append(one)

    def _feedback(self, message: Any) -> None:
        card, parameters = self._cards.get(message.agent, (None, ()))
        making = self._newest.making if self._newest is not None else None
        self.story.lessons.append(
            RecordedFeedback(feedback=message, card=card, parameters=parameters, making=making)
        )

    def _record(self, message: Any) -> None:
        run = self._run_of(message)
        if not run.records:
            run.texts = tuple(reversed(self._texts[message.host_instance]))
        run.records.append(message)

    def _status(self, message: Any) -> None:
        self._run_of(message).statuses.append(message)

    def _run_of(self, message: Any) -> RunStory:
        key = (message.host_instance, message.epoch, message.round, message.agent)
        return self.story.runs.setdefault(key, RunStory(key=key))


def _migrate_options(auction: Any) -> int:
    """Give an auction of format 1 the fields of format 2; return the format it was written in.

    In format 1, which knows no ``earlier_runs``, the options of the shadow strategy and the count
    of earlier runs stand with the options of the strategy, under names of their own.
    """
    if hasattr(auction, "earlier_runs"):
        return 2
    given = dict(zip(auction.option_names, auction.option_values, strict=True))
    auction.earlier_runs = int(given.pop(_EARLIER_RUNS_1, 0.0))
    shadow = {name: value for name, value in given.items() if name.startswith(_SHADOW_1)}
    own = {name: value for name, value in given.items() if name not in shadow}
    auction.option_names, auction.option_values = list(own), list(own.values())
    auction.shadow_option_names = [name.removeprefix(_SHADOW_1) for name in shadow]
    auction.shadow_option_values = list(shadow.values())
    return 1


_OF_RUNS = (f"{_TYPES}RunRecord", f"{_TYPES}TreeStatus")

_TAKES = {
    "AgentFiles": _Teller._files,
    "HostCard": _Teller._card,
    "Run": _Teller._run,
    "Auction": _Teller._auction,
    "Feedback": _Teller._feedback,
    "RunRecord": _Teller._record,
    "TreeStatus": _Teller._status,
}
