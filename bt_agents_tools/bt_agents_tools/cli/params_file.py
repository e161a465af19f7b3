# SPDX-License-Identifier: Apache-2.0
"""Check of the form and the node names of a ROS parameter file before nodes get it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import click
import yaml

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.text import printable_line, quote
from bt_agents_language.diagnostics.collection import nearest
from bt_agents_ros.system_topics import NODES
from bt_agents_tools.launcher.components import HOST

_MAX_BYTES = 1_000_000
_VALUES = "ros__parameters"
_MAX_NESTED = 16
_NODES = {*(name.format(host=HOST) for name in NODES), "fleet", "visitors"}


def checked_params(
    _context: click.Context, _parameter: click.Parameter, path: Path | None
) -> Path | None:
    """Return a parameter file that nodes can read; a click callback.

    It reports on standard error node names that look like misspelled parts of the system, and
    those without a namespace if the nodes have one.

    Raises:
        BtAgentsError: It is too large, not YAML, or does not have the form that ROS expects.
    """
    if path is not None:
        namespace = os.environ.get("ROS_NAMESPACE", "").strip("/")
        for name in _nodes(path, _loaded(path)):
            node = name.rpartition("/")[2]
            near = nearest(node, _NODES)
            if node in _NODES and namespace and name == node:
                click.echo(
                    f"{path.name}: '{node}' names no node, as ROS_NAMESPACE is '{namespace}', so "
                    f"its values count for nothing; write '/**/{node}' or '/{namespace}/{node}'",
                    err=True,
                )
            elif node not in _NODES and near is not None:
                click.echo(
                    f"{path.name}: no node is called {quote(printable_line(node))}; did you mean "
                    f"'{near}'?",
                    err=True,
                )
    return path


def _loaded(path: Path) -> object:
    try:
        with path.open("rb") as file:
            text = file.read(_MAX_BYTES + 1)
        if len(text) > _MAX_BYTES:
            raise BtAgentsError(f"{path.name} is larger than {_MAX_BYTES:,} bytes")
        return yaml.load(text, Loader=yaml.CSafeLoader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f", line {mark.line + 1}" if mark is not None else ""
        raise BtAgentsError(
            f"{path.name}{place}: it is no YAML, expected a ROS parameter file"
        ) from None


def _nodes(path: Path, document: object, name: str = "", depth: int = 0) -> Iterator[str]:
    """Yield the name of each node of a document, without the first slash.

    Raises:
        BtAgentsError: A name contains neither ``ros__parameters`` nor another name.
    """
    if not isinstance(document, Mapping) or not document or depth > _MAX_NESTED:
        place = f"below {quote(printable_line(name.rpartition('/')[2]))}" if name else "in it"
        raise BtAgentsError(
            f"{path.name}: there is no '{_VALUES}' {place}, expected a ROS parameter file such as "
            f"'marketplace: {{{_VALUES}: {{bid_deadline: 3.0}}}}'"
        )
    if _VALUES in document:
        yield name
        return
    for key, value in document.items():
        yield from _nodes(path, value, f"{name}/{key}".strip("/"), depth + 1)
