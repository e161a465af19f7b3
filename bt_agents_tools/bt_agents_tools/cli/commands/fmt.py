# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents fmt`: YAML files in one canonical style, for diffs without noise."""

from __future__ import annotations

import difflib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import click

from bt_agents_core.atomic_file import write_atomically
from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_core.trees_folder import is_installed
from bt_agents_language.tools.formatting.formatter import format_source
from bt_agents_language.yaml.source import Source, read_source
from bt_agents_tools.cli.trees_choice import named_path, take_trees

_SUFFIXES = (".yaml", ".yml")
_COLOURS = {"+": "green", "-": "red", "@": "cyan"}


@click.command()
@click.argument("paths", nargs=-1, metavar="[PATH]...")
@click.option("--check", is_flag=True, help="Change nothing; exit code 1 if a file would change.")
@click.option("--diff", is_flag=True, help="Change nothing; show what would change.")
def fmt(paths: tuple[str, ...], check: bool, diff: bool) -> None:
    """Write files in canonical style; comments and meaning stay.

    A PATH is a YAML file or a folder; without one it is the trees folder. A file that cannot be
    read is left as it is and reported, and the others go on; the exit code is then 1.
    """
    changed, broken = [], 0
    files = list(_files(paths))
    for path in files:
        try:
            source = read_source(path)
            text = format_source(source)
            if text == source.text:
                continue
            if diff:
                _show_diff(source, text)
            elif check:
                click.echo(f"{path}: would change")
            else:
                write_atomically(path, text)
                click.echo(f"{path}: changed")
            changed.append(path)
        except (BtAgentsError, OSError) as error:
            broken += 1
            click.echo(error.report if isinstance(error, ReadError) else _message(path, error))
    done = "would change" if check or diff else "changed"
    are = "it is" if broken == 1 else "they are"
    left = f", {broken} left as {are} because of errors" if broken else ""
    click.echo(f"{len(changed)} of {len(files)} files {done}{left}", err=True)
    sys.exit(1 if broken or (check and changed) else 0)


def _files(paths: tuple[str, ...]) -> Iterator[Path]:
    for path in (named_path(path) for path in paths or (take_trees(may_be_shipped=False),)):
        if is_installed(path):
            raise BtAgentsError(
                f"'{path}' belongs to the installation, whose files are not changed; 'bt-agents "
                "new NAME' makes a trees folder of your own"
            )
        if not path.is_dir():
            yield path
            continue
        found = sorted(
            file
            for file in path.rglob("*")
            if file.suffix in _SUFFIXES
            and not any(part.startswith(".") for part in file.relative_to(path).parts)
        )
        if not found:
            raise BtAgentsError(f"there is no YAML file in '{path}'; name a trees folder or files")
        yield from found


def _show_diff(source: Source, text: str) -> None:
    lines = difflib.unified_diff(
        source.text.splitlines(), text.splitlines(), source.file, source.file, lineterm=""
    )
    for line in lines:
        colour = None if line.startswith(("+++", "---")) else _COLOURS.get(line[:1])
        # click itself leaves colours out where the output is no terminal.
        click.secho(line, fg=colour, color=False if os.environ.get("NO_COLOR") else None)


def _message(path: Path, error: Exception) -> str:
    reason = error.strerror if isinstance(error, OSError) else ""
    return f"{path}: cannot be written: {reason}; check its permissions" if reason else str(error)
