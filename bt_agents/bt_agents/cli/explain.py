# SPDX-License-Identifier: Apache-2.0
"""`bt-agents explain`: the page of the reference about one word or one code, in the terminal."""

from __future__ import annotations

from collections.abc import Iterable

import click
from rich.console import Console, RenderableType
from rich.padding import Padding
from rich.syntax import Syntax
from rich.table import Table
from rich.text import Text

from bt_agents.errors import BtAgentsError
from bt_agents.language.codes.entry import Code, FileKind
from bt_agents.language.codes.table import CODES
from bt_agents.language.diagnostics import nearest, shown
from bt_agents.language.plugins import installed_plugins
from bt_agents.language.reference import FieldEntry, Group, NodePage, node_page, node_pages
from bt_agents.language.schema.folder import folder_vocabulary
from bt_agents.language.vocabulary import Vocabulary
from bt_agents.scene import SceneSpace
from bt_agents.trees_folder import find_trees


@click.command()
@click.argument("word", metavar="[NODE|CODE]", required=False, default="")
@click.option("--dir", "directory", default="", help="The trees folder whose skills count.")
def explain(word: str, directory: str) -> None:
    """Explain a node, skill, modifier or code of an error; without one, list them all.

    A code stands in brackets in a report of 'bt-agents check': error[unknown-node].
    """
    console = Console(highlight=False)
    vocabulary = _vocabulary(directory)
    if not word:
        console.print(_overview(vocabulary))
        return
    for part in explanation(word, vocabulary):
        console.print(part)


def explanation(word: str, vocabulary: Vocabulary) -> Iterable[RenderableType]:
    """Return the page of a word, part by part.

    Args:
        word: A node, skill, modifier or code, as written or as a report shows it.
        vocabulary: The words that there are.

    Raises:
        BtAgentsError: There is no such word.
    """
    plain = word.strip().rstrip(":")
    if plain.endswith("]"):
        plain = plain[:-1].rpartition("[")[2]
    if plain in CODES:
        return _code(CODES[plain])
    page = node_page(plain, vocabulary)
    if page is not None:
        return _node(page)
    # A word that could be either is rather a node that somebody has typed than a code.
    near = nearest(plain, [one.key for one in node_pages(vocabulary)]) or nearest(plain, CODES)
    hint = f"did you mean '{near}'?" if near else "'bt-agents explain' lists all"
    raise BtAgentsError(f"there is no node, skill, modifier or code {shown(plain)}; {hint}")


def _vocabulary(directory: str) -> Vocabulary:
    """Return the words of a trees folder, without one those of the language itself.

    Raises:
        BtAgentsError: A folder is named and cannot be used.
    """
    try:
        return folder_vocabulary(find_trees(directory))
    except BtAgentsError as error:
        if directory:
            raise
        click.echo(f"without the skills of a trees folder: {_first_line(error)}", err=True)
    space = SceneSpace(parameters=(), mood=None)
    return Vocabulary(space=space, skills={}, plugins=installed_plugins().kinds)


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0]


def _code(code: Code) -> Iterable[RenderableType]:
    style = "bold red" if code.severity.value == "error" else "bold yellow"
    yield Text.assemble((f"{code.severity.value}[{code.code}]", style), f"  {code.kind.value}")
    yield Text(f"\n{code.meaning}\n")
    language = "xml" if code.kind is FileKind.XML else "yaml"
    yield Text("Wrong:", style="red")
    yield _example(code.wrong, language)
    yield Text("Right:", style="green")
    yield _example(code.right, language)


def _node(page: NodePage) -> Iterable[RenderableType]:
    yield Text.assemble((page.key, "bold"), f"  {page.group.value}")
    yield Text(f"\n{page.description}\n")
    for form in page.forms:
        yield Text(f"  {form}", style="cyan")
    if page.fields:
        yield Text()
        yield _fields(page.fields)
    if page.outputs:
        yield Text("\nLater nodes can use:\n")
        for one in page.outputs:
            yield Text(f"  ${{{one.name}}} ({one.expected})  {one.description}")
    if page.note:
        yield Text(f"\n{page.note}")
    yield Text("\nExample:")
    yield _example(page.example, "yaml")


def _fields(fields: Iterable[FieldEntry]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for heading in ("  field", "value", "left out", ""):
        table.add_column(heading, overflow="fold")
    for field in fields:
        left_out = "needed" if field.required else field.default
        table.add_row(
            Text(f"  {field.name}", style="bold" if field.main else ""),
            Text(field.expected),
            Text(left_out),
            Text(field.description),
        )
    return table


def _example(text: str, language: str) -> RenderableType:
    # The terminal's own colours, so that it can be read on light and on dark ground.
    syntax = Syntax(text.rstrip(), language, theme="ansi_dark", background_color="default")
    return Padding(syntax, (0, 0, 1, 2))


def _overview(vocabulary: Vocabulary) -> RenderableType:
    table = Table(box=None, pad_edge=False, show_header=False, padding=(0, 2, 1, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    pages = node_pages(vocabulary)
    for group in Group:
        keys = [page.key for page in pages if page.group is group]
        if keys:
            table.add_row(group.value, Text("  ".join(keys)))
    table.add_row("code", Text("  ".join(CODES)))
    return table
