# SPDX-License-Identifier: Apache-2.0
"""How a host introduces itself: cards of its agents and the structure of their trees."""

from __future__ import annotations

from collections.abc import Iterable

from bt_agents.language.folder_reader import Trees as TreesFolder
from bt_agents.language.specs import NodeSpec
from bt_agents.roster import Member, Roster
from bt_agents_interfaces.msg import AgentCard, HostCard, MoodRule, Tree, TreeNode, Trees


def host_card(host: str, instance: str, roster: Roster, folder: TreesFolder) -> HostCard:
    """Return the card of a host: its registered agents, and every problem of its files."""
    problems = [line for broken in folder.broken for line in broken.error.lines]
    problems += [
        f"{member.spec.file}: {member.refusal}"
        for member in roster.members.values()
        if member.refusal
    ]
    return HostCard(
        host=host,
        host_instance=instance,
        parameters=list(roster.space.names),
        agents=[_agent_card(m) for m in roster.members.values() if m.agent_id],
        broken_files=[str(broken.file) for broken in folder.broken],
        problems=problems,
    )


def _agent_card(member: Member) -> AgentCard:
    spec = member.spec
    return AgentCard(
        name=spec.name,
        title=spec.title,
        description=spec.description,
        tags=list(spec.tags),
        profile=list(spec.profile),
        current=list(member.profile),
        revision=member.revision,
        learning_rate=member.learning_rate,
        rules=[
            MoodRule(
                when=rule.when.text,
                hold_s=rule.hold_s,
                give=MoodRule.POSITIVE if rule.positive else MoodRule.NEGATIVE,
                cancel=rule.cancel,
            )
            for rule in spec.rules
        ],
    )


def tree_structures(host: str, instance: str, members: Iterable[Member]) -> Trees:
    """Return the structure of the trees of all agents, the clean-up branches included."""
    return Trees(
        host=host,
        host_instance=instance,
        trees=[Tree(agent=m.spec.name, nodes=_nodes(m)) for m in members],
    )


def _nodes(member: Member) -> list[TreeNode]:
    nodes: list[TreeNode] = []
    roots = [member.spec.tree, *([member.spec.on_cancel] if member.spec.on_cancel else [])]
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
