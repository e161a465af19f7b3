# SPDX-License-Identifier: Apache-2.0
"""The ledger's file under kills, cuts, flipped bits and full disks: never a wrong value."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from feedback_node.ledger import Ledger, LedgerEntry
from feedback_node.ledger.file import LedgerError
from feedback_node.ledger.rows import LAYER, RevisionCause

pytestmark = pytest.mark.e2e

KILLS = 120
FLIPS = 500
PARTS = ("", "-wal", "-shm", ".lock")
NAMED = {"LEDGER_CORRUPT", "LEDGER_CUT_OFF", "LEDGER_FOREIGN", "OTHER_FORMAT", "LEDGER_UNREADABLE"}

# Forks a writer for each line that it reads, so that none of them must start Python.
WRITER = """
import json, os, random, resource, signal, sys
from pathlib import Path
from feedback_node.ledger import Ledger, LedgerEntry, file
from feedback_node.ledger.rows import LAYER, RevisionCause

def say(*words):
    os.write(1, (json.dumps(words) + "\\n").encode())

def die_at_line(number):
    folder, lines = str(Path(file.__file__).parent), 0
    def trace(frame, event, _):
        nonlocal lines
        lines += event == "line"
        if lines == number:
            os.kill(os.getpid(), signal.SIGKILL)
        return trace
    sys.settrace(lambda frame, *_: trace if frame.f_code.co_filename.startswith(folder) else None)

def die_at_size(size):
    signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

DEATHS = {"line": die_at_line, "size": die_at_size}

def create(path, at, number):
    DEATHS[at](number)
    Ledger(path)
    sys.settrace(None)

def write(path, seed):
    chance = random.Random(seed)
    ledger = Ledger(path)
    ledger.enter({"guide": {"age": 0.0}, "express": {"age": 0.0}})
    for number in range(100_000):
        agent, what = chance.choice(["guide", "express"]), chance.random()
        layer = f"person/p{chance.randrange(4)}" if what < 0.3 else ""
        if what > 0.97:
            layers = [row.layer for row in ledger.layers(agent)]
            if layers:
                say("forgetting", agent, layers[0])
                ledger.forget([(agent, layers[0])])
                say("forgotten", agent, layers[0])
            continue
        if what > 0.9:
            ledger.checkpoint()
            continue
        age, one = chance.random(), f"{seed}/{number}"
        entries = []
        causes = [(age, RevisionCause(feedback_id=one))]
        if layer and ledger.current(agent, layer) is None:
            causes.insert(0, (0.0, RevisionCause(cause=LAYER)))
        for value, cause in causes:
            profile = {"age": value}
            entries.append(LedgerEntry(agent=agent, layer=layer, profile=profile, cause=cause))
        say("recording", one)
        row = ledger.record(entries)[-1]
        say("recorded", one, agent, layer, row.revision, age)

for line in sys.stdin:
    do, *words = json.loads(line)
    child = os.fork()
    if child == 0:
        say("started", os.getpid())
        try:
            {"write": write, "create": create}[do](*words)
        except BaseException as error:
            say("failed", repr(error))
        os._exit(0)
    _, status = os.waitpid(child, 0)
    say("ended", os.waitstatus_to_exitcode(status))
"""


@pytest.fixture
def tmp_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder on the disk, where creating a ledger takes some time."""
    return tmp_path_factory.mktemp("ledger")


