# SPDX-License-Identifier: Apache-2.0
"""Index of a journal: its rounds, profile changes and runs of trees."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_lab.recorder.reading import JournalEntry, JournalReader
from bt_agents_lab.replay.texts import ParsedTexts, TextFiles
from marketplace_node.effects import RunEventKind

_TYPES = "bt_agents_interfaces/msg/"

_SHADOW_1 = "shadow."
_EARLIER_RUNS_1 = "market.earlier_runs"

NO_TEXTS = "there is no scene.yaml, as no host has sent its texts before"
"""Why a round cannot be decided again whose ``parsed`` is unknown."""

RunKey = tuple[str, str, int, str]
"""Instance of the host, epoch of the market, round and agent of a run."""


@dataclass(kw_only=True)
class RecordedRun:
    """Messages about one run of a tree.

    Attributes:
        records: Its record, in the order in which the parts were sent.
        statuses: Changes of its ticks, in the same order.
        texts: Texts of its host before it began, newest first.
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
        runs: Number of runs that this start of the market had begun before it; None for unknown.
        parsed: Texts that define the scene and the rules of the market; None for unknown.
        format: Format of its message, see :func:`_migrate_options`. In format 1 the change by
            which the runner-up would have won, and the sentence about it, come from another
            search, so they are not compared.
    """

    auction: Any
    runs: int | None
    parsed: ParsedTexts | None
    format: int

    @property
    def earlier(self) -> int:
        """Number of runs before this start of the market, as far as it knows."""
        return int(self.auction.earlier_runs)

    @property
    def least(self) -> int:
        """Least number of runs before it, by the counts in its bids."""
        ranking = self.auction.ranking
        last = max((bid.last_run for bid in ranking), default=0)
        return max(int(last), sum(int(bid.runs) for bid in ranking))


@dataclass(kw_only=True)
class RecordedFeedback:
    """One change of a profile.

    Attributes:
        card: The agent as its host introduced it last; None for unknown.
        parameters: Order of the values of the card.
        parsed: Texts that define the scene parameters; None for unknown.
    """

    feedback: Any
    card: Any
    parameters: tuple[str, ...]
    parsed: ParsedTexts | None


@dataclass(kw_only=True)
class RecordingIndex:
    """Contents of a journal.

    Attributes:
        rounds: Of all markets, in order.
        counts: Topic → messages.
        lost: Topic → messages that the journal found no room for.
        first_ns: When the first message was sent [ns since 1970]; 0 for none.
        problems: Texts about what cannot be read.
        hints: Texts to show before them.
    """

    rounds: list[Round] = field(default_factory=list)
    feedbacks: list[RecordedFeedback] = field(default_factory=list)
    runs: dict[RunKey, RecordedRun] = field(default_factory=dict)
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


def index_entries(entries: Iterable[JournalEntry]) -> RecordingIndex:
    """Return the contents of messages in the order in which they were sent."""
    return _Indexer().index(entries)


def read(paths: Sequence[Path]) -> RecordingIndex:
    """Return the contents of some files; messages of no use for a replay are only counted.

    Raises:
        BtAgentsError: A file cannot be opened.
    """
    reader = JournalReader(paths)
    recording = index_entries(reader.entries(_HANDLERS.keys()))
    for topic, counted in reader.counted.items():
        recording.counts[topic] += counted.messages
        if counted.lost:
            recording.lost[topic] += counted.lost
        recording.first_ns = min(recording.first_ns or counted.first_ns, counted.first_ns)
        recording.last_ns = max(recording.last_ns, counted.last_ns)
    recording.problems[:0] = reader.problems
    return recording


class _Indexer:
    def __init__(self) -> None:
        self.recording = RecordingIndex()
        self._cards: dict[str, tuple[Any, tuple[str, ...]]] = {}
        self._texts: defaultdict[str, list[TextFiles]] = defaultdict(list)
        self._newest: TextFiles | None = None
        self._begun: Counter[str] = Counter()
        self._whole: set[str] = set()
        self._last_runs: dict[str, RecordedRun] = {}

    def index(self, entries: Iterable[JournalEntry]) -> RecordingIndex:
        recording = self.recording
        for entry in entries:
            recording.counts[entry.topic] += 1
            recording.first_ns = recording.first_ns or entry.sent_ns
            recording.last_ns = max(recording.last_ns, entry.sent_ns)
            if entry.lost:
                recording.lost[entry.topic] += entry.lost
            handle = _HANDLERS.get(entry.type)
            if handle is None:
                continue
            try:
                message = entry.decode()
                handle(self, message)
                if entry.type in _OF_RUNS:
                    self._mark_gap(entry.topic, self._run_of(message), entry.lost > 0)
            except (BtAgentsError, AttributeError, ValueError, LookupError, TypeError) as error:
                reason = error.reason if isinstance(error, Refused) else str(error)
                problem = f"a message on {entry.topic} cannot be read: {reason}"
                if problem not in recording.problems:
                    recording.problems.append(problem)
        return recording

    def _mark_gap(self, topic: str, run: RecordedRun, gap: bool) -> None:
        """Mark the runs before and after lost messages, as both may miss some."""
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
            parsed=self._newest.parsed if self._newest is not None else None,
            format=written,
        )
        if one.runs is not None and one.runs + one.earlier < one.least:
            # A run that the journal has not received.
            self._whole.discard(epoch)
            one.runs = None
        self.recording.rounds.append(one)

    def _feedback(self, message: Any) -> None:
        card, parameters = self._cards.get(message.agent, (None, ()))
        parsed = self._newest.parsed if self._newest is not None else None
        self.recording.feedbacks.append(
            RecordedFeedback(feedback=message, card=card, parameters=parameters, parsed=parsed)
        )

    def _record(self, message: Any) -> None:
        run = self._run_of(message)
        if not run.records:
            run.texts = tuple(reversed(self._texts[message.host_instance]))
        run.records.append(message)

    def _status(self, message: Any) -> None:
        self._run_of(message).statuses.append(message)

    def _run_of(self, message: Any) -> RecordedRun:
        key = (message.host_instance, message.epoch, message.round, message.agent)
        return self.recording.runs.setdefault(key, RecordedRun(key=key))


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

_HANDLERS = {
    f"{_TYPES}AgentFiles": _Indexer._files,
    f"{_TYPES}HostCard": _Indexer._card,
    f"{_TYPES}Run": _Indexer._run,
    f"{_TYPES}Auction": _Indexer._auction,
    f"{_TYPES}Feedback": _Indexer._feedback,
    f"{_TYPES}RunRecord": _Indexer._record,
    f"{_TYPES}TreeStatus": _Indexer._status,
}
