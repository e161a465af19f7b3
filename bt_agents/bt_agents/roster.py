# SPDX-License-Identifier: Apache-2.0
"""The agents of one host as the market sees them: who bids what for a scene, and who declines."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

from bt_agents.engine.scope import RunScope, holds
from bt_agents.errors import Refused
from bt_agents.language.expression.expressions import EvaluationError, MissingValue
from bt_agents.language.specs import AgentSpec, Plain
from bt_agents.layers import MOST_LAYERS, checked_layer, layers_of
from bt_agents.scene import Scene, SceneSpace, Vector


@dataclass(kw_only=True)
class Member:
    """One agent and what has changed since its file was read.

    Attributes:
        spec: The file.
        profile: What it bids now.
        revision: Ledger revision of that profile; 0 for the one in the file.
        layers: Profile and ledger revision for a person or a place, by ``person/anna``.
        learning_rate: 0..1.
        tunables: Current values by name; a running tree reads the same mapping.
        agent_id: Id from the market; 0 while it is not registered.
        refusal: Why the market does not take it; empty when it does.
        leaving: Why it does not bid any more and goes; empty when it stays.
    """

    spec: AgentSpec
    profile: Vector
    revision: int = 0
    layers: dict[str, tuple[Vector, int]] = field(default_factory=dict)
    learning_rate: float
    tunables: dict[str, Plain] = field(default_factory=dict)
    agent_id: int = 0
    refusal: str = ""
    leaving: str = ""

    def profile_for(self, scene: Scene) -> Vector:
        """Return what it bids for a scene: for the person, else for the place, else for all."""
        for kind, layer in layers_of(scene).items():
            if kind in self.spec.learning.layers and layer in self.layers:
                return self.layers[layer][0]
        return self.profile


@dataclass(frozen=True, kw_only=True)
class Answer:
    """A host's answer to a call for bids: who bids, and name → reason of those who do not."""

    bids: tuple[Member, ...]
    declined: Mapping[str, str]


class Roster:
    """All agents of a host by name."""

    def __init__(self, space: SceneSpace, agents: Iterable[AgentSpec]) -> None:
        self.space = space
        self.members: dict[str, Member] = {}
        for spec in agents:
            self.add(spec)

    def add(self, spec: AgentSpec) -> Member:
        """Take an agent in, as its file says; return it."""
        member = self.members[spec.name] = Member(
            spec=spec,
            profile=spec.profile,
            learning_rate=spec.learning_rate,
            tunables={tunable.name: tunable.default for tunable in spec.tunables},
        )
        return member

    def remove(self, name: str) -> None:
        """Let an agent go."""
        del self.members[name]

    def member(self, name: str) -> Member:
        """Return an agent.

        Raises:
            Refused: ``UNKNOWN_AGENT``.
        """
        if name not in self.members:
            known = ", ".join(self.members) or "none"
            raise Refused("UNKNOWN_AGENT", f"no agent '{name}' here; there are: {known}")
        return self.members[name]

    def enrol(self, names: Iterable[str], ids: Iterable[int], reasons: Iterable[str]) -> None:
        """Take over the market's answer to a registration."""
        for name, agent_id, reason in zip(names, ids, reasons, strict=True):
            if name in self.members:
                self.members[name].agent_id = agent_id
                self.members[name].refusal = "" if agent_id else reason

    def answer(
        self, scene: Scene, excluded: Collection[str] = (), *, obstacle: str = ""
    ) -> Answer:
        """Return who bids for a scene; members that the market did not take stay silent.

        Args:
            scene: What is to be bid for.
            excluded: Names of agents that are not asked.
            obstacle: Why nobody here can run now, in words; empty when they can.
        """
        bids = []
        declined = {}
        for member in self.members.values():
            if not member.agent_id or member.spec.name in excluded:
                continue
            reason = obstacle or self._obstacle(member, scene)
            if reason:
                declined[member.spec.name] = reason
            else:
                bids.append(member)
        return Answer(bids=tuple(bids), declined=declined)

    def set_profile(self, name: str, values: Iterable[float], revision: int) -> Member:
        """Give an agent a new profile; return the agent.

        Raises:
            Refused: ``UNKNOWN_AGENT``, ``STALE_REVISION``, or as in :meth:`SceneSpace.vector`.
        """
        member = self.member(name)
        profile = self.space.vector(values, what=f"profile of {name}")
        if revision < member.revision:
            raise Refused(
                "STALE_REVISION",
                f"{name} has revision {member.revision} already, {revision} is older",
            )
        member.profile = profile
        member.revision = revision
        return member

    def set_layer(self, name: str, layer: str, values: Iterable[float], revision: int) -> Member:
        """Give an agent a new profile for a person or a place; return the agent.

        Raises:
            Refused: ``BAD_LAYER``, ``TOO_MANY_LAYERS``, or as in :meth:`set_profile`.
        """
        member = self.member(name)
        profile = self.space.vector(values, what=f"profile of {name} for {checked_layer(layer)}")
        held = member.layers.get(layer)
        if held is None and len(member.layers) >= MOST_LAYERS:
            raise Refused(
                "TOO_MANY_LAYERS",
                f"{name} has profiles for {MOST_LAYERS} persons and places already",
            )
        if held is not None and revision < held[1]:
            raise Refused(
                "STALE_REVISION",
                f"{name} has revision {held[1]} for {layer} already, {revision} is older",
            )
        member.layers[layer] = (profile, revision)
        return member

    def weights(self, members: Iterable[Member]) -> list[float]:
        """Return how much each parameter counts for each of some agents, one after the other.

        Empty when all count as scene.yaml says.
        """
        own = [member.spec.weights for member in members]
        if not any(own):
            return []
        return [
            float(one.get(parameter.name, parameter.weight))
            for one in own
            for parameter in self.space.parameters
        ]

    def remove_layer(self, name: str, layer: str) -> None:
        """Forget the profile of an agent for a person or a place; all of all with empty names.

        Raises:
            Refused: ``UNKNOWN_AGENT`` or ``BAD_LAYER``.
        """
        if not name and not layer:
            for member in self.members.values():
                member.layers.clear()
            return
        self.member(name).layers.pop(checked_layer(layer), None)

    def _obstacle(self, member: Member, scene: Scene) -> str:
        if member.leaving:
            return member.leaving
        if member.spec.unoffered:
            return "; ".join(member.spec.unoffered)
        return unmet(member.spec, self.space, scene, member.profile_for(scene), member.tunables)


def unmet(
    spec: AgentSpec,
    space: SceneSpace,
    scene: Scene,
    profile: Vector,
    tunables: Mapping[str, Plain],
) -> str:
    """Return what an agent requires of a scene and does not find, in words; empty for nothing."""
    requires = spec.requires
    if requires is None:
        return ""
    scope = RunScope(
        space=space, scene=scene, live=lambda: scene, profile=profile, tunables=tunables
    )
    try:
        return "" if holds(requires, scope) else f"needs {requires.text}"
    except MissingValue as missing:
        return f"needs {requires.text}, but {missing.name} is missing"
    except EvaluationError as error:
        return f"needs {requires.text}, but {error}"
