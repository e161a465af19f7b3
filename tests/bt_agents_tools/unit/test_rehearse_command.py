# SPDX-License-Identifier: Apache-2.0
"""`bt-agents rehearse`: its arguments and its output."""

from __future__ import annotations

import os
import shlex
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.main import bt_agents
from bt_agents_tools.cli.scenario_options import event_yaml
from command_results import split_runner
from tree_harness import TREES, agent

GUIDE = "trees/agents/attentive_guide"


@pytest.fixture(autouse=True)
def _in_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(TREES.parent)


def rehearse(*words: str, typed: str | None = None) -> Result:
    return split_runner().invoke(bt_agents, ["rehearse", *words], input=typed)


def test_agent_may_be_file_and_follow_scene_values() -> None:
    scene = ("--scene", "age=4", "mood=3")
    assert rehearse(*scene, f"{GUIDE}.yaml").stdout == rehearse("attentive_guide", *scene).stdout


def test_case_with_another_outcome_is_judged() -> None:
    result = rehearse(f"{GUIDE}.test.yaml:annoyed", "--at", "1s cancel")
    assert result.exit_code == 1
    assert "✘ trees/agents/attentive_guide.test.yaml:" in result.output


def test_output_fits_80_columns_without_colour() -> None:
    output = rehearse("attentive_guide", "--answer", "drive={fails: the way is blocked}").output
    assert all(len(line) <= 80 for line in output.splitlines()[3:])
    assert "\x1b" not in output


@pytest.mark.parametrize(
    "answers", [["ask={fails: silence}", "ask=bad"], ["ask=[{fails: silence}]", "ask=[bad, good]"]]
)
def test_repeated_answer_options_are_used_in_order(answers: list[str]) -> None:
    options = [word for answer in answers for word in ("--answer", answer)]
    output = rehearse("evening_round", *options).output
    assert "Pardon? How was your day?" in output, output
    assert "I am sorry to hear that." in output, output


def test_invalid_repeated_answer_is_shown_as_typed() -> None:
    wrong = 'ask={fial: "silence"}'
    output = str(rehearse("evening_round", "--answer", "ask=bad", "--answer", wrong).exception)
    assert f'--answer "{wrong}"' in output
    assert "--answer ask=bad" not in output


@pytest.mark.parametrize(("place", "said"), [(0, "Tomorrow is another day."), (1, "Micro chips")])
def test_option_picks_child_of_random(place: int, said: str) -> None:
    result = rehearse("evening_round", "--answer", "ask=bad", "--pick", f"**.random/{place}.*")
    assert said in result.output


def test_options_cover_whole_scenario() -> None:
    scene = "--scene mood=2 --clock hour=22 --clock weekday=sunday --tune patience=20s --seed 3"
    events = "--at '1s mood=3.5' --at '3s buttons/confirm data=true' --at '3.5 s reading_time=4s'"
    ends = "--answer 'drive={after: 1 min}' --at '20s cancel it is in the way'"
    result = rehearse("silent_text", *shlex.split(f"{scene} {events} {ends}"))
    for line in (
        "sunday at 22 h",
        "patience 20 s",
        "1.0 s  ◆ mood 3.5",
        "2.0 s  ★ feedback positive: mood.change >= 0.5 held 1 s: mood 2 → 3.5",
        "3.0 s  ◆ message on buttons/confirm: data true",
        "3.5 s  ◆ tuned: reading_time 4 s",
        "20.0 s  ■ cancelled: it is in the way",
        "20.0 s  ● cancelled: it is in the way",
    ):
        assert line in result.output, result.output


def test_ticks_show_every_node() -> None:
    assert "· ▷ ask" in rehearse("attentive_guide", "--ticks").output


