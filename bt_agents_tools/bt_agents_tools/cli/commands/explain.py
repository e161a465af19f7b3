# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents explain`: shows the reference page of a word or code in the terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from contextlib import suppress

import click
from rich.console import Console
from rich.padding import Padding
from rich.segment import Segment, Segments
from rich.syntax import Syntax
from rich.table import Table
from rich.text import Text

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import nearest
from bt_agents_language.fields.scope import GROUPS
from bt_agents_language.model.specs import SubtreeSpec
from bt_agents_language.nodes.plugin_discovery import installed_plugins
from bt_agents_language.nodes.symbols import ImportProblem, SymbolTable
from bt_agents_language.reference.codes import Code, codes
from bt_agents_language.reference.file_pages import FilePage, file_pages, file_words
from bt_agents_language.reference.node_pages import (
    FieldEntry,
    Group,
    NodePage,
    node_page,
    node_pages,
    subtree_page,
)
from bt_agents_language.reference.topics import TOPICS, ReferenceTopic, topic
from bt_agents_language.tools.schema.folder import folder_symbols
from bt_agents_tools.cli.installed_kinds import installed_kinds
from bt_agents_tools.cli.trees_choice import take_trees

Part = Text | Table | Padding
"""Part of a page; a text that must not be wrapped has ``no_wrap``."""


@click.command()
@click.argument("word", metavar="[WORD|CODE]", required=False, default="")
@click.option("--dir", "directory", default="", help="The trees folder whose words count.")
def explain(word: str, directory: str) -> None:
    """Explain a word of the language or a code of an error or refusal; without one, list all.

    WORD is a node, a skill, a decorator, a kind of file, a key of a file or node, a subtree of a
    library, or one of units, expressions and names. CODE stands in brackets in a report of
    'bt-agents check', such as error[unknown-node], or begins a refusal, such as BUSY.
    """
    console = Console(highlight=False)
    symbols = _symbols(directory)
    print_page(console, explanation(word, symbols) if word else [_overview(symbols)])


def print_page(console: Console, parts: Iterable[Part]) -> None:
    """Print parts of a page without trailing blanks, and without breaks in text to copy."""
    for part in parts:
        if isinstance(part, Text) and part.no_wrap:
            console.print(part, soft_wrap=True)
            continue
        lines = map(_trimmed, console.render_lines(part, pad=False))
        segments = (segment for line in lines for segment in (*line, Segment.line()))
        console.print(Segments(segments), end="")


def _trimmed(line: list[Segment]) -> list[Segment]:
    while line and not line[-1].text.strip():
        line = line[:-1]
    return [*line[:-1], Segment(line[-1].text.rstrip(), line[-1].style)] if line else []


def explanation(word: str, symbols: SymbolTable) -> Iterable[Part]:
    """Return the page of a word or code, written as in a file or a report, part by part.

    Raises:
        BtAgentsError: There is no such word.
    """
    plain = word.strip().rstrip(":")
    if plain.endswith("]"):
        plain = plain[:-1].rpartition("[")[2]
    subtrees = list(_subtrees(symbols))
    pages = list(_pages(plain, symbols, subtrees))
    if pages:
        # Put an empty line between two of them.
        return (part for one in pages for part in (Text(), *one)[one is pages[0] :])
    if plain.partition(".")[0] in (*GROUPS, "person"):
        return explanation("names", symbols)
    # A misspelled node is more likely than a misspelled key or code.
    nodes = node_pages(symbols)
    names = [one.key for one in nodes] + [*TOPICS] + [one.name for _, one in subtrees]
    keys = [*file_words(installed_kinds()), *(field.name for one in nodes for field in one.fields)]
    known = (names, keys, codes(), RefusalCode.__members__)
    near = next(filter(None, (nearest(plain, of) for of in known)), None)
    hint = f"did you mean '{near}'?" if near else "'bt-agents explain' lists all"
    raise BtAgentsError(f"there is no word or code {quote(plain)}; {hint}")


def _pages(
    word: str, symbols: SymbolTable, subtrees: Iterable[tuple[str, SubtreeSpec]]
) -> Iterator[Iterable[Part]]:
    """Yield all pages of a word: a node may have the same name as a key of a file or node."""
    if word in codes():
        yield _code(codes()[word])
    if word in RefusalCode.__members__:
        yield _refusal(RefusalCode(word))
    page = node_page(word, symbols)
    if page is not None:
        yield _node(page)
    about = topic(word, symbols.space)
    if about is not None:
        yield _topic(about)
    for library, one in subtrees:
        if one.name == word:
            yield _node(subtree_page(library, one))
    for in_file in file_pages(word, installed_kinds()):
        yield _file(in_file)
    for node in node_pages(symbols):
        for field in (field for field in node.fields if field.name == word):
            where = f"key of {node.key}"
            yield _file(
                FilePage(
                    key=word, where=where, description=field.description, expected=field.expected
                )
            )


