# SPDX-License-Identifier: Apache-2.0
"""A changing trees folder: which files are read again, and when."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from bt_agents.host.reload.folder_watch import MAX_UNSETTLED_POLLS, FolderWatch, WatchStopped
from bt_agents_language.files.folder_reader import Trees, read_trees
from reload_harness import MANNERS, SKILLS, agent, new_folder, write


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return new_folder(tmp_path / "trees", "ann", "bob", "zoe")


@pytest.fixture
def trees(folder: Path) -> Trees:
    return read_trees(folder)


@pytest.fixture
def watch(trees: Trees) -> FolderWatch:
    """A watch that has read the folder once."""
    return watching(trees)


def watching(trees: Trees) -> FolderWatch:
    watch = FolderWatch(trees)
    assert settled(watch) is None
    return watch


def settled(watch: FolderWatch):
    found = [trees for trees in (watch.poll() for _ in range(3)) if trees is not None]
    assert len(found) <= 1
    return found[0] if found else None


def specs(trees) -> dict[str, int]:
    return {one.name: id(one) for one in trees.agents}


def reread(before, after) -> set[str]:
    """Return the agents with another spec than before."""
    known = specs(before)
    return {name for name, one in specs(after).items() if known.get(name) != one}


def changed(before, after) -> list[bool]:
    """Return for each file whether it was read again."""
    known = {id(one) for one in before.files}
    return [id(one) not in known for one in after.files]


def test_only_changed_file_is_reread(folder, trees):
    read = []
    watch = FolderWatch(trees, lambda: read.append(1))
    assert settled(watch) is None
    write(folder, "bob", agent("bob", "{say: bye}"))
    after = settled(watch)
    assert (reread(trees, after), read) == ({"bob"}, [1])
    assert changed(trees, after) == [False, True, False]


def test_touched_file_is_not_a_change(folder, watch):
    os.utime(folder / "agents" / "bob.yaml", (1, 1))
    assert settled(watch) is None


def test_file_being_written_is_read_once_stable(folder, watch):
    text = agent("bob", "{say: bye}")
    for end in (0, 20, 40, len(text)):
        write(folder, "bob", text[:end])
        assert watch.poll() is None
    after = watch.poll()
    assert (after.broken, after.files[1].text) == ((), text)


def test_constantly_changing_file_is_read_eventually(folder, watch):
    found = []
    for number in range(MAX_UNSETTLED_POLLS + 1):
        write(folder, "bob", agent("bob", f"{{say: bye {number}}}"))
        found.append(watch.poll())
    assert found[:-1] == [None] * MAX_UNSETTLED_POLLS
    assert found[-1] is not None


def test_editor_renames_and_swap_files_are_handled(folder, trees, watch):
    for name, text in ((".bob.yaml.swp", "["), ("bob.yaml~", "["), ("4913", "")):
        (folder / "agents" / name).write_text(text)
    new = write(folder, ".bob", agent("bob", "{say: bye}"))
    new.rename(folder / "agents" / "bob.yaml")
    after = settled(watch)
    assert changed(trees, after) == [False, True, False]
    assert after.broken == ()


def test_change_keeping_size_and_mtime_is_detected(folder, watch):
    file = folder / "agents" / "bob.yaml"
    stamp = (file.stat().st_atime_ns, file.stat().st_mtime_ns)
    file.write_text(file.read_text().replace("hello", "olleh"))
    os.utime(file, ns=stamp)
    assert settled(watch) is not None


def test_file_recreated_between_polls_is_not_a_change(folder, watch):
    file = folder / "agents" / "bob.yaml"
    text = file.read_text()
    file.unlink()
    assert watch.poll() is None
    file.write_text(text)
    assert settled(watch) is None


@pytest.mark.parametrize("part", ["", "agents", "skills"])
def test_missing_folder_keeps_agents_and_reports_a_problem(folder, trees, watch, part):
    away = folder.parent / "away"
    (folder / part).rename(away)
    gone = settled(watch)
    assert specs(gone) == specs(trees)
    (problem,) = gone.problems
    assert problem.startswith(f"the folder {folder / part} cannot be read (No such file")
    assert settled(watch) is None
    away.rename(folder / part)
    back = settled(watch)
    assert back.problems == ()
    assert specs(back) == specs(trees)


def test_changed_scene_is_reported_but_not_reread(folder, trees, watch):
    scene = folder / "scene.yaml"
    text = scene.read_text()
    scene.write_text(text + "# more\n")
    after = settled(watch)
    assert after.problems == (f"{scene} has changed; restart everything to use it",)
    assert after.scene is trees.scene
    assert specs(after) == specs(trees)
    scene.write_text(text)
    assert settled(watch).problems == ()


def test_changed_library_rereads_direct_and_transitive_importers(folder):
    libraries = folder / "libraries"
    (libraries / "more.yaml").write_text(
        "format: 1\nimports: [libraries/manners.yaml]\n"
        "subtrees:\n  twice: {tree: {sequence: [{subtree: greet}, {subtree: greet}]}}\n"
    )
    write(folder, "ann", agent("ann", "{subtree: twice}", "imports: [libraries/more.yaml]\n"))
    write(folder, "bob", agent("bob", "{subtree: greet}", "imports: [libraries/manners.yaml]\n"))
    trees = read_trees(folder)
    watch = watching(trees)
    (libraries / "manners.yaml").write_text(MANNERS.replace("Good day", "Hi"))
    assert reread(trees, settled(watch)) == {"ann", "bob"}


def test_library_change_affects_only_agents_it_concerns(folder):
    head = "imports: [libraries/manners.yaml]\n"
    write(folder, "ann", agent("ann", "{subtree: greet}", head))
    trees = read_trees(folder)
    watch = watching(trees)
    library = folder / "libraries" / "manners.yaml"
    library.write_text(MANNERS + "  bye: {tree: {say: Bye}}\n")
    assert specs(settled(watch)) == specs(trees)
    library.write_text("format: 1\nsubtrees: 3\n")
    after = settled(watch)
    assert [one.file.name for one in after.broken] == ["ann.yaml", "manners.yaml"]
    assert after.holders["ann"] == folder / "agents" / "ann.yaml"
    library.write_text(MANNERS)
    mended = settled(watch)
    assert (mended.broken, [*specs(mended)]) == ((), ["ann", "bob", "zoe"])


def test_changed_text_rereads_agents_that_use_it(folder):
    (folder / "scene.yaml").write_text((folder / "scene.yaml").read_text() + "language: de\n")
    texts = folder / "texts" / "de.yaml"
    texts.parent.mkdir()
    texts.write_text("format: 1\ntexts: {hello: Hallo., bye: Ade.}\n")
    write(folder, "ann", agent("ann", '{say: "${t.hello}"}'))
    trees = read_trees(folder)
    watch = watching(trees)
    texts.write_text("format: 1\ntexts: {hello: Hallo., bye: Bis bald.}\n")
    assert specs(settled(watch)) == specs(trees)
    texts.write_text("format: 1\ntexts: {hello: Guten Tag., bye: Bis bald.}\n")
    after = settled(watch)
    assert reread(trees, after) == {"ann"}
    assert after.agents[0].tree.fields["text"].value == "Guten Tag."
    texts.unlink()
    assert [one.file.name for one in settled(watch).broken] == ["ann.yaml"]
    texts.write_text("format: 1\ntexts: {hello: Hallo.}\n")
    assert [*specs(settled(watch))] == ["ann", "bob", "zoe"]
    texts.write_text("format: 1\ntexts: [hello]\n")
    assert [one.file.name for one in settled(watch).broken] == ["ann.yaml", "de.yaml"]


def test_changed_skills_reread_all_agents_unless_broken(folder, trees, watch):
    skills = folder / "skills" / "robot.yaml"
    skills.write_text("format: 1\nskills: 3\n")
    broken = settled(watch)
    assert specs(broken) == specs(trees)
    assert [one.file for one in broken.broken] == [folder / "skills"]
    skills.write_text(SKILLS.replace("name: say,", "name: talk,"))
    after = settled(watch)
    assert (after.broken, reread(trees, after)) == ((), {"ann", "bob", "zoe"})
    beep = "  beep: {topic: {name: b, type: std_msgs/msg/Empty}}\n"
    skills.write_text(skills.read_text() + beep)
    more = settled(watch)
    assert specs(more) == specs(after)
    assert "beep" in more.symbols.skills


def test_first_holder_keeps_duplicate_agent_name(folder, watch):
    write(folder, "aaa", agent("zoe"))
    (broken,) = settled(watch).broken
    assert broken.file.name == "aaa.yaml"
    assert "there is an agent 'zoe' already" in broken.error.lines[0]
    write(folder, "zoe", agent("zoe", "{sya: hello}"))
    assert {one.file.name for one in settled(watch).broken} == {"aaa.yaml", "zoe.yaml"}
    (folder / "agents" / "zoe.yaml").unlink()
    taken = settled(watch)
    assert (taken.broken, taken.holders["zoe"].name) == ((), "aaa.yaml")


def test_two_files_can_swap_agent_names(folder, watch):
    write(folder, "ann", agent("bob"))
    write(folder, "bob", agent("ann"))
    after = settled(watch)
    assert after.broken == ()
    files = {name: file.name for name, file in after.holders.items()}
    assert files == {"ann": "bob.yaml", "bob": "ann.yaml", "zoe": "zoe.yaml"}


def test_tests_scripts_presets_and_hidden_files_change_nothing(folder, watch):
    (folder / "agents" / "ann.test.yaml").write_text("[")
    for name in ("scripts", "presets", ".git"):
        (folder / name).mkdir()
        (folder / name / "a.yaml").write_text("[")
    assert settled(watch) is None


def test_poll_can_be_stopped(folder, watch):
    write(folder, "ann", agent("ann", "{say: bye}"))
    watch.stop()
    with pytest.raises(WatchStopped):
        watch.poll(settle=False)


def test_failed_reading_is_retried(folder, monkeypatch):
    failures = [1]

    def pause() -> None:
        if failures:
            failures.pop()
            raise RuntimeError("no memory")

    watch = FolderWatch(read_trees(folder), pause)
    settled(watch)
    write(folder, "ann", agent("ann", "{say: bye}"))
    watch.poll()
    with pytest.raises(RuntimeError):
        watch.poll()
    assert watch.poll().agents[0].tree.fields["text"].value == "bye"


def test_agent_can_move_to_another_file(folder, watch):
    shutil.move(folder / "agents" / "ann.yaml", folder / "agents" / "anna.yaml")
    after = settled(watch)
    assert (after.broken, after.holders["ann"].name) == ((), "anna.yaml")
