# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents tune`: changes tunables, learning rates and profiles at run time."""

from __future__ import annotations

import getpass
import re
import shutil
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import click

from bt_agents.host.tuning.change_log import read_history
from bt_agents.host.tuning.tunable import TICK_RATE
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import printable
from bt_agents_language.expression.quantities import QuantityError, number
from bt_agents_tools.cli.connection import NoSystemError, accepted, connect, find_host, find_hosts
from bt_agents_tools.cli.formatting import moment_text
from bt_agents_tools.cli.table import Column, TableForm, print_table, table_options
from bt_agents_tools.cli.trees_choice import kept_state, state_option
from bt_agents_tools.cli.tune_table import table

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_PROFILE = re.compile(r"(?P<agent>[^.]+)\.profile\.(?P<parameter>.+)")


def user() -> str:
    """Return the name of the user, empty if unknown."""
    try:
        return getpass.getuser()[:60]
    except (OSError, KeyError):
        return ""


author_option = click.option(
    "--author", default=user, show_default="you", help="Who makes the request."
)


def ask_host(observer: Observer, host: str, action: str, **fields: Any) -> None:
    """Ask a host to tune, and print its answer if it accepts."""
    answer = observer.ask(f"{host}/tune", action=action, **fields)
    click.echo(accepted(answer, f"the host {host}").message)


@click.command()
@click.argument("arguments", metavar="[AGENT] [NAME=VALUE]...", nargs=-1)
@click.option("--undo", is_flag=True, help="Undo the last change.")
@click.option("--redo", is_flag=True, help="Redo the change that was undone last.")
@click.option("--history", is_flag=True, help="Show the last changes, and who made them.")
@click.option("--reason", default="", help="Why, in words.")
@click.option("--author", default=user, show_default="you", help="Who makes the change.")
@state_option
@table_options
def tune(
    arguments: tuple[str, ...],
    undo: bool,
    redo: bool,
    history: bool,
    reason: str,
    author: str,
    state: str,
    form: TableForm,
) -> None:
    """Change values of an AGENT while it runs, or show them.

    For example: bt-agents tune attentive_guide patience=12 voice_rate=0.9.

    Times may have units: patience=12s, patience="2 min". Beside the tunables of its file each
    agent has learning_rate and the values of its profile, such as profile.age; the whole host has
    tick_rate: bt-agents tune tick_rate=30. Values of several agents change together when they are
    named in full: bt-agents tune quick.patience=5 slow.patience=12. Values of a profile are a
    change of their own, which the feedback node records.

    Without values it shows where everything stands. 'bt-agents keep' writes changed values into
    the agents' files. Without a running system --history is read from the file, as with --state.
    """
    agent, values = _split(arguments)
    actions = [name for name, on in (("undo", undo), ("redo", redo), ("history", history)) if on]
    if len(actions) > 1:
        raise click.UsageError(f"--{actions[0]} and --{actions[1]} do not go together")
    if actions and values:
        raise click.UsageError(f"--{actions[0]} goes with an AGENT, not with values")
    if actions and agent == TICK_RATE.name:
        raise click.UsageError(
            f"tick_rate belongs to no agent; --{actions[0]} alone is for the whole host"
        )
    if state and not history:
        raise click.UsageError("--state goes with --history; all else needs a running system")
    if history:
        _history(agent, state, form)
        return
    observer = connect()
    if actions:
        _take_back(observer, agent, actions[0], author=author, reason=reason)
    elif values:
        _set(observer, agent, values, author=author, reason=reason)
    else:
        _show(observer, agent, form)


def _split(arguments: Sequence[str]) -> tuple[str, list[tuple[str, str]]]:
    """Return the agent, empty for none, and the names and values that follow it."""
    agent = arguments[0] if arguments and "=" not in arguments[0] else ""
    values = []
    for argument in arguments[bool(agent) :]:
        name, equals, text = argument.partition("=")
        if not equals or not name.strip():
            raise click.UsageError(
                f"'{argument}' is not of the form name=value, for example patience=12"
            )
        values.append((name.strip(), text))
    return agent, values


def _set(
    observer: Observer, agent: str, values: Iterable[tuple[str, str]], *, author: str, reason: str
) -> None:
    """Set values, first the values of hosts, then of profiles."""
    named = [(f"{agent}.{name}" if agent else name, text) for name, text in values]
    profiles = _profiles(named)
    on_hosts = [(name, text) for name, text in named if not _PROFILE.fullmatch(name)]
    for one in profiles:
        find_host(observer, one)
    names, texts = [name for name, _ in on_hosts], [text for _, text in on_hosts]
    for host in _hosts_of(observer, names):
        ask_host(observer, host, "SET", names=names, values=texts, author=author, reason=reason)
    for one, wanted in profiles.items():
        from bt_agents_tools.client import tuning

        answer = tuning.set_profile(observer, one, wanted, author=author, reason=reason)
        answer = accepted(answer, "the feedback node")
        click.echo(f"{answer.message} (revision {answer.feedback.revision} of the profile)")