def test_answers_can_be_typed_interactively() -> None:
    result = rehearse("professional_express", "-i", typed="gate 9\nfail the lift is out\n")
    assert result.exit_code == 1
    lines = result.output.splitlines()
    at = next(i for i, line in enumerate(lines) if '▶ ask "Where to?"' in line)
    assert lines[at + 3] == "          ? answer [yes] > gate 9"
    assert lines[at + 4].endswith("✔ answer: gate 9")
    assert "drive gate 9 – aborted: the lift is out" in result.output


def test_invalid_typed_answer_is_requested_again() -> None:
    result = rehearse("professional_express", "-i", typed="gate 9\nperhaps\n\n")
    assert "it gives nothing back that could be 'perhaps'" in result.output
    assert "● succeeded" in result.output


def test_interactive_user_can_supply_event_when_idle() -> None:
    options = ("--tune", "patience=60s", "--answer", "show={ends: never}", "-i")
    result = rehearse("silent_text", *options, typed="nonsense=1\ncancel enough\n")
    assert "what happens?" in result.output
    assert "[unknown-key]" in result.output
    assert "● cancelled: enough" in result.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("attentive_gide",), "there is no agent 'attentive_gide'"),
        (("trees/agents/nobody.yaml",), "there is no file"),
        (("attentive_guide", "--scene", "age"), "write --scene age=4"),
        (("attentive_guide", "--at", "2s"), "does not say what happens"),
        (("attentive_guide", "--at", "5m mood=2"), "'5m' in '5m mood=2' is not a time; write a"),
        (("attentive_guide", "--at", "3 sec cancel"), "such as '3 s'"),
        (("attentive_guide", "--at", "cancle"), "did you mean 'cancel'?"),
        (("silent_text", "--at", "x"), "possible here: cancel, buttons/confirm"),
        (("silent_text", "--at", "2s buttons/confirm data=ja"), "'data' is 'ja', expected true"),
        (("silent_text", "--at", "2s buttons/confirm dta=true"), "no field 'dta'"),
        (("attentive_guide", "--answer", "ask={broken"), "an option cannot be understood"),
        ((f"{GUIDE}.test.yaml:xyz",), "no case has 'xyz'"),
    ],
)
def test_invalid_arguments_are_named(words: tuple[str, ...], message: str) -> None:
    result = rehearse(*words)
    assert isinstance(result.exception, BtAgentsError)
    assert message in str(result.exception)


