# SPDX-License-Identifier: Apache-2.0
"""`bt-agents check`: the files that it checks, its output, and repeated checks."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.file_watch import PERIOD_S
from bt_agents_language.tools import folder_check
from bt_agents_language.tools.folder_check import Checked, check_folder
from bt_agents_tools.cli.commands import check as check_module
from bt_agents_tools.cli.commands.check import check, check_paths, summary, watched
from command_results import split_runner
from fake_interfaces import FakeInterfaces
from tree_harness import TREES

GOOD = (
    "format: 1\nagent: {}\nprofile: {{age: 3, familiarity: 3, mood: 3}}\ntree: {{say: Hello.}}\n"
)
WARNED = GOOD.replace("{{say: Hello.}}", "{{wait_for: live.person}}")
BROKEN = GOOD.replace("say", "sya")


@pytest.fixture(autouse=True)
def _without_ros(monkeypatch):
    monkeypatch.setattr(check_module, "installed_types", lambda: None)


@pytest.fixture
def trees(tmp_path, monkeypatch) -> Path:
    """A trees folder in the current folder, with two valid agents."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "trees"
    (folder / "agents").mkdir(parents=True)
    (folder / "skills").mkdir()
    shutil.copy(TREES / "scene.yaml", folder)
    shutil.copy(TREES / "skills" / "robot.yaml", folder / "skills")
    write("agents/one.yaml", GOOD.format("one"))
    write("agents/two.yaml", GOOD.format("two"))
    return folder


def write(name: str, text: str) -> Path:
    path = Path("trees") / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def run(*arguments: str) -> tuple[int, str]:
    result = split_runner().invoke(check, arguments, catch_exceptions=False)
    return result.exit_code, result.stdout


def found(*paths: str) -> list[str]:
    problems = check_paths(paths, None).problems
    return [f"{p.position.file}:{p.position.line} {p.code}" for p in problems]


def test_warning_shows_line_and_fails_only_when_strict(trees):
    write("agents/two.yaml", WARNED.format("two"))
    code, text = run()
    assert code == 0
    assert "    4 | tree: {wait_for: live.person}\n      |        ^^^^^^^^\n" in text
    assert text.endswith("2 agents are fine, 1 warning\n")
    assert run("--strict")[0] == 1


def test_all_files_in_folder_are_checked(trees):
    write("agents/two.yaml", BROKEN.format("two"))
    test = "format: 1\ntest: nobody\ncases: [{name: a, expect: {ends: b}}]\n"
    write("agents/one.test.yaml", test)
    write("libraries/manners.yaml", "format: 1\nsubtrees: {greet: {tree: {sya: A.}}}\n")
    write("scripts/morning.yaml", "format: 1\nvisits: [{label: a, person: maybe}]\n")
    write("market.yaml", "format: 1\nrules:\n  - {when: scene.age > 7, agents: [one]}\n")
    write("presets/morning.yaml", "format: 1\npreset: morning\nvalues: {one: 12 s}\n")
    assert sorted(found()) == [
        "trees/agents/one.test.yaml:2 unknown-agent",
        "trees/agents/two.yaml:4 unknown-node",
        "trees/libraries/manners.yaml:2 unknown-node",
        "trees/market.yaml:3 constant-condition",
        "trees/presets/morning.yaml:3 wrong-type",
        "trees/scripts/morning.yaml:2 wrong-type",
    ]
    write("scripts/noon.yaml", "format: 1\nvisits:\n  - label: Gate #4\n")
    assert "trees/scripts/noon.yaml:3 cut-text" in found()


def test_unknown_values_of_a_preset_are_warnings(trees):
    head = "format: 1\npreset: morning\nvalues:\n"
    write("presets/morning.yaml", f"{head}  onne: {{x: 1}}\n  one: {{learning_rate: 0, y: 1}}\n")
    assert found() == [
        "trees/presets/morning.yaml:4 unknown-in-preset",
        "trees/presets/morning.yaml:5 unknown-in-preset",
    ]


def test_preset_of_a_taken_name_is_an_error(trees):
    for name in ("evening", "morning"):
        write(
            f"presets/{name}.yaml", "format: 1\npreset: dusk\nvalues: {one: {learning_rate: 0}}\n"
        )
    assert found() == ["trees/presets/morning.yaml:2 duplicate-preset"]


def test_unread_files_of_a_folder_are_warnings(trees):
    for path in ("agents/a/two.yaml", "agents/THREE.YAML", "agents/.git/x.yaml", "texts/read.me"):
        write(path, "")
    assert found() == [
        "trees/agents/THREE.YAML:1 passed-over",
        "trees/agents/a/two.yaml:1 passed-over",
    ]


