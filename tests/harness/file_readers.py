# SPDX-License-Identifier: Apache-2.0
"""Readers of files by their kind, for tests that read many files."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from bt_agents_core.errors import ReadError
from bt_agents_core.gc_pause import gc_paused
from bt_agents_language.files.agent_reader import read_agent
from bt_agents_language.files.experiment_reader import read_experiment
from bt_agents_language.files.libraries import FolderLibraries
from bt_agents_language.files.market_reader import read_market
from bt_agents_language.files.preset_reader import read_preset
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.files.script_reader import read_script
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.files.texts_reader import read_texts
from bt_agents_language.nodes.symbols import ImportProblem
from tree_harness import SPACE, SYMBOLS

ALONE = replace(SYMBOLS, libraries=None)
SLOWEST_S = 1.0
LARGEST = 64 * 1024 * 1024
Reader = Callable[[Path], object]


def read_library(path: Path) -> None:
    """Read a library in a trees folder of its own."""
    libraries = FolderLibraries(path.parents[1], ALONE)
    name = f"{path.parent.name}/{path.name}"
    try:
        libraries.load(name)
    except ImportProblem:
        raise libraries.broken[name] from None


READERS: Mapping[str, Reader] = {
    "agent": lambda path: read_agent(path, SYMBOLS),
    "skills": lambda path: read_skills([path]),
    "library": read_library,
    "scene": read_scene,
    "market": lambda path: read_market(path, SPACE),
    "script": lambda path: read_script(path, SPACE),
    "texts": read_texts,
    "preset": read_preset,
    "experiment": lambda path: read_experiment(path, SPACE),
}


def read_quickly(read: Reader, path: Path) -> object:
    """Return what a reader makes of a file, or its refusal; it may not take long."""
    found: object
    # The collector would visit all objects that thousands of other tests have left.
    with gc_paused():
        start = time.process_time()
        try:
            found = read(path)
        except ReadError as error:
            found = error
        took = time.process_time() - start
    assert took < SLOWEST_S
    return found


def check_memory(read: Reader, path: Path) -> None:
    """Check that reading a file takes little memory."""
    tracemalloc.start()
    try:
        with suppress(ReadError):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < LARGEST
    finally:
        tracemalloc.stop()
