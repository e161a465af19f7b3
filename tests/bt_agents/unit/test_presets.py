# SPDX-License-Identifier: Apache-2.0
"""Presets of a trees folder: saved, read, applied to other hosts, refused, never overwritten."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_agents.host.tuning import presets as presets_module
from bt_agents.host.tuning.presets import Presets
from bt_agents_core.errors import Refused
from bt_agents_language.files.preset_reader import preset_text

VALUES = {"b.loud": "true", "a.patience": "12 s", "a.place": 'say "hi": #1'}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "presets"


@pytest.fixture
def presets(folder: Path) -> Presets:
    return Presets(folder)


def write(folder: Path, file: str, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / file
    path.write_text(text)
    return path


def values(presets: Presets, name: str) -> dict[str, str]:
    return dict(presets.get(name).values)


def files(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def test_a_preset_is_a_readable_file(presets, folder):
    presets.save("Care home", VALUES)
    assert (folder / "care_home.yaml").read_text() == (
        "format: 1\n"
        "preset: Care home\n"
        "values:\n"
        "  a:\n"
        "    patience: 12 s\n"
        "    place: 'say \"hi\": #1'\n"
        "  b:\n"
        "    loud: true\n"
    )
    assert values(presets, "Care home") == values(Presets(folder), "Care home") == VALUES
    assert files(folder) == ["care_home.yaml"]


def test_saved_again_and_forgotten_preset_has_one_file(folder):
    write(folder, "mine.yaml", preset_text("morning", {"a.patience": "12 s"}))
    presets = Presets(folder)
    presets.save("morning", {"a.patience": "3 s"})
    assert values(presets, "morning") == {"a.patience": "3 s"}
    assert files(folder) == ["mine.yaml"]
    presets.forget("morning")
    assert (dict(presets.by_name), files(folder)) == ({}, [])


def test_two_hosts_share_the_presets_of_a_folder(folder):
    one, other = Presets(folder), Presets(folder)
    one.save("morning", {"a.patience": "12 s"})
    other.save("evening", {"b.patience": "3 s"})
    one.forget("evening")
    other.save("night", {"b.loud": "false"})
    assert list(Presets(folder).by_name) == list(other.by_name) == ["morning", "night"]


def test_file_edited_by_author_is_read_again(presets, folder):
    path = write(folder, "early.yaml", preset_text("early", {"a.patience": "12 s"}))
    presets.refresh()
    before = presets.by_name
    presets.refresh()
    assert presets.by_name is before
    path.write_text(preset_text("early", {"a.patience": "9.5 s"}))
    presets.refresh()
    assert values(presets, "early") == {"a.patience": "9.5 s"}


def test_a_broken_file_affects_no_other_preset(folder):
    text = "format: 1\npreset: morning\nvalues: [\n"
    broken = write(folder, "morning.yaml", text)
    write(folder, "night.yaml", preset_text("night", {"b.loud": "false"}))
    presets = Presets(folder)
    assert list(presets.by_name) == ["night"]
    assert [*presets.problems] == [broken]
    assert presets.problems[broken].startswith(f"{broken}:")
    with pytest.raises(Refused, match=r"left out because of problems: morning\.yaml"):
        presets.get("morning")
    with pytest.raises(Refused, match=r"FILE_TAKEN: .*morning\.yaml holds another"):
        presets.save("morning", VALUES)
    assert broken.read_text() == text


def test_name_with_file_of_other_preset_is_refused(presets):
    presets.save("care home", {"a.patience": "12 s"})
    with pytest.raises(Refused, match="FILE_TAKEN"):
        presets.save("care-home", VALUES)
    assert values(presets, "care home") == {"a.patience": "12 s"}


def test_second_file_with_same_name_is_reported(folder):
    write(folder, "one.yaml", preset_text("morning", {"a.patience": "12 s"}))
    two = write(folder, "two.yaml", preset_text("morning", {"a.patience": "3 s"}))
    presets = Presets(folder)
    assert values(presets, "morning") == {"a.patience": "12 s"}
    assert presets.problems[two].endswith("one.yaml holds the preset 'morning' already")


@pytest.mark.parametrize("name", ["", " x", "x\n", "x" * 61, "\x00", "a\u2028b", "..", "/"])
def test_unusable_preset_name_is_refused(folder, name):
    with pytest.raises(Refused, match="BAD_NAME: a preset cannot be called"):
        Presets(folder).save(name, VALUES)
    assert not folder.exists()


@pytest.mark.parametrize(
    "name", ["../scene", "/etc/passwd", "a/../../b", "~/x", ".hidden", "a.test", "C:\\x", "ẞ" * 60]
)
def test_no_name_leaves_the_folder(folder, name):
    Presets(folder).save(name, VALUES)
    assert list(folder.parent.iterdir()) == [folder]
    assert list(Presets(folder).by_name) == [name]


def test_an_unknown_preset_is_refused_with_the_nearest(presets):
    with pytest.raises(Refused, match="UNKNOWN_PRESET: no preset 'x'; 'bt-agents preset save"):
        presets.get("x")
    presets.save("morning", VALUES)
    with pytest.raises(Refused, match="did you mean 'morning'"):
        presets.forget("mornin")


def test_presets_and_their_values_are_bounded(presets, folder, monkeypatch):
    monkeypatch.setattr(presets_module, "MOST_PRESETS", 2)
    monkeypatch.setattr(presets_module, "MOST_VALUES", 4)
    presets.save("one", {"a.x": "1", "a.y": "1"})
    with pytest.raises(Refused, match="TOO_MANY: 2 presets with 5 values"):
        presets.save("two", VALUES)
    presets.save("two", {"a.x": "1"})
    with pytest.raises(Refused, match="TOO_MANY: 3 presets"):
        presets.save("three", {"a.x": "1"})
    late = write(folder, "z.yaml", preset_text("z", {"a.x": "1"}))
    presets.refresh()
    assert "a host takes at most 2 presets" in presets.problems[late]


def test_full_disk_leaves_no_preset_file(presets, folder, monkeypatch):
    def full(*_arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(presets_module, "write_atomically", full)
    with pytest.raises(
        Refused, match=r"STORAGE_FULL: .*morning\.yaml cannot be written: No space"
    ):
        presets.save("morning", VALUES)
    assert (dict(presets.by_name), list(folder.iterdir())) == ({}, [])


def test_the_folder_of_the_installation_takes_no_presets(tmp_path, monkeypatch):
    installed = tmp_path / "share" / "bt_agents_trees"
    installed.mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    presets = Presets(installed / "presets")
    with pytest.raises(Refused, match=r"CANNOT_WRITE: .* belongs to the installation, .* a copy"):
        presets.save("morning", VALUES)
    assert list(installed.iterdir()) == []
