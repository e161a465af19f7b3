# SPDX-License-Identifier: Apache-2.0
"""The command `bt-agents`, of which only the part that is called is loaded."""

from __future__ import annotations

import difflib
import signal
import sys
from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_ros.signals import end_silently, loading

COMMANDS: Mapping[str, str] = {
    "demo": "run_system",
    "up": "run_system",
    "trigger": "trigger",
    "sense": "sense",
    "cancel": "cancel",
    "scene": "scene",
    "status": "status",
    "why": "why",
    "pin": "operate",
    "unpin": "operate",
    "veto": "operate",
    "allow": "operate",
    "award": "operate",
    "preview": "operate",
    "strategy": "strategy",
    "feedback": "feedback",
    "profile": "profile",
    "moods": "moods",
    "check": "check",
    "explain": "explain",
    "new": "new",
    "show": "show",
    "fmt": "fmt",
    "rehearse": "rehearse",
    "test": "test",
    "schema": "schema",
    "tune": "tune",
    "preset": "preset",
    "keep": "keep",
    "reload": "reload",
    "versions": "reload",
    "roll-back": "reload",
}
"""Command → the module of ``bt_agents_tools.cli.commands`` that has it.

Its function has the name of the command, with ``_`` for ``-``.
"""

GROUP = "bt_agents.commands"
"""Entry points of other packages: command → its function."""


@cache
def all_commands() -> Mapping[str, EntryPoint]:
    """Return every command by its name, those of other packages included."""
    own = {
        name: EntryPoint(
            name, f"bt_agents_tools.cli.commands.{module}:{name.replace('-', '_')}", GROUP
        )
        for name, module in COMMANDS.items()
    }
    return {**{entry.name: entry for entry in entry_points(group=GROUP)}, **own}


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return sorted(all_commands())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; None when there is no such command."""
        entry = all_commands().get(cmd_name)
        if entry is None:
            return None
        with loading():
            command = _load(entry)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command of some arguments; a misspelt one is refused with the nearest."""
        near = difflib.get_close_matches(args[0], all_commands(), n=1, cutoff=0.75)
        if args[0] not in all_commands() and near:
            ctx.fail(f"no command '{args[0]}'; did you mean '{near[0]}'?")
        return super().resolve_command(ctx, args)


def _load(entry: EntryPoint) -> object:
    """Return the function of a command.

    Raises:
        BtAgentsError: It needs a package that not every installation has.
    """
    try:
        return entry.load()
    except ModuleNotFoundError as error:
        if entry.name in COMMANDS:
            raise
        raise BtAgentsError(
            f"this command needs the package {error.name}; install it with "
            "pip install 'bt-agents[lab]'"
        ) from None


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="bt-agents", prog_name="bt-agents")
def bt_agents() -> None:
    """Run interaction characters on a robot: one YAML file an agent, one market a robot."""


def main() -> None:
    """Run the command line; an error on purpose is one message and exit code 1."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        bt_agents(prog_name="bt-agents")
    except BtAgentsError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        end_silently()