def test_agent_outside_trees_folder_is_refused_with_hint(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("format: 1")
    assert "is in no trees folder" in str(rehearse(os.fspath(tmp_path / "a.yaml")).exception)


@pytest.mark.parametrize(
    ("typed", "text"),
    [
        ("2 s mood=1.5 person=false", "{after: 2 s, mood: 1.5, person: false}"),
        ("mood=1", "{after: 0 s, mood: 1}"),
        ("1min patience=3s", "{after: 1min, tune: {patience: 3s}}"),
        ("4s bell", "{after: 4s, publish: {topic: bell, message: {}}}"),
        (
            "4s bell data='a, b' n=1",
            '{after: 4s, publish: {topic: bell, message: {data: "a, b", n: 1}}}',
        ),
        ("5s cancel", '{after: 5s, cancel: "cancelled by hand"}'),
        ("5s cancel by='mood rule' go", '{after: 5s, cancel: {by: mood rule, reason: "go"}}'),
        ("5s cancel by=host", '{after: 5s, cancel: {by: host, reason: "cancelled by hand"}}'),
    ],
)
def test_typed_event_uses_test_file_syntax(typed: str, text: str) -> None:
    head = "tunables: {patience: {default: 8 s, min: 2 s, max: 30 s, description: d}}"
    assert event_yaml(agent("wait: ${patience}", head), typed) == text


def test_invalid_option_is_shown_as_typed() -> None:
    shown = str(rehearse("attentive_guide", "--at", "3s mod=1", "--scene", "mood=x").exception)
    assert (
        "\n      --at \"3s mod=1\"\n               ^^^\n      hint: did you mean 'mood'?" in shown
    )
    assert "\n      --scene mood=x\n                   ^" in shown
    assert "the options" not in shown


def test_typed_error_is_marked_with_caret() -> None:
    result = rehearse("silent_text", "--scene", "mood=2", "-i", typed="3s mod=1\n\n")
    assert "\n      3s mod=1\n         ^^^\n" in result.output


def test_question_shows_all_choices() -> None:
    assert "? answer [good] or bad >" in rehearse("evening_round", "-i", typed="\nbad\n").output


@pytest.mark.parametrize("typed", ["mood=1.5", "0.5s mood=1.5", "tune patience=30s", "0 s cancel"])
def test_event_can_be_entered_at_any_question(typed: str) -> None:
    output = rehearse("attentive_guide", "--scene", "age=4", "-i", typed=f"\n{typed}\n\n").output
    assert any(word in output for word in ("◆ mood 1.5", "◆ tuned: patience 30 s", "■ cancelled"))
    assert "is none of the choices" not in output


def test_cancel_before_first_tick_is_its_end() -> None:
    assert rehearse("attentive_guide", "--at", "cancel").output.endswith(
        "cancelled after 0.0 s, 0 ticks\n"
    )


def test_button_can_be_pressed_during_limited_wait() -> None:
    result = rehearse(
        "large_print", "-i", "--scene", "age=5", typed="8s buttons/confirm data=true\n\n"
    )
    assert "it waits: pressed, 19.9 s at most" in result.output
    assert "◆ message on buttons/confirm: data true" in result.output
    assert "✘" not in result.output


def test_header_says_market_would_not_call_agent() -> None:
    lines = rehearse("patient_carrier").stdout.splitlines()
    assert lines[1].endswith("a person is there")
    assert lines[2].startswith("The market would not call it: it does not bid, it needs not")
    assert "● succeeded" in lines[-3]
    assert "nobody is there" in rehearse("patient_carrier", "person=false").output


def test_agent_comes_from_chosen_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "copied"
    shutil.copytree(TREES, folder)
    guide = folder / "agents" / "attentive_guide.yaml"
    guide.write_text(guide.read_text().replace("Hello. I carry", "Good day. I carry"))
    assert "Good day. I carry" in rehearse("attentive_guide", "--dir", str(folder)).output
    assert "Good day. I carry" not in rehearse("attentive_guide").output
    monkeypatch.chdir(folder)
    assert "Good day. I carry" in rehearse("attentive_guide").output
    assert "Good day. I carry" in CliRunner().invoke(bt_agents, ["show", "attentive_guide"]).output


@pytest.mark.parametrize(("language", "said"), [("", "Guten Tag, Ann."), ("en", "Hello Ann.")])
def test_agent_speaks_chosen_language(tmp_path: Path, language: str, said: str) -> None:
    files = {
        "scene.yaml": (TREES / "scene.yaml").read_text() + "\nlanguage: de\n",
        "skills/robot.yaml": (TREES / "skills" / "robot.yaml").read_text(),
        "texts/de.yaml": 'format: 1\ntexts: {hello: "Guten Tag, ${guest}."}\n',
        "texts/en.yaml": 'format: 1\ntexts: {hello: "Hello ${guest}."}\n',
        "agents/guide.yaml": "format: 1\nagent: guide\n"
        "profile: {age: 3, familiarity: 3, mood: 3}\n"
        "tree: {sequence: [set: {guest: Ann}, say: '${t.hello}']}\n",
        "agents/guide.test.yaml": "format: 1\ntest: guide\n"
        f"cases: [{{name: it greets, expect: {{says: ['{said}']}}}}]\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    chosen = ["--language", language] if language else []
    shown = rehearse(str(tmp_path / "agents" / "guide.yaml"), *chosen)
    assert f'say "{said}"' in shown.output, shown.output
    tested = CliRunner().invoke(bt_agents, ["test", str(tmp_path), *chosen])
    assert tested.exit_code == 0, tested.output
