# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents schema`: writes JSON Schemas of an author's files, for editors."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_language.tools.schema.folder import folder_symbols, schema_file, schema_text
from bt_agents_tools.cli.installed_kinds import installed_kinds
from bt_agents_tools.cli.trees_choice import take_trees


@click.command()
@click.argument("directory", required=False, default="")
@click.option(
    "--output",
    "-o",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("schema"),
    show_default=True,
    help="The folder to write to.",
)
@click.option("--check", is_flag=True, help="Write nothing; exit code 1 when a file is outdated.")
def schema(directory: str, output: Path, check: bool) -> None:
    """Write a JSON Schema for each kind of file of a trees DIRECTORY.

    They hold its scene parameters and skills and the nodes of installed plug-ins. An editor with
    yaml-language-server uses them where a file says so in its first line:

    \b
    # yaml-language-server: $schema=../../schema/agent.schema.json
    """  # noqa: D301 (click needs the character, not the escape sequence)
    symbols = folder_symbols(take_trees(directory))
    outdated = []
    for name, kind in installed_kinds().items():
        file = output / schema_file(name)
        text = schema_text(kind, symbols)
        if _written(file) == text.encode():
            continue
        if check:
            outdated.append(file)
        else:
            _write(file, text)
            click.echo(f"wrote {file}")
    for file in outdated:
        click.echo(f"{file} is {'outdated' if file.exists() else 'missing'}")
    if outdated:
        click.echo("write them with 'bt-agents schema'")
        sys.exit(1)


def _written(file: Path) -> bytes | None:
    try:
        return file.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise BtAgentsError(f"cannot read '{file}': {error.strerror or error}") from error


def _write(file: Path, text: str) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BtAgentsError(f"cannot write '{file}': {error.strerror or error}") from error
