# SPDX-License-Identifier: Apache-2.0
"""Pages of the documentation site: those of docs/, and those that are made from the code."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

ROOT = Path(__file__).parents[1]

NODES = ("agents", "feedback", "journal", "marketplace", "robot", "scene_layer")
"""Nodes whose parameters are listed."""

OF_EVERY_NODE = ("start_type_description_service", "use_sim_time")
"""Parameters that rclpy declares."""

HANG_S = 120.0
"""How long the nodes of a system may take to describe their parameters [s]."""


def start_page() -> str:
    """Return README as the first page."""
    return _moved((ROOT / "README.md").read_text(encoding="utf-8"))


def contributing_page() -> str:
    """Return CONTRIBUTING as a page."""
    return _moved((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))


def _moved(text: str) -> str:
    """Return a text of the root folder with links as they are seen from docs/."""
    text = re.sub(r"\]\(docs/", "](", text)
    return text.replace("](CONTRIBUTING.md", "](contributing.md").replace(
        "](README.md", "](index.md"
    )


def commands_page() -> str:
    """Return the page of all commands, from the help that they print."""
    from bt_agents_tools.cli.main import bt_agents

    top = click.Context(bt_agents, info_name="bt-agents")
    parts = ["# Commands", "What `bt-agents COMMAND --help` prints, of every command."]
    for path, command, context in _commands(bt_agents, top):
        level = "#" * min(1 + len(path), 3)
        parts.append(f"{level} {' '.join(path)}")
        parts.append(f"~~~text\n{_help(command, context)}\n~~~")
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


def _help(command: click.Command, context: click.Context) -> str:
    context.terminal_width = context.max_content_width = 88
    return command.get_help(context)


def files_page() -> str:
    """Return the page of all keys of all kinds of files, from the tables they are read by."""
    from bt_agents_language.reference.file_pages import key_pages
    from bt_agents_tools.cli.installed_kinds import installed_kinds

    parts = [
        "# Keys of every file",
        "Made from the tables by which the files are read. `bt-agents explain KEY` says the same, "
        "and an [editor](../editor.md) shows it. What stands in a tree has pages of its own: "
        "[the nodes](../nodes.md).",
    ]
    for kind in installed_kinds().values():
        parts += [f"## {kind.name}", kind.description]
        rows = [
            (f"`{page.key}`", page.where, page.expected, page.description)
            for page in key_pages(kind)
        ]
        parts.append(_table(("key", "where", "expected", "means"), rows))
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


def parameters_page() -> str:
    """Return the page of all ROS parameters, as the nodes of a running system describe them."""
    parts = [
        "# Parameters",
        "As the nodes describe them; `ros2 param describe /marketplace bid_deadline` says the "
        "same. A host has [tunables](../tuning.md) of its agents besides, as `<agent>.<name>`. "
        "How to set them: [the ROS graph](../ros.md#parameters).",
    ]
    with TemporaryDirectory() as folder, _system(Path(folder)):
        for node, rows in _described_parameters():
            parts += [f"## {node}", _table(("parameter", "default", "allowed", "means"), rows)]
    return _page(parts)


@contextmanager
def _system(folder: Path) -> Iterator[None]:
    """Run all nodes in a domain of their own."""
    from bt_agents_tools.launcher.domain_lock import reserve_domain

    os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
    words = ("up", str(ROOT / "trees"), "--no-voice", "--journal", str(folder / "journal"))
    process = subprocess.Popen(
        [sys.executable, "-m", "bt_agents_tools.cli", *words],
        env={**os.environ, "XDG_STATE_HOME": str(folder)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(HANG_S)
        finally:
            process.kill()


def _described_parameters() -> Iterator[tuple[str, list[tuple[str, ...]]]]:
    import rclpy
    from rclpy.parameter_client import AsyncParameterClient

    context = rclpy.Context()
    rclpy.init(context=context)
    probe = rclpy.create_node("documentation", context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(probe)

    def answer(future: Any) -> Any:
        executor.spin_until_future_complete(future, HANG_S)
        if not future.done():
            raise TimeoutError("a node does not describe its parameters")
        return future.result()

    try:
        for name in NODES:
            client = AsyncParameterClient(probe, name)
            if not client.wait_for_services(HANG_S):
                raise TimeoutError(f"there is no node {name}")
            names = sorted(
                one
                for one in answer(client.list_parameters()).result.names
                if one.count(".") == 0 and one not in OF_EVERY_NODE
            )
            described = answer(client.describe_parameters(names)).descriptors
            values = answer(client.get_parameters(names)).values
            yield (
                name,
                [
                    (f"`{one.name}`", _default(value), _allowed(one), one.description)
                    for one, value in zip(described, values, strict=True)
                ],
            )
    finally:
        executor.shutdown()
        probe.destroy_node()
        context.shutdown()


def _default(value: Any) -> str:
    from rclpy.parameter import parameter_value_to_python

    default = parameter_value_to_python(value)
    is_path = isinstance(default, str) and "/" in default
    return "" if default == "" or is_path else f"`{json.dumps(default)}`"


def _allowed(descriptor: Any) -> str:
    if descriptor.additional_constraints:
        return str(descriptor.additional_constraints)
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    return ", ".join(f"{one.from_value:g} to {one.to_value:g}" for one in ranges)


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(map(_cell, line))} |" for line in lines)


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())


def _page(parts: Iterable[str]) -> str:
    return "\n\n".join(parts) + "\n"


PAGES: Mapping[str, Callable[[], str]] = {
    "index.md": start_page,
    "contributing.md": contributing_page,
    "reference/commands.md": commands_page,
    "reference/files.md": files_page,
    "reference/interfaces.md": interfaces_page,
    "reference/parameters.md": parameters_page,
}
"""Page of the site → what makes it."""


def write_pages(folder: Path) -> None:
    """Write all pages, those of docs/ too."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(ROOT / "docs", folder)
    for name, make in PAGES.items():
        page = folder / name
        page.parent.mkdir(exist_ok=True)
        page.write_text(make(), encoding="utf-8")


def load_nothing_from_the_net(site: Path) -> None:
    """Let the pages of a site load what stands in for workers from the site itself.

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
    """Build the site; every link is checked."""
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
