# SPDX-License-Identifier: Apache-2.0
"""Counts public trees of BehaviorTree.CPP that can be imported, checked and exported again.

The arguments are clones of repositories; it reads their XML files, and texts in their C++ files.
It prints rows as in docs/groot.md, then a line for each tree that fails.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.extend(str(Path(__file__).parents[1] / one) for one in ("scripts", "tests/harness"))

from markdown_table import markdown_table

from bt_agents_core.errors import ReadError
from bt_agents_groot.agent_export import export_agent
from bt_agents_groot.agent_import import import_agent, skills_file
from bt_agents_groot.translation import RemarkLevel
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.folder_reader import read_symbols
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.yaml.source import Source
from tree_shape import shape

ROOT = Path(__file__).parents[1]
RAW = re.compile(r'R"(\w*)\((.*?)\)\1"', re.DOTALL)
NAME = re.compile(r'<BehaviorTree\s+ID="([^"]+)"')
STEPS = ("trees", "imported", "without a loss", "pass check", "equal after export")


def texts(clone: Path) -> Iterator[tuple[str, str]]:
    """Yield the place and text of each tree in the files that git tracks."""
    listed = subprocess.run(
        ["git", "ls-tree", "-r", "--name-only", "-z", "HEAD"],
        cwd=clone,
        capture_output=True,
        text=True,
        check=True,
    )
    for name in listed.stdout.split("\0"):
        if not name.endswith((".xml", ".cpp", ".h", ".hpp")):
            continue
        content = subprocess.run(
            ["git", "show", f"HEAD:{name}"], cwd=clone, capture_output=True, check=True
        ).stdout.decode(errors="replace")
        found = [content] if name.endswith(".xml") else [one[1] for one in RAW.findall(content)]
        for number, text in enumerate(found):
            if "<BehaviorTree" in text and "<root" in text:
                yield f"{name}:{number}", text


def main_tree(text: str) -> str:
    """Return the first of several trees if the file names no main one; else an empty text."""
    names = NAME.findall(text)
    return str(names[0]) if len(names) > 1 and "main_tree_to_execute" not in text else ""


def follow(text: str, symbols: SymbolTable) -> Iterator[str]:
    """Yield each step that a tree passes, then the failure, if any."""
    yield "trees"
    try:
        made = import_agent(Source("tree.xml", text), "agent", symbols, main=main_tree(text))
        yield "imported"
        if not any(one.level is RemarkLevel.LOST for one in made.remarks):
            yield "without a loss"
        skeleton = skills_file(made.missing)
        if skeleton:
            symbols = symbols.with_skills(read_skills([Source("new.yaml", skeleton)]))
        agent = read_agent(Source("agent.yaml", made.text), symbols)
        yield "pass check"
        exported = export_agent(Source("agent.yaml", made.text), symbols)
        again = import_agent(Source("again.xml", exported.text), "agent", symbols)
        twice = read_agent(Source("again.yaml", again.text), symbols)
        if shape(twice.tree) == shape(agent.tree):
            yield "equal after export"
        else:
            yield "differs after export"
    except ReadError as error:
        first = error.diagnostics[0]
        yield f"{first.code}: {first.message}"


def main(clones: list[str]) -> None:
    """Print how far the trees of some clones get."""
    symbols = read_symbols(ROOT / "trees")
    rows, failed = [], []
    for clone in map(Path, clones):
        counts = dict.fromkeys(STEPS, 0)
        for place, text in texts(clone):
            reached = list(follow(text, symbols))
            for step in STEPS:
                counts[step] += step in reached
            if reached[-1] not in STEPS:
                failed.append(f"{clone.name} {place}: {reached[-1]}")
        rows.append((clone.name, *map(str, counts.values())))
    print(markdown_table(("repository", *STEPS), rows))
    print("\n".join(failed))


if __name__ == "__main__":
    main(sys.argv[1:])
