# SPDX-License-Identifier: Apache-2.0
"""Pages of the documentation site: from docs/, and generated from the code."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path

import click
from markdown_table import markdown_table

ROOT = Path(__file__).parents[1]


def moved_page(name: str) -> str:
    """Return a file of the root folder as a page, with its links relative to docs/."""
    text = (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")
    text = text.replace("](CONTRIBUTING.md", "](contributing.md")
    return text.replace("](README.md", "](index.md")


def commands_page() -> str:
    """Return the page of all commands, made from their help."""
    from bt_agents_tools.cli.main import bt_agents

    top = click.Context(bt_agents, info_name="bt-agents")
    parts = ["# Commands", "What `bt-agents COMMAND --help` prints, of every command."]
    for path, command, context in _commands(bt_agents, top):
        level = "#" * min(1 + len(path), 3)
        parts.append(f"{level} {' '.join(path)}")
        context.terminal_width = context.max_content_width = 88
        parts.append(f"~~~text\n{command.get_help(context)}\n~~~")
    return _page(parts)


def _commands(
    group: click.Group, context: click.Context, above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command, click.Context]]:
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        inner = click.Context(command, parent=context, info_name=name)
        path = (*above, name)
        yield path, command, inner
        if isinstance(command, click.Group):
            yield from _commands(command, inner, path)


def files_page() -> str:
    """Return the page of all keys of all file kinds, made from their field tables."""
    from bt_agents_language.reference.file_pages import key_pages
    from bt_agents_tools.cli.installed_kinds import installed_kinds

    parts = [
        "# Keys of every file",
        "Made from the tables that the readers of the files use. `bt-agents explain KEY` says the "
        "same, and an [editor](../folders.md#writing-in-an-editor) shows it. Trees contain "
        "[nodes](../nodes.md).",
    ]
    for kind in installed_kinds().values():
        parts += [f"## {kind.name}", kind.description]
        rows = [
            (f"`{page.key}`", page.where, page.expected, page.description)
            for page in key_pages(kind)
        ]
        parts.append(markdown_table(("key", "where", "expected", "means"), rows))
    return _page(parts)


def interfaces_page() -> str:
    """Return the page of all messages, services and actions, with their comments."""
    parts = [
        "# Messages, services, actions",
        "All of `bt_agents_interfaces`. What is sent where, and when: [the ROS graph](../ros.md).",
    ]
    for folder, heading in (("msg", "Messages"), ("srv", "Services"), ("action", "Actions")):
        parts.append(f"## {heading}")
        for file in sorted((ROOT / "bt_agents_interfaces" / folder).glob(f"*.{folder}")):
            head, _, fields = file.read_text(encoding="utf-8").partition("\n")
            parts += [
                f"### {file.stem}",
                head.removeprefix("# "),
                f"~~~text\n{fields.strip()}\n~~~",
            ]
    return _page(parts)


def _page(parts: Iterable[str]) -> str:
    return "\n\n".join(parts) + "\n"


PAGES: Mapping[str, Callable[[], str]] = {
    "index.md": partial(moved_page, "README.md"),
    "contributing.md": partial(moved_page, "CONTRIBUTING.md"),
    "reference/commands.md": commands_page,
    "reference/files.md": files_page,
    "reference/interfaces.md": interfaces_page,
}
"""Page of the site → function that makes it."""


def write_pages(folder: Path) -> None:
    """Write all pages, including docs/."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / "docs", folder)
    for name, make in PAGES.items():
        page = folder / name
        page.parent.mkdir(exist_ok=True)
        page.write_text(make(), encoding="utf-8")


def load_nothing_from_the_net(site: Path) -> None:
    """Make the pages of a site load their workers from the site itself.

    Raises:
        RuntimeError: A page loads something else from the net.
    """
    for page in site.rglob("*.html"):
        here = "../" * (len(page.relative_to(site).parts) - 1)
        text = page.read_text(encoding="utf-8")
        text = text.replace("https://unpkg.com/iframe-worker/shim", f"{here}site/worker_frame.js")
        page.write_text(text, encoding="utf-8")
        loaded = re.findall(
            r'(?:src="|rel="(?:stylesheet|preconnect)" href=")(https?:[^"]*)', text
        )
        if loaded:
            raise RuntimeError(f"{page.name} loads {', '.join(loaded)}")


def main() -> None:
    """Build the site and check every link."""
    write_pages(ROOT / "build" / "pages")
    site = ROOT / "build" / "site"
    shutil.rmtree(site, ignore_errors=True)
    command = [sys.executable, "-m", "zensical", "build", "--clean", "--strict"]
    if subprocess.run(command, cwd=ROOT).returncode:
        sys.exit("the site has links that lead nowhere, or pages that nothing leads to; see above")
    load_nothing_from_the_net(site)
    print(f"open {site / 'index.html'}")


if __name__ == "__main__":
    main()
