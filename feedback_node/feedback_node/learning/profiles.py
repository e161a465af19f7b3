# SPDX-License-Identifier: Apache-2.0
"""Current profiles of all known agents, their recorded changes, and the deliveries to hosts."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import FeedbackKind
from bt_agents_core.profile_layers import MOST_LAYERS
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace, Vector
from bt_agents_core.text import printable_line
from feedback_node.announced_runs import AnnouncedRun
from feedback_node.learning import learning_step
from feedback_node.learning.cards import Agent, LearningCard, read_card
from feedback_node.learning.layers import LayerStep, anonymous, layer_step, past_targets, shares
from feedback_node.ledger import Ledger, LedgerEntry
from feedback_node.ledger.file import LedgerError
from feedback_node.ledger.rows import FORGOTTEN, LAYER, ProfileRevision, RevisionCause, check_texts

MOST_HOSTS = 100
"""Most hosts with known agents; see :meth:`Profiles.register_card`."""

_REMEMBERED = 1000
"""Most layers whose targets are cached."""


@dataclass(frozen=True, kw_only=True)
class ProfileChange:
    """Recorded change; vectors in the order of the space, NaN for missing values.

    Attributes:
        revision: Row of the ledger, with agent, layer, cause and time.
        target: Vector that the profile moved towards or away from; NaN for no opinion.
        rates: Fraction of the distance that each parameter moved; empty if all moved by the
            learning rate.
        false_rate: Estimated share of wrong feedback for the profile, 0..1; NaN for too little
            feedback.
        fresh: False if the same feedback was recorded earlier and not applied again.
        others: Changes of the same feedback in other layers.
    """

    revision: ProfileRevision
    before: Vector
    after: Vector
    target: Vector
    rates: Vector = ()
    false_rate: float = math.nan
    fresh: bool
    text: str
    others: tuple[ProfileChange, ...] = ()

    @property
    def all(self) -> tuple[ProfileChange, ...]:
        """This change and ``others``."""
        return (self, *self.others)


@dataclass(frozen=True, kw_only=True)
class Delivery:
    """Profile to send to a host, which bids with it from then on.

    Attributes:
        host: Full name of the host.
        agent: Agent of the profile; empty if the host must forget all of its layers.
        layer: Layer of the profile; empty for the profile for everybody.
        remove: True if the host must forget it.
        values: The profile; empty if it is removed.
    """

    host: str
    agent: str
    layer: str = ""
    remove: bool = False
    values: Vector = ()
    revision: int = 0


Table = tuple[tuple[str, str, int, Vector], ...]
"""Name, layer, revision and profile of every known agent and layer, by name and layer."""


def changed(
    revision: ProfileRevision,
    before: ProfileRevision,
    space: SceneSpace,
    *,
    fresh: bool,
    text: str,
    false_rate: float = math.nan,
) -> ProfileChange:
    """Return a recorded change as vectors; see :class:`ProfileChange`."""
    rates = revision.cause.rates
    return ProfileChange(
        revision=revision,
        before=space.ordered(before.profile),
        after=space.ordered(revision.profile),
        target=space.ordered(revision.cause.target),
        rates=space.ordered(rates) if rates else (),
        false_rate=false_rate,
        fresh=fresh,
        text=text,
    )


def moved(before: ProfileRevision, after: ProfileRevision) -> str:
    """Return the difference of two revisions as text."""
    moves = [
        f"{name} {before.profile.get(name, math.nan):.4g} → {value:.4g}"
        for name, value in after.profile.items()
        if before.profile.get(name) != value
    ]
    return ", ".join(moves) or "the profile stays as it is"


def together(changes: Sequence[ProfileChange]) -> ProfileChange:
    """Return the changes of one feedback as a single change with all texts."""
    first, *others = changes
    more = [one.text if one.revision.layer else f"for everybody {one.text}" for one in others]
    text = "; ".join([first.text, *more])
    return replace(first, text=text, others=tuple(others))


class Profiles:
    """Agents of all cards, with their profiles in the ledger; errors of the ledger are passed on.

    Args:
        space: The scene parameters.
        ledger: Ledger that records the profiles.
        is_there: Returns whether a host accepts profiles.
    """

    def __init__(
        self,
        space: SceneSpace,
        ledger: Ledger,
        is_there: Callable[[str], bool] = lambda _host: True,
    ) -> None:
        self.scenes = space
        self.space = space.profiles
        self._ledger = ledger
        self._agents: dict[str, Agent] = {}
        self._is_there = is_there
        self._starts: dict[str, str] = {}
        self._current: dict[tuple[str, str], ProfileRevision] = {}
        self._false_rates: dict[tuple[str, str], tuple[int, float]] = {}
        self._differing: set[str] = set()
        self._recent: dict[tuple[str, str], tuple[int, int, tuple[Vector, ...]]] = {}

    def register_card(self, card: LearningCard) -> tuple[tuple[Delivery, ...], tuple[str, ...]]:
        """Register the card of a host.

        A card without agents is from a start that is not registered with the market; it does not
        affect another start of the same name.

        When :data:`MOST_HOSTS` are known, a new host replaces the absent one that became known
        last, so that invented hosts replace each other.

        Returns:
            Deliveries that the host still needs, and the problems of its agents in words.

        Raises:
            Refused: The whole card is refused: ``TOO_MANY_HOSTS``, or see :func:`read_card` and
                :class:`Ledger`.
        """
        agents, problems = read_card(card, self.space, self._agents)
        start = self._starts.get(card.host)
        fresh = start != card.instance
        if not card.agents and start is not None and fresh:
            return (), ()
        self._make_room_for(card.host)
        entered = self._enter(agents)
        self._drop(card.host, keep={agent.name for agent in agents})
        hosts = self.hosts
        self._starts = {host: known for host, known in self._starts.items() if host in hosts}
        self._starts[card.host] = card.instance
        deliveries, more = [], []
        if fresh and agents and self._ledger.has_layers():
            # It drops layers that may be forgotten by now; the current ones follow its answer.
            deliveries.append(Delivery(host=card.host, agent="", remove=True))
        for agent in agents:
            known = self._agents.get(agent.name, agent)
            if known.host != agent.host:
                more.append(
                    f"TWO_HOSTS: '{agent.name}' was at {known.host}, now it is at {agent.host}; "
                    f"what it learns goes there"
                )
            self._agents[agent.name] = agent
            revision = self._current[agent.name, ""].revision
            self._differing.discard(agent.name)
            if agent.entry.revision < revision:
                deliveries.append(self.delivery(agent.name))
            elif agent.entry.revision > revision:
                more.append(
                    f"STALE_LEDGER: {agent.host} holds revision {agent.entry.revision} of "
                    f"'{agent.name}', the ledger ends at {revision}; it is given that profile. "
                    "Put the newer ledger back if there is one, else somebody has set the profile "
                    "past the feedback node"
                )
            elif self._bids_otherwise(agent):
                more.append(
                    f"OTHER_PROFILE: {agent.host} bids for '{agent.name}' with other values than "
                    f"those of revision {revision} in the ledger; it is given them"
                )
            else:
                continue
            if agent.entry.revision >= revision:
                deliveries.append(self.delivery(agent.name))
                self._differing.add(agent.name)
        if not fresh:
            deliveries += [d for d in self.layers_at(card.host) if d.agent in entered]
        return tuple(deliveries), (*problems, *more)

    def _make_room_for(self, host: str) -> None:
        """Drop an absent host if there is no room for another one.

        Raises:
            Refused: ``TOO_MANY_HOSTS``.
        """
        hosts = self.hosts
        if host in hosts or len(hosts) < MOST_HOSTS:
            return
        for known in reversed(self._starts):
            if known in hosts and not self._is_there(known):
                self._drop(known)
                return
        raise Refused(
            RefusalCode.TOO_MANY_HOSTS,
            f"card of {host}: {len(hosts)} hosts are there, expected {MOST_HOSTS} at most; let "
            "one host have more agents",
        )

    def _drop(self, host: str, keep: Collection[str] = ()) -> None:
        """Forget the agents of a host except those to keep."""
        for name, known in list(self._agents.items()):
            if known.host == host and name not in keep:
                del self._agents[name]
                self._differing.discard(name)
                for key in [key for key in self._current if key[0] == name]:
                    del self._current[key]

    @property
    def differing(self) -> tuple[str, ...]:
        """The known agents whose host bids with another profile than that in the ledger."""
        return tuple(sorted(self._differing))

    def not_delivered(self, name: str) -> None:
        """Record that the host of an agent has not accepted its profile, until a card shows it."""
        if name in self._agents:
            self._differing.add(name)

    def agent(self, name: str) -> Agent:
        """Return a known agent.

        Raises:
            Refused: ``UNKNOWN_AGENT``.
        """
        if name not in self._agents:
            known = ", ".join(sorted(self._agents)) or "none yet"
            raise Refused(RefusalCode.UNKNOWN_AGENT, f"no agent '{name}'; known are: {known}")
        return self._agents[name]

    @property
    def hosts(self) -> frozenset[str]:
        """The hosts with known agents."""
        return frozenset(agent.host for agent in self._agents.values())

    def knows(self, name: str) -> bool:
        """Return True if a card has introduced the agent."""
        return name in self._agents

    def profile(self, name: str, layer: str = "") -> Vector:
        """Return the profile of a known agent; that for everybody if the layer is missing."""
        current = self._current.get((name, layer), self._current[name, ""])
        values, authored = current.profile, self._agents[name].authored
        return self.space.clamp(
            [values.get(key, own) for key, own in zip(self.space.names, authored, strict=True)]
        )

    def check_expected(self, name: str, layer: str, expected: Vector) -> None:
        """Check that a profile still has the values that a request relies on.

        Args:
            name: Name of the agent.
            layer: As in :meth:`profile`.
            expected: NaN for any value, empty for all.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``WRONG_LENGTH`` or ``CHANGED_MEANWHILE``.
        """
        if not expected:
            return
        self.agent(name)
        names = self.space.names
        if len(expected) != len(names):
            raise Refused(
                RefusalCode.WRONG_LENGTH,
                f"{len(expected)} expected values, the scene has {len(names)} parameters",
            )
        current = self.profile(name, layer)
        for parameter, value, wanted in zip(names, current, expected, strict=True):
            if not (math.isnan(wanted) or math.isclose(value, wanted)):
                raise Refused(
                    RefusalCode.CHANGED_MEANWHILE,
                    f"{parameter} of {name} is {value:g} now, expected {wanted:g}",
                )

    def _bids_otherwise(self, agent: Agent) -> bool:
        """Return whether the card of an agent has other values than the ledger."""
        ledger = self.profile(agent.name)
        bid = agent.entry.current
        return len(bid) == len(ledger) and not all(map(math.isclose, bid, ledger))

    def delivery(self, name: str, layer: str = "") -> Delivery:
        """Return the delivery of a known agent's current profile to its host."""
        host = self._agents[name].host
        current = self._current.get((name, layer))
        if current is None:
            return Delivery(host=host, agent=name, layer=layer, remove=True)
        return Delivery(
            host=host,
            agent=name,
            layer=layer,
            values=self.profile(name, layer),
            revision=current.revision,
        )

    def layers_at(self, host: str) -> tuple[Delivery, ...]:
        """Return the deliveries of all layers of a host's agents."""
        return tuple(
            self.delivery(name, layer)
            for name, layer in sorted(self._current)
            if layer and self._agents[name].host == host
        )

    def deliveries(self, changes: Iterable[ProfileChange]) -> tuple[Delivery, ...]:
        """Return the deliveries of changed profiles to the hosts of known agents."""
        return tuple(
            self.delivery(change.revision.agent, change.revision.layer)
            for change in changes
            if self.knows(change.revision.agent)
        )

    def table(self) -> Table:
        """Return the profiles of all known agents and layers."""
        return tuple(
            (name, layer, self._current[name, layer].revision, self.profile(name, layer))
            for name, layer in sorted(self._current)
        )

    def recorded_of(self, prefix: str) -> Mapping[str, int]:
        """Return agent → number of its changes whose feedback id has the prefix."""
        return self._ledger.count(prefix)

    def recorded(self, feedback_id: str) -> ProfileChange | None:
        """Return the change that a feedback led to; None for a new id."""
        found = self._ledger.find_all(feedback_id)
        if not found:
            return None
        changes = []
        for revision in found:
            gone = revision.cause.cause == FORGOTTEN
            text = f"recorded before as revision {revision.revision}, not applied again"
            if gone:
                text = "recorded before, and forgotten since; not applied again"
            before = revision if gone else self._ledger.before(revision)
            changes.append(changed(revision, before, self.space, fresh=False, text=text))
        return replace(changes[0], others=tuple(changes[1:]))

    def apply(
        self,
        name: str,
        kind: FeedbackKind,
        target: Vector,
        *,
        feedback_id: str,
        source: str,
        reason: str,
        run: AnnouncedRun | None,
        cancels: bool = False,
        leaf: str = "",
    ) -> ProfileChange:
        """Move an agent's profile and record it; the same id is applied once.

        If the agent has separate layers for the person or the place of the run's scene, these
        layers move, and the profile for everybody moves in part; ``SET`` sets the profile for
        everybody. The target is a wanted profile or a scene, NaN for no opinion.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``TOO_LONG``, ``BAD_TEXT``, ``RESERVED_ID``,
                ``BAD_LAYER``, ``TOO_MANY_LAYERS`` if nothing else learns, or as in
                :func:`learning_step.step` and :class:`Ledger`; nothing has changed.
        """
        if (known := self.recorded(feedback_id)) is not None:
            return known
        agent = self.agent(name)
        reason = printable_line(reason)
        check_texts(feedback_id=feedback_id, source=source, reason=reason, leaf=leaf)
        cause = RevisionCause(
            kind=kind,
            source=source,
            reason=reason,
            feedback_id=feedback_id,
            epoch=run.epoch if run else "",
            round=run.round if run else 0,
            scene_id=run.scene.scene_id if run else "",
            leaf=leaf,
            cancels=cancels,
        )
        entries: list[LedgerEntry] = []
        steps: dict[str, LayerStep] = {}
        crowded: list[Refused] = []
        scene = run.scene if run else None
        window = agent.learning.window
        for number, (layer, share) in enumerate(shares(agent.learning, kind, scene)):
            known_layer = self._current.get((name, layer))
            if known_layer is None:
                try:
                    entries.append(self.first_layer_entry(name, layer))
                except LedgerError:
                    raise
                except Refused as refusal:
                    crowded.append(refusal)
                    continue
            one = layer_step(
                kind,
                self.profile(name, layer),
                target,
                agent=agent,
                share=share,
                cause=anonymous(cause) if number else cause,
                changes=known_layer.cause.changes if known_layer else 0,
                recent=self._past_targets(name, layer, window),
                space=self.space,
            )
            steps[layer] = one
            after = self.space.named(one.step.after)
            entries.append(LedgerEntry(agent=name, layer=layer, profile=after, cause=one.cause))
        if crowded and not steps:
            raise crowded[0]
        recorded = self._ledger.record(entries)
        for revision in recorded:
            if (step := steps.get(revision.layer)) and revision.cause is step.cause:
                self._recent.pop((name, revision.layer), None)
                self._recent[name, revision.layer] = (revision.revision, window, step.recent)
        while len(self._recent) > _REMEMBERED:
            del self._recent[next(iter(self._recent))]
        change = self.on_recorded(recorded, steps)
        if crowded:
            change = replace(change, text=f"{change.text}; {crowded[0].reason}")
        return change

    def on_recorded(
        self, revisions: Iterable[ProfileRevision], steps: Mapping[str, LayerStep] | None = None
    ) -> ProfileChange:
        """Adopt revisions that the ledger has recorded, of known and unknown agents.

        The beginning of a layer belongs to its next revision. ``steps`` are those of feedback.
        """
        changes = []
        for revision in revisions:
            name, layer = revision.agent, revision.layer
            before = self._current.get((name, layer))
            if self.knows(name):
                self._current[name, layer] = revision
            if revision.cause.cause == LAYER:
                continue
            one = steps.get(layer) if steps else None
            if before is None or before.revision != revision.revision - 1:
                before = self._ledger.before(revision)
            text = one.step.text if one else moved(before, revision)
            changes.append(
                changed(
                    revision,
                    before,
                    self.space,
                    fresh=True,
                    text=f"for {layer} {text}" if layer else text,
                    false_rate=self._false_rate_of(revision, one),
                )
            )
        return together(changes)

    def on_erased(self, profiles: Iterable[tuple[str, str]]) -> tuple[Delivery, ...]:
        """Drop erased layers; return the deliveries to their hosts."""
        deliveries = []
        for name, layer in profiles:
            self._current.pop((name, layer), None)
            self._false_rates.pop((name, layer), None)
            self._recent.pop((name, layer), None)
            if self.knows(name):
                deliveries.append(self.delivery(name, layer))
        return tuple(deliveries)

    def false_rate(self, name: str, layer: str = "") -> float:
        """Return the estimated share of wrong feedback; see :class:`ProfileChange`."""
        current = self._ledger.current(name, layer)
        return math.nan if current is None else self._false_rate_of(current, None)

    def _past_targets(self, name: str, layer: str, window: int) -> tuple[Vector, ...]:
        current = self._current.get((name, layer))
        number, reach, recent = self._recent.get((name, layer), (-1, 0, ()))
        if current is not None and (number, reach) == (current.revision, window):
            return recent
        return past_targets(self._ledger, name, layer, self.space, window)

    def _false_rate_of(self, revision: ProfileRevision, step: LayerStep | None) -> float:
        """Return it for the current revision of a profile; estimated once per revision."""
        key = (revision.agent, revision.layer)
        number, rate = self._false_rates.get(key, (-1, math.nan))
        if step is not None:
            rate = step.false_rate
        elif number != revision.revision:
            rate = learning_step.false_rate(
                past_targets(self._ledger, *key, self.space, 0), self.space
            )
        self._false_rates[key] = (revision.revision, rate)
        return rate

    def first_layer_entry(self, name: str, layer: str) -> LedgerEntry:
        """Return the first ledger entry of a layer, for an agent that the ledger knows.

        Raises:
            Refused: ``TOO_MANY_LAYERS``.
        """
        count = self._ledger.count_layers(name)
        if count >= MOST_LAYERS:
            raise Refused(
                RefusalCode.TOO_MANY_LAYERS,
                f"{name} has profiles of its own for {count} persons and places, expected "
                f"{MOST_LAYERS} at most; 'bt-agents profile expire' forgets those that have not "
                "changed for long",
            )
        cause = RevisionCause(
            cause=LAYER, source="feedback", reason="begins as the profile for everybody"
        )
        everybody = self._ledger.current(name)
        profile = everybody.profile if everybody is not None else {}
        return LedgerEntry(agent=name, layer=layer, profile=profile, cause=cause)

    def _enter(self, agents: Iterable[Agent]) -> Collection[str]:
        """Record new authored profiles in the ledger; return the names of their agents."""
        changed_agents = [
            agent
            for agent in agents
            if agent.name not in self._agents
            or self._agents[agent.name].authored != agent.authored
        ]
        if not changed_agents:
            return ()
        entered = self._ledger.enter(
            {a.name: self.space.named(a.authored) for a in changed_agents}
        )
        for name, revision in entered.items():
            self._current[name, ""] = revision
            for row in self._ledger.layers(name):
                self._current[name, row.layer] = row
        return entered.keys()