def test_values_of_a_preset_are_possible_ones(trees):
    tunable = "tunables: {x: {default: 8 s, min: 2 s, max: 30 s, step: 2 s}}\n"
    write("agents/one.yaml", GOOD.format("one") + tunable)
    for number, value in enumerate(("2,5 s", "99 s", "7 s", "8 s")):
        text = f"format: 1\npreset: p{number}\nvalues: {{one: {{x: '{value}'}}}}\n"
        write(f"presets/p{number}.yaml", text)
    write("presets/cut.yaml", "format: 1\npreset: c\nvalues: {one: {x: 2,5 s}}\n")
    write("presets/rate.yaml", "format: 1\npreset: r\nvalues: {one: {learning_rate: 2}}\n")
    assert [one for one in found() if "presets" in one] == [
        "trees/presets/cut.yaml:3 missing-value",
        "trees/presets/p0.yaml:3 bad-duration",
        "trees/presets/p1.yaml:3 out-of-range",
        "trees/presets/p2.yaml:3 off-step",
        "trees/presets/rate.yaml:3 out-of-range",
    ]


def test_path_accepts_file_or_folder_below_trees_folder(trees):
    write("agents/two.yaml", BROKEN.format("two"))
    write("agents/three.yaml", WARNED.format("three"))
    write("scripts/morning.yaml", "format: 1\nvisits: [{label: a}]\n")
    assert run("trees/agents/one.yaml") == (0, "1 agent is fine\n")
    assert run("trees/scripts/morning.yaml") == (0, "1 file is fine\n")
    assert found("trees/agents/two.yaml") == ["trees/agents/two.yaml:4 unknown-node"]
    assert found("trees/agents/two.yaml", "trees/agents/three.yaml") == found("trees/agents")
    assert found("trees/agents", "trees") == found("trees") == found(".")


def test_fault_of_check_is_problem_of_one_file(trees, monkeypatch):
    write("agents/three.yaml", WARNED.format("three"))
    lint = folder_check.lint

    def faulty(agent, **options):
        if agent.name == "one":
            raise KeyError("cogwheel")
        return lint(agent, **options)

    monkeypatch.setattr(folder_check, "lint", faulty)
    assert found() == [
        "trees/agents/one.yaml:1 reader-fault",
        "trees/agents/three.yaml:4 endless-wait",
    ]
    assert "one" in check_paths((), None).agents


def test_broken_scene_and_skills_leave_agents_unchecked(trees):
    write("skills/more.yaml", "format: 1\nskills: {bow: {descriptoin: a}}\n")
    write("scene.yaml", "format: 1\nparameters: {age: {min: 1}}\n")
    checked = check_paths(["trees/agents/one.yaml"], None)
    files = [problem.position.file for problem in checked.problems]
    assert files == ["trees/scene.yaml", "trees/skills/more.yaml"]
    assert checked.unchecked == ("trees/agents/one.yaml",)
    assert summary(checked) == (
        "2 errors, 1 file not checked: correct scene.yaml and the skills files first"
    )


def test_other_scene_files_are_checked_against_known_types(trees):
    text = (
        "format: 1\nparameters: {mood: {min: 1, max: 5, default: 3}}\nsources:\n"
        "  mood: {topic: a, type: NAME, field: msg.good + msg.bad, stale_after: 2 s}\n"
    )
    write("scenes/absent.yaml", text.replace("NAME", "absent_msgs/msg/X"))
    write("scenes/known.yaml", text.replace("NAME", "known_msgs/msg/X"))
    write("scenes/wrong.yaml", text.replace("NAME", "known_msgs/msg/X").replace("2 s", "soon"))
    mended = (TREES / "scene.yaml").read_text().replace("std_msgs/", "known_msgs/")
    write("scene.yaml", mended.replace("field: data", "field: good"))
    for name in ("agents", "skills"):
        shutil.rmtree(trees / name)
    found = check_folder(trees, FakeInterfaces(), only=[trees / "scenes"])
    assert found.files == 3
    assert [(Path(d.position.file).stem, d.position.column, d.code) for d in found.problems] == [
        ("known", 62, "unknown-ros-field"),
        ("wrong", 62, "unknown-ros-field"),
        ("wrong", 84, "bad-duration"),
    ]


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("nowhere.yaml", "there is no file or folder 'nowhere.yaml'"),
        ("loose.yaml", "'loose.yaml' is in no trees folder"),
        ("trees/notes.txt", "'trees/notes.txt' is not a file that the robot reads"),
    ],
)
def test_path_without_checkable_files_is_refused(trees, path, words):
    Path("loose.yaml").write_text(GOOD.format("loose"))
    write("notes.txt", "")
    with pytest.raises(BtAgentsError, match=words):
        run(path)


