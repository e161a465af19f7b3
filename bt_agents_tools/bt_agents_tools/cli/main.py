# SPDX-License-Identifier: Apache-2.0
"""Command line `bt-agents`: the table of commands, each loaded only when called."""

from __future__ import annotations

import ast
import difflib
import signal
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from operator import attrgetter
from typing import NamedTuple

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.optional_packages import how_to_install
from bt_agents_core.text import printable_line, printable_lines
from bt_agents_ros.signals import interruptible, loading
from bt_agents_ros.workarounds.bounded_end import limit_end
from bt_agents_tools.cli.terminal import OutputLost, os_error_text, prepare_streams

_INTERRUPTED = 128 + signal.SIGINT
_LEFT = 128 + signal.SIGPIPE


class CommandEntry(NamedTuple):
    """Module and function of a command: an entry point without ``importlib.metadata``."""

    module: str
    function: str

    def load(self) -> object:
        """Return the command."""
        return attrgetter(self.function)(import_module(self.module))


TASKS: Mapping[str, Mapping[str, str]] = {
    "Write agents": {
        "new": "new",
        "check": "check",
        "explain": "explain",
        "show": "show",
        "rehearse": "rehearse",
        "test": "test",
        "schema": "schema",
        "import": "",
        "export": "",
    },
    "Run them": {
        "demo": "demo",
        "up": "up",
        "host": "host",
        "robot": "robot",
        "status": "status",
        "studio": "",
        "watch": "",
        "reload": "reload",
        "security": "security",
    },
    "Play the person": {
        "trigger": "trigger",
        "sense": "trigger",
        "answer": "answer",
        "press": "publish",
        "publish": "publish",
        "visit": "visit",
    },
    "Take charge": {
        "cancel": "operate",
        "pause": "control",
        "resume": "control",
        "step": "control",
        "breakpoint": "control",
        "pin": "operate",
        "unpin": "operate",
        "veto": "operate",
        "allow": "operate",
        "award": "operate",
        "preview": "operate",
        "strategy": "strategy",
    },
    "Tune and teach": {
        "tune": "tune",
        "preset": "preset",
        "keep": "keep",
        "feedback": "feedback",
        "profile": "profile",
        "forget": "forget",
        "fleet": "",
    },
    "Study": {
        "scene": "scene",
        "why": "why",
        "trace": "",
        "moods": "moods",
        "record": "record",
        "journal": "",
        "replay": "",
        "what-if": "",
        "experiment": "",
    },
}
"""Task → its commands, as the help lists them → their modules in ``bt_agents_tools.cli.commands``.

The function has the name of the command, with ``_`` for ``-``. Other packages provide the commands
without a module, and may add further ones.
"""

COMMANDS: Mapping[str, CommandEntry] = {
    name: CommandEntry(f"bt_agents_tools.cli.commands.{module}", name.replace("-", "_"))
    for commands in TASKS.values()
    for name, module in commands.items()
    if module
}
"""Commands of this package."""

_MEANT: Mapping[str, str] = {
    "undo": "'tune --undo' for tuning, 'profile undo AGENT' for learning",
    "redo": "'tune --redo' for tuning",
    "history": "'tune --history' or 'profile history AGENT'",
    "start": "'up' for a system, 'trigger' for a scene",
    "run": "'up' for a system, 'rehearse AGENT' without a robot",
    "stop": "'cancel' for the running agent, Ctrl-C in the terminal of 'up' for all",
    "reset": "'profile reset AGENT'",
    "save": "'preset save NAME' for a set of values, 'keep' for the files",
    "list": "'status' for the agents, 'tune' for what can be tuned",
    "log": "'why' for decisions, 'tune --history' and 'profile history AGENT' for changes",
    "lint": "'check'",
    "continue": "'resume' for a paused run",
    "break": "'breakpoint' for a node, 'pause' for the run under way",
    "say": "'answer' plays the person; what an agent says is in its file",
}
"""Word that is not a command → the commands that do what it says."""

GROUP = "bt_agents.commands"
"""Entry point group for commands of other packages."""


@cache
def all_commands() -> Mapping[str, CommandEntry]:
    """Return all commands by name; it takes long to find those of other packages."""
    from importlib.metadata import entry_points

    others = {one.name: CommandEntry(one.module, one.attr) for one in entry_points(group=GROUP)}
    return {**others, **COMMANDS}


