# SPDX-License-Identifier: Apache-2.0
"""The agent that a command line names, by its file or by its name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.trees_folder import enclosing_folder, find_trees
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.files.folder_reader import Trees, read_trees
from bt_agents_language.model.specs import AgentSpec


def named_agent(
    word: str, directory: str = "", trees: Trees | None = None
) -> tuple[Trees, AgentSpec]:
    """Return an agent, with the trees folder that it is in.

    Args:
        word: An agent file, or the name of an agent.
        directory: The trees folder; empty finds it above the file, or as :func:`find_trees`.
        trees: The same, read already.

    Raises:
        BtAgentsError: There is no such file or agent.
        ReadError: The agent's file is broken, or the scene or the skills of its folder are.
    """
    if not word.endswith((".yaml", ".yml")) and "/" not in word:
        trees = trees or read_trees(find_trees(directory))
        return trees, _chosen(trees, word, lambda _: False)
    path = Path(word)
    if not path.is_file():
        raise BtAgentsError(f"there is no file '{word}'; name an agent file, or an agent")
    trees = trees or read_trees(find_trees(directory) if directory else enclosing_folder(path))
    return trees, _chosen(trees, word, path.samefile)


def _chosen(trees: Trees, word: str, is_it: Callable[[Path], bool]) -> AgentSpec:
    for spec in trees.agents:
        if spec.name == word or is_it(Path(spec.file)):
            return spec
    for broken in trees.broken:
        if broken.file.stem == word or is_it(broken.file):
            raise broken.error
    hint = did_you_mean(word, [spec.name for spec in trees.agents])
    raise BtAgentsError(f"there is no agent '{word}' in '{trees.folder}'; {hint}".rstrip("; "))