def _subtrees(symbols: SymbolTable) -> Iterator[tuple[str, SubtreeSpec]]:
    """Return the path of each library with each of its subtrees; a broken library has none."""
    libraries = symbols.libraries
    for path in libraries.paths() if libraries is not None else ():
        with suppress(ImportProblem):
            assert libraries is not None
            for subtree in libraries.load(path).subtrees.values():
                yield path, subtree


def _symbols(directory: str) -> SymbolTable:
    """Return the symbols of a trees folder, or without one, of the language itself."""
    try:
        return folder_symbols(take_trees(directory))
    except BtAgentsError as error:
        if directory:
            raise
        problem = str(error).partition("\n")[0]
        click.echo(f"without the skills of a trees folder: {problem}", err=True)
    space = SceneSpace(parameters=(), mood=None)
    return SymbolTable(space=space, skills={}, plugins=installed_plugins().kinds)


def _code(code: Code) -> Iterable[Part]:
    style = "bold red" if code.severity.value == "error" else "bold yellow"
    yield Text.assemble((f"{code.severity.value}[{code.code}]", style), f"  {code.kind.value}")
    yield Text(f"\n{code.meaning}\n")
    if not code.wrong:
        return
    language = code.kind.language
    yield Text("Wrong:", style="red")
    yield _example(code.wrong, language)
    yield Text("\nRight:", style="green")
    yield _example(code.right, language)


def _refusal(code: RefusalCode) -> Iterable[Part]:
    yield Text.assemble((code, "bold red"), "  a refusal at run time")
    yield Text(f"\n{code.sentence}\n")


def _node(page: NodePage) -> Iterable[Part]:
    yield Text.assemble((page.key, "bold"), f"  {page.group.value}")
    yield Text(f"\n{page.description}\n" if page.description else "")
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


def _file(page: FilePage) -> Iterable[Part]:
    yield Text.assemble((page.key, "bold"), f"  {page.where}")
    yield Text(f"\n{page.description}\n")
    if page.expected:
        yield Text(f"  {page.key}: {page.expected}\n", style="cyan")
    if page.fields:
        yield _fields(page.fields)
        yield Text()


def _topic(page: ReferenceTopic) -> Iterable[Part]:
    yield Text.assemble((page.key, "bold"), "  values and conditions")
    yield Text(f"\n{page.description}\n")
    for heading, rows in page.tables.items():
        if heading:
            yield Text(f"{heading}:\n")
        table = Table(box=None, pad_edge=False, show_header=False, padding=(0, 2, 0, 0))
        if any(meaning for _, meaning in rows):
            # This leaves room for the meaning next to it.
            table.add_column(style="cyan", max_width=34)
        for form, meaning in rows:
            table.add_row(*map(Text, filter(None, (form, meaning))))
        yield Padding(table, (0, 0, 1, 2))
    yield Text(page.note)
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


def _example(text: str, language: str) -> Text:
    # The terminal's own colours are readable on light and dark backgrounds.
    syntax = Syntax("", language, theme="ansi_dark", background_color="default")
    highlighted = syntax.highlight(textwrap.indent(text.rstrip(), "  "))
    highlighted.rstrip()
    highlighted.no_wrap = True
    return highlighted


def _overview(symbols: SymbolTable) -> Table:
    table = Table(box=None, pad_edge=False, show_header=False, padding=(0, 2, 1, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    pages = node_pages(symbols)
    for group in Group:
        keys = [page.key for page in pages if page.group is group]
        if keys:
            table.add_row(group.value, Text("  ".join(keys)))
    libraries: dict[str, list[str]] = {}
    for path, subtree in _subtrees(symbols):
        libraries.setdefault(path, []).append(subtree.name)
    for path, names in libraries.items():
        table.add_row("subtree", Text(f"{'  '.join(names)}\nin {path}"))
    table.add_row("file", Text("  ".join(installed_kinds())))
    table.add_row("about values", Text("  ".join(TOPICS)))
    table.add_row("code", Text("  ".join(codes())))
    table.add_row("refusal", Text("  ".join(RefusalCode)))
    for problem in installed_plugins().without(symbols.skills).problems:
        table.add_row("left out", Text(problem, style="yellow"))
    return table
