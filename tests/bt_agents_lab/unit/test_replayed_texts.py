# SPDX-License-Identifier: Apache-2.0
"""Texts of agents in a journal: the files of a host are read in its language."""

from __future__ import annotations

from pathlib import Path

from bt_agents.host.reload.source_bundle import source_bundle
from bt_agents.host.reload.versions import AgentVersions
from bt_agents_lab.replay.texts import TextFiles
from bt_agents_language.files.folder_reader import read_trees
from reload_harness import agent, new_folder, write


def test_the_files_of_a_host_have_its_texts_and_are_read_in_its_language(tmp_path: Path) -> None:
    folder = new_folder(tmp_path / "trees")
    (folder / "scene.yaml").write_text((folder / "scene.yaml").read_text() + "language: de\n")
    (folder / "texts").mkdir()
    for language, text in (("de", "Hallo."), ("en", "Hello.")):
        file = folder / "texts" / f"{language}.yaml"
        file.write_text(f"format: 1\ntexts: {{hello: {text}}}\n")
    write(folder, "ann", agent("ann", '{say: "${t.hello}"}'))
    versions = AgentVersions(read_trees(folder, language="en"))
    bundle = source_bundle(versions, lambda _package: True)
    assert {"texts/de.yaml", "texts/en.yaml"} <= bundle.files.keys()
    parsed = TextFiles(files=bundle.files).parsed
    assert [one.tree.fields["text"].value for one in parsed.trees.agents] == ["Hello."]
