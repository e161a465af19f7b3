# SPDX-License-Identifier: Apache-2.0
"""Events in the terminal, line by line."""

from __future__ import annotations

import io
import math
import re
from typing import Any

import pytest
from rich.console import Console

from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_interfaces import msg
from bt_agents_tools.cli import event_printer
from bt_agents_tools.cli.event_printer import EventPrinter
from tree_harness import SPACE

VALUES = "age 1 (a child), familiarity missing, mood 3 (neutral)"
STARTED = ("run", msg.Run(event=msg.Run.STARTED, agent="a", epoch="e", round=2))
STARTS = "      run  a starts"
INVALID, RUNNING = msg.StatusChange.INVALID, msg.StatusChange.RUNNING
SUCCESS, FAILURE = msg.StatusChange.SUCCESS, msg.StatusChange.FAILURE


def printing(
    width: int = 100, space: SceneSpace = SPACE, **how: Any
) -> tuple[io.StringIO, EventPrinter]:
    """Return a printer and its output."""
    output = io.StringIO()
    return output, EventPrinter(Console(file=output, width=width, color_system=None, **how), space)


def told(*events: tuple[str, Any]) -> list[str]:
    output, printer = printing()
    for name, argument in events:
        getattr(printer, name)(argument)
    return [line.rstrip() for line in output.getvalue().splitlines() if line.strip()]


def scene(mood: float = 3.0, age: float = 1.0, person: bool = True, **more: Any) -> msg.Scene:
    values = {"age": age, "familiarity": math.nan, "mood": mood}
    known = {
        "scene_id": "s1",
        "values": [msg.SceneValue(name=n, value=v) for n, v in values.items()],
    }
    return msg.Scene(person=person, **(known | more))


def stopping(**more: Any) -> tuple[str, msg.Run]:
    return "run", msg.Run(event=msg.Run.CANCELLING, agent="a", **more)


def auction(outcome: int, reason: str, **more: Any) -> tuple[str, msg.Auction]:
    known = {"round": 2, "winner": "a", "scene": scene()}
    return "auction", msg.Auction(outcome=outcome, reason=reason, **(known | more))


def change(path: str, status: int, message: str = "", name: str = "", **values: str) -> Any:
    changed = [msg.ChangedValue(name=key, value=value) for key, value in values.items()]
    name = name or path.rpartition("/")[2]
    return msg.StatusChange(path=path, name=name, status=status, message=message, values=changed)


def tree(tick: int, *changes: msg.StatusChange) -> tuple[str, msg.TreeStatus]:
    return "tree", msg.TreeStatus(agent="a", epoch="e", round=2, tick=tick, changes=list(changes))


def test_scene_shows_labels_missing_values_and_urgency() -> None:
    nobody = scene(mood=math.nan, age=math.nan, person=False)
    urgent = scene(label="[Mrs] Smith", urgent=True)
    assert told(("scene", scene()), ("scene", nobody), ("scene", urgent)) == [
        f"    scene  {VALUES}",
        "    scene  no person, nothing else is known",
        f"    scene  urgent [Mrs] Smith: {VALUES}",
    ]


def test_challenge_says_whether_run_continues() -> None:
    words = "b 0.5 for the new scene, a who runs has 2.5: better by 2.0, margin 1.0"
    stops, goes_on = f"{words}: a is stopped", f"{words}: a goes on, the scene waits"
    events = auction(msg.Auction.PREEMPTS, stops), auction(msg.Auction.WAITS, goes_on)
    assert told(("scene", scene()), *events)[1:] == [
        f"challenge  the run is stopped  {stops}",
        f"challenge  the run goes on  {goes_on}",
    ]


def test_unheard_scene_is_shown_with_its_auction() -> None:
    again = auction(msg.Auction.AWARDED, "a 1.0", scene=scene(scene_id="s1+again"))
    assert told(("scene", scene()), again) == [
        f"    scene  {VALUES}",
        f"    scene  {VALUES}",
        "    award  a wins  a 1.0",
    ]


def test_waiting_scene_is_shown_as_waiting() -> None:
    assert told(
        ("market", msg.MarketStatus()),
        ("market", msg.MarketStatus(queued=1, agent="a", state=msg.MarketStatus.RUNNING)),
        ("market", msg.MarketStatus(queued=1, agent="a", state=msg.MarketStatus.RUNNING)),
        ("market", msg.MarketStatus(queued=2, state=msg.MarketStatus.BIDDING)),
        ("market", msg.MarketStatus()),
        ("market", msg.MarketStatus(queued=1, message="waiting for hosts to register")),
    ) == [
        "    scene  waits in line: a has the robot",
        "    scene  waits in line as the last of 2: another is under way",
        "    scene  waits in line: waiting for hosts to register",
    ]


