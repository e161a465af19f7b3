# SPDX-License-Identifier: Apache-2.0
"""Events in the terminal, line by line."""

from __future__ import annotations

import io
import math
import re
from types import SimpleNamespace as Message
from typing import Any

import pytest
from rich.console import Console

from bt_agents_core.scene import SceneParameter, SceneSpace
from bt_agents_interfaces.msg import MarketStatus
from bt_agents_tools.cli.event_printer import (
    LINES_S,
    LONGEST_TEXT,
    MOST_COUNTED,
    MOST_LINES,
    EventPrinter,
)
from tree_harness import SPACE


def told(*events: tuple[str, Any]) -> list[str]:
    output = io.StringIO()
    story = EventPrinter(Console(file=output, width=100, color_system=None), SPACE)
    for name, argument in events:
        getattr(story, name)(argument)
    return [line.rstrip() for line in output.getvalue().splitlines() if line.strip()]


def scene(mood: float = 3.0, age: float = 1.0, person: bool = True, **more: Any) -> Message:
    values = {"age": age, "familiarity": math.nan, "mood": mood}
    known = {"scene_id": "s1", "label": "", "urgent": False}
    known["values"] = [Message(name=n, value=v) for n, v in values.items()]
    return Message(person=person, **(known | more))


def run_event(event: int, **more: Any) -> Message:
    events = {"STARTED": 1, "CANCELLING": 2, "ENDED": 3, "REFUSED": 4}
    outcomes = {"SUCCEEDED": 1, "FAILED": 2, "CANCELLED": 3, "LOST": 4}
    known = {"agent": "a", "epoch": "e", "round": 2, "scene": scene(), "stopped_by": 0}
    return Message(**events, **outcomes, event=event, **(known | more))


def auction(outcome: int, **more: Any) -> Message:
    outcomes = {"AWARDED": 1, "NO_BIDS": 2, "PREEMPTS": 3, "WAITS": 4}
    values = {"round": 2, "follows": 0, "winner": "a", "ranking": [], "refused": []}
    values["scene"] = scene()
    return Message(**outcomes, outcome=outcome, **(values | more))


def feedback(kind: int, **more: Any) -> Message:
    kinds = {"DIRECT": 0, "POSITIVE": 1, "NEGATIVE": 2, "SET": 3}
    known = {"agent": "a", "source": "mood rule", "reason": "", "layer": "", "revision": 3}
    return Message(**kinds, kind=kind, **(known | more))


def change(path: str, status: int, message: str = "", name: str = "", **values: str) -> Message:
    changed = [Message(name=key, value=value) for key, value in values.items()]
    return Message(
        path=path, name=name or path.rpartition("/")[2], status=status, message=message,
        values=changed,
        INVALID=0, RUNNING=1, SUCCESS=2, FAILURE=3,
    )  # fmt: skip


def tree(tick: int, *changes: Message) -> tuple[str, Message]:
    return "tree", Message(agent="a", epoch="e", round=2, tick=tick, changes=list(changes))


def test_scene_shows_value_labels_and_missing_values() -> None:
    assert told(("scene", scene())) == [
        "    scene  age 1 (a child), familiarity missing, mood 3 (neutral)"
    ]


def test_empty_scene_without_person_is_stated_in_words() -> None:
    nobody = scene(mood=math.nan, age=math.nan, person=False)
    assert told(("scene", nobody)) == ["    scene  no person, nothing else is known"]


def test_auction_shows_bids_refusals_and_reason() -> None:
    awarded = auction(
        outcome=1,
        reason="a 1.0 = |4−3|",
        ranking=[Message(agent="a", distance=1.0, calculation="1.0 = |4−3|")],
        refused=[Message(agent="b", reason="needs scene.person")],
    )
    assert told(("scene", scene()), ("auction", awarded))[1:] == [
        "    bid 2  a                      1.0 = |4−3|",
        "    bid 2  b                      –  needs scene.person",
        "    award  a wins  a 1.0 = |4−3|",
    ]