def test_json_report_lists_agents_files_and_problems(trees):
    write("agents/two.yaml", BROKEN.format("two"))
    code, text = run("--format", "json")
    report = json.loads(text)
    counted = [report[key] for key in ("agents", "files", "unchecked")]
    assert (code, counted) == (1, [["one"], 4, []])
    assert [problem["code"] for problem in report["problems"]] == ["unknown-node"]


def test_github_format_prints_annotations(trees):
    write("agents/two.yaml", BROKEN.format("two"))
    _, text = run("--format", "github")
    first, last = text.splitlines()
    assert first.startswith("::error file=trees/agents/two.yaml,line=4,col=8,endColumn=10,")
    assert last == "1 agent is fine, 1 error"


@pytest.mark.parametrize(
    ("subtree", "use", "code"),
    [
        ("tree: {wait_for: live.person}", "", "endless-wait"),
        ("tree: {say: Hello., when: scene.age > 7}", "", "constant-condition"),
        ("inputs: {who: text}, tree: {say: Hello.}", ", with: {who: Ann}", "unused-input"),
    ],
)
def test_library_warning_is_reported_once_for_all_users(trees, subtree, use, code):
    write("libraries/waits.yaml", f"format: 1\nsubtrees:\n  await: {{{subtree}}}\n")
    for name in ("one", "two"):
        text = GOOD.format(name).replace("{say: Hello.}", f"{{subtree: await{use}}}")
        write(f"agents/{name}.yaml", text + "imports: [libraries/waits.yaml]\n")
    assert found() == [f"trees/libraries/waits.yaml:3 {code}"]


class Steps:
    """A sleep that changes the files each time, and finally ends the watch."""

    def __init__(self, *steps) -> None:
        self.steps = list(steps)
        self.slept: list[float] = []

    def __call__(self, seconds: float) -> None:
        self.slept.append(seconds)
        if not self.steps:
            raise KeyboardInterrupt
        self.steps.pop(0)()


def test_a_watch_checks_again_only_after_a_change(trees):
    shown: list[Checked] = []
    steps = Steps(
        lambda: None,
        lambda: write("agents/two.yaml", BROKEN.format("two") + "# longer\n"),
        lambda: write("notes.txt", "no YAML"),
        lambda: write("agents/three.yaml", GOOD.format("three")),
        lambda: Path("trees/agents/two.yaml").unlink(),
    )
    changed = []
    with pytest.raises(KeyboardInterrupt):
        changed.extend(watched((), shown.append, steps))
    assert [len(checked.problems) for checked in shown] == [0, 1, 1, 0]
    assert [Path(file).stem for files in changed for file in files] == ["two", "three", "two"]
    assert steps.slept == [PERIOD_S] * 6


def test_watch_survives_temporarily_missing_folder(trees, capsys):
    shown: list[Checked] = []
    steps = Steps(
        lambda: (trees / "scene.yaml").rename("scene.yaml"),
        lambda: Path("scene.yaml").rename(trees / "scene.yaml"),
    )
    with pytest.raises(KeyboardInterrupt):
        list(watched(("trees",), shown.append, steps))
    assert len(shown) == 2
    assert "error: " in capsys.readouterr().err


def test_ctrl_c_ends_watch_cleanly(trees, monkeypatch):
    monkeypatch.setattr("time.sleep", Steps())
    code, text = run("--watch")
    assert code == 0
    assert "2 agents are fine\n" in text


@pytest.mark.parametrize("neighbour", ["loop", "pipe", "nowhere"])
def test_unreadable_file_does_not_stop_other_checks(trees, neighbour):
    strange = trees / "agents" / f"{neighbour}.yaml"
    if neighbour == "pipe":
        os.mkfifo(strange)
    else:
        strange.symlink_to(strange.name if neighbour == "loop" else "not_there.yaml")
    assert run("trees/agents/one.yaml") == (0, "1 agent is fine\n")
    code, output = run(f"trees/agents/{neighbour}.yaml")
    assert code == 1
    assert f"{neighbour}.yaml" in output


def test_importing_an_agent_blames_only_the_importer(trees):
    for name in ("two", "one"):
        write("agents/one.yaml", GOOD.format("one") + f"imports: [agents/{name}.yaml]\n")
        assert found() == ["trees/agents/one.yaml:5 bad-import"]


def test_current_folder_is_checked_if_trees_folder(trees, monkeypatch):
    monkeypatch.chdir(trees)
    assert run() == (0, "2 agents are fine\n")
