# SPDX-License-Identifier: Apache-2.0
"""What the terminal shows of an event, line by line."""

from __future__ import annotations

import io
import math
import re
from types import SimpleNamespace as Message
from typing import Any

from rich.console import Console

from bt_agents.cli.story import Story
from stage import SPACE

KINDS = {"DIRECT": 0, "POSITIVE": 1, "NEGATIVE": 2, "SET": 3}


def told(*events: tuple[str, Any]) -> list[str]:
    output = io.StringIO()
    story = Story(Console(file=output, width=100, color_system=None), SPACE)
    for name, argument in events:
        getattr(story, name)(argument)
    return [line.rstrip() for line in output.getvalue().splitlines() if line.strip()]


def scene(mood: float = 3.0, age: float = 1.0, person: bool = True) -> Message:
    values = {"age": age, "familiarity": math.nan, "mood": mood}
    return Message(person=person, values=[Message(name=n, value=v) for n, v in values.items()])


def run_event(event: int, **more: Any) -> Message:
    events = {"STARTED": 1, "CANCELLING": 2, "ENDED": 3, "REFUSED": 4}
    outcomes = {"SUCCEEDED": 1, "FAILED": 2, "CANCELLED": 3, "LOST": 4}
    return Message(**events, **outcomes, event=event, agent="a", scene=scene(), **more)


def auction(outcome: int, **more: Any) -> Message:
    outcomes = {"AWARDED": 1, "NO_BIDS": 2, "PREEMPTS": 3, "WAITS": 4}
    values = {"round": 2, "follows": 0, "winner": "a", "ranking": [], "refused": []}
    return Message(**outcomes, outcome=outcome, **(values | more))


def change(path: str, status: int, message: str = "") -> Message:
    return Message(
        path=path, name=path.rpartition("/")[2], status=status, message=message,
        INVALID=0, RUNNING=1, SUCCESS=2, FAILURE=3,
    )  # fmt: skip


def test_a_scene_says_the_words_of_its_values_and_what_is_missing() -> None:
    assert told(("scene", scene())) == [
        "    scene  age 1 (a child), familiarity missing, mood 3 (neutral)"
    ]


def test_nothing_known_and_nobody_there_is_said_in_words() -> None:
    nobody = scene(mood=math.nan, age=math.nan, person=False)
    assert told(("scene", nobody)) == ["    scene  no person, nothing else is known"]


def test_an_auction_shows_each_bid_each_refusal_and_the_reason() -> None:
    awarded = auction(
        outcome=1,
        reason="a 1.0 = |4−3|",
        ranking=[Message(agent="a", distance=1.0, calculation="1.0 = |4−3|")],
        refused=[Message(agent="b", reason="needs scene.person")],
    )
    assert told(("auction", awarded)) == [
        "    bid 2  a                       1.00 = |4−3|",
        "    bid 2  b                        –   needs scene.person",
        "    award  a wins  a 1.0 = |4−3|",
    ]


def test_a_challenge_says_whether_the_run_goes_on() -> None:
    words = "b 0.5 for the new scene, a who runs has 2.5: better by 2.0, margin 1.0"
    assert told(
        ("auction", auction(outcome=3, reason=f"{words}: a is stopped")),
        ("auction", auction(outcome=4, reason=f"{words}: a goes on, the scene waits")),
    ) == [
        f"challenge  the run is stopped  {words}: a is stopped",
        f"challenge  the run goes on  {words}: a goes on, the scene waits",
    ]


def test_the_end_of_a_scene_is_told_when_no_run_has_told_it() -> None:
    assert told(
        ("end", Message(code="QUEUE_FULL", message="10 wait, at most 10 may")),
        ("end", Message(code="PREEMPTED", message="a cancelled: preempted by scene 's2'")),
        ("end", Message(code="SUCCEEDED", message="a succeeded: done")),
        ("end", Message(code="NO_BIDS", message="no agents are registered")),
    ) == [
        "    scene  queue full: 10 wait, at most 10 may",
    ]


def test_a_run_ends_with_its_outcome_in_words() -> None:
    ended = run_event(3, outcome=4, duration_s=1.5, ticks=30, message="no heartbeat", orphans=[])
    assert told(("run", ended)) == ["      run  a lost after 1.5 s, 30 ticks: no heartbeat"]


def test_mood_is_told_only_during_a_run_and_only_when_it_has_changed() -> None:
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


def test_a_tick_shows_first_what_ended_then_what_began_parents_first() -> None:
    changes = [
        change("tree/0.say", 2),
        change("tree/1.sequence/0.ask", 1, "Where to?"),
        change("tree/1.sequence", 1),
        change("tree/1.sequence@timeout", 1),
        change("tree/2.wait", 0),
    ]
    assert told(("tree", Message(tick=7, changes=changes))) == [
        "     tree     7   ✔ 0.say",
        "     tree     7   ▶ 1.sequence",
        "     tree     7     ▶ 0.ask Where to?",
    ]


def test_a_modifier_is_shown_when_it_made_something_fail() -> None:
    changes = [change("tree/0.say@timeout", 3, "not done within 5 s")]
    assert told(("tree", Message(tick=7, changes=changes))) == [
        "     tree     7   ✘ 0.say@timeout not done within 5 s"
    ]


def test_feedback_shows_the_profile_before_and_after() -> None:
    feedback = Message(
        **KINDS,
        agent="a",
        kind=2,
        source="mood rule",
        reason="mood.change <= -1 held 1 s",
        before=[4.0, 1.5, 3.0],
        after=[4.1, 1.4, 3.0],
        revision=3,
    )
    assert told(("feedback", feedback)) == [
        " feedback  negative for a by mood rule: mood.change <= -1 held 1 s",
        "  profile  a [4, 1.5, 3] → [4.1, 1.4, 3] (revision 3)",
    ]


def test_what_a_person_wrote_is_never_taken_for_markup() -> None:
    assert told(("act", "says: [red]hello[/red]")) == ["    robot  says: [red]hello[/red]"]


def test_the_summary_shows_every_profile_whole_on_a_narrow_terminal() -> None:
    output = io.StringIO()
    story = Story(Console(file=output, width=80, color_system=None), SPACE)
    story.profiles({"professional_express": [3.0, 5.0, 3.0], "attentive_guide": [4.0, 1.5, 3.0]})
    story.feedback(
        Message(
            **KINDS,
            agent="attentive_guide",
            kind=2,
            source="mood rule",
            reason="",
            before=[4.0, 1.5, 3.0],
            after=[4.12, 1.28, 3.0],
            revision=1,
        )
    )
    story.summary()
    shown = output.getvalue()
    assert re.search(
        r"attentive_guide +– +negative +\[4, 1\.5, 3\] → \[4\.12, 1\.28, 3\]\n", shown
    )
    assert re.search(r"professional_express +– +– +\[3, 5, 3\]\n", shown)
