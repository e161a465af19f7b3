# SPDX-License-Identifier: Apache-2.0
"""Rehearsals of trees on a virtual clock: their events and outcomes."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from bt_agents.engine.run import TreeOutcome
from bt_agents_core.errors import ReadError
from bt_agents_language.files.testing.scenarios import ScriptedEvent
from bt_agents_language.model.specs import NodeSpec
from bt_agents_robot.acts import Ask
from bt_agents_tools.rehearsal.events import EventKind, Rehearsed
from bt_agents_tools.rehearsal.rehearsal import Limits, rehearse
from bt_agents_tools.rehearsal.transcript import transcript
from file_texts import read_agent_text, read_scene_text, read_skills_text
from rehearsal_harness import documented_tree, events_of, rehearsed, scenario, spoken_texts
from tree_harness import SPACE, SYMBOLS, agent

RULES = """
feedback:
  - {when: mood.change >= 0.5, for: 2 s, give: positive}
  - {when: mood.change <= -1.0, for: 2 s, give: negative, then: cancel}
"""
ECHO = """
sequence:
  - ask: {text: Which?, choices: %s}
  - say: ${answer}
"""


def test_answers_are_used_in_order_and_last_repeats() -> None:
    result = rehearsed(f"{ECHO % '[]'}repeat: 3", "answers: {ask: [one, two]}")
    assert spoken_texts(result)[1::2] == ["one", "two", "two"]


def test_path_answer_overrides_skill_answer() -> None:
    tree = "sequence: [ask: First?, say: '${answer}', ask: Second?, say: '${answer}']"
    result = rehearsed(tree, "answers: {ask: by skill, tree/2.ask: by path}")
    assert spoken_texts(result)[1::2] == ["by skill", "by path"]


def test_text_outside_choices_is_not_an_answer() -> None:
    result = rehearsed("ask: {text: Which?, choices: [bag], wait: 4 s}", "answers: {ask: cat}")
    assert result.outcome is TreeOutcome.FAILED
    assert "'cat' is none of the choices" in result.message
    assert result.duration_s == pytest.approx(0.4 + 6 * 0.06 + 4.0)


@pytest.mark.parametrize(
    ("choices", "typed", "later"), [(["Yes", "no"], " yES ", "Yes"), ([], " Both ", "Both")]
)
def test_later_nodes_get_answer_in_robot_form(choices: list[str], typed: str, later: str) -> None:
    act = Ask("Which?", choices, 9.0, pace=1.0, voice=None)
    act.begin(0.0)
    assert act.receive(typed)
    result = rehearsed(ECHO % choices, f"answers: {{ask: '{typed}'}}")
    assert [act.answer, spoken_texts(result)[1]] == [later, later]


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("drive: {fails: the way is blocked}", "aborted: the way is blocked"),
        ("drive: {ends: rejected}", "rejected"),
        ("drive: {ends: unreachable}", "unreachable"),
        ("ask: {outputs: {answer: ''}}", "result.answer != ''"),
    ],
)
def test_a_skill_can_fail_in_every_way(answer: str, words: str) -> None:
    result = rehearsed(f"{answer.partition(':')[0]}: gate 7", f"answers: {{{answer}}}")
    assert result.outcome is TreeOutcome.FAILED
    assert words in result.message
    assert "(tree, a.yaml:" in result.message


def prompted(tree: str, *events: ScriptedEvent | None) -> tuple[Rehearsed, list[str]]:
    """Rehearse a tree with a user who supplies some events; return also the prompts."""
    spec, typed = agent(tree), iter(events)
    asked: list[str] = []

    def prompt(reason: str, waits: Sequence[NodeSpec]) -> ScriptedEvent | None:
        asked.append(reason)
        return next(typed)

    return rehearse(spec, SPACE, scenario(spec), prompt=prompt), asked


def test_interactive_user_is_prompted_once_per_limited_wait() -> None:
    result, asked = prompted("wait_for: live.mood > 4\ntimeout: 20 s\nsucceed: true", None)
    assert asked == ["it waits: wait_for live.mood > 4, 19.9 s at most"]
    assert result.duration_s == 20.0


def test_wait_prompts_again_until_tree_proceeds() -> None:
    moods = (ScriptedEvent(after_s=3.0, values={"mood": mood}) for mood in (2.0, 5.0))
    result, asked = prompted("wait_for: live.mood > 4", *moods)
    assert (result.outcome, len(asked)) == (TreeOutcome.SUCCEEDED, 2)
    assert "it waits for ever: nothing more will happen (tree, a.yaml:" in asked[0]
    assert result.duration_s == pytest.approx(6.2, abs=0.21)


def test_endless_tree_is_ended() -> None:
    spec = agent("light: green\nrepeat: forever")
    result = rehearse(spec, SPACE, scenario(spec), limits=Limits(duration_s=60.0))
    assert result.outcome is None
    assert "still runs after 1:00.1" in result.message


def test_one_hour_of_speech_ticks_only_on_events() -> None:
    result = rehearsed(
        """
        repeat: 360
        sequence:
          - say: Drink something, please.
          - wait_for: {condition: live.mood > 4.5}
            timeout: 5 s
            on_failure: {wait: 3.16 s}
        """,
        head=RULES,
    )
    assert result.duration_s == pytest.approx(3600.0, rel=0.02)
    assert len(spoken_texts(result)) == 360
    assert result.ticks < 12 * 360


def test_long_mood_condition_is_watched_without_ticking() -> None:
    rules = "feedback:\n  - {when: mood.change <= -1.0, for: 10 min, give: negative}\n"
    result = rehearsed("wait: 1 h", "during: [{after: 1 min, mood: 1}]", head=rules)
    assert events_of(result, EventKind.FEEDBACK)[0][0] == pytest.approx(660.0)
    assert result.ticks < 12


def test_mood_is_unknown_after_person_leaves() -> None:
    result = rehearsed("wait: 20 s", "during: [{after: 1 s, mood: 1, person: false}]", head=RULES)
    assert result.feedback == ()


def test_scripted_event_can_wait_for_node() -> None:
    wait = "wait_for: {topic: button, type: std_msgs/msg/Bool, until: msg.data}"
    press = "publish: {topic: button, message: {data: true}}"
    result = rehearsed(
        f"sequence: [say: A text whose length nobody wants to count., {wait}]",
        f"during: [{{at: tree/1.wait_for, after: 2 s, {press}}}]",
    )
    assert result.outcome is TreeOutcome.SUCCEEDED
    [(said_s, _), *_] = events_of(result, EventKind.WAITS)
    assert result.duration_s == pytest.approx(said_s + 2.0)


def test_tunables_can_be_set_initially_and_during_rehearsal() -> None:
    head = "tunables: {pause: {default: 10 s, min: 1 s, max: 60 s, description: d}}"
    assert rehearsed("wait: ${pause}", "tunables: {pause: 5 s}", head=head).duration_s == 5.0
    result = rehearsed("wait: ${pause}", "during: [{after: 2 s, tune: {pause: 30 s}}]", head=head)
    assert result.duration_s == 30.0
    assert events_of(result, EventKind.TUNES) == [(2.0, "pause 30 s")]


DEFAULTS = """
format: 1
parameters:
  age: {min: 1, max: 5, default: 3, missing: default}
  familiarity: {min: 1, max: 5, default: 2}
  mood: {min: 1, max: 5, default: 3}
