# SPDX-License-Identifier: Apache-2.0
"""Agent argument of commands: an agent's file or name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.trees_folder import enclosing_folder
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.files.folder_reader import Trees, read_trees
from bt_agents_language.model.specs import AgentSpec
from bt_agents_tools.cli.trees_choice import take_trees


def named_agent(argument: str, directory: str = "", language: str = "") -> tuple[Trees, AgentSpec]:
    """Return the trees folder and the agent for an argument, which is a name or a file.

    An empty directory is looked up above the file, or as in :func:`take_trees`; an empty language
    is that of the scene.

    Raises:
        BtAgentsError: There is no such file or agent.
        ReadError: The agent's file, or the scene or the skills of its folder, are broken.
    """
    if not argument.endswith((".yaml", ".yml")) and "/" not in argument:
        trees = read_trees(take_trees(directory), language=language)
        return trees, _find(trees, argument, lambda _: False)
    path = Path(argument)
    if not path.is_file():
        raise BtAgentsError(f"there is no file '{argument}'; name an agent file, or an agent")
    folder = take_trees(directory) if directory else enclosing_folder(path)
    trees = read_trees(folder, language=language)
    return trees, _find(trees, argument, path.samefile)


def _find(trees: Trees, argument: str, is_it: Callable[[Path], bool]) -> AgentSpec:
    for spec in trees.agents:
        if spec.name == argument or is_it(Path(spec.file)):
            return spec
    for broken in trees.broken:
        if broken.file.stem == argument or is_it(broken.file):
            raise broken.error
    hint = did_you_mean(argument, [spec.name for spec in trees.agents])
    raise BtAgentsError(f"there is no agent '{argument}' in '{trees.folder}'; {hint}".rstrip("; "))
