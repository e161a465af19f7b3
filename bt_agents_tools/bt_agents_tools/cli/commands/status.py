# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents status`: shows the market, all hosts and agents, and every problem."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import click
from rich.markup import escape

from bt_agents.host.reload.host_card_diff import degraded_reason, problem_text
from bt_agents.host.run_control import pause_text
from bt_agents_core.scene_labels import SceneLabels
from bt_agents_core.text import format_known
from bt_agents_tools.cli.connection import FIND_LIMIT_S, connect
from bt_agents_tools.cli.decisions import (
    SOON_S,
    admission_text,
    as_plain_data,
    disagreements,
    end_text,
    last_decisions,
    last_end_received,
    names_of_scenes,
)
from bt_agents_tools.cli.formatting import (
    STATES,
    clock_text,
    constant_text,
    counted,
    fitted_console,
    print_line,
    since_text,
)
from bt_agents_tools.cli.table import Column, TableForm, print_json, print_table, table_options
from bt_agents_tools.launcher.process_report import PARAMETERS, UP_ON

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_HEALTH_S = 5.0  # `up` publishes the health of its processes within a second of its discovery
_ENDS_SHOWN = 3
_AGENTS_SHOWN = 50
_DIFFERS = (
    "its host bids with another profile than the ledger has, and has not taken that one so "
    "far; the log of the feedback node says why"
)


@click.command()
@table_options
@click.option("--all", "shows_all", is_flag=True, help="Show every agent, not only the first 50.")
def status(form: TableForm, shows_all: bool) -> None:
    """Show what runs, all agents, and every problem."""
    observer = connect()
    scenes = observer.received("bt_agents/scene")
    ends = observer.received("bt_agents/scene_ends")
    health = observer.received("/diagnostics")
    auctions = last_decisions(observer)
    observer.spin_until(lambda: bool(observer.cards), FIND_LIMIT_S)
    at = _node_at_work(observer)
    pause = _pause(observer)
    observer.spin_until(lambda: last_end_received(observer, ends), SOON_S)
    observer.spin_until(lambda: observer.profiles is not None, SOON_S)
    unknown = _unknown_parameters(observer, health)
    market, names = observer.market, names_of_scenes(auctions)
    for scene in scenes:  # a refused scene has no decision
        names.add(scene)
    cards = [card for _, card in sorted(observer.cards.items())]
    if form is TableForm.JSON:
        found = {
            "market": market,
            "hosts": cards,
            "ended": ends[-_ENDS_SHOWN:],
            "rule_problems": rule_problems(market, observer.profiles),
            "differing": differing_agents(observer.profiles),
            "pauses": [] if pause is None else [pause],
        }
        plain = {name: as_plain_data(one) for name, one in found.items()}
        print_json({**plain, "unknown_parameters": unknown})
        return
    if form is TableForm.CSV:
        _print_agents(cards)
        return
    _print = partial(print_line, fitted_console(form))
    known = any(end.scene_id == market.finished_scene_id for end in ends[-_ENDS_SHOWN:])
    _print("market    ", market_text(market, names, time.time(), is_end_shown=known))
    if pause is not None:
        by = pause_text(pause.paused_at, pause.author)
        _print("          ", f"{by}, until 'bt-agents resume'")
    if at:
        _print("          ", f"at {at}")
    for host in market.refused_hosts:
        _print("          ", f"refuses {host}")
    for host in market.awaited_hosts:
        _print("          ", f"scenes in line wait for {host} to be back")
    for number, label in enumerate(market.waiting, start=1):
        _print("          ", f"waits, number {number} in line: '{names.name_of(label)}'")
    new_scenes = ", ".join(filter(None, admission_text(observer)))
    _print(
        "          ",
        f"round {market.round}, {counted(market.hosts, 'host')}, "
        f"{counted(market.agents, 'agent')}; new scenes: {new_scenes}",
    )
    for line in _ranking_lines(market, auctions[-1] if auctions else None):
        _print("          ", line)
    for problem in rule_problems(market, observer.profiles):
        _print("  problem: ", problem_text(problem))
    for text in unknown.values():
        _print("  problem: ", text)
    most = sys.maxsize if shows_all else _AGENTS_SHOWN
    for card, shown in zip(cards, shown_agents(cards, most), strict=True):
        machine = f", on {card.machine}" if card.machine else ""
        _print("host      ", f"{card.host}{machine}")
        for agent in shown:
            values = zip(card.parameters, agent.current, strict=True)
            profile = ", ".join(f"{name} {format_known(value)}" for name, value in values)
            _print(
                f"  {escape(f'{agent.name:<22}')} ",
                f"{profile}  (revision {agent.revision}, "
                f"version {agent.version}{_version_text(agent)})",
            )
            if agent.name in differing_agents(observer.profiles):
                _print("  problem: ", f"{agent.name}: {_DIFFERS}")
        if len(shown) < len(card.agents):
            more = counted(len(card.agents) - len(shown), "more agent")
            _print("  ", f"{more}: bt-agents status --all")
        for problem in card.problems:
            _print("  problem: ", problem_text(problem))
    for end in ends[-_ENDS_SHOWN:]:
        when = clock_text(end.header.stamp.sec)
        place = f"round {end.round}, " if end.round else ""
        _print(
            "ended     ", f"{when}, {place}'{names.name_of(end.scene_id)}', {end_text(end, names)}"
        )


