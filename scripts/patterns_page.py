# SPDX-License-Identifier: Apache-2.0
"""The page of patterns, docs/patterns.md: each with its file, its tests and a rehearsal."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory

from click.testing import CliRunner

from bt_agents_language.files.folder_reader import read_trees, yaml_files
from bt_agents_language.files.libraries import FolderLibraries
from bt_agents_language.model.specs import SubtreeSpec
from bt_agents_language.tools.templates.first_files import (
    pattern_file,
    pattern_names,
    tests_beside,
)
from bt_agents_tools.cli.main import bt_agents

HEAD = """# Patterns

Twelve small agents that each solve one common problem: the file with its reasons, a rehearsal, and
what its tests check. Start from one, and change it:

```console
$ bt-agents new breakfast --pattern ask_on_screen_and_aloud
```

`bt-agents new granny_guide --like attentive_guide` starts from a whole agent instead, one of yours
or a shipped one. Its imports come along.
"""

LIBRARIES = """## Shipped libraries

Libraries hold subtrees that several agents share. An agent that imports the file can call them:
`imports: [libraries/manners.yaml]`, then `subtree: greet`.
"""


def patterns_page(trees: Path) -> str:
    """Return the page of all patterns, and of the libraries of a trees folder."""
    parts = [HEAD, _contents(), *map(_pattern, pattern_names()), LIBRARIES, *_libraries(trees)]
    return "\n".join(f"{part.rstrip()}\n" for part in parts)


def _contents() -> str:
    rows = (f"| [{_title(name)}](#{name}) | `{name}` |\n" for name in pattern_names())
    return "| pattern | name |\n|---|---|\n" + "".join(rows)


def _pattern(name: str) -> str:
    agent = pattern_file(name).read_text(encoding="utf-8")
    tests = tests_beside(pattern_file(name)).read_text(encoding="utf-8")
    cases = [part.partition("\n")[0] for part in tests.split("- name: ")[1:]]
    test_case = f"trees/agents/{name}.test.yaml:{cases[0]}"
    return (
        f"## {name}\n\n**{_title(name)}.** {_why(agent)}\n\n```yaml\n{agent}```\n\n"
        f"```console\n$ bt-agents new {name} --pattern {name}\n"
        f"$ bt-agents rehearse {shlex.quote(test_case)}\n{_rehearsal(name, test_case)}```\n\n"
        "Its tests check:\n\n" + "\n".join(f"- {one}" for one in cases)
    )


def _rehearsal(name: str, test_case: str) -> str:
    """Return the output of a rehearsal of the pattern in a folder without other files."""
    runner = CliRunner()
    with TemporaryDirectory() as folder, chdir(folder):
        made = runner.invoke(bt_agents, ["new", name, "--pattern", name], catch_exceptions=False)
        assert made.exit_code == 0, made.output
        words = ["rehearse", test_case]
        return runner.invoke(bt_agents, words, catch_exceptions=False).stdout


def _title(name: str) -> str:
    text = pattern_file(name).read_text(encoding="utf-8")
    return text.partition("title: ")[2].partition("\n")[0]


def _why(agent: str) -> str:
    return " ".join(agent.partition("description: >\n")[2].partition("\ntags:")[0].split())


def _libraries(trees: Path) -> Iterator[str]:
    libraries = FolderLibraries(trees, read_trees(trees).symbols)
    for file in yaml_files(trees / "libraries"):
        library = libraries.load(f"libraries/{file.name}")
        yield f"### libraries/{file.name}\n"
        for name, subtree in library.subtrees.items():
            yield f"**`{name}`**: {subtree.description}\n"
            yield _fields(subtree)


def _fields(subtree: SubtreeSpec) -> str:
    rows = [
        f"| `{one.name}` | input | {one.type.value} | "
        f"{'needed' if one.default is None else f'`{one.default}`'} | {one.description} |"
        for one in subtree.inputs
    ]
    rows += [
        f"| `{one.name}` | output | {one.type.value} | | {one.description} |"
        for one in subtree.outputs
    ]
    return "\n".join(["| | | type | left out | |\n|---|---|---|---|---|", *rows])
