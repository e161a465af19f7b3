# SPDX-License-Identifier: Apache-2.0
"""Schemas for editors: they accept all valid files, and reject common slips."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from jsonschema import Draft7Validator
from py_trees.behaviour import Behaviour

from bt_agents_core.field_types import FieldType
from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.nodes.catalogue import DECORATORS, NODE_TYPES, SIBLINGS
from bt_agents_language.nodes.node_type import Content, NodeField, NodeType
from bt_agents_language.tools.schema.folder import (
    folder_symbols,
    schema_file,
    schema_of,
    schema_text,
)
from bt_agents_language.yaml.source import read_source
from bt_agents_tools.cli.commands.schema import schema
from bt_agents_tools.cli.installed_kinds import installed_kinds
from checkout import ROOT
from core_schema import loaded
from tree_harness import SPACE, SYMBOLS

CORPUS = ROOT / "tests" / "corpus"
TREES = ROOT / "trees"
FOLDERS = {
    folder: folder_symbols(folder)
    for folder in (TREES, *sorted(p.parent for p in ROOT.glob("experiments/*/experiment.yaml")))
}
KIND_OF_FOLDER = {"skills": "library", "libraries": "library"}
"""Folder → kind of its files, where the folder has not the name of its kind."""
KINDS = installed_kinds()
VALIDATORS = {name: Draft7Validator(schema_of(kind, SYMBOLS)) for name, kind in KINDS.items()}
HEAD = "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\n"


def shipped() -> Iterator[Path]:
    for folder in FOLDERS:
        yield from sorted((*folder.glob("*.yaml"), *folder.glob("*/*.yaml")))
    yield from sorted(ROOT.glob("experiments/sweeps/*.yaml"))


def accepted() -> Iterator[Path]:
    """Return the files of the corpus without errors."""
    for file in sorted((CORPUS / "expected").glob("*.txt")):
        for line in file.read_text(encoding="utf-8").splitlines():
            name, colon, errors = line.partition(":")
            # Agents with imports of their own know more words.
            own = name.startswith("imports/agents")
            sound = colon and not own and not line.startswith("#") and not errors.strip()
            if sound and (CORPUS / name).is_file():
                yield CORPUS / name


def kind_of(path: Path) -> str:
    if path.name.endswith(".test.yaml"):
        return "test"
    if path.name in ("scene.yaml", "market.yaml", "experiment.yaml"):
        return path.stem
    folder = path.parent.name
    return KIND_OF_FOLDER.get(folder) or folder.removesuffix("s")


def problems(kind: str, text: str) -> list[str]:
    return [error.message for error in VALIDATORS[kind].iter_errors(loaded(text))]


@pytest.mark.parametrize("kind", KINDS)
def test_schema_is_valid_json_schema(kind):
    Draft7Validator.check_schema(json.loads(schema_text(KINDS[kind], SYMBOLS)))


@pytest.mark.parametrize("path", list(shipped()), ids=lambda path: str(path.relative_to(ROOT)))
def test_schema_accepts_every_shipped_file(path):
    content = loaded(read_source(path).text)
    folder = (path.parent / content.get("experiment", "")).resolve()
    words = FOLDERS.get(folder) or FOLDERS[path.parents[1]]
    validator = Draft7Validator(schema_of(KINDS[kind_of(path)], words))
    assert [error.message for error in validator.iter_errors(content)] == []


@pytest.mark.parametrize("path", list(accepted()), ids=lambda path: str(path.relative_to(CORPUS)))
def test_schema_accepts_every_file_the_readers_accept(path):
    assert problems(kind_of(path), read_source(path).text) == []


@pytest.mark.parametrize("key", [*NODE_TYPES, *SYMBOLS.skills, *DECORATORS, *SIBLINGS])
def test_node_schema_describes_every_word(key):
    properties = schema_of(AGENT, SYMBOLS)["definitions"]["node"]["properties"]
    assert properties[key]["description"]
    assert properties[key]["markdownDescription"].startswith(properties[key]["description"])


@pytest.mark.parametrize("kind", KINDS)
def test_schema_describes_every_key(kind):
    def undescribed(part: object, at: str) -> Iterator[str]:
        if isinstance(part, list):
            for item in part:
                yield from undescribed(item, at)
        elif isinstance(part, dict):
            for key, one in part.get("properties", {}).items():
                if "description" not in one:
                    yield f"{at}/{key}"
            for key, one in part.items():
                yield from undescribed(one, f"{at}/{key}")

    described_by_nature = ("condition", "duration", *SPACE.names, *SYMBOLS.skills)
    found = [
        path
        for path in undescribed(schema_of(KINDS[kind], SYMBOLS), "")
        if path.rpartition("/")[2] not in described_by_nature
    ]
    assert found == []


@pytest.mark.parametrize(
    "node",
    [
        "sya: Hello.",
        "say: {txt: Hello.}",
        "say: Hello.\nask: Really?",
        "say: Hello.\nretrry: 3",
        "sequence:\n  say: Hello.",
        "parallel: {succeed_on: al, children: [{say: Hello.}]}",
        "wait: 5 sx",
        "say: Hello.\ninvert: yes",
        "say: Hello.\nwith: {a: 1}",
        "wait: 5 s\noutputs: {a: b}",
        "give_feedback: positiv",
        "publish: {topic: sound, type: String, message: {}}",
    ],
)
def test_schema_rejects_errors_in_trees(node):
    lines = "".join(f"  {line}\n" for line in node.splitlines())
    assert problems("agent", f"{HEAD}tree:\n{lines}")


def test_schema_checks_profile_against_scene():
    text = "format: 1\nagent: a\nprofile: {age: 9, mood: x, size: 1}\ntree: {wait: 1 s}\n"
    found = "\n".join(problems("agent", text))
    assert "9 is greater than the maximum of 5" in found
    assert "'familiarity' is a required property" in found
    assert "'size' was unexpected" in found
    assert "'x' does not match" in found


def test_schema_types_fields_of_plugin_nodes():
    mode = NodeField(name="mode", content=Content.CONSTANT, required=False, words=("slow", "fast"))
    fields = {
        "blink": (
            NodeField(name="seconds", type=FieldType.DURATION, description="how long"),
            mode,
            NodeField(name="data", required=False),
        ),
        "talk": (NodeField(name="what"),),
        "nod": (),
        "turn": (mode,),
    }
    kinds = {
        key: NodeType(
            key=key,
            main=of_key[0].name if of_key else None,
            fields=of_key,
            description="Moves.",
            plugin=Behaviour,
        )
        for key, of_key in fields.items()
    }
    words = replace(SYMBOLS, plugins=kinds)
    validator = Draft7Validator(schema_of(AGENT, words))

    def fits(node: str) -> bool:
        return bool(validator.is_valid(loaded(f"{HEAD}tree: {node}\n")))

    assert fits("{blink: 5 s}")
    assert fits("{blink: {seconds: 5, mode: slow, data: [1, {a: b}]}}")
    assert fits("{talk: [1, 2]}")
    for key in ("nod", "turn"):
        assert fits(f"{{{key}: }}")
        assert fits(f"{{{key}: {{}}}}")
        assert not fits(f"{{{key}: 3}}")
    assert not fits("{blink: }")
    assert not fits("{blink: loud}")
    assert not fits("{blink: {mode: slow}}")
    assert not fits("{blink: {seconds: 5 s, mode: quick}}")
    properties = schema_of(AGENT, words)["definitions"]["node"]["properties"]
    assert properties["blink"]["description"] == "Moves."


def test_schema_command_output_passes_its_check(tmp_path):
    run = CliRunner().invoke
    arguments = [str(TREES), "--output", str(tmp_path / "schema")]
    assert run(schema, [*arguments, "--check"]).exit_code == 1
    written = run(schema, arguments)
    assert written.exit_code == 0
    assert sorted(path.name for path in (tmp_path / "schema").iterdir()) == sorted(
        map(schema_file, KINDS)
    )
    assert run(schema, [*arguments, "--check"]).output == ""
    (tmp_path / "schema" / "agent.schema.json").write_bytes(b"\xff")
    stale = run(schema, [*arguments, "--check"])
    assert stale.exit_code == 1
    assert "agent.schema.json is outdated" in stale.output
    assert run(schema, arguments).output.splitlines() == [
        f"wrote {tmp_path / 'schema' / 'agent.schema.json'}"
    ]