def rule_problems(market: Any, profiles: Any) -> Sequence[Any]:
    """Return the rules of the market and of moods that could not be decided.

    The profiles are None if the feedback node has published none.
    """
    return [*market.problems, *(profiles.problems if profiles is not None else ())]


def differing_agents(profiles: Any) -> Sequence[str]:
    """Return the agents whose host bids with a profile that differs from the ledger."""
    return profiles.differing if profiles is not None else ()


def shown_agents(cards: Sequence[Any], most: int) -> list[Sequence[Any]]:
    """Return the first agents of all hosts, by host."""
    shown = []
    for card in cards:
        shown.append(card.agents[:most])
        most -= len(shown[-1])
    return shown


def market_text(market: Any, names: SceneLabels, now: float, *, is_end_shown: bool) -> str:
    """Return the activity of a market, its beginning and its scene, as text.

    For an idle market it is the last activity, unless that is shown elsewhere.
    """
    text = f"{constant_text(market, market.state, STATES)} {since_text(market.header.stamp, now)}"
    if market.scene_id:
        scene = market.scene_label or names.name_of(market.scene_id)
        return f"{text}: '{scene}', {names.with_names(market.message)}"
    if is_end_shown and not market.queued:
        return text
    return f"{text}: {names.with_names(market.message)}"


def _node_at_work(observer: Observer) -> str:
    """Return the node that decides the status of the running tree; empty without one."""
    market = observer.market
    if market.state not in (market.RUNNING, market.CANCELLING):
        return ""
    beats = observer.received(f"{market.host}/heartbeat")
    run = (market.epoch, market.round)

    def of_run() -> Any:
        return next((b for b in reversed(beats) if (b.epoch, b.round) == run and b.tip), None)

    observer.spin_until(lambda: of_run() is not None, SOON_S)
    beat = of_run()
    if beat is None:
        return ""
    return f"{beat.tip_name} ({beat.tip})" if beat.tip_name else str(beat.tip)


def _pause(observer: Observer) -> Any:
    """Return the ``RunControl.msg`` of the current run if it is paused, else None."""
    market = observer.market
    if market.state not in (market.RUNNING, market.CANCELLING):
        return None
    received = observer.received(f"{market.host}/run_control")
    observer.spin_until(lambda: bool(received), SOON_S)
    control = received[-1] if received else None
    return control if control is not None and control.paused else None


def _unknown_parameters(observer: Observer, received: Sequence[Any]) -> dict[str, str]:
    """Return sentences about parameters of files that no node has, as `up` reports them."""
    name = f"{observer.namespace}/{UP_ON}".lstrip("/")

    def of_up() -> list[Any]:
        every = (one for message in received for one in message.status)
        return [one for one in every if one.name.startswith(name)]

    if observer.market.supervised:
        observer.spin_until(lambda: bool(of_up()), _HEALTH_S)
    return {
        value.key: value.value
        for part in of_up()
        if part.name.endswith(f": {PARAMETERS}")
        for value in part.values
    }


def _ranking_lines(market: Any, last: Any) -> Iterator[str]:
    """Yield lines about the ranking of bids, and about agents that may not bid or get no run."""
    text = f"strategy: {market.strategy}"
    if market.shadow_strategy:
        text += f"; beside it {market.shadow_strategy} only scores"
        by = (market.strategy, market.shadow_strategy)
        if last is not None and (last.strategy, last.shadow_strategy) == by:
            text += f", {disagreements(last)}"
    yield text
    if market.pinned:
        yield f"pinned: only {market.pinned} may bid, until 'bt-agents unpin'"
    for agent in market.vetoed:
        yield f"vetoed: {agent} may not bid, until 'bt-agents allow {agent}'"
    for agent in market.starved:
        yield f"starved: {agent} bids again and again and gets no run"


def _version_text(agent: Any) -> str:
    waiting = "; a newer one waits for the end of the run" if agent.waiting else ""
    reason = degraded_reason(agent)
    return waiting + (f"; {reason}" if reason else "")


def _print_agents(cards: Sequence[Any]) -> None:
    """Print a CSV line for each agent of some hosts."""
    parameters = list(dict.fromkeys(name for card in cards for name in card.parameters))
    rows = []
    for card in cards:
        for agent in card.agents:
            profile = dict(zip(card.parameters, agent.current, strict=True))
            version = (agent.revision, agent.version, agent.waiting)
            state = (*version, degraded_reason(agent), card.machine)
            rows.append((agent.name, card.host, *map(profile.get, parameters), *state))
    keys = ("agent", "host", *parameters, "revision", "version", "waiting", "degraded", "machine")
    print_table([Column(key=key) for key in keys], rows, TableForm.CSV)
