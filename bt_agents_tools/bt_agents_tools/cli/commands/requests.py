# SPDX-License-Identifier: Apache-2.0
"""Commands that ask a running system: trigger, sense, cancel, status, why, feedback."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from bt_agents.host.reload.host_card_diff import why_kept
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_tools.cli.assignments import Assignments, assignments
from bt_agents_tools.cli.connection import FIND_LIMIT_S, accepted, running_system
from bt_agents_tools.cli.constants import STATES, code_words, counted, word
from bt_agents_tools.cli.decisions import (
    decision_as_json,
    disagreements,
    headline,
    heard_decisions,
    names_of_scenes,
    show_decision,
)
from bt_agents_tools.cli.scene_labels import SceneLabels
from bt_agents_tools.cli.wrap import print_line

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_DECIDE_LIMIT_S = 5.0

_SOON_S = 0.3

_CHALLENGE_LIMIT_S = 1.0

_ENDS_SHOWN = 3
_NOT_TAKEN = ("BUSY", "QUEUE_FULL", "DUPLICATE", "SHUTTING_DOWN")


@click.command()
@click.argument("values", nargs=-1, callback=assignments)
@click.option("--label", default="", help="Words for people.")
@click.option("--person/--no-person", default=True, help="Whether somebody is there.")
@click.option("--urgent", is_flag=True, help="Stop whoever runs, where new scenes preempt.")
def trigger(values: Assignments, label: str, person: bool, urgent: bool) -> None:
    """Put a scene on the market.

    For example: bt-agents trigger age=4.5 mood=2. What is not named is as measured, or missing.
    """
    with running_system() as observer:
        from bt_agents_tools.client import system

        auctions, ends = system.decisions(observer), system.scene_ends(observer)
        names, numbers = _columns(values)
        answer = system.analyze(
            observer, names, numbers, label=label, person=person, urgent=urgent, announce=True
        )
        mine = accepted(answer, "the scene layer").scene.scene_id

        def rounds() -> list[Any]:
            return [auction for auction in auctions if auction.scene.scene_id == mine]

        def end() -> Any:
            return next((end for end in ends if end.scene_id == mine), None)

        def decided() -> bool:
            last = rounds()[-1:]
            return end() is not None or any(a.outcome != a.PREEMPTS for a in last)

        def waits() -> bool:
            return not rounds() and bool(observer.market.queued)

        observer.turn_until(lambda: decided() or waits(), _DECIDE_LIMIT_S)
        if waits():
            # It may still be asked about, or be refused.
            observer.turn_until(lambda: decided() or bool(rounds()), _CHALLENGE_LIMIT_S)
        known = observer.turn_until(decided, _DECIDE_LIMIT_S) if rounds() else decided()
        scene_names = names_of_scenes(auctions)
        if any(auction.outcome == auction.WAITS for auction in rounds()[-1:]):
            # There may be no room to wait.
            observer.turn_until(lambda: end() is not None, _SOON_S)
        for auction in rounds():
            click.echo(f"round {auction.round}: {headline(auction)}")
            click.echo(scene_names.in_words(auction.reason))
        if end() is not None and end().code in _NOT_TAKEN:
            raise Refused(end().code, scene_names.in_words(end().message))
        if not known:
            says = scene_names.in_words(observer.market.message)
            click.echo(
                f"waits in line: {_place(observer, urgent)}; {says}"
                if waits()
                else f"not decided yet, the market says: {says}"
            )


def _place(observer: Observer, urgent: bool) -> str:
    """Return how many scenes wait, and what an urgent one cannot expect."""
    mode, waiting = _line(observer)
    if urgent and mode not in ("", "preempt"):
        waiting += f" (urgent counts only where new scenes preempt, here they {mode})"
    return waiting


def _line(observer: Observer) -> tuple[str, str]:
    """Return what becomes of new scenes, empty when nobody knows, and how many wait in words."""
    from bt_agents_tools.client import system

    waiting = observer.market.queued
    settings = system.new_scenes(observer)
    if settings is None:
        return "", f"{waiting} wait"
    mode, limit = settings
    return mode, f"{waiting} of {limit} wait"


@click.command()
@click.argument("values", nargs=-1, required=True, callback=assignments)
@click.option("--person/--no-person", default=None, help="Whether somebody is there.")
def sense(values: Assignments, person: bool | None) -> None:
    """Change the live scene of a run.

    For example: bt-agents sense mood=1.5.
    """
    with running_system() as observer:
        from bt_agents_tools.client import system

        names, numbers = _columns(values)
        answer = system.analyze(observer, names, numbers, person=person, announce=False)
        click.echo(accepted(answer, "the scene layer").message)


@click.command()
@click.option("--reason", default="the operator stopped it", help="Why, in words.")
@click.option("--next", "next_", is_flag=True, help="Go on with the next scene that waits.")
def cancel(reason: str, next_: bool) -> None:
    """Stop the running agent, and forget the scenes that wait."""
    with running_system() as observer:
        from bt_agents_tools.client import system

        answer = system.cancel_run(observer, reason, observer.market.round if next_ else 0)
        click.echo(accepted(answer, "the marketplace").message)


@click.command()
def status() -> None:
    """Show what runs, all agents, and every problem."""
    with running_system() as observer:
        from bt_agents_tools.client import system

        auctions, ends = system.decisions(observer), system.scene_ends(observer)
        observer.turn_until(lambda: bool(observer.cards), FIND_LIMIT_S)
        observer.turn_until(lambda: _heard_last(observer, ends), _SOON_S)
        market, names = observer.market, names_of_scenes(auctions)
        known = any(end.scene_id == market.finished_scene_id for end in ends[-_ENDS_SHOWN:])
        state = word(market, market.state, STATES)
        if market.state != market.IDLE or not known:
            state += f": {names.in_words(market.message)}"
        _say("market    ", state)
        new_scenes = ", ".join(filter(None, _line(observer)))
        _say(
            "          ",
            f"round {market.round}, {counted(market.hosts, 'host')}, "
            f"{counted(market.agents, 'agent')}; new scenes: {new_scenes}",
        )
        for words in _ranking(market, auctions[-1] if auctions else None):
            _say("          ", words)
        for host, card in sorted(observer.cards.items()):
            click.echo(f"host      {host}")
            for agent in card.agents:
                profile = _row(card.parameters, agent.current)
                _say(
                    f"  {agent.name:<22} ",
                    f"{profile}  (revision {agent.revision}, "
                    f"version {agent.version}{_condition(agent)})",
                )
            for problem in card.problems:
                _say("  problem: ", problem)
        for end in ends[-_ENDS_SHOWN:]:
            when = time.strftime("%H:%M:%S", time.localtime(end.stamp.sec))
            place = f"round {end.round}, " if end.round else ""
            _say("ended     ", f"{when}, {place}'{names.of(end.scene_id)}', {_end(end, names)}")


def _ranking(market: Any, last: Any) -> Iterator[str]:
    """Yield how bids are ranked, and who may not bid or gets no run."""
    words = f"strategy: {market.strategy}"
    if market.shadow_strategy:
        words += f"; beside it {market.shadow_strategy} only scores"
        by = (market.strategy, market.shadow_strategy)
        if last is not None and (last.strategy, last.shadow_strategy) == by:
            words += f", {disagreements(last)}"
    yield words
    if market.pinned:
        yield f"pinned: only {market.pinned} may bid, until 'bt-agents unpin'"
    for agent in market.vetoed:
        yield f"vetoed: {agent} may not bid, until 'bt-agents allow {agent}'"
    for agent in market.starved:
        yield f"starved: {agent} bids again and again and gets no run"


def _condition(agent: Any) -> str:
    waits = "; a newer one waits for the end of the run" if agent.waiting else ""
    why = why_kept(agent)
    return waits + (f"; {why}" if why else "")


@click.command()
@click.argument("round_number", metavar="[ROUND]", required=False, type=int)
@click.option("--json", "as_json", is_flag=True, help="The whole record of the decision, as JSON.")
def why(round_number: int | None, as_json: bool) -> None:
    """Say why an agent won, last or in a ROUND."""
    with running_system() as observer:
        from bt_agents_tools.client import system

        ends = system.scene_ends(observer)
        auctions = heard_decisions(observer)
        observer.turn_until(lambda: _heard_last(observer, ends), _SOON_S)
        found = [a for a in auctions if round_number is None or a.round == round_number]
        if not found:
            kept = ", ".join(str(a.round) for a in auctions)
            raise BtAgentsError(
                f"no decision {'yet' if round_number is None else f'of round {round_number}'}"
                + (f"; there are rounds {kept}" if kept else "; 'bt-agents trigger' asks for one")
            )
        if as_json:
            click.echo(decision_as_json(found[-1]))
            return
        names = names_of_scenes(auctions)
        show_decision(found[-1], names)
        for end in ends:
            if end.scene_id == found[-1].scene.scene_id and end.code != "DUPLICATE":
                click.echo(f"the scene ended: {_end(end, names)}")


def _heard_last(observer: Observer, ends: list[Any]) -> bool:
    """Whether the end of the last interaction has been heard, if there was one."""
    finished = observer.market.finished_scene_id
    return not finished or any(end.scene_id == finished for end in ends)


def _end(end: Any, names: SceneLabels) -> str:
    return f"{code_words(end.code)}: {names.in_words(end.message)}"


def _say(head: str, words: str) -> None:
    print_line(Console(), head, words)


@click.command()
@click.argument("kind", type=click.Choice(["positive", "negative", "direct", "set"]))
@click.argument("values", nargs=-1, callback=assignments)
@click.option("--agent", default="", help="Whose; default: who runs, else who ran last.")
@click.option("--reason", default="", help="Why, in words.")
def feedback(kind: str, values: Assignments, agent: str, reason: str) -> None:
    """Tell an agent how it did.

    For example: bt-agents feedback positive.

    Direct feedback names the wanted profile: bt-agents feedback direct age=5 mood=2. With set
    instead of direct the profile takes these values at once.
    """
    if kind in ("direct", "set") and not values:
        raise click.UsageError(
            f"{kind} feedback names the wanted values, for example: bt-agents feedback {kind} "
            "age=5 mood=2"
        )
    with running_system() as observer:
        from bt_agents_tools.client import system

        observer.turn_until(lambda: observer.profiles is not None, FIND_LIMIT_S)
        wanted = _wanted(observer, values) if kind in ("direct", "set") else _columns(values)[1]
        answer = system.give_feedback(observer, agent, kind, wanted, reason)
        answer = accepted(answer, "the feedback node")
        click.echo(f"{answer.message} (revision {answer.feedback.revision})")


def _columns(values: Assignments) -> tuple[list[str], list[float]]:
    return [name for name, _ in values], [value for _, value in values]


def _wanted(observer: Observer, values: Assignments) -> list[float]:
    names = list(observer.profiles.parameters) if observer.profiles else []
    given = dict(values)
    unknown = [name for name in given if name not in names]
    if unknown:
        raise BtAgentsError(f"no scene parameter '{unknown[0]}'; there are {', '.join(names)}")
    return [given.get(name, math.nan) for name in names]


def _row(names: Any, values: Any) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in zip(names, values, strict=True))