def test_awaited_and_refused_hosts_are_named_on_change() -> None:
    refusing = msg.MarketStatus(refused_hosts=["/b: HOST_EXISTS: it is there"])
    waiting = msg.MarketStatus(queued=2, awaited_hosts=["/agents"])
    assert told(
        ("market", waiting),
        ("market", waiting),
        ("market", msg.MarketStatus(queued=3, awaited_hosts=["/agents", "/others"])),
        ("market", msg.MarketStatus(queued=3, agent="a", state=msg.MarketStatus.RUNNING)),
        ("market", waiting),
        ("market", refusing),
        ("market", refusing),
    ) == [
        "    scene  2 in line wait for /agents to be back",
        "    scene  3 in line wait for /agents and /others to be back",
        "    scene  2 in line wait for /agents to be back",
        "   market  refuses /b: HOST_EXISTS: it is there",
    ]


CLEANING = tree(9, change("on_cancel", RUNNING))
CLEANS = "     tree     9 ▶ on_cancel"


def test_run_stopped_by_host_is_shown() -> None:
    assert told(STARTED, CLEANING, CLEANING) == [
        STARTS,
        "      run  stopping a: its host hears no market",
        CLEANS,
        CLEANS,
    ]


def test_scenes_are_named_by_label_instead_of_id() -> None:
    stopped = stopping(message="preempted by scene 's2': b 0.5, s1 has 'none'")
    lost = msg.SceneEnd(code="LOST", message="asked again as scene 's1+again'", scene_id="s1")
    named = [("scene", scene(label="Anna")), ("scene", scene(scene_id="s2", label="Ben"))]
    assert told(*named, stopped, ("end", lost))[2:] == [
        "      run  stopping a: preempted by scene 'Ben': b 0.5, s1 has 'none'",
        "    scene  'Anna' lost: asked again as scene 'Anna'",
    ]


def test_market_stop_names_its_requester_not_the_host() -> None:
    stop = stopping(stopped_by=msg.Run.MOOD_RULE, message="mood.change <= -1 held 2 s")
    assert told(STARTED, stop, CLEANING) == [
        STARTS,
        "      run  stopping a (mood rule): mood.change <= -1 held 2 s",
        CLEANS,
    ]


def tuned(revision: int, *reasons: str) -> tuple[str, msg.Tunings]:
    values = {"name": "a.patience", "before": "8 s", "after": "12 s", "author": "root"}
    tunings = [
        msg.Tuning(revision=number, reason=reason, **values)
        for number, reason in enumerate(reasons, start=1)
    ]
    return "tunings", msg.Tunings(host="/agents", revision=revision, tunings=tunings)


def test_tuning_is_shown_once_and_only_after_start() -> None:
    assert told(
        tuned(1, "long ago"),
        tuned(2, "long ago", "Mrs Smith is slow"),
        tuned(3, "long ago", "Mrs Smith is slow", ""),
    ) == [
        "    tuned  a.patience: 8 s → 12 s (root: Mrs Smith is slow, revision 2)",
        "    tuned  a.patience: 8 s → 12 s (root, revision 3)",
    ]


def test_scene_end_is_shown_unless_run_reported_it() -> None:
    full = msg.SceneEnd(code="QUEUE_FULL", message="10 wait, at most 10 may", scene_id="s1")
    by_run = (("end", msg.SceneEnd(code=code)) for code in ("PREEMPTED", "SUCCEEDED", "NO_BIDS"))
    assert told(("scene", scene(label="Anna")), ("end", full), *by_run)[1:] == [
        "    scene  'Anna' queue full: 10 wait, at most 10 may"
    ]


def test_mood_is_shown_during_runs_on_change() -> None:
    start = ("run", msg.Run(event=msg.Run.STARTED, agent="a", epoch="e", scene=scene()))
    moods = [("live", scene(mood=mood)) for mood in (3.1, 1.5, 1.5, 4.0)]
    assert told(("live", scene(mood=1.0)), start, *moods) == [
        STARTS,
        "     mood  falls from 3 to 1.5",
        "     mood  rises from 1.5 to 4",
    ]


def test_tick_shows_ended_nodes_then_started_parents_first() -> None:
    changes = [
        change("tree/0.say", SUCCESS, answer="'yes'", sure="[b]"),
        change("tree/1.sequence/0.ask", RUNNING, "Where to?"),
        change("tree/1.sequence", RUNNING),
        change("tree/1.sequence@timeout", RUNNING),
        change("tree/2.wait", INVALID),
        change("tree/3.say@timeout", FAILURE, "not done within 5 s"),
    ]
    assert told(tree(7, *changes)) == [
        "     tree     7   ✔ 0.say answer = 'yes', sure = [b]",
        "     tree     7   ✘ 3.say@timeout not done within 5 s",
        "     tree     7   ▶ 1.sequence",
        "     tree     7     ▶ 0.ask Where to?",
    ]


