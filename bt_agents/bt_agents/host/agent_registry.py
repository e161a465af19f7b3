# SPDX-License-Identifier: Apache-2.0
"""Registry of the agents of one host: profiles, bids for a scene, and declines."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

from bt_agents_core.errors import Refused
from bt_agents_core.local_time import LocalTime
from bt_agents_core.profile_layers import MOST_LAYERS, checked_layer, layers_of
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene, SceneSpace, Vector
from bt_agents_language.expression.expression_values import Undecided
from bt_agents_language.expression.expressions import Expression, MissingValue
from bt_agents_language.expression.name_resolution import resolve
from bt_agents_language.model.specs import AgentSpec


@dataclass(kw_only=True, slots=True)
class HostedAgent:
    """One agent, with all changes since its file was read.

    Attributes:
        on_change: Called after an attribute was set.
        spec: Content of its file.
        profile: Its current profile, which it bids.
        revision: Ledger revision of the profile; 0 for the profile in the file.
        layers: Profile and ledger revision for a person or a place, by ``person/anna``.
        learning_rate: Learning rate, 0..1.
        tunables: Current values by name; a running tree reads this mapping.
        agent_id: Id from the market; 0 while not registered.
        refusal: Why the market refused it; empty if it did not.
        removal_reason: Why it is being removed and no longer bids; empty if it stays.
    """

    on_change: Callable[[], None] = field(repr=False, compare=False)
    spec: AgentSpec
    profile: Vector
    revision: int = 0
    layers: dict[str, tuple[Vector, int]] = field(default_factory=dict)
    learning_rate: float
    tunables: dict[str, bool | int | float | str] = field(default_factory=dict)
    agent_id: int = 0
    refusal: str = ""
    removal_reason: str = ""

    def __setattr__(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)
        self.on_change()

    def profile_for(self, scene: Scene) -> Vector:
        """Return its bid for a scene: for the person, else for the place, else for all."""
        return self._profile_in(layers_of(scene))

    @property
    def obstacle(self) -> str:
        """Why its tree cannot run here for any scene; empty if it can."""
        return self.removal_reason or "; ".join(self.spec.unoffered)

    def _profile_in(self, named: Mapping[str, str]) -> Vector:
        for kind, layer in named.items():
            if kind in self.spec.learning.layers and layer in self.layers:
                return self.layers[layer][0]
        return self.profile


@dataclass(frozen=True, kw_only=True, eq=False)
class BidderColumns:
    """Bidding agents by column, as in messages; shared, so do not modify.

    Attributes:
        members: The N agents.
        names: Their names.
        ids: Their ids.
        vectors: Their bids for a scene, concatenated; N times n.
        weights: Weight of each parameter for each agent, in the form of the vectors; empty if all
            use the weights of ``scene.yaml``.
    """

    members: tuple[HostedAgent, ...]
    names: list[str]
    ids: array[int]
    vectors: array[float]
    weights: array[float]


class Decline(NamedTuple):
    """Reason why an agent does not bid.

    Attributes:
        unmet: Part of its requirement that the scene lacks.
        undecided: True if its requirement cannot be decided.
    """

    reason: str
    unmet: str = ""
    undecided: bool = False


@dataclass(frozen=True, kw_only=True)
class HostBids:
    """Answer of a host to a call for bids: bidders, and declines by name."""

    bidders: BidderColumns
    declined: Mapping[str, Decline]

    @property
    def undecided(self) -> Mapping[str, str]:
        """Reasons for the agents whose requirement cannot be decided, by name."""
        return {name: one.reason for name, one in self.declined.items() if one.undecided}

    def fields(self) -> dict[str, Any]:
        return {
            "agents": self.bidders.names,
            "agent_ids": self.bidders.ids,
            "vectors": self.bidders.vectors,
            "weights": self.bidders.weights,
            "declined": list(self.declined),
            "decline_reasons": [decline.reason for decline in self.declined.values()],
            "unmet": [decline.unmet for decline in self.declined.values()],
        }


@dataclass(frozen=True, kw_only=True)
class _Registered:
    """Registered agents, prepared for scenes without a layer.

    ``conditional`` agents may decline a scene; ``layered``: some agent has a profile for a layer.
    """

    bidders: BidderColumns
    conditional: tuple[HostedAgent, ...]
    layered: bool


class AgentRegistry:
    """All agents of a host by name.

    Attributes:
        undecided: Those of the last answered call; see :class:`HostBids`.
    """

    def __init__(self, space: SceneSpace, agents: Iterable[AgentSpec]) -> None:
        self.space = space
        self.members: dict[str, HostedAgent] = {}
        self.undecided: Mapping[str, str] = {}
        self._registered: _Registered | None = None
        self._last_subset: tuple[frozenset[str], BidderColumns] | None = None
        for spec in agents:
            self.add(spec)

    def add(self, spec: AgentSpec) -> HostedAgent:
        """Add an agent from its file; return it."""
        member = self.members[spec.name] = HostedAgent(
            on_change=self._invalidate,
            spec=spec,
            profile=spec.profile,
            learning_rate=spec.learning_rate,
            tunables={tunable.name: tunable.default for tunable in spec.tunables},
        )
        return member

    def remove(self, name: str) -> None:
        """Remove an agent."""
        del self.members[name]
        self._invalidate()

    def member(self, name: str) -> HostedAgent:
        """Return an agent.

        Raises:
            Refused: ``UNKNOWN_AGENT``.
        """
        if name not in self.members:
            known = ", ".join(self.members) or "none"
            raise Refused(RefusalCode.UNKNOWN_AGENT, f"no agent '{name}' here; there are: {known}")
        return self.members[name]

    def apply_registration(
        self, names: Iterable[str], ids: Iterable[int], reasons: Iterable[str]
    ) -> None:
        """Apply the market's answer to a registration."""
        for name, agent_id, reason in zip(names, ids, reasons, strict=True):
            if name in self.members:
                self.members[name].agent_id = agent_id
                self.members[name].refusal = "" if agent_id else reason

    def bids_for(
        self,
        scene: Scene,
        excluded: Collection[str] = (),
        *,
        obstacle: str = "",
        clock: Callable[[], LocalTime] | None = None,
    ) -> HostBids:
        """Return the bids for a scene, from registered agents that are not excluded.

        ``obstacle`` is the reason why no agent of this host can run; empty if they can. ``clock``
        returns the local time; None where it is unknown.
        """
        registered = self._registered or self._register()
        everybody = registered.bidders
        if obstacle:
            decline = Decline(obstacle)
            declined = {name: decline for name in everybody.names if name not in excluded}
        else:
            declined = self._declined(registered.conditional, scene, excluded, clock)
        named = layers_of(scene) if registered.layered else {}
        if not (declined or excluded or named):
            return HostBids(bidders=everybody, declined=declined)
        others = frozenset(declined).union(excluded)
        some = self._last_subset
        if named or some is None or some[0] != others:
            bids = (m for m in everybody.members if m.spec.name not in others)
            some = (others, self._columns_of(bids, named))
            self._last_subset = None if named else some
        return HostBids(bidders=some[1], declined=declined)

    def set_profile(
        self, name: str, values: Iterable[float], revision: int, layer: str = ""
    ) -> HostedAgent:
        """Set the profile of an agent, for all or for a person or a place; return the agent.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``BAD_LAYER``, ``TOO_MANY_LAYERS``, or as in
                :meth:`SceneSpace.vector`.
        """
        member = self.member(name)
        whose = f" for {checked_layer(layer)}" if layer else ""
        profile = self.space.profiles.vector(values, what=f"profile of {name}{whose}")
        if layer and layer not in member.layers and len(member.layers) >= MOST_LAYERS:
            raise Refused(
                RefusalCode.TOO_MANY_LAYERS,
                f"{name} has profiles for {MOST_LAYERS} persons and places already",
            )
        if layer:
            member.layers[layer] = (profile, revision)
            self._invalidate()
        else:
            member.profile, member.revision = profile, revision
        return member

    def remove_layer(self, name: str, layer: str) -> None:
        """Remove the profile of an agent for a person or a place; empty names mean all.

        Raises:
            Refused: ``UNKNOWN_AGENT`` or ``BAD_LAYER``.
        """
        if not name and not layer:
            for member in self.members.values():
                member.layers.clear()
        else:
            self.member(name).layers.pop(checked_layer(layer), None)
        self._invalidate()

    def _invalidate(self) -> None:
        self._registered = self._last_subset = None

    def _register(self) -> _Registered:
        members = [member for member in self.members.values() if member.agent_id]
        self._registered = _Registered(
            bidders=self._columns_of(members, {}),
            conditional=tuple(
                member for member in members if member.obstacle or member.spec.requires is not None
            ),
            layered=any(member.layers for member in members),
        )
        return self._registered

    def _columns_of(
        self, members: Iterable[HostedAgent], named: Mapping[str, str]
    ) -> BidderColumns:
        """Return agents by column for scenes with these layers."""
        bidders = tuple(members)
        vectors, weights = array("d"), array("d")
        for member in bidders:
            vectors.extend(member._profile_in(named) if named else member.profile)
        own_weights = [member.spec.weights for member in bidders]
        if any(own_weights):
            parameters = self.space.profiles.parameters
            for own in own_weights:
                weights.extend(own.get(one.name, one.weight) for one in parameters)
        return BidderColumns(
            members=bidders,
            names=[member.spec.name for member in bidders],
            ids=array("I", [member.agent_id for member in bidders]),
            vectors=vectors,
            weights=weights,
        )

    def _declined(
        self,
        conditional: Iterable[HostedAgent],
        scene: Scene,
        excluded: Collection[str],
        clock: Callable[[], LocalTime] | None,
    ) -> dict[str, Decline]:
        """Return the declines of a scene by agent name."""
        declined = {}
        by_condition: dict[str, Decline | None] = {}
        for member in conditional:
            name, requires = member.spec.name, member.spec.requires
            if name in excluded:
                continue
            if member.obstacle:
                decline: Decline | None = Decline(member.obstacle)
            elif requires is not None and requires.text in by_condition:
                decline = by_condition[requires.text]
            elif requires is not None:
                decline = by_condition[requires.text] = decline_of(requires, scene, clock)
            else:
                continue
            if decline is not None:
                declined[name] = decline
        return declined


def decline_of(
    requires: Expression | None, scene: Scene, clock: Callable[[], LocalTime] | None = None
) -> Decline | None:
    """Return the decline of an agent whose requirement is not met now; None if it is met.

    A requirement names only values of the scene, its person and the time.
    """
    if requires is None:
        return None
    names = partial(resolve, scene=scene, clock=clock, person=scene.of_person)
    try:
        if requires.is_true(names):
            return None
        lacking = requires.unmet(names)
    except MissingValue as missing:
        lacking = f"{requires.text}, but {missing.name} is missing"
    except Undecided as undecided:
        return Decline(reason=f"needs what {undecided}", undecided=True)
    return Decline(reason=f"needs {lacking}", unmet=lacking)
