# SPDX-License-Identifier: Apache-2.0
"""Choice of the trees folder, and of the folder with its state."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.state_folder import ID_FILE, StateFolder, claim_state, find_state, state_home
from bt_agents_core.trees_folder import (
    SHIPPED,
    NoTreesFolderError,
    find_experiments,
    find_sweep,
    find_trees,
    is_installed,
)


def make(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.yaml").write_text("format: 1\n")
    return folder


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder without trees, and an installation."""
    make(tmp_path / "installation" / "share" / "bt_agents_trees")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "installation"))
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def near() -> Path | None:
    with pytest.raises(NoTreesFolderError, match="no trees folder here") as caught:
        find_trees()
    return caught.value.near


def test_current_folder_or_its_trees_subfolder_is_used(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(here / "trees")
    assert find_trees() == Path("trees")
    monkeypatch.chdir(here / "trees")
    assert find_trees() == Path()


def test_installed_trees_are_used_only_on_request(here: Path) -> None:
    assert near() is None
    assert find_trees(SHIPPED) == here.parent / "installation" / "share" / "bt_agents_trees"


def test_nearby_trees_folder_is_only_suggested(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside = make(here / "hospital" / "trees")
    assert near() == Path("hospital") / "trees"
    agents = beside / "agents"
    agents.mkdir()
    monkeypatch.chdir(agents)
    assert near() == beside


def test_wrong_named_folder_is_refused_with_suggestion(here: Path) -> None:
    make(here / "hospital" / "trees")
    with pytest.raises(BtAgentsError, match="did you mean 'hospital/trees'"):
        find_trees("hospital")
    with pytest.raises(BtAgentsError, match="'nowhere' is not a trees folder"):
        find_trees("nowhere")
    assert find_trees("hospital/trees") == Path("hospital") / "trees"


def test_symlinked_checkout_does_not_count_as_installed(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed = find_trees(SHIPPED)
    assert is_installed(installed / "scene.yaml")
    assert not is_installed(make(here / "trees"))
    linked = here / "editable" / "share"
    linked.mkdir(parents=True)
    (linked / "bt_agents_trees").symlink_to(here / "trees")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(here / "editable"))
    assert find_trees(SHIPPED) == here / "trees"
    assert not is_installed(here / "trees" / "scene.yaml")


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return tmp_path / "home"


@pytest.fixture
def trees(tmp_path: Path) -> Path:
    return make(tmp_path / "one" / "trees")


def claim(trees: Path, home: Path, explicit: str = "") -> StateFolder:
    return claim_state(trees, explicit, home)


def test_two_projects_use_separate_state_folders(tmp_path: Path, home: Path) -> None:
    one = claim(make(tmp_path / "one" / "trees"), home)
    other = claim(make(tmp_path / "other" / "trees"), home)
    assert one.path != other.path
    assert one.is_new
    assert one.path.is_relative_to(home)
    assert one.path.name.startswith("one-")
    files = (one.ledger, one.tunings, one.orders, one.scenes, one.memory, one.journal)
    assert {file.parent for file in files} == {one.path}


def test_restart_finds_the_previous_state_folder(home: Path, trees: Path) -> None:
    first = claim(trees, home)
    again = claim(trees, home)
    assert (again.path, again.is_new, again.note) == (first.path, False, "")
    assert find_state(trees, home=home) == again


def test_finding_state_writes_nothing(home: Path, trees: Path) -> None:
    found = find_state(trees, home=home)
    assert not home.exists()
    assert not (trees / ID_FILE).exists()
    assert claim(trees, home).path == found.path


def test_moved_trees_folder_keeps_its_state(tmp_path: Path, home: Path, trees: Path) -> None:
    first = claim(trees, home)
    moved = Path(shutil.move(trees, tmp_path / "elsewhere"))
    found = claim(moved, home)
    assert found.path == first.path
    assert f"was {trees} before" in found.note
    assert claim(moved, home).note == ""
    # A new folder in the old place is another one.
    assert claim(make(trees), home).path != first.path


def test_copied_trees_folder_gets_new_state_and_note(
    tmp_path: Path, home: Path, trees: Path
) -> None:
    first = claim(trees, home)
    copied = Path(shutil.copytree(trees, tmp_path / "copy" / "trees"))
    assert "is a copy of" in find_state(copied, home=home).note
    found = claim(copied, home)
    assert found.path != first.path
    assert found.is_new
    assert f"is a copy of {trees}" in found.note
    again = claim(copied, home)
    assert (again.path, again.note) == (found.path, "")
    assert claim(trees, home).path == first.path


def test_folder_without_id_file_is_known_by_path(home: Path, trees: Path) -> None:
    first = claim(trees, home)
    (trees / ID_FILE).unlink()
    assert claim(trees, home).path == first.path


def test_installed_folder_gets_no_id_file(
    tmp_path: Path, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trees = make(tmp_path / "installation" / "share" / "bt_agents_trees")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "installation"))
    first = claim(trees, home)
    assert sorted(path.name for path in trees.iterdir()) == ["scene.yaml"]
    assert claim(trees, home).path == first.path


@pytest.mark.parametrize("text", ["../../etc", "a/b", "a b", "", "x" * 81, "\x00", "-rf"])
def test_invalid_folder_id_is_refused(home: Path, trees: Path, text: str) -> None:
    (trees / ID_FILE).write_text(f"{text}\n")
    if not text:
        assert claim(trees, home).path.parent == home / "trees"
        return
    with pytest.raises(BtAgentsError, match="expected a line of letters"):
        claim(trees, home)


def test_named_state_folder_belongs_to_one_trees_folder(tmp_path: Path, home: Path) -> None:
    one, other = make(tmp_path / "one" / "trees"), make(tmp_path / "other" / "trees")
    place = str(tmp_path / "robot")
    assert claim(one, home, place).path == tmp_path / "robot"
    assert not (one / ID_FILE).exists()
    assert not home.exists()
    with pytest.raises(BtAgentsError, match=f"holds the state of the trees folder {one}"):
        claim(other, home, place)
    assert claim(one, home, place).note == ""
    shutil.rmtree(one)
    assert f"was {one} before" in claim(other, home, place).note


def test_unwritable_state_folder_suggests_the_state_option(tmp_path: Path, home: Path) -> None:
    home.write_text("a file")
    with pytest.raises(BtAgentsError, match="name another folder with --state"):
        claim(make(tmp_path / "one" / "trees"), home)


def test_state_home_follows_xdg() -> None:
    assert state_home({"XDG_STATE_HOME": "/x"}) == Path("/x/bt-agents")
    assert state_home({}) == Path.home() / ".local" / "state" / "bt-agents"


def test_own_experiments_do_not_hide_installed_ones(here: Path) -> None:
    installed = here.parent / "installation" / "share" / "bt_agents_experiments"
    own = Path("experiments")
    for folder in (installed / "1", installed / "2-high", own / "1", own / "mine"):
        folder.mkdir(parents=True)
        (folder / "experiment.yaml").touch()
    (installed / "sweeps").mkdir()
    (installed / "sweeps" / "told.yaml").touch()
    assert find_experiments("mine") == (own / "mine",)
    assert find_experiments("1") == (own / "1",)
    assert find_experiments("2") == (installed / "2-high",)
    with pytest.raises(BtAgentsError, match="there are 1, mine, 2-high, or name"):
        find_experiments("3")
    assert find_sweep("told") == installed / "sweeps" / "told.yaml"
