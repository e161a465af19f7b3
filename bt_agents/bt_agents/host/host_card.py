# SPDX-License-Identifier: Apache-2.0
"""Card of a host, with the structure of its trees and the texts of their files."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterable
from dataclasses import asdict

from rclpy.node import Node

from bt_agents.host.agent_registry import AgentRegistry, HostedAgent
from bt_agents.host.reload.version_state import FileProblem
from bt_agents.host.reload.versions import AgentVersions
from bt_agents_core.feedback import WEIGHTS, LearningRule
from bt_agents_core.scene import SceneSpace
from bt_agents_interfaces.msg import (
    AgentCard,
    AgentFiles,
    HostCard,
    Learning,
    Tree,
    TreeNode,
    Trees,
)
from bt_agents_interfaces.msg import FileProblem as FileProblemMsg
from bt_agents_interfaces.msg import MoodRule as MoodRuleMsg
from bt_agents_language.model.mood_rule import MoodRule
from bt_agents_language.model.specs import AgentSpec, NodeSpec
from bt_agents_ros import qos


class HostCardPublisher:
    """Publishes the card, trees and files of a host, latched.

    The card is published under the name of the host. Only the host that the market has registered
    publishes one: the card of another host of the same name would replace it.

    Args:
        other_problems: Returns problems outside the files.

    Attributes:
        problems: All problems at the time of the last card.
    """

    def __init__(
        self,
        node: Node,
        instance: str,
        registry: AgentRegistry,
        versions: AgentVersions,
        other_problems: Callable[[], Iterable[str]] = tuple,
    ) -> None:
        self._host = str(node.get_fully_qualified_name())
        self._instance = instance
        self._registry = registry
        self._versions = versions
        self._other_problems = other_problems
        self._folder = str(versions.trees.folder.resolve())
        self._machine = socket.gethostname()
        self._node = node
        self._registered = False
        self._texts: dict[str, str] = {}
        self.problems: tuple[FileProblem, ...] = ()
        self._cards = node.create_publisher(HostCard, "bt_agents/cards", qos.FACT)
        self._trees = node.create_publisher(Trees, "~/trees", qos.FACT)
        self._files = node.create_publisher(AgentFiles, "~/files", qos.FACT)

    def set_registered(self, registered: bool) -> None:
        """Publish the card of a host that the market has registered, or withdraw it."""
        if self._registered and not registered:
            self._node.destroy_publisher(self._cards)
            self._cards = self._node.create_publisher(HostCard, "bt_agents/cards", qos.FACT)
        self._registered = registered
        self.card()

    def card(self) -> None:
        """Publish the card: the registered agents, and every problem."""
        trees = self._versions.trees
        members = self._registry.members.values()
        problems = self._versions.folder_problems()
        for member in members:
            problems += self._versions.states[member.spec.name].problems
            if member.refusal:
                problems.append(FileProblem(agent=member.spec.name, message=member.refusal))
        problems += [
            FileProblem(agent=name, message=f"does not bid: it {reason}")
            for name, reason in self._registry.undecided.items()
        ]
        problems += [FileProblem(message=message) for message in self._other_problems()]
        self.problems = tuple(dict.fromkeys(problems))
        if not self._registered:
            return
        self._cards.publish(
            HostCard(
                host=self._host,
                host_instance=self._instance,
                machine=self._machine,
                trees=self._folder,
                parameters=list(self._registry.space.profiles.names),
                agents=[self._agent_card(member) for member in members if member.agent_id],
                broken_files=[str(broken.file) for broken in trees.broken],
                problems=_problems_to_msg(self.problems),
            )
        )

    def trees(self) -> None:
        """Publish the structure of all trees, including the clean-up branches."""
        # Created each time, because the nodes of 1,000 agents take 2 MB.
        self._trees.publish(
            Trees(
                host=self._host,
                host_instance=self._instance,
                trees=[
                    Tree(agent=name, nodes=_nodes(member.spec))
                    for name, member in self._registry.members.items()
                ],
            )
        )

    def files(self) -> None:
        """Publish the texts of the agents in force, if they have changed."""
        found = self._versions.texts_in_force()
        if found == self._texts:
            return
        self._texts = found
        self._files.publish(
            AgentFiles(
                host=self._host,
                host_instance=self._instance,
                files=list(found),
                texts=list(found.values()),
            )
        )

    def _agent_card(self, member: HostedAgent) -> AgentCard:
        spec = member.spec
        state = self._versions.states[spec.name]
        return AgentCard(
            name=spec.name,
            title=spec.title,
            description=spec.description,
            tags=list(spec.tags),
            profile=list(spec.profile),
            current=list(member.profile),
            revision=member.revision,
            learning_rate=member.learning_rate,
            learning=learning_to_msg(spec.learning, self._registry.space.profiles),
            rules=[rule_to_msg(rule) for rule in spec.rules],
            version=state.current.number,
            change=state.current.change,
            waiting=state.waiting is not None,
            degraded=bool(state.problems),
            problems=_problems_to_msg(state.problems),
            removal_reason=state.removal_reason,
        )


def learning_to_msg(rule: LearningRule, space: SceneSpace) -> Learning:
    """Return the message of a learning rule, with values in the order of the profile space."""
    weights = {**WEIGHTS, **rule.weights}
    return Learning(
        rates=space.ordered(rule.rates),
        update=rule.update.value,
        width=space.ordered(rule.width),
        window=rule.window,
        anneal=rule.anneal,
        drift=space.ordered(rule.drift),
        retreat=space.ordered(rule.retreat),
        sources=list(weights),
        weights=list(weights.values()),
        layers=list(rule.layers),
        general=rule.general,
    )


def rule_to_msg(rule: MoodRule) -> MoodRuleMsg:
    """Return the message of a mood rule."""
    return MoodRuleMsg(
        when=rule.when.text,
        hold_s=rule.hold_s,
        give=rule.give,
        action=rule.action,
        baseline_s=rule.baseline_s,
        release=rule.release.text if rule.release is not None else "",
        cooldown_s=rule.cooldown_s,
        confidence=rule.confidence,
    )


def _problems_to_msg(problems: Iterable[FileProblem]) -> list[FileProblemMsg]:
    return [FileProblemMsg(**asdict(problem)) for problem in problems]


def _nodes(agent: AgentSpec) -> list[TreeNode]:
    nodes: list[TreeNode] = []
    roots = [agent.tree, *([agent.on_cancel] if agent.on_cancel else [])]
    open_specs: list[tuple[NodeSpec, int]] = [(root, -1) for root in reversed(roots)]
    while open_specs:
        spec, parent = open_specs.pop()
        index = len(nodes)
        nodes.append(
            TreeNode(
                path=spec.path,
                parent=parent,
                kind=spec.kind,
                name=spec.name,
                file=spec.position.file,
                line=spec.position.line,
                column=spec.position.column,
            )
        )
        open_specs += [(child, index) for child in reversed(spec.children)]
    return nodes