def test_challenge_says_whether_run_continues() -> None:
    words = "b 0.5 for the new scene, a who runs has 2.5: better by 2.0, margin 1.0"
    assert told(
        ("scene", scene()),
        ("auction", auction(outcome=3, reason=f"{words}: a is stopped")),
        ("auction", auction(outcome=4, reason=f"{words}: a goes on, the scene waits")),
    )[1:] == [
        f"challenge  the run is stopped  {words}: a is stopped",
        f"challenge  the run goes on  {words}: a goes on, the scene waits",
    ]


def test_scene_shows_label_and_urgency() -> None:
    assert told(("scene", scene(label="[Mrs] Smith", urgent=True))) == [
        "    scene  urgent [Mrs] Smith: age 1 (a child), familiarity missing, mood 3 (neutral)"
    ]


def test_unheard_scene_is_shown_with_its_auction() -> None:
    again = auction(outcome=1, reason="a 1.0", scene=scene(scene_id="s1+again"))
    assert told(("scene", scene()), ("auction", again)) == [
        "    scene  age 1 (a child), familiarity missing, mood 3 (neutral)",
        "    scene  age 1 (a child), familiarity missing, mood 3 (neutral)",
        "    award  a wins  a 1.0",
    ]


def test_waiting_scene_is_shown_as_waiting() -> None:
    assert told(
        ("market", MarketStatus()),
        ("market", MarketStatus(queued=1, agent="a", state=MarketStatus.RUNNING)),
        ("market", MarketStatus(queued=1, agent="a", state=MarketStatus.RUNNING)),
        ("market", MarketStatus(queued=2, state=MarketStatus.BIDDING)),
        ("market", MarketStatus()),
        ("market", MarketStatus(queued=1, message="waiting for hosts to register")),
    ) == [
        "    scene  waits in line: a has the robot",
        "    scene  waits in line as the last of 2: another is under way",
        "    scene  waits in line: waiting for hosts to register",
    ]


def test_awaited_hosts_are_named_on_change() -> None:
    waiting = MarketStatus(queued=2, awaited_hosts=["/agents"])
    assert told(
        ("market", waiting),
        ("market", waiting),
        ("market", MarketStatus(queued=3, awaited_hosts=["/agents", "/others"])),
        ("market", MarketStatus(queued=3, agent="a", state=MarketStatus.RUNNING)),
        ("market", waiting),
    ) == [
        "    scene  2 in line wait for /agents to be back",
        "    scene  3 in line wait for /agents and /others to be back",
        "    scene  2 in line wait for /agents to be back",
    ]


def cleaning() -> tuple[str, Message]:
    return tree(9, change("on_cancel", 1))


def test_run_stopped_by_host_is_shown() -> None:
    assert told(("run", run_event(1)), cleaning(), cleaning()) == [
        "      run  a starts",
        "      run  stopping a: its host hears no market",
        "     tree     9 ▶ on_cancel",
        "     tree     9 ▶ on_cancel",
    ]


def test_scenes_are_named_by_label_instead_of_id() -> None:
    stopped = run_event(2, message="preempted by scene 's2': b 0.5, s1 has 'none'")
    lost = Message(code="LOST", message="asked again as scene 's1+again'", scene_id="s1")
    assert told(
        ("scene", scene(label="Anna")), ("scene", scene(scene_id="s2", label="Ben")),
        ("run", stopped), ("end", lost),
    )[2:] == [
        "      run  stopping a: preempted by scene 'Ben': b 0.5, s1 has 'none'",
        "    scene  'Anna' lost: asked again as scene 'Anna'",
    ]  # fmt: skip


def test_unlabelled_scene_is_named_by_its_values() -> None:
    refused = Message(code="BUSY", message="scene 's1' is under way", scene_id="s2")
    assert told(("scene", scene()), ("end", refused))[1:] == [
        "    scene  's2' busy: scene 'age 1, mood 3' is under way"
    ]