def _profiles(named: Iterable[tuple[str, str]]) -> dict[str, dict[str, float]]:
    """Return the values that belong to profiles, by agent and scene parameter."""
    found: dict[str, dict[str, float]] = {}
    for name, text in named:
        match = _PROFILE.fullmatch(name)
        if match is None:
            continue
        values = found.setdefault(match["agent"], {})
        if match["parameter"] in values:
            raise Refused(RefusalCode.DUPLICATE, f"{name} stands twice; give it one value")
        try:
            values[match["parameter"]] = number(text)
        except QuantityError as error:
            hint = f"; {error.hint}" if error.hint else ""
            raise Refused(RefusalCode.NOT_A_VALUE, f"{name}: {error.message}{hint}") from None
    return found


def _take_back(observer: Observer, agent: str, action: str, *, author: str, reason: str) -> None:
    """Undo or redo the last change of an agent or the host; for profiles, the last tuning."""
    host = _one_host(observer, agent)
    if action == "undo":
        tuned = _tuned_profile(observer, host, agent)
        if tuned:
            answer = observer.ask(
                "feedback/manage", action="UNDO", agent=tuned, author=author, reason=reason
            )
            click.echo(f"undo of a profile: {accepted(answer, 'the feedback node').message}")
            return
    agents = [agent] if agent else []
    ask_host(observer, host, action.upper(), agents=agents, author=author, reason=reason)


def _tuned_profile(observer: Observer, host: str, agent: str) -> str:
    """Return the agent whose profile was tuned after every change that the host can undo."""
    from bt_agents_tools.client import tuning

    stamps = (
        one.stamp.sec + one.stamp.nanosec * 1e-9
        for one in tuning.tunings(observer, host).tunings
        if one.undoable and (not agent or one.name.startswith(f"{agent}."))
    )
    return tuning.tuned_profile(observer, agent, max(stamps, default=0.0))


def _hosts(observer: Observer, agent: str) -> list[str]:
    return [find_host(observer, agent)] if agent else find_hosts(observer)


def _one_host(observer: Observer, agent: str) -> str:
    found = _hosts(observer, agent)
    if len(found) > 1:
        raise BtAgentsError(f"there are several hosts: {', '.join(found)}; name an agent")
    return found[0]


def _hosts_of(observer: Observer, names: Sequence[str]) -> list[str]:
    """Return the hosts that get values; values without an agent go to every host."""
    if not names:
        return []
    whose = {name.partition(".")[0] for name in names if "." in name}
    found = sorted({find_host(observer, one) for one in whose}) or find_hosts(observer)
    if whose and len(found) > 1:
        raise BtAgentsError(
            f"these agents are on different hosts, {', '.join(found)}, which cannot change "
            "together; tune one after the other"
        )
    return found


def _show(observer: Observer, agent: str, form: TableForm) -> None:
    from bt_agents_tools.client import tuning

    hosts = _hosts(observer, agent)
    states = {host: tuning.parameters(observer, host, [agent] if agent else ()) for host in hosts}
    if form.for_program:
        keys = ("host", "agent", "name", "value", "default", "minimum", "maximum", "description")
        rows = [
            (host, of.agent, of.name, *map(_exact, values), of.minimum, of.maximum, of.description)
            for host, found in states.items()
            for of, values in ((o.parameter, (o.value, o.parameter.default)) for o in found)
        ]
        print_table([Column(key=key) for key in keys], rows, form)
        return
    # Output to a file or pipe is not wrapped.
    fitted = form is TableForm.FITTED and sys.stdout.isatty()
    width = shutil.get_terminal_size().columns if fitted else 10_000
    for found in states.values():
        for line in table(found, width):
            click.echo(line)


def _exact(value: Any) -> Any:
    return printable(value) if isinstance(value, str) else value


_HISTORY = (
    Column(key="revision", right=True),
    Column(key="stamp", title="when", text=moment_text),
    Column(key="name"),
    Column(key="before"),
    Column(key="after"),
    Column(key="author", title="by"),
    Column(key="reason", title="why"),
)


def _history(agent: str, state: str, form: TableForm) -> None:
    if not state:
        try:
            observer = connect()
            _show_history(observer, agent, form)
        except NoSystemError as error:
            click.echo(f"{error}; this is from the file", err=True)
        else:
            return
    kept = kept_state(state)
    try:
        history = read_history(kept.tunings)
    except (OSError, ValueError) as error:
        raise BtAgentsError(f"{kept.tunings} cannot be read: {error}") from None
    if not history.revision:
        raise BtAgentsError(f"nothing was tuned in {kept.trees} yet: {kept.tunings} has no change")
    rows = [
        (one.number, one.stamp, change.name, change.before, change.after, *by)
        for one in history.shown
        for change in one.changes
        for by in [(one.cause.author, one.cause.reason)]
        if not agent or change.name.startswith(f"{agent}.")
    ]
    print_table(_HISTORY, rows, form)


def _show_history(observer: Observer, agent: str, form: TableForm) -> None:
    from bt_agents_tools.client import tuning

    found = {host: tuning.tunings(observer, host) for host in _hosts(observer, agent)}
    rows = [
        (one.revision, one.stamp.sec, one.name, one.before, one.after, one.author, one.reason)
        for tunings in found.values()
        for one in tunings.tunings
        if not agent or one.name.startswith(f"{agent}.")
    ]
    print_table(_HISTORY, rows, form)
    if form.for_program:
        return
    for host, tunings in found.items():
        tuned = _tuned_profile(observer, host, agent)
        undo = f"the last change of the profile of {tuned}" if tuned else tunings.undo
        click.echo(f"undo would be: {undo or 'nothing'}")
        click.echo(f"redo would be: {tunings.redo or 'nothing'}")
