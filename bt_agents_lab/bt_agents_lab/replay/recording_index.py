# SPDX-License-Identifier: Apache-2.0
"""Index of a journal: rounds, the rules that ranked them, and profile changes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.scene import SceneSpace, scene_name
from bt_agents_core.stop_cause import StopCause
from bt_agents_lab.recorder.reading import JournalEntry, JournalReader
from bt_agents_language.files.market_reader import MARKET_FILE, MarketRule, read_market
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.yaml.source import Source
from marketplace_node.outcomes import RunEventKind, RunOutcome
from marketplace_node.round.precedence import apply_rules
from marketplace_node.settings import RULES

Rules = tuple[MarketRule, ...]

_TYPES = "bt_agents_interfaces/msg/"
_SCENE = "scene.yaml"

NO_TEXTS = "there is no scene.yaml, as no host has sent its texts before"
"""Why a round with an unknown ``space`` cannot be decided again."""


def rules_of_market(
    auctions: Sequence[Any], texts: Iterable[str], space: SceneSpace
) -> tuple[Rules, ...]:
    """Return the rules that agree with all rounds of one start of a market, at least one.

    A market reads its rules at its start, and its hosts send their texts at each change: so its
    rules may differ from the newest text, and a host of another folder may have none. If none
    agree, the result is the rules of the first text.

    Args:
        auctions: Rounds of the market.
        texts: Texts of ``market.yaml``, the most likely one first.
        space: The scene parameters.
    """
    candidates = [*(_rules(text, space) for text in texts), ()]
    agreeing = [
        rules for rules in candidates if all(_agree(rules, auction) for auction in auctions)
    ]
    return tuple(agreeing) or (candidates[0],)


def _rules(text: str, space: SceneSpace) -> Rules:
    """Return the rules of a text; none if it is invalid, because then no rule counts."""
    try:
        return read_market(Source(MARKET_FILE, text), space)
    except BtAgentsError:
        return ()


def _agree(rules: Rules, auction: Any) -> bool:
    """Return whether these rules agree with a round that rules ranked or only scored."""
    bidders = [bid.agent for bid in auction.ranking]
    if RULES not in (auction.strategy, auction.shadow_strategy) or not bidders:
        return True
    values = {value.name: value.value for value in auction.scene.values}
    rule = apply_rules(rules, values, auction.scene.person, bidders).rule
    first = [agent for agent in rule.agents if agent in bidders] if rule else []
    if auction.strategy == RULES:
        return [bid.agent for bid in auction.ranking if bid.score < 0.0] == first
    return not first or auction.shadow_winner == first[0]


@dataclass(kw_only=True)
class Round:
    """One round of a market.

    Attributes:
        runs: Number of earlier runs of this start of the market; None if unknown.
        space: The scene parameters; None if unknown.
        possible_rules: Rules of the market, for the strategy ``rules``, that agree with all of
            its rounds, the most likely ones first.
        excluded: Agents that its call for bids left out; None if unknown.
        pinned: The one agent that could bid; empty for all.
        vetoed: Agents that could not bid.
        ran: Agents whose runs began after it; more than one if the host was lost.
        run_events: Messages about these runs, in order.
    """

    auction: Any
    runs: int | None
    space: SceneSpace | None
    possible_rules: tuple[Rules, ...] = ((),)
    excluded: tuple[str, ...] | None = None
    pinned: str = ""
    vetoed: tuple[str, ...] = ()
    ran: list[str] = field(default_factory=list)
    run_events: list[Any] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Its number and scene, for people."""
        return f"round {self.auction.round} ({scene_name(self.auction.scene)})"

    @property
    def rules(self) -> Rules:
        """The most likely rules of the market."""
        return self.possible_rules[0]

    @property
    def earlier(self) -> int:
        """Known number of runs before this start of the market."""
        return int(self.auction.earlier_runs)

    @property
    def least(self) -> int:
        """Minimum number of earlier runs, by the counts in its bids."""
        ranking = self.auction.ranking
        last = max((bid.last_run for bid in ranking), default=0)
        return max(int(last), sum(int(bid.runs) for bid in ranking))


@dataclass(kw_only=True)
class RecordedFeedback:
    """One change of a profile.

    Attributes:
        card: Latest card of the agent from its host; None if unknown.
        parameters: Order of the values of the card.
        space: The scene parameters; None if unknown.
    """

    feedback: Any
    card: Any
    parameters: tuple[str, ...]
    space: SceneSpace | None


@dataclass(kw_only=True)
class RecordedProfile:
    """Revision of a profile without feedback: its beginning, or an edit of its file.

    Attributes:
        layer: Layer; empty for everybody's profile.
        profile: Values; empty if the layer was forgotten.
    """

    agent: str
    layer: str
    profile: tuple[float, ...]