def test_market_stop_is_not_attributed_to_host() -> None:
    stopped = run_event(2, message="she says stop")
    assert told(("run", run_event(1)), ("run", stopped), cleaning()) == [
        "      run  a starts",
        "      run  stopping a: she says stop",
        "     tree     9 ▶ on_cancel",
    ]


def tuned(revision: int, *reasons: str) -> tuple[str, Message]:
    tunings = [
        Message(
            revision=number,
            name="a.patience",
            before="8 s",
            after="12 s",
            author="root",
            reason=reason,
        )
        for number, reason in enumerate(reasons, start=1)
    ]
    return "tunings", Message(host="/agents", revision=revision, tunings=tunings)


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
    assert told(
        ("scene", scene(label="Anna")),
        ("end", Message(code="QUEUE_FULL", message="10 wait, at most 10 may", scene_id="s1")),
        ("end", Message(code="PREEMPTED", message="a cancelled: preempted by scene 's2'")),
        ("end", Message(code="SUCCEEDED", message="a succeeded: done")),
        ("end", Message(code="NO_BIDS", message="no agents are registered")),
    )[1:] == ["    scene  'Anna' queue full: 10 wait, at most 10 may"]


def test_run_end_shows_outcome_in_words() -> None:
    ended = run_event(3, outcome=4, duration_s=1.5, ticks=30, message="no heartbeat", orphans=[])
    assert told(("run", ended)) == ["      run  a lost after 1.5 s, 30 ticks: no heartbeat"]


def test_mood_is_shown_during_runs_on_change() -> None:
    assert told(
        ("live", scene(mood=1.0)),
        ("run", run_event(1)),
        ("live", scene(mood=3.1)),
        ("live", scene(mood=1.5)),
        ("live", scene(mood=1.5)),
        ("live", scene(mood=4.0)),
    ) == [
        "      run  a starts",
        "     mood  falls from 3 to 1.5",
        "     mood  rises from 1.5 to 4",
    ]


def test_tick_shows_ended_nodes_then_started_parents_first() -> None:
    changes = [
        change("tree/0.say", 2),
        change("tree/1.sequence/0.ask", 1, "Where to?"),
        change("tree/1.sequence", 1),
        change("tree/1.sequence@timeout", 1),
        change("tree/2.wait", 0),
    ]
    assert told(tree(7, *changes)) == [
        "     tree     7   ✔ 0.say",
        "     tree     7   ▶ 1.sequence",
        "     tree     7     ▶ 0.ask Where to?",
    ]


def test_changed_values_are_shown_with_their_node() -> None:
    assert told(tree(7, change("tree/0.ask", 2, answer="'yes'", sure="[b]"))) == [
        "     tree     7   ✔ 0.ask answer = 'yes', sure = [b]"
    ]


def test_run_start_is_shown_once_before_first_tick() -> None:
    first, again = tree(1, change("tree/0.say", 1)), run_event(1, round=3)
    assert told(first, ("run", run_event(1)), ("run", again)) == [
        "      run  a starts",
        "     tree     1   ▶ 0.say",
        "      run  a starts",
    ]


def test_modifier_is_shown_when_it_causes_failure() -> None:
    assert told(tree(7, change("tree/0.say@timeout", 3, "not done within 5 s"))) == [
        "     tree     7   ✘ 0.say@timeout not done within 5 s"
    ]


def test_feedback_shows_the_profile_before_and_after() -> None:
    negative = feedback(
        2, reason="mood.change <= -1 held 1 s", before=[4.0, 1.5, 3.0], after=[4.1, 1.4, 3.0]
    )
    assert told(("feedback", negative)) == [
        " feedback  negative for a by mood rule: mood.change <= -1 held 1 s",
        "  profile  a [4, 1.5, 3] → [4.1, 1.4, 3] (revision 3)",
    ]


def test_tuned_profile_names_its_author() -> None:
    tuned = feedback(3, source="tuning", reason="tuned by root", before=[4.0], after=[5.0])
    assert told(("feedback", tuned)) == [
        " feedback  set for a by tuning: tuned by root",
        "  profile  a [4] → [5] (revision 3)",
    ]


