# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents show`: an agent's tree with every decorator and subtree in its place."""

from __future__ import annotations

import shutil
from pathlib import Path

import click

from bt_agents_core.errors import BtAgentsError
from bt_agents_language.tools.drawing.mermaid import mermaid
from bt_agents_language.tools.drawing.outline import outline
from bt_agents_language.tools.drawing.svg import svg
from bt_agents_tools.cli.named_agent import named_agent


@click.command()
@click.argument("agent", metavar="FILE|AGENT")
@click.option("--dir", "directory", default="", help="The trees folder in which AGENT is.")
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "mermaid", "svg"]),
    default="text",
    show_default=True,
    help="What to print.",
)
@click.option("--svg", "picture", metavar="OUT", default="", help="Write a picture to this file.")
def show(agent: str, directory: str, form: str, picture: str) -> None:
    """Show what an agent does: its tree, with decorators as nodes in the order in which they nest.

    FILE is an agent file in a trees folder, AGENT the name of an agent. Numbers are lines of the
    file.
    """
    trees, spec = named_agent(agent, directory)
    space = trees.scene.space
    if picture:
        try:
            Path(picture).write_text(svg(spec, space), encoding="utf-8")
        except OSError as error:
            raise BtAgentsError(f"'{picture}' cannot be written: {error.strerror}") from None
        click.echo(f"wrote {picture}")
    elif form == "mermaid":
        click.echo(mermaid(spec), nl=False)
    else:
        width = shutil.get_terminal_size().columns
        text = svg(spec, space) if form == "svg" else outline(spec, space, width)
        click.echo(text, nl=False)