mood: mood
no_person: {age: 1}
"""
WITH_DEFAULTS = read_scene_text(DEFAULTS, "scene.yaml").space


def test_unknown_values_match_scene_layer() -> None:
    spec = agent("sequence: [check: scene.age == 3, check: scene.familiarity > 0]")
    result = rehearse(spec, WITH_DEFAULTS, scenario(spec, "scene: {mood: 4}"))
    assert "'scene.familiarity' has no value" in result.message


def test_absent_person_uses_no_person_values_until_arrival() -> None:
    spec = agent(
        "sequence: [check: scene.age == 1 and live.age == 1, wait: 2 s, check: live.age == 3]"
    )
    events = "during: [{after: 1 s, person: true}, {after: 1.5 s, person: false}]"
    visit = scenario(spec, f"scene: {{person: false}}\n{events}")
    result = rehearse(spec, WITH_DEFAULTS, visit)
    assert result.outcome is TreeOutcome.SUCCEEDED, result.message


def test_replaced_nodes_are_not_rehearsed() -> None:
    way = "{name: way, timeout: 5 s, sequence: [drive: gate 7, drive: gate 8]}"
    tree = f"sequence: [{way}, say: Here we are.]"
    result = rehearsed(tree, 'replace: {"tree/*.way*": succeed}')
    assert (result.outcome, spoken_texts(result)) == (TreeOutcome.SUCCEEDED, ["Here we are."])
    assert [use.skill for use in result.uses] == ["say"]
    assert not any("way" in path for path in result.marks)
    assert rehearsed(tree, 'replace: {"**.way": fail}').outcome is TreeOutcome.FAILED


def test_the_same_seed_gives_the_same_picks() -> None:
    tree = "repeat: 20\nrandom: [say: one, say: two, say: three]"
    first, same, other = (spoken_texts(rehearsed(tree, f"seed: {seed}")) for seed in (7, 7, 8))
    assert first == same
    assert first != other


@pytest.mark.parametrize(("after", "shown_s"), [("5 s", 5.0), ("3 min", 120.0)])
def test_documented_text_is_shown_until_button_press(after: str, shown_s: float) -> None:
    tree = documented_tree("language.md", "when you have it")
    press = "publish: {topic: buttons/confirm, message: {data: true}}"
    result = rehearsed(tree, f"during: [{{after: {after}, {press}}}]")
    assert events_of(result, EventKind.STOPS, EventKind.SUCCEEDS)[0] == (shown_s, "show")
    assert result.outcome is TreeOutcome.SUCCEEDED


@pytest.mark.parametrize(
    ("answer", "does"), [("no", ["ask", "say"]), ("yes", ["ask", "say", "drive", "say"])]
)
def test_documented_tree_ends_early(answer: str, does: list[str]) -> None:
    tree = documented_tree("language.md", "Then I wish you a good flight")
    result = rehearsed(tree, f"answers: {{ask: {answer}}}")
    assert result.outcome is TreeOutcome.SUCCEEDED
    assert [use.skill for use in result.uses] == does


GREETS = """
repeat: 4
sequence:
  - random: [{say: hi, weight: 0}, {say: hello}, {say: hey, timeout: 9 s}]
  - random: {seed: 1, children: [say: one, say: two]}