class Writers:
    """Starts writers of a ledger one after another, and kills them."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", WRITER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def run(self, path: Path, seed: int, acknowledged: int, more_s: float) -> list[list[Any]]:
        """Run a writer until a number of acknowledgements; return its output."""
        pid = self._start("write", str(path), seed)
        heard: list[list[Any]] = []
        while sum(words[0] == "recorded" for words in heard) < acknowledged:
            heard.append(self._hear())
            assert heard[-1][0] not in ("failed", "ended"), heard[-1]
        time.sleep(more_s)
        os.kill(pid, signal.SIGKILL)
        return heard + self._rest()[:-1]

    def create(self, path: Path, at: str, number: int) -> bool:
        """Let a writer create a ledger; return whether a given line or size killed it before."""
        self._start("create", str(path), at, number)
        (_, code), *more = reversed(self._rest())
        assert not more, more
        return bool(code)

    def _start(self, *words: Any) -> int:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(words) + "\n")
        self._process.stdin.flush()
        started, pid = self._hear()
        assert started == "started"
        return int(pid)

    def _rest(self) -> list[list[Any]]:
        """Return the remaining output of a writer; its exit code comes last."""
        heard = [self._hear()]
        while heard[-1][0] != "ended":
            heard.append(self._hear())
        return heard

    def _hear(self) -> list[Any]:
        assert self._process.stdout is not None
        heard: list[Any] = json.loads(self._process.stdout.readline())
        return heard

    def close(self) -> None:
        # Including the writer, which would continue otherwise.
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.communicate()


@pytest.fixture
def writers() -> Iterator[Writers]:
    made = Writers()
    try:
        yield made
    finally:
        made.close()


def test_kills_neither_lose_nor_duplicate_acknowledged_revisions(tmp_path, writers):
    path = tmp_path / "ledger.sqlite"
    chance = random.Random(17)
    expected: dict[str, tuple[str, str, int, float]] = {}
    forgotten: set[str] = set()
    acknowledged = kills_in_the_middle = 0

    def forget(*layer: str) -> None:
        gone = [one for one, row in expected.items() if row[:2] == layer]
        forgotten.update(gone)
        for one in gone:
            del expected[one]

    for seed in range(KILLS):
        heard = writers.run(path, seed, chance.randrange(10), chance.uniform(0.0, 0.02))
        under_way: list[Any] = []
        for what, *words in heard:
            assert what != "failed", words
            if what == "recorded":
                one, agent, layer, revision, age = words
                expected[one] = (agent, layer, revision, age)
                acknowledged += 1
            elif what == "forgotten":
                forget(*words)
            under_way = [what, *words] if what in ("recording", "forgetting") else []
        kills_in_the_middle += bool(under_way)
        with Ledger(path) as ledger:
            if under_way[:1] == ["forgetting"] and not ledger.current(*under_way[1:]):
                forget(*under_way[1:])
            found = {
                row.cause.feedback_id: (row.agent, row.layer, row.revision, row.profile["age"])
                for agent in ledger.agents()
                for layer in ["", *(row.layer for row in ledger.layers(agent))]
                for row in ledger.history(agent, layer)
                if row.cause.feedback_id is not None
            }
            extra = found.keys() - expected.keys()
            assert len(extra) <= (under_way[:1] == ["recording"])
            assert {one: found[one] for one in expected} == expected
            expected = dict(found)
            if forgotten:
                one = chance.choice(sorted(forgotten))
                before = ledger.history("guide")
                assert not ledger.append(
                    "guide", {"age": 1.0}, RevisionCause(feedback_id=one)
                ).profile
                assert ledger.history("guide") == before
    assert acknowledged > KILLS
    assert kills_in_the_middle > KILLS // 10


@pytest.mark.parametrize(
    ("at", "step", "left"), [("line", 1, ["-wal", "-shm"]), ("size", 512, ["-journal"])]
)
def test_ledger_opens_after_kills_during_creation(tmp_path, writers, at, step, left):
    found = set()
    for number in count(step, step):
        path = tmp_path / str(number) / "ledger.sqlite"
        if not writers.create(path, at, number):
            break
        found.update(part for part in (*PARTS, "-journal") if Path(f"{path}{part}").exists())
        with Ledger(path) as ledger:
            ledger.enter({"guide": {"age": 0.0}})
    assert {"", *left} <= found


class Files:
    """A ledger after a crash: its last commits are in the log.

    Attributes:
        states: All answers of the ledger, after each commit since the last one in its file.
    """

    def __init__(self, folder: Path, *, in_log: bool) -> None:
        self.folder = folder
        self.path = folder / "ledger.sqlite"
        with Ledger(self.path) as ledger:
            self.teach(ledger, 0, 30)
            ledger.forget([("guide", "person/bob")])
            ledger.checkpoint()
            self.states = [self.answers(ledger)]
            for number in range(30, 45) if in_log else ():
                self.teach(ledger, number, number + 1)
                self.states.append(self.answers(ledger))
            self.parts = {part: self._part(part).read_bytes() for part in PARTS}
        if not in_log:
            self.parts = {
                part: self._part(part).read_bytes() if self._part(part).exists() else b""
                for part in PARTS
            }

    @staticmethod
    def teach(ledger: Ledger, first: int, last: int) -> None:
        ledger.enter({"guide": {"age": 0.0, "mood": 1.0}})
        for number in range(first, last):
            layer = ("", "person/anna", "person/bob")[number % 3]
            entries = [
                LedgerEntry(
                    agent="guide",
                    layer=layer,
                    profile={"age": number / 7, "mood": 1.0},
                    cause=RevisionCause(feedback_id=f"f{number}", reason="because" * 20),
                )
            ]
            if layer and ledger.current("guide", layer) is None:
                begins = RevisionCause(cause=LAYER)
                entries.insert(
                    0, LedgerEntry(agent="guide", layer=layer, profile={"age": 0.0}, cause=begins)
                )
            ledger.record(entries)

    @staticmethod
    def answers(ledger: Ledger) -> list[Any]:
        """Return all answers of a ledger."""
        layers = ["", "person/anna", "person/bob"]
        return [
            *(ledger.history("guide", layer) for layer in layers),
            *(ledger.current("guide", layer) for layer in layers),
            *(ledger.find_all(f"f{number}") for number in range(45)),
        ]

    def _part(self, part: str) -> Path:
        return self.path.with_name(self.path.name + part)

    def lay(self, **changed: bytes) -> None:
        """Restore the files, except for some of them."""
        for part in PARTS:
            content = changed.get(part.strip("-."), self.parts[part])
            file = self._part(part)
            if content or part == "":
                file.write_bytes(content)
            elif file.exists():
                file.unlink()

    def judge(self) -> str | int:
        """Open the ledger; return the code of its error, or its state."""
        before = {
            part: self._part(part).read_bytes()
            for part in ("", "-wal")
            if self._part(part).exists()
        }
        try:
            with Ledger(self.path) as ledger:
                found = self.states.index(self.answers(ledger))
                ledger.append("guide", {"age": 2.0, "mood": 2.0}, RevisionCause(feedback_id="new"))
                return found
        except LedgerError as error:
            code = error.code
        after = {part: self._part(part).read_bytes() for part in before}
        assert (code in NAMED, after == before) == (True, True)
        return code


def test_log_truncated_anywhere_is_reported(tmp_path):
    files = Files(tmp_path, in_log=True)
    log = files.parts["-wal"]
    page = 4096
    frames = [32 + number * (24 + page) for number in range((len(log) - 32) // (24 + page) + 1)]
    assert len(frames) > 30
    assert frames[-1] == len(log)
    states = []
    for cut in [0, 16, *(one for frame in frames[:-1] for one in (frame, frame + 24 + page // 2))]:
        files.lay(wal=log[:cut])
        assert files.judge() == "LEDGER_CUT_OFF"
        # Continuing with the rest yields every commit before the cut.
        files._part(".lock").unlink()
        states.append(files.judge())
    assert states == sorted(states)
    assert set(states) == set(range(len(files.states) - 1))


@pytest.mark.parametrize("in_log", [True, False], ids=["with_a_log", "without"])
def test_each_flipped_bit_is_harmless_or_reported(tmp_path, in_log):
    files = Files(tmp_path, in_log=in_log)
    last = len(files.states) - 1
    chance = random.Random(5)
    sizes = {part: len(content) for part, content in files.parts.items() if content}
    del sizes[".lock"]
    found: dict[str, list[str | int]] = {part: [] for part in sizes}
    for _ in range(FLIPS // 2):
        part = chance.choices(list(sizes), list(sizes.values()))[0]
        content = bytearray(files.parts[part])
        # A third of them at the beginning, where most bytes matter.
        where = chance.randrange(
            len(content) if chance.random() < 0.66 else min(600, len(content))
        )
        content[where] ^= 1 << chance.randrange(8)
        files.lay(**{part.strip("-."): bytes(content)})
        found[part].append(files.judge())
    # Every loss is reported.
    assert {one for part in found for one in found[part] if isinstance(one, int)} == {last}
    assert "LEDGER_CORRUPT" in found[""]
    if in_log:
        # SQLite drops the end of a log from its first damaged frame on.
        assert "LEDGER_CUT_OFF" in found["-wal"]
        assert set(found["-shm"]) == {last}


def test_older_copy_of_ledger_is_reported(tmp_path):
    files = Files(tmp_path, in_log=False)
    with Ledger(files.path) as ledger:
        Files.teach(ledger, 60, 61)
    files.path.write_bytes(files.parts[""])
    assert files.judge() == "LEDGER_CUT_OFF"
    files._part(".lock").unlink()
    assert files.judge() == 0


def test_ledger_from_version_without_row_number_opens(tmp_path):
    files = Files(tmp_path, in_log=True)
    files.lay()
    files._part(".lock").write_bytes(b"")
    assert files.judge() == len(files.states) - 1
    files.path.write_bytes(files.parts[""])
    assert files.judge() == "LEDGER_CUT_OFF"


def test_damaged_last_row_number_is_harmless(tmp_path):
    files = Files(tmp_path, in_log=False)
    chance = random.Random(5)
    for where in range(len(files.parts[".lock"])):
        content = bytearray(files.parts[".lock"])
        content[where] ^= 1 << chance.randrange(8)
        files.lay(lock=bytes(content))
        assert files.judge() == len(files.states) - 1


@pytest.mark.parametrize(
    ("lost", "found"),
    [("", "LEDGER_CORRUPT"), ("-wal", "LEDGER_CUT_OFF"), ("-shm", -1), (".lock", -1)],
)
def test_lost_file_is_harmless_or_reported(tmp_path, lost, found):
    files = Files(tmp_path, in_log=True)
    files.lay()
    files._part(lost).unlink()
    assert files.judge() == (found if found != -1 else len(files.states) - 1)


def test_outdated_page_is_reported(tmp_path):
    files = Files(tmp_path, in_log=False)
    with Ledger(files.path) as ledger:
        Files.teach(ledger, 60, 90)
    new = bytearray(files.path.read_bytes())
    old = files.parts[""]
    differing = [
        at for at in range(4096, len(old), 4096) if old[at : at + 4096] != new[at : at + 4096]
    ]
    assert differing
    for at in differing:
        mixed = bytearray(new)
        mixed[at : at + 4096] = old[at : at + 4096]
        files.path.write_bytes(mixed)
        with pytest.raises(LedgerError) as error:
            Ledger(files.path)
        assert error.value.code == "LEDGER_CORRUPT"
