# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents show`: shows an agent's tree with its decorators and subtrees in place."""

from __future__ import annotations

import shutil

import click

from bt_agents_language.tools.drawing.mermaid import mermaid
from bt_agents_language.tools.drawing.outline import outline
from bt_agents_tools.cli.named_agent import named_agent


@click.command()
@click.argument("agent", metavar="FILE|AGENT")
@click.option("--dir", "directory", default="", help="The trees folder in which AGENT is.")
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "mermaid"]),
    default="text",
    show_default=True,
    help="What to print.",
)
def show(agent: str, directory: str, form: str) -> None:
    """Show what an agent does: its tree, with decorators as nodes in the order in which they nest.

    FILE is an agent file in a trees folder, AGENT the name of an agent. Numbers are lines of the
    file.
    """
    trees, spec = named_agent(agent, directory)
    if form == "mermaid":
        text = mermaid(spec)
    else:
        text = outline(spec, trees.scene.space, shutil.get_terminal_size().columns)
    click.echo(text, nl=False)