@dataclass(kw_only=True)
class RecordingIndex:
    """Contents of a journal.

    Attributes:
        events: Rounds of all markets, and changes of profiles, in order.
        recordings: Latest ``RecordingStatus`` of each file, in order.
        bookmarks: ``Bookmark`` messages, in order.
        counts: Topic → number of messages.
        lost: Topic → number of messages that the journal dropped.
        first_ns: When the first message was sent [ns since 1970]; 0 for none.
        files: Files that hold the messages.
        is_counted: Whether the files count lost messages.
        problems: Texts about unreadable parts.
        hints: Texts to show before the problems.
    """

    events: list[Round | RecordedFeedback | RecordedProfile] = field(default_factory=list)
    recordings: dict[str, Any] = field(default_factory=dict)
    bookmarks: list[Any] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    lost: Counter[str] = field(default_factory=Counter)
    first_ns: int = 0
    last_ns: int = 0
    files: list[Path] = field(default_factory=list)
    is_counted: bool = True
    problems: list[str] = field(default_factory=list)
    hints: list[str] = field(default_factory=list)

    @property
    def rounds(self) -> list[Round]:
        """Rounds of all markets, in order."""
        return [one for one in self.events if isinstance(one, Round)]

    @property
    def feedbacks(self) -> list[RecordedFeedback]:
        """Changes of profiles, in order."""
        return [one for one in self.events if isinstance(one, RecordedFeedback)]

    @property
    def whole(self) -> bool:
        """Whether everything was readable and nothing is lost."""
        return not self.problems and not self.lost


def index_entries(entries: Iterable[JournalEntry]) -> RecordingIndex:
    """Return the index of messages, which come in the order of sending."""
    return _Indexer().index(entries)


def read(paths: Sequence[Path], namespace: str = "") -> RecordingIndex:
    """Return the index of some files; messages that a replay does not need are only counted.

    Args:
        paths: As for :class:`JournalReader`.
        namespace: As for :class:`JournalReader`.

    Raises:
        BtAgentsError: A file cannot be opened, or holds several systems.
    """
    reader = JournalReader(paths, namespace)
    recording = index_entries(reader.entries(_HANDLERS.keys()))
    for topic, counted in reader.counted.items():
        recording.counts[topic] += counted.messages
        if counted.lost:
            recording.lost[topic] += counted.lost
        recording.first_ns = min(recording.first_ns or counted.first_ns, counted.first_ns)
        recording.last_ns = max(recording.last_ns, counted.last_ns)
    recording.files, recording.is_counted = reader.files, reader.is_counted
    recording.problems[:0] = reader.problems
    recording.hints += reader.hints
    return recording