def test_long_line_wraps_at_words_within_its_column() -> None:
    output = io.StringIO()
    terminal = Console(file=output, width=40, color_system=None, force_terminal=True)
    ended = run_event(3, outcome=1, duration_s=1.5, ticks=30, message="all is said", orphans=[])
    EventPrinter(terminal, SPACE).run(ended)
    assert output.getvalue().splitlines() == [
        "      run  a succeeded after 1.5 s, 30",
        "           ticks: all is said",
    ]


def test_long_foreign_text_is_truncated() -> None:
    (line,) = told(("act", "x" * 20_000))
    assert line == f"    robot  {'x' * (LONGEST_TEXT - 1)}…"


def test_printed_lines_are_limited_during_event_flood() -> None:
    output, now_s = io.StringIO(), 0.0
    printer = EventPrinter(Console(file=output, width=500), SPACE, lambda: now_s)
    for _ in range(3 * MOST_LINES):
        printer.act("hello")
        printer.visitor("Anna")
    lines = [line for line in output.getvalue().splitlines() if line]
    assert len(lines) == MOST_LINES
    assert lines[0] == "    robot  hello"
    assert "Anna (others are left out for 5.0 s)" in lines[-1]
    now_s += LINES_S
    printer.act("again")
    assert output.getvalue().endswith("    robot  again\n")


def test_run_counts_are_bounded() -> None:
    printer = EventPrinter(Console(file=io.StringIO()), SPACE)
    for number in range(MOST_COUNTED + 1):
        agent = f"{number}" + "a" * (20_000 if number == MOST_COUNTED else 1)
        known = {"outcome": 1, "duration_s": 1.5, "ticks": 3, "message": "", "orphans": []}
        printer.run(run_event(3, agent=agent, **known))
    assert len(printer.runs) == MOST_COUNTED
    assert max(len(agent) for agent, _ in printer.runs) == 180


def test_user_text_is_never_parsed_as_markup() -> None:
    assert told(("act", "says: [red]hello[/red]")) == ["    robot  says: [red]hello[/red]"]


def test_summary_shows_full_profiles_on_narrow_terminal() -> None:
    output = io.StringIO()
    story = EventPrinter(Console(file=output, width=80, color_system=None), SPACE)
    story.profiles({"professional_express": [3.0, 5.0, 3.0], "attentive_guide": [4.0, 1.5, 3.0]})
    values = {"before": [4.0, 1.5, 3.0], "after": [4.12, 1.28, 3.0]}
    story.feedback(feedback(2, agent="attentive_guide", **values))
    story.summary()
    shown = output.getvalue()
    assert re.search(
        r"attentive_guide +– +negative +\[4, 1\.5, 3\] → \[4\.12, 1\.28, 3\]\n", shown
    )
    assert re.search(r"professional_express +– +– +\[3, 5, 3\]\n", shown)


def test_stop_names_its_requester() -> None:
    stopped = run_event(2, stopped_by=2, message="mood.change <= -1 held 2 s")
    assert told(("run", stopped)) == [
        "      run  stopping a (mood rule): mood.change <= -1 held 2 s"
    ]


def test_summary_names_only_profile_parameters() -> None:
    pain = SceneParameter(name="pain", minimum=0.0, maximum=10.0, default=0.0, profiled=False)
    output = io.StringIO()
    space = SceneSpace(parameters=(pain, *SPACE.parameters), mood="mood")
    printer = EventPrinter(Console(file=output, width=100, color_system=None), space)
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
def test_node_name_shows_values_of_its_references(
    name: str, message: str, filled: list[str]
) -> None:
    lines = told(
        tree(1, change("tree", 1, message, name)),
        tree(2, change("tree", 2, "", name)),
        tree(3, change("tree", 3, "it is broken", name)),
    )
    shown = [re.split(r"tree +[123] ", line)[1].strip() for line in lines if "tree" in line]
    assert shown == [*filled, f"✘ {name} it is broken"]
