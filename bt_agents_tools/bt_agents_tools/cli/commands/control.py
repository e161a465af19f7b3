# SPDX-License-Identifier: Apache-2.0
"""Commands that control a running tree: `bt-agents pause`, `resume`, `step` and `breakpoint`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.text import join_quoted
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_tools.cli.commands.tune import author_option
from bt_agents_tools.cli.connection import BUSY_LIMIT_S, accepted, connect, find_host, find_hosts
from bt_agents_tools.cli.table import Column, TableForm, print_table, table_options

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer


@click.command()
@author_option
def pause(author: str) -> None:
    """Stop ticking the running tree, until 'resume'; what it has begun goes on."""
    _control("PAUSE", author)


@click.command()
@author_option
def resume(author: str) -> None:
    """Tick a paused tree again."""
    _control("RESUME", author)


@click.command()
@author_option
def step(author: str) -> None:
    """Tick a paused tree once."""
    _control("STEP", author)


@click.command()
@click.argument("agent", default="")
@click.argument("nodes", nargs=-1)
@click.option(
    "--remove", is_flag=True, help="Remove the breakpoints of NODES; without any, all of AGENT."
)
@author_option
@table_options
def breakpoint(
    agent: str, nodes: Sequence[str], remove: bool, author: str, form: TableForm
) -> None:
    """Pause the run of AGENT whenever one of NODES is about to start.

    For example: bt-agents breakpoint attentive_guide 1.ask. A node is named by its path or the
    end of it. Without NODES it shows the breakpoints of AGENT, and without AGENT all.
    """
    if remove and not agent:
        raise click.UsageError("--remove needs an AGENT")
    observer = connect()
    if not nodes and not remove:
        hosts = [find_host(observer, agent)] if agent else find_hosts(observer)
        _show(observer, hosts, agent, form)
        return
    host = find_host(observer, agent)
    before = _breakpoints(observer, host).get(agent, [])
    if remove:
        gone = _paths(nodes, before) if nodes else before
        paths = [path for path in before if path not in gone]
    else:
        tree = _nodes(observer, [host]).get(agent, ())
        paths = list(dict.fromkeys([*before, *_paths(nodes, [one.path for one in tree])]))
    _ask(observer, host, "BREAKPOINTS", agent=agent, paths=paths, author=author)


def _control(action: str, author: str) -> None:
    observer = connect()
    market = observer.market
    if market.state not in (market.RUNNING, market.CANCELLING):
        raise BtAgentsError("no agent is running; look at 'bt-agents status'")
    _ask(observer, market.host, action, author=author, epoch=market.epoch, round=market.round)


def _ask(observer: Observer, host: str, action: str, **fields: Any) -> None:
    answer = observer.ask(f"{host}/control", action=action, **fields)
    click.echo(accepted(answer, f"the host {host}").message)


def _show(observer: Observer, hosts: Sequence[str], agent: str, form: TableForm) -> None:
    trees = _nodes(observer, hosts)
    stops = {
        (name, path)
        for host in hosts
        for name, paths in _breakpoints(observer, host).items()
        for path in paths
    }
    rows = [
        (name, node.path, node.name, (name, node.path) in stops)
        for name, nodes in sorted(trees.items())
        for node in nodes
        if name == agent or (not agent and (name, node.path) in stops)
    ]
    columns = [
        Column(key="agent"),
        Column(key="path"),
        Column(key="name"),
        Column(key="breakpoint", text=lambda one: "pauses before it" if one else ""),
    ]
    if not rows and not form.for_program:
        click.echo("no breakpoints; 'bt-agents breakpoint AGENT NODE' sets one")
        return
    print_table(columns, rows, form)


def _breakpoints(observer: Observer, host: str) -> dict[str, list[str]]:
    """Return the breakpoints of a host by agent."""
    received = observer.received(f"{host}/run_control")
    if not observer.spin_until(lambda: bool(received), BUSY_LIMIT_S):
        raise BtAgentsError(f"the host {host} does not say which breakpoints it has; try again")
    found: dict[str, list[str]] = {}
    for one in received[-1].breakpoints:
        found.setdefault(one.agent, []).append(one.path)
    return found


def _nodes(observer: Observer, hosts: Iterable[str]) -> dict[str, list[Any]]:
    """Return the tree nodes of some hosts by agent, without the clean-up."""
    received = [observer.received(f"{host}/trees") for host in hosts]
    observer.spin_until(lambda: all(received), BUSY_LIMIT_S)
    return {
        tree.agent: [node for node in tree.nodes if node.path.startswith("tree")]
        for messages in received
        for message in messages[-1:]
        for tree in message.trees
    }


def _paths(words: Iterable[str], known: Sequence[str]) -> list[str]:
    """Return the paths that match given paths or ends of paths.

    Raises:
        BtAgentsError: A given path matches none or several.
    """
    found = []
    for word in words:
        fitting = [path for path in known if path == word or path.endswith(f"/{word}")]
        if not fitting:
            ends = [path.rpartition("/")[2] for path in known]
            hint = did_you_mean(word, dict.fromkeys([*known, *ends]))
            raise BtAgentsError(f"no node '{word}' here; {hint}".rstrip("; "))
        if len(fitting) > 1 and word not in fitting:
            raise BtAgentsError(f"'{word}' may be {join_quoted(fitting)}; write more of the path")
        found.append(word if word in fitting else fitting[0])
    return found