def test_run_start_is_shown_once_before_first_tick() -> None:
    first = tree(1, change("tree/0.say", RUNNING))
    again = ("run", msg.Run(event=msg.Run.STARTED, agent="a", epoch="e", round=3))
    assert told(first, STARTED, again) == [STARTS, "     tree     1   ▶ 0.say", STARTS]


def test_long_line_wraps_at_words_within_its_column() -> None:
    output, printer = printing(width=40, force_terminal=True)
    ended = {"agent": "a", "duration_s": 1.5, "ticks": 30, "message": "all is said"}
    printer.run(msg.Run(event=msg.Run.ENDED, outcome=msg.Run.SUCCEEDED, **ended))
    assert output.getvalue().splitlines() == [
        "      run  a succeeded after 1.5 s, 30",
        "           ticks: all is said",
    ]


def test_foreign_text_is_truncated_and_never_markup() -> None:
    assert told(("act", "x" * 20_000), ("act", "says: [red]hello[/red]")) == [
        f"    robot  {'x' * (event_printer.LONGEST_TEXT - 1)}…",
        "    robot  says: [red]hello[/red]",
    ]


def test_printed_lines_are_limited_during_event_flood() -> None:
    output, now_s = io.StringIO(), 0.0
    printer = EventPrinter(Console(file=output, width=500), SPACE, lambda: now_s)
    for _ in range(3 * event_printer.MOST_LINES):
        printer.act("hello")
        printer.visitor("Anna")
    lines = [line for line in output.getvalue().splitlines() if line]
    assert len(lines) == event_printer.MOST_LINES
    assert lines[0] == "    robot  hello"
    assert "Anna (others are left out for 5.0 s)" in lines[-1]
    now_s += event_printer.LINES_S
    printer.act("again")
    assert output.getvalue().endswith("    robot  again\n")


def test_run_counts_are_bounded() -> None:
    _, printer = printing()
    for number in range(event_printer.MOST_COUNTED + 1):
        agent = f"{number}" + "a" * (20_000 if number == event_printer.MOST_COUNTED else 1)
        printer.run(msg.Run(event=msg.Run.ENDED, outcome=msg.Run.SUCCEEDED, agent=agent))
    assert len(printer.runs) == event_printer.MOST_COUNTED
    assert max(len(agent) for agent, _ in printer.runs) == 180


def test_summary_shows_full_profiles_on_narrow_terminal() -> None:
    output, printer = printing(width=80)
    printer.profiles({"professional_express": [3.0, 5.0, 3.0], "attentive_guide": [4.0, 1.5, 3.0]})
    values = {"before": [4.0, 1.5, 3.0], "after": [4.12, 1.28, 3.0]}
    negative = {"agent": "attentive_guide", "kind": msg.Feedback.NEGATIVE}
    printer.feedback(msg.Feedback(**negative, **values))
    printer.summary()
    shown = output.getvalue()
    assert re.search(
        r"attentive_guide +– +negative +\[4, 1\.5, 3\] → \[4\.12, 1\.28, 3\]\n", shown
    )
    assert re.search(r"professional_express +– +– +\[3, 5, 3\]\n", shown)


def test_summary_names_only_profile_parameters() -> None:
    pain = SceneParameter(name="pain", minimum=0.0, maximum=10.0, default=0.0, profiled=False)
    space = SceneSpace(parameters=(pain, *SPACE.parameters), mood="mood")
    output, printer = printing(space=space)
    printer.profiles({"a": (3.0, 3.0, 3.0)})
    printer.summary()
    assert "profile (age, familiarity, mood)" in output.getvalue()


@pytest.mark.parametrize(
    ("name", "message", "filled"),
    [
        ('say "${words}"', "Good evening.", ['▶ say "Good evening."', '✔ say "Good evening."']),
        ('say "Dear ${name}, yo…"', "Dear Anna.", ['▶ say "Dear Anna."', '✔ say "Dear Anna."']),
        ("wait ${patience}", "8 s", ["▶ wait 8 s", "✔ wait 8 s"]),
        ("wait_for x == ${y}", "x is 1", ["▶ wait_for x == ${y} x is 1", "✔ wait_for x == ${y}"]),
        ("blink ${mode}", "turns left", ["▶ blink ${mode} turns left", "✔ blink ${mode}"]),
        ('say "Hello."', "", ['▶ say "Hello."', '✔ say "Hello."']),
        ("greeting", "Hello.", ["▶ greeting Hello.", "✔ greeting"]),
    ],
)
def test_node_name_shows_referenced_values(name: str, message: str, filled: list[str]) -> None:
    lines = told(
        tree(1, change("tree", RUNNING, message, name)),
        tree(2, change("tree", SUCCESS, "", name)),
        tree(3, change("tree", FAILURE, "it is broken", name)),
    )
    shown = [re.split(r"tree +[123] ", line)[1].strip() for line in lines if "tree" in line]
    assert shown == [*filled, f"✘ {name} it is broken"]
