# SPDX-License-Identifier: Apache-2.0
"""Choice of the trees folder, and the hint if there is none."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.trees_folder import SHIPPED, NoTreesFolderError, find_trees, is_installed


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