class _Indexer:
    def __init__(self) -> None:
        self.recording = RecordingIndex()
        self._cards: dict[str, tuple[Any, tuple[str, ...]]] = {}
        self._unread: str | None = None
        self._space: SceneSpace | None = None
        self._markets: list[str] = []
        self._markets_of_epochs: dict[str, int] = {}
        self._begun: Counter[str] = Counter()
        self._whole: set[str] = set()
        self._rounds: dict[tuple[str, int], Round] = {}
        self._calls: dict[tuple[str, int], _Call] = {}
        self._overrides: dict[str, tuple[str, tuple[str, ...]]] = {}
        self._revisions: dict[tuple[str, str], int] = {}

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
                handle(self, entry.decode())
            except (BtAgentsError, AttributeError, ValueError, LookupError, TypeError) as error:
                problem = f"a message on {entry.topic} cannot be read: {_reason(error)}"
                if problem not in recording.problems:
                    recording.problems.append(problem)
        for epoch, before in self._markets_of_epochs.items():
            self._set_rules(epoch, [*reversed(self._markets[:before]), *self._markets[before:]])
        return recording

    def _set_rules(self, epoch: str, texts: Sequence[str]) -> None:
        """Set the rules in the rounds of one start of a market, from their known texts."""
        rounds = [one for key, one in self._rounds.items() if key[0] == epoch]
        space = next((one.space for one in rounds if one.space is not None), None)
        if space is not None:
            auctions = [one.auction for one in rounds]
            rules = rules_of_market(auctions, texts, space)
            for one in rounds:
                one.possible_rules = rules

    def _recording(self, message: Any) -> None:
        self.recording.recordings[message.file] = message

    def _bookmark(self, message: Any) -> None:
        self.recording.bookmarks.append(message)

    def _files(self, message: Any) -> None:
        texts = dict(zip(message.files, message.texts, strict=True))
        if (market := texts.get(MARKET_FILE)) is not None and market not in self._markets:
            self._markets.append(market)
        self._unread = texts.get(_SCENE)

    def _known_space(self) -> SceneSpace | None:
        """Return the parameters in the newest ``scene.yaml`` that can be read here."""
        text, self._unread = self._unread, None
        if text is not None:
            try:
                self._space = read_scene(Source(_SCENE, text)).space
            except BtAgentsError:
                if self._space is None:
                    raise
        return self._space

    def _card(self, message: Any) -> None:
        for card in message.agents:
            self._cards[card.name] = (card, tuple(message.parameters))

    def _market(self, message: Any) -> None:
        self._markets_of_epochs.setdefault(message.epoch, len(self._markets))
        self._overrides[message.epoch] = (message.pinned, tuple(message.vetoed))

    def _call(self, message: Any) -> None:
        pinned, vetoed = self._overrides.get(message.epoch, ("", ()))
        self._calls[message.epoch, message.round] = _Call(
            excluded=tuple(message.excluded), pinned=pinned, vetoed=vetoed
        )

    def _run(self, message: Any) -> None:
        one = self._rounds.get((message.epoch, message.round))
        ran = one.ran if one is not None else []
        if one is not None:
            one.run_events.append(message)
        if message.event == RunEventKind.STARTED:
            self._begun[message.epoch] += 1
            ran.append(message.agent)
        elif message.event == RunEventKind.ENDED and message.agent not in ran:
            # The run was stopped before its host took it; a host ends only runs that it has taken.
            taken = message.outcome in _TAKEN or message.stop_cause != StopCause.NOT_STOPPED
            self._begun[message.epoch] += taken

    def _auction(self, message: Any) -> None:
        if message.preview:
            return
        epoch = message.epoch
        if message.round == 1:
            self._whole.add(epoch)
        self._markets_of_epochs.setdefault(epoch, len(self._markets))
        call = self._calls.pop((epoch, message.round), _Call())
        one = Round(
            auction=message,
            runs=self._begun[epoch] if epoch in self._whole else None,
            space=self._known_space(),
            excluded=call.excluded,
            pinned=call.pinned,
            vetoed=call.vetoed,
        )
        if one.runs is not None and one.runs + one.earlier < one.least:
            # A run that the journal has not received.
            self._whole.discard(epoch)
            one.runs = None
        self.recording.events.append(one)
        self._rounds[epoch, message.round] = one

    def _feedback(self, message: Any) -> None:
        card, parameters = self._cards.get(message.agent, (None, ()))
        self._revisions[message.agent, message.layer] = message.revision
        self.recording.events.append(
            RecordedFeedback(
                feedback=message, card=card, parameters=parameters, space=self._known_space()
            )
        )

    def _profiles(self, message: Any) -> None:
        """Take the table of all profiles, for revisions without feedback."""
        width, found, events = len(message.parameters), {}, self.recording.events
        keys = zip(message.agents, message.layers, message.revisions, strict=True)
        for place, (agent, layer, revision) in enumerate(keys):
            found[agent, layer] = revision
            if self._revisions.get((agent, layer)) != revision:
                profile = tuple(message.vectors[place * width : (place + 1) * width])
                events.append(RecordedProfile(agent=agent, layer=layer, profile=profile))
        for agent, layer in self._revisions:
            if layer and (agent, layer) not in found:
                events.append(RecordedProfile(agent=agent, layer=layer, profile=()))
        self._revisions = found


def _reason(error: Exception) -> str:
    match error:
        case Refused():
            return error.reason
        case AttributeError():
            return (
                f"it has no '{error.name}', as messages of another version; replay it with the "
                "version that recorded it"
            )
        case _:
            return str(error)


@dataclass(frozen=True, kw_only=True)
class _Call:
    """Call for bids, with the pins and vetoes in force; by default an unrecorded one."""

    excluded: tuple[str, ...] | None = None
    pinned: str = ""
    vetoed: tuple[str, ...] = ()


_TAKEN = (RunOutcome.SUCCEEDED, RunOutcome.FAILED, RunOutcome.LOST)

_HANDLERS = {
    f"{_TYPES}AgentFiles": _Indexer._files,
    f"{_TYPES}Bookmark": _Indexer._bookmark,
    f"{_TYPES}RecordingStatus": _Indexer._recording,
    f"{_TYPES}HostCard": _Indexer._card,
    f"{_TYPES}Run": _Indexer._run,
    f"{_TYPES}MarketStatus": _Indexer._market,
    f"{_TYPES}CallForBids": _Indexer._call,
    f"{_TYPES}Auction": _Indexer._auction,
    f"{_TYPES}Feedback": _Indexer._feedback,
    f"{_TYPES}Profiles": _Indexer._profiles,
}
