# SPDX-License-Identifier: Apache-2.0
"""Versions of an agent: broken, with new values, with a new tree, waiting, rolled back."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_agents.host.reload.reload_service import reload_lines
from bt_agents.host.reload.versions import AgentVersions
from bt_agents_language.files.folder_reader import read_trees
from reload_harness import Watched, agent, new_folder, write

TUNABLES = "tunables:\n  patience: {{default: {}, min: 1 s, max: 60 s, description: d}}\n"
WAIT = "{wait: '${patience}'}"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return new_folder(tmp_path / "trees", "ann", "bob")


@pytest.fixture
def watched(folder: Path) -> Watched:
    one = Watched(folder)
    assert one.poll() == []
    return one


def edit(watched: Watched, name: str, text: str) -> list[str]:
    write(watched.folder, name, text)
    return watched.poll()


def in_force(watched: Watched, name: str) -> tuple[int, str]:
    version = watched.versions.states[name].current
    return version.number, version.change


def test_changed_tree_of_idle_agent_is_replaced(watched):
    ann = watched.in_force["ann"]
    change = "tree changed: 1 node changed, 2 nodes added"
    said = edit(watched, "bob", agent("bob", "{sequence: [{say: a}, {say: b}]}"))
    assert said == [f"replace bob: version 2 in force ({change})"]
    assert watched.in_force["ann"] is ann
    assert in_force(watched, "bob") == (2, change)
    said = edit(watched, "bob", agent("bob", "{sequence: [{say: b}, {say: a}]}"))
    assert said == ["replace bob: version 3 in force (tree changed: nodes in another order)"]


def fail(watched: Watched, name: str) -> list[str]:
    """Settle an agent as a host whose parameters cannot be declared; return the reports."""
    trees = watched.watch.poll(settle=False)
    assert trees is not None
    assert watched.versions.update(trees) == [name]
    effect = watched.versions.settle(name, watched.running)
    assert effect is not None
    reported = watched.versions.failed(effect, "OSError: disk")
    assert reported.is_error
    return [reported.text]


def test_failed_version_is_rolled_back_and_retried(watched):
    write(watched.folder, "bob", agent("bob", "{say: bye}"))
    assert fail(watched, "bob") == [
        "bob: version 2 could not be brought into force, version 1 stays: OSError: disk"
    ]
    assert watched.versions.states["bob"].problems
    assert in_force(watched, "bob") == (1, "")
    in_force_now = "version 2 in force (tree changed: 1 node changed)"
    assert edit(watched, "ann", agent("ann", "{say: hi}")) == [
        f"replace ann: {in_force_now}",
        f"replace bob: {in_force_now}",
    ]
    assert not watched.versions.states["bob"].problems


def test_failed_addition_of_agent_is_retried(watched):
    write(watched.folder, "cid", agent("cid"))
    assert fail(watched, "cid") == ["cid: version 1 could not be added: OSError: disk"]
    assert "cid" not in watched.versions.states
    said = edit(watched, "ann", agent("ann", "{say: hi}"))
    assert "add cid: new agent from cid.yaml, version 1 in force" in said


def test_changed_default_updates_running_agent(watched):
    edit(watched, "bob", agent("bob", WAIT, TUNABLES.format("8 s")))
    watched.running = "bob"
    said = edit(watched, "bob", agent("bob", WAIT, TUNABLES.format("12 s")))
    assert said == ["update bob: version 3 in force (patience: 8 s → 12 s)"]


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("title: Bobby\n", "title changed"),
        ("learning_rate: 0.5\n", "learning_rate: 0.2 → 0.5"),
        ("learning: {update: median}\n", "learning changed"),
        ("learning: {rate: 0.5}\n", "learning_rate: 0.2 → 0.5"),
        ("weights: {age: 2}\n", "weights changed"),
        ("tags: [a]\n", "tags changed"),
        ("requires: scene.person\n", "requires changed"),
        ("feedback: [{when: live.age > 3, give: positive}]\n", "feedback rules changed"),
        ("profile: {age: 4.5}\n", "profile age: 3 → 4.5"),
        ("# a comment\n", "only comments or layout changed"),
    ],
)
def test_changes_outside_tree_take_effect_immediately(watched, head, words):
    watched.running = "bob"
    # A profile of the head replaces the usual one.
    text = agent("bob", head=head).replace("profile: {age: 3}\nprofile", "profile")
    said = edit(watched, "bob", text)
    assert said == [f"update bob: version 2 in force ({words})"]


def test_new_tunable_waits_like_a_tree_change(watched):
    watched.running = "bob"
    said = edit(watched, "bob", agent("bob", head=TUNABLES.format("8 s")))
    assert said == ["report bob: version 2 waits for the end of its run (tunable patience added)"]


def test_changed_tree_waits_for_end_of_run(watched):
    before = watched.in_force["bob"]
    watched.running = "bob"
    change = "(tree changed: 1 node changed)"
    said = edit(watched, "bob", agent("bob", "{say: bye}"))
    assert said == [f"report bob: version 2 waits for the end of its run {change}"]
    assert watched.in_force["bob"] is before
    assert watched.versions.states["bob"].waiting
    assert watched.versions.waiting_text("bob") == "version 2 of bob waits"
    assert watched.end_run() == [f"replace bob: version 2 in force {change}"]
    assert not watched.versions.states["bob"].waiting
    assert watched.versions.states["bob"].current.number == 2


def test_only_newest_version_waits_and_can_be_reverted(watched):
    watched.running = "bob"
    edit(watched, "bob", agent("bob", "{say: bye}"))
    edit(watched, "bob", agent("bob", "{say: adieu}"))
    assert watched.versions.waiting_text("bob") == "version 3 of bob waits"
    assert edit(watched, "bob", agent("bob")) == [
        "report bob: version 1 stays in force, 3 does not wait any more"
    ]
    assert watched.end_run() == []
    assert watched.versions.states["bob"].current.number == 1


def test_broken_file_keeps_last_good_version(watched):
    before = watched.in_force["bob"]
    (said,) = edit(watched, "bob", agent("bob", "{sya: hello}"))
    assert said.startswith("report bob: bob.yaml is broken, version 1 stays in force: ")
    assert "bob.yaml:4:8: error[unknown-node]" in said
    [problem] = watched.versions.states["bob"].problems
    assert "error[unknown-node]" in problem.message
    said = edit(watched, "bob", agent("bob"))
    assert said == ["report bob: bob.yaml is good again, version 1 stays"]
    assert watched.versions.states["bob"].problems == ()
    assert watched.in_force["bob"] is before


def test_broken_file_keeps_the_waiting_version(watched):
    watched.running = "bob"
    edit(watched, "bob", agent("bob", "{say: bye}"))
    (said,) = edit(watched, "bob", "[")
    assert "version 2 still waits for the end of its run" in said
    assert watched.end_run()[0].startswith("replace bob: version 2 in force")
    assert watched.versions.states["bob"].problems


def test_agents_are_added_and_removed_with_their_files(watched):
    added = ["add mia: new agent from mia.yaml, version 1 in force"]
    assert edit(watched, "mia", agent("mia")) == added
    (watched.folder / "agents" / "mia.yaml").unlink()
    (said,) = watched.poll()
    assert said.startswith("remove mia: removed, its file ")
    assert set(watched.in_force) == {"ann", "bob"}
    assert edit(watched, "mia", agent("mia", "{say: bye}")) == added


def test_agent_name_change_in_file_renames_agent(watched):
    said = edit(watched, "bob", agent("rob"))
    assert said == [
        "remove bob: removed, bob.yaml calls it 'rob' now",
        "add rob: new agent from bob.yaml, version 1 in force",
    ]


def test_deleted_running_agent_leaves_at_end_of_run(watched):
    watched.running = "bob"
    file = watched.folder / "agents" / "bob.yaml"
    text = file.read_text()
    file.unlink()
    (said,) = watched.poll()
    assert said.endswith("is gone; it leaves at the end of its run")
    assert watched.versions.states["bob"].removal_reason
    assert edit(watched, "bob", text) == ["report bob: bob.yaml is good again, version 1 stays"]
    assert not watched.versions.states["bob"].removal_reason
    file.unlink()
    watched.poll()
    (said,) = watched.end_run()
    assert said.startswith("remove bob")
    assert watched.poll() == []


def test_only_agents_with_requested_tags_are_loaded(folder):
    write(folder, "ann", agent("ann", head="tags: [x]\n"))
    watched = Watched(folder, "x")
    assert set(watched.in_force) == {"ann"}
    assert edit(watched, "bob", agent("bob", head="tags: [x, y]\n")) == [
        "add bob: new agent from bob.yaml, version 1 in force"
    ]
    assert edit(watched, "ann", agent("ann")) == [
        "remove ann: removed, it has none of the tags x any more"
    ]


def test_pending_and_broken_versions_are_always_reported():
    assert reload_lines([], "", []) == ["nothing has changed"]
    assert reload_lines([], "version 4 of ann waits", ["a.yaml:1:1: error[x]: y"]) == [
        "version 4 of ann waits for the end of the run; 'bt-agents reload --now' cancels it",
        "a.yaml:1:1: error[x]: y",
    ]


def test_problem_named_by_change_is_reported_once():
    changed = ["ann: a.yaml is broken, version 3 stays in force: a.yaml:1:1: error[x]: y"]
    assert reload_lines(changed, "", ["a.yaml:1:1: error[x]: y"]) == changed


def test_problem_includes_its_hint(folder):
    write(folder, "ann", agent("ann", "{syy: hi}"))
    [problem] = AgentVersions(read_trees(folder)).folder_problems()
    assert problem.message.endswith("(did you mean 'say'?)")