class LazyGroup(click.Group):
    """Click group that imports a command when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(all_commands())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        entry = COMMANDS.get(cmd_name) or all_commands().get(cmd_name)
        if entry is None:
            return None
        try:
            with loading():
                command = entry.load()
            if not isinstance(command, click.Command):
                raise TypeError(f"it is a {type(command).__name__}, expected a click.Command")
        except (Exception, SystemExit) as error:
            if cmd_name in COMMANDS:
                raise
            command = _unavailable(cmd_name, _obstacle(entry, error))
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        names = self.list_commands(ctx)
        limit = formatter.width - 6 - max(map(len, names))
        listed = {name: click.Command(name, help=self._help(ctx, name)) for name in names}
        rows = {name: (name, one.get_short_help_str(limit)) for name, one in listed.items()}
        for task, wanted in TASKS.items():
            with formatter.section(task):
                formatter.write_dl([rows.pop(name) for name in wanted if name in rows])
        if rows:
            with formatter.section("Other packages"):
                formatter.write_dl([*rows.values()])

    def _help(self, ctx: click.Context, name: str) -> str:
        """Return the help of a command from its source, because loading all commands is slow."""
        entry = all_commands()[name]
        for node in _statements(entry.module):
            if isinstance(node, ast.FunctionDef) and node.name == entry.function:
                return ast.get_docstring(node) or ""
        command = self.get_command(ctx, name)
        return (command and command.help) or ""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] not in COMMANDS and args[0] not in all_commands():
            if args[0] in _MEANT:
                ctx.fail(f"no command '{args[0]}'; there is {_MEANT[args[0]]}")
            if near := difflib.get_close_matches(args[0], all_commands(), n=1, cutoff=0.75):
                ctx.fail(f"no command '{args[0]}'; did you mean '{near[0]}'?")
        return super().resolve_command(ctx, args)


def _statements(module: str) -> Sequence[ast.stmt]:
    """Return the statements of a module without loading it; none if they cannot be read."""
    try:
        spec = find_spec(module)
        get_source = getattr(spec and spec.loader, "get_source", None)
        return ast.parse((get_source and get_source(module)) or "").body
    except (Exception, SystemExit):
        # Even the package around a module of somebody else may raise anything.
        return ()


def _obstacle(entry: CommandEntry, error: BaseException) -> str:
    """Return why a command of another package cannot be loaded."""
    if isinstance(error, ModuleNotFoundError) and entry.module.startswith("bt_agents_"):
        package = (error.name or "").partition(".")[0]
        return f"this command needs the package {package}; {how_to_install(package)}"
    reason = f"{type(error).__name__}: {printable_line(str(error))}"
    return f"this command cannot be loaded from {entry.module}: {reason}"


def _unavailable(name: str, obstacle: str) -> click.Command:
    """Return a placeholder for a command that cannot be loaded."""

    def refuse(rest: tuple[str, ...]) -> None:
        raise BtAgentsError(obstacle)

    return click.Command(
        name,
        callback=refuse,
        params=[click.Argument(["rest"], nargs=-1, type=click.UNPROCESSED)],
        context_settings={"ignore_unknown_options": True},
        help=f"Not available: {obstacle}.",
    )


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="bt-agents", prog_name="bt-agents")
def bt_agents() -> None:
    """Run interaction characters on a robot: one YAML file an agent, one market a robot."""


def main() -> None:
    """Run the command line, close its connections, and end with its exit code.

    An error that a person can fix gives one message and exit code 1, Ctrl-C gives exit code 130,
    and a closed pipe gives exit code 141, as for other programs.
    """
    prepare_streams()
    connections = ExitStack()
    code = 1
    try:
        code = _run(connections)
    finally:
        limit_end(code)
        connections.close()
    sys.exit(code)


def _run(connections: ExitStack) -> int:
    """Run the command line, which adds its connections; return the exit code."""
    try:
        with interruptible():
            try:
                _check_arguments(sys.argv[1:])
                code = bt_agents.main(
                    prog_name="bt-agents", standalone_mode=False, obj=connections
                )
            finally:
                sys.stdout.flush()
    except click.Abort as abort:
        # Click raises it for Ctrl-C, for an end of the input, and for a denied question.
        if isinstance(abort.__context__, KeyboardInterrupt):
            return _INTERRUPTED
        click.echo("Aborted!", err=True)
        return 1
    except KeyboardInterrupt:
        return _INTERRUPTED
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except BtAgentsError as error:
        return _failed(str(error))
    except OutputLost as lost:
        return _LEFT if lost.is_left else _failed(f"standard output: {os_error_text(lost.error)}")
    except OSError as error:
        return _failed(os_error_text(error))
    except SystemExit as end:
        if isinstance(end.code, str):
            return _failed(end.code)
        code = end.code
    return code if isinstance(code, int) else 0


def _check_arguments(arguments: Sequence[str]) -> None:
    """Check that ROS can send every argument.

    Raises:
        BtAgentsError: An argument is not UTF-8.
    """
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError:
            raise BtAgentsError(
                f"the argument '{argument}' is not UTF-8, so ROS cannot send it; set the terminal "
                "to UTF-8"
            ) from None


def _failed(text: str) -> int:
    click.echo(f"error: {printable_lines(text)}", err=True)
    return 1
