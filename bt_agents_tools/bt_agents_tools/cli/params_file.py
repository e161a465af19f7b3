# SPDX-License-Identifier: Apache-2.0
"""Option for a ROS parameter file, and the check of its form and node names."""

from __future__ import annotations

import os
from pathlib import Path

import click

from bt_agents_core.text import printable_line, quote
from bt_agents_language.diagnostics.collection import nearest
from bt_agents_ros.system_topics import NODES
from bt_agents_tools.launcher.components import HOST
from bt_agents_tools.launcher.parameter_file import ParameterFile, read_parameters

_NODES = {*(name.format(host=HOST) for name in NODES), "fleet", "visitors"}


def checked_params(
    _context: click.Context, _parameter: click.Parameter, path: Path | None
) -> ParameterFile | None:
    """Read a parameter file; a click callback.

    It reports on standard error node names that look like misspelled parts of the system, and
    those without a namespace if the nodes have one.

    Raises:
        BtAgentsError: As in :func:`read_parameters`.
    """
    if path is None:
        return None
    file = read_parameters(path)
    namespace = os.environ.get("ROS_NAMESPACE", "").strip("/")
    for name, _ in file.sections:
        node = name.rpartition("/")[2]
        near = nearest(node, _NODES)
        if node in _NODES and namespace and name == node:
            problem = (
                f"'{node}' names no node, as ROS_NAMESPACE is '{namespace}', so its values count "
                f"for nothing; write '/**/{node}' or '/{namespace}/{node}'"
            )
        elif node not in _NODES and near is not None:
            problem = f"no node is called {quote(printable_line(node))}; did you mean '{near}'?"
        else:
            continue
        click.echo(f"{path.name}: {problem}", err=True)
    return file


params_option = click.option(
    "--params",
    type=click.Path(exists=True, dir_okay=False, resolve_path=True, path_type=Path),
    callback=checked_params,
    help="ROS parameter file for all nodes; what the command sets by itself wins.",
)
