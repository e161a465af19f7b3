# SPDX-License-Identifier: Apache-2.0
"""The command `bt-agents`, of which only the part that is called is loaded."""

from __future__ import annotations

import difflib
import importlib
import signal
import sys
from types import ModuleType

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_ros.signals import end_silently, loading

COMMANDS = {
    "demo": "live",
    "up": "live",
    "trigger": "ask",
    "sense": "ask",
    "cancel": "ask",
    "scene": "scene",
    "status": "ask",
    "why": "ask",
    "pin": "operate",
    "unpin": "operate",
    "veto": "operate",
    "allow": "operate",
    "award": "operate",
    "preview": "operate",
    "strategy": "strategy",
    "feedback": "ask",
    "profile": "profile",
    "moods": "moods",
    "experiment": "bt_agents_lab.cli.experiment",
    "journal": "bt_agents_lab.cli.journal",
    "replay": "bt_agents_lab.cli.replay",
    "what-if": "bt_agents_lab.cli.what_if",
    "check": "check",
    "explain": "explain",
    "new": "new",
    "show": "show",
    "fmt": "fmt",
    "rehearse": "rehearse",
    "test": "test",
    "schema": "schema",
    "import": "groot",
    "export": "groot",
    "tune": "tune",
    "preset": "preset",
    "keep": "keep",
    "reload": "reload",
    "versions": "reload",
    "roll-back": "reload",
}
"""Command to the module that has it; one without a dot is in ``bt_agents_tools.cli``.

Its function has the name of the command, with ``_`` for ``-``, and one behind a word of Python.
"""

_PYTHONS = ("import",)


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; None when there is no such command."""
        module = COMMANDS.get(cmd_name)
        if module is None:
            return None
        path = module if "." in module else f"bt_agents_tools.cli.{module}"
        function = cmd_name.replace("-", "_") + ("_" if cmd_name in _PYTHONS else "")
        with loading():
            command = getattr(_imported(path), function)
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command of some arguments; a misspelt one is refused with the nearest."""
        near = difflib.get_close_matches(args[0], COMMANDS, n=1, cutoff=0.75)
        if args[0] not in COMMANDS and near:
            ctx.fail(f"no command '{args[0]}'; did you mean '{near[0]}'?")
        return super().resolve_command(ctx, args)


def _imported(path: str) -> ModuleType:
    """Return a module.

    Raises:
        BtAgentsError: It needs a package that not every installation has.
    """
    try:
        return importlib.import_module(path)
    except ModuleNotFoundError as error:
        if not path.startswith("bt_agents_lab."):
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
