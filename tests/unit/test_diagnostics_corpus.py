# SPDX-License-Identifier: Apache-2.0
"""Hand-made files, most of them bad: every error in them with its code and place, and no other."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from bt_agents.errors import ReadError
from bt_agents.language import diagnostics
from bt_agents.language.agent_reader import read_agent
from bt_agents.language.diagnostics import CODES
from bt_agents.language.experiment_reader import read_experiment
from bt_agents.language.scene_reader import read_scene
from bt_agents.language.script_reader import read_script
from bt_agents.language.skills_reader import read_skills
from stage import SPACE, VOCABULARY

CORPUS = Path(__file__).parents[1] / "corpus"
READERS: dict[str, Callable[[Path], object]] = {
    "agents": lambda path: read_agent(path, VOCABULARY),
    "skills": lambda path: read_skills([path]),
    "scenes": read_scene,
    "scripts": lambda path: read_script(path, SPACE),
    "experiments": lambda path: read_experiment(path, SPACE),
}
ELSEWHERE = {
    # What stands around a file, not in it.
    "no-file", "not-a-file", "duplicate-agent", "duplicate-skill",
    # Too large to be kept here.
    "too-large", "too-deep", "too-many-values", "too-long",
    # Known only where ROS is.
    "unknown-ros-type", "unknown-ros-field",
}  # fmt: skip
LINE = re.compile(r"(?P<file>.+):(?P<place>\d+:\d+): error\[(?P<code>[a-z0-9-]+)\]: .+")


def expectations() -> dict[str, str]:
    lines = (CORPUS / "expected.txt").read_text(encoding="utf-8").splitlines()
    pairs = (line.split(":", 1) for line in lines if line and not line.startswith("#"))
    return {file: errors.strip() for file, errors in pairs}


EXPECTED = expectations()


@pytest.mark.parametrize("file", EXPECTED)
def test_every_error_is_found_where_it_is(file):
    path = CORPUS / file
    found = []
    try:
        READERS[path.parent.name](path)
    except ReadError as error:
        for line in error.lines:
            match = LINE.fullmatch(line)
            assert match, line
            assert match["file"] == str(path)
            found.append(f"{match['code']} {match['place']}")
    assert ", ".join(found) == EXPECTED[file]


def test_every_code_is_provoked_by_a_file_or_by_a_test_of_its_own():
    provoked = set(re.findall(r"([a-z0-9-]+) \d+:\d+", " ".join(EXPECTED.values())))
    assert provoked | ELSEWHERE == set(CODES)
    assert not provoked & ELSEWHERE


def test_every_code_that_the_readers_know_is_in_the_table():
    emitted = re.compile(
        r"""(?:\.error|\.error_in|\.add|_give_up|_refusal)\(\s*(?:event,|file,)?
        \s*"([a-z0-9-]+)" """,
        re.VERBOSE,
    )
    sources = Path(diagnostics.__file__).parent.glob("*.py")
    found = {code for path in sources for code in emitted.findall(path.read_text("utf-8"))}
    assert len(found) > 40
    assert found <= set(CODES)


def test_every_file_of_the_corpus_has_an_expectation():
    files = {str(path.relative_to(CORPUS)) for path in CORPUS.glob("*/*.yaml")}
    assert files == set(EXPECTED)
