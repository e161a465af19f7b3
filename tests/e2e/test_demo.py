# SPDX-License-Identifier: Apache-2.0
"""The morning at the airport, from the command line, with real processes."""

from __future__ import annotations

import json
import re
import signal
import urllib.request
from collections.abc import Iterable
from pathlib import Path

import pytest

from bt_agents_tools.launcher.supervisor import FIRST_LIMIT_S, STOP_LIMIT_S
from programs import ROOT, Start, alive, children, nodes, wait_for

pytestmark = pytest.mark.e2e


def without_times(line: str) -> str:
    """Return a printed line without times and ticks, which differ each time."""
    return re.sub(r"^ +tree +\d+|\d+\.\d s, \d+ ticks", "…", line)


def shared_memory(pids: Iterable[int]) -> set[Path]:
    """Return the files in /dev/shm that processes have mapped."""
    found: set[Path] = set()
    for pid in pids:
        try:
            maps = Path(f"/proc/{pid}/maps").read_text()
        except OSError:
            continue
        found |= {Path(name) for name in re.findall(r"/dev/shm/\S*rtps\S*", maps)}
    return found


def test_demo_plays_whole_script_and_its_journal_replays(start: Start, tmp_path: Path) -> None:
    demo = start("demo", "--no-voice", "--journal", str(tmp_path))
    demo.until("an airport employee")
    pids = children(demo.process.pid)
    assert len(nodes(demo.process.pid)) == 7
    shared = shared_memory([demo.process.pid, *pids])
    assert demo.wait() == 0
    told = demo.output
    chapters = re.split(r"^(?=\S.*─{5,})", told, flags=re.MULTILINE)[1:]
    assert [chapter.partition(" ──")[0].strip() for chapter in chapters] == [
        "an airport employee with tools",
        "an elderly lady, first time",
        "a curious child",
        "a traveller whose mood falls",
        "a ladder",
        "summary",
    ]
    employee, lady, child, traveller, ladder, summary = chapters
    for chapter, winner in (
        (employee, "professional_express"),
        (lady, "attentive_guide"),
        (child, "playful_companion"),
    ):
        assert f"{winner} wins" in chapter
        assert f"{winner} succeeded" in chapter
        bids = re.findall(r"bid \d+ +(\w+) +(\d+\.\d+) = ", chapter)
        assert len(bids) == 4
        assert bids[0][0] == winner
        assert "✔" in chapter
        assert "robot" in chapter
    assert "drives to: Gate 12" in employee
    assert "mood  rises" in lady, lady
    assert "positive for attentive_guide" in lady
    steps = [
        "attentive_guide wins",
        "mood  falls from 3 to 1.5",
        "negative for attentive_guide by mood rule",
        "stopping attentive_guide",
        "attentive_guide cancelled",
        "silent_text wins",
        "silent_text succeeded",
    ]
    places = [traveller.find(step) for step in steps]
    assert -1 not in places, dict(zip(steps, places, strict=True))
    assert places == sorted(places)
    assert re.search(r"profile  attentive_guide \[.*\] → \[.*\]", traveller)
    assert "nobody" in ladder
    assert "scene.person" in ladder
    assert "says" not in ladder
    assert "1 taken over by another agent" in summary
    readme = (ROOT / "README.md").read_text().partition("```text\n")[2].partition("```")[0]
    printed = {without_times(line) for line in traveller.splitlines()}
    shown = [line for line in readme.splitlines()[1:] if line.strip(" …")]
    assert len(shown) > 30
    for line in shown:
        assert without_times(line) in printed, "README shows something else"
    assert not re.search("Traceback|had to be killed", told)
    assert not [pid for pid in pids if alive(pid)]
    assert not shared
    again = start("replay", str(tmp_path), "--json")
    assert again.wait() == 0, again.output
    found = json.loads(again.output)
    assert found["counts"] == {
        "decisions": {"equal": 6, "different": 0, "not recorded": 0},
        "profile changes": {"equal": 2, "different": 0, "not recorded": 0},
    }
    assert found["problems"] == []
    assert found["lost"] == {}
    trace = start("trace", "--journal", str(tmp_path), "--json")
    assert trace.wait() == 0, trace.output
    last = json.loads(trace.output)[-1]
    assert (last["path"], last["status"]) == ("tree", "success")


@pytest.mark.parametrize(
    ("number", "options"),
    [(signal.SIGINT, ()), (signal.SIGTERM, ()), (signal.SIGINT, ("--one-process",))],
)
def test_signal_during_run_ends_all_processes_without_kill(
    start: Start, number: int, options: tuple[str, ...]
) -> None:
    demo = start("demo", "--no-voice", *options)
    demo.until("says|asks")
    pids = children(demo.process.pid)
    shared = shared_memory([demo.process.pid, *pids])
    code, seconds = demo.stop(number)
    assert code == 0, demo.output
    assert seconds < FIRST_LIMIT_S + STOP_LIMIT_S
    assert "had to be killed" not in demo.output
    assert "Traceback" not in demo.output
    assert not [pid for pid in pids if alive(pid)]
    assert not shared


def test_killed_demo_leaves_no_process_behind(start: Start) -> None:
    demo = start("demo", "--no-voice")
    demo.until("ready")
    pids = children(demo.process.pid)
    demo.process.kill()
    demo.process.wait()
    wait_for(lambda: not any(map(alive, pids)))


def test_browser_demo_serves_visitor_page_until_it_ends(start: Start) -> None:
    demo = start("demo", "--browser")
    demo.until("studio: http")
    address = demo.until("to be the person: http").split()[-1]
    assert re.search(r"/person#[0-9a-f]{64}$", address)
    pids = children(demo.process.pid)
    assert len(nodes(demo.process.pid)) == 6
    with urllib.request.urlopen(address, timeout=10) as answer:
        assert b"bt-agents studio" in answer.read()
    code, seconds = demo.stop()
    assert (code, "Traceback" in demo.output) == (0, False), demo.output
    assert seconds < FIRST_LIMIT_S + STOP_LIMIT_S
    assert not any(map(alive, pids))