"""


@pytest.mark.parametrize(
    ("picks", "said"),
    [
        ("'**/0.random/0.say'", ["hi"] * 4),
        ("['**/0.random/2.say', '**/0.random/1.say']", ["hey", "hello", "hello", "hello"]),
        ("['**/0.random/1.say', '**/0.random/2.*']", ["hello", "hey", "hey", "hey"]),
    ],
)
def test_test_case_picks_child_of_random(picks: str, said: list[str]) -> None:
    assert spoken_texts(rehearsed(GREETS, f"picks: {picks}"))[::2] == said


def test_picks_affect_only_their_own_random() -> None:
    drawn = spoken_texts(rehearsed(GREETS))
    assert spoken_texts(rehearsed(GREETS, "picks: '**/0.random/0.say'"))[1::2] == drawn[1::2]
    both = "picks: ['**/1.random/1.say', '**/0.random/0.say', '**/1.random/0.say']"
    assert spoken_texts(rehearsed(GREETS, both))[:4] == ["hi", "two", "hi", "one"]


def test_non_bidding_agent_runs_only_when_forced() -> None:
    spec = agent("say: Hello.", "requires: scene.person")
    nobody = scenario(spec, "person: false")
    assert rehearse(spec, SPACE, nobody).declined == "needs scene.person"
    assert rehearse(spec, SPACE, nobody).uses == ()
    assert spoken_texts(rehearse(spec, SPACE, nobody, force=True)) == ["Hello."]


def test_memoryless_sequence_repeats_children_while_waiting() -> None:
    result = rehearsed("sequence: {memory: false, children: [sound: beep, wait: 1 s]}")
    assert len(result.uses) == 11


def test_skill_without_robot_support_can_be_rehearsed() -> None:
    fields = "{main: style, inputs: {style: text}, outputs: {applause: {type: number}}}"
    dance = read_skills_text(f"format: 1\nskills: {{dance: {fields}}}", "s.yaml")
    head = "format: 1\nagent: dancer\nprofile: {age: 3, familiarity: 3, mood: 3}\n"
    tree = "sequence: [{dance: tango, outputs: {loud: applause}}, say: 'Thank you for ${loud}.']"
    spec = read_agent_text(f"{head}tree: {{{tree}}}", "a.yaml", SYMBOLS.with_skills(dance))
    result = rehearse(spec, SPACE, scenario(spec, "answers: {dance: 0.7}"))
    assert spoken_texts(result) == ["Thank you for 0.7."]


def test_replacement_nodes_can_set_the_same_outputs() -> None:
    tree = """
        sequence:
          - ask: Where to?
          - {drive: "${answer}", timeout: 9 s}
          - say: Here we are, at ${answer}.
    """
    replace = """
        replace:
          "**.ask": {set: {answer: home}}
          "**.drive*": {sequence: [{wait: "${patience}"}, say: I would drive.]}
    """
    head = "tunables: {patience: {default: 3 s, min: 1 s, max: 9 s, description: d}}"
    result = rehearsed(tree, replace, head=head)
    assert result.outcome is TreeOutcome.SUCCEEDED
    assert spoken_texts(result) == ["I would drive.", "Here we are, at home."]
    assert result.duration_s > 3.0
    assert not {path for path in result.marks if "drive" in path and path.count("/") == 1}


def test_tick_is_reported_from_root_down() -> None:
    result = rehearsed("sequence: [{selector: [{say: Hello.}]}, {wait: 1 s}]")
    changes = [one.change for one in result.events if one.change is not None and one.at_s == 0.0]
    paths = [change.path for change in changes]
    assert paths == ["tree", "tree/0.selector", "tree/0.selector/0.say"]


def test_clock_advances_from_rehearsal_start_time() -> None:
    night = "{when: clock.hour < 6, say: Good night.}"
    tree = f"sequence: [wait_for: clock.weekday == 'monday', {night}]"
    late = rehearsed(tree, "clock: {hour: 22, weekday: sunday}")
    assert spoken_texts(late) == ["Good night."]
    assert events_of(late, EventKind.BEGINS) == [(7200.0, "say")]
    assert spoken_texts(rehearsed(night)) == []


def test_variants_are_used_in_order_and_last_repeats() -> None:
    tree = "{say: {one_of: [Hello., Hi., Good day.]}, repeat: 4}"
    result = rehearsed(tree, "variants: {tree: [3, 1]}")
    assert spoken_texts(result) == ["Good day.", "Hello.", "Hello.", "Hello."]
    assert spoken_texts(rehearsed(tree, "variants: {'**': 2}")) == ["Hi."] * 4


@pytest.mark.parametrize(
    ("variants", "problem"),
    [
        ("{tree: 3}", "[out-of-range]: the text of 'tree' is 3, expected 1 to 2"),
        ("{tree: first}", "[bad-number]"),
        ("{tree: []}", "[missing-value]: 'tree' has no number"),
        ("{tree/7.say: 1}", "[unknown-path]"),
    ],
)
def test_nonexistent_text_variant_cannot_be_picked(variants: str, problem: str) -> None:
    with pytest.raises(ReadError) as error:
        rehearsed("say: {one_of: [Hello., Hi.]}", f"variants: {variants}")
    assert problem in error.value.lines[0]


# --- branches that are not taken ------------------------------------------------------------

NOT_TAKEN = """
selector:
  - sequence:
      - check: scene.age > 4
      - say: You are old.
  - when: scene.mood > 4
    say: You are glad.
  - choose:
      - name: sad
        when: scene.mood < 2
        say: You are sad.
  - say: You are here.
"""


def test_reason_for_skipped_branch_is_reported_once() -> None:
    told = transcript(rehearsed(NOT_TAKEN).events)
    assert told.count("↷") == 3
    assert "↷ check: not so: scene.age > 4 (scene.age is 3" in told
    assert "↷ say: left out: not so: scene.mood > 4" in told
    assert "choose: no case fits" in told
    assert told.index("↷ check") < told.index("You are here.")


def test_final_failure_is_reported_only_at_run_end() -> None:
    told = transcript(rehearsed("check: scene.age > 4").events)
    assert "↷" not in told
    assert told.count("not so: scene.age > 4") == 1


def test_closed_branch_is_reported_once() -> None:
    children = "[sequence: [check: live.mood > 4, say: You are glad.], wait: 5 s]"
    tree = f"selector: {{memory: false, children: {children}}}"
    told = rehearsed(tree, "during:\n  - {after: 1 s, mood: 2}\n  - {after: 2 s, mood: 3.5}\n")
    assert transcript(told.events).count("↷") == 1
