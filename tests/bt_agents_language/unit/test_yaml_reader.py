# SPDX-License-Identifier: Apache-2.0
"""YAML with places: positions of nodes, refusals, and robustness."""

from __future__ import annotations

import pytest

from bt_agents_core.errors import ReadError
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.expression.quantities import QuantityError
from bt_agents_language.yaml.scalars import plain_value
from bt_agents_language.yaml.source import Source, read_source
from bt_agents_language.yaml.yaml_reader import MAX_DEPTH, Mapping, Scalar, Sequence, read_yaml


def read(text: str) -> Mapping:
    problems = Diagnostics(None)
    node = read_yaml(Source("a.yaml", text), problems)
    problems.raise_if_any()
    assert isinstance(node, Mapping)
    return node


def codes(text: str) -> list[str]:
    with pytest.raises(ReadError) as error:
        read(text)
    return [line.partition("error[")[2].partition("]")[0] for line in error.value.lines]


def scalar(text: str) -> Scalar:
    node = read(f"k: {text}\n").get("k")
    assert isinstance(node, Scalar)
    return node


def test_nodes_know_their_positions():
    text = "a: 1\nb:\n  - x\n  - {c: 'y z'}\n"
    root = read(text)
    listed = root.get("b")
    assert isinstance(listed, Sequence)
    inner = listed.items[1]
    assert isinstance(inner, Mapping)
    value = inner.get("c")
    assert isinstance(value, Scalar)
    assert str(value.position) == "a.yaml:4:9"
    assert text[slice(*value.span)] == "'y z'"
    assert text[slice(*inner.span)] == "{c: 'y z'}"
    assert (value.text, value.style) == ("y z", "'")


def test_positions_count_characters_not_bytes():
    text = "grüße: 👋\nname: x\n"
    root = read(text)
    for entry in root.entries:
        assert text[slice(*entry.key.span)] == entry.key.text
    assert root.entries[1].key.position.column == 1


def test_crlf_line_ends_and_bom_are_accepted(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_bytes("\ufeffa: 1\r\nb: x\r\n".encode())
    source = read_source(path)
    problems = Diagnostics(source)
    root = read_yaml(source, problems)
    assert isinstance(root, Mapping)
    assert [(e.key.text, e.key.position.line, e.key.position.column) for e in root.entries] == [
        ("a", 1, 1),
        ("b", 2, 1),
    ]
    assert source.line(2) == "b: x"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("-5", -5),
        ("1.5", 1.5),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("true", True),
        ("False", False),
        ("~", None),
        ("null", None),
        ("0x1F", 31),
        ("0o17", 15),
        ("5 s", 5.0),
        ("'5 s'", "5 s"),
        ('"1"', "1"),
        ("yes", "yes"),
        ("on", "on"),
        ("No", "No"),
        ("010", "010"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("2026-11-21", "2026-11-21"),
        ("5 m", 5.0),
        ("25 cm", 0.25),
        ("2 rad", 2.0),
        ("5 metres", "5 metres"),
    ],
)
def test_plain_scalars_follow_yaml_1_2(text, value):
    found = plain_value(scalar(text))
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize("text", [".inf", "-.INF", ".nan", "1e999", "9" * 30])
def test_invalid_numbers_are_rejected_as_plain_values(text):
    with pytest.raises(QuantityError):
        plain_value(scalar(text))


def test_nesting_depth_64_is_accepted_and_65_rejected():
    deep = MAX_DEPTH - 1
    read("k: " + "[" * deep + "]" * deep)
    assert codes("k: " + "[" * (deep + 1) + "]" * (deep + 1)) == ["too-deep"]


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("levels", [65, 999, 1_000, 1_001, 100_000])
@pytest.mark.parametrize(("start", "end"), [("[", "]"), ("{", "}"), ("[ [", "] ]"), ("{[", "]}")])
def test_level_65_is_reported_at_any_depth(start, end, levels, closed):
    count = levels // len(start.replace(" ", ""))
    text = "k: " + start * count + (end * count if closed else "")
    first = [index for index, letter in enumerate(text) if letter in "[{"][MAX_DEPTH - 1]
    with pytest.raises(ReadError) as error:
        read(text)
    assert [(one.code, one.position.column) for one in error.value.diagnostics] == [
        ("too-deep", first + 1)
    ]


def test_reading_stops_early_with_error_per_line():
    assert len(codes("a: 1\n" * 200_000)) < 200


def test_lone_surrogate_escape_is_an_error():
    assert codes('a: "\\ud800"') == ["syntax"]


@pytest.mark.parametrize("name", ["absent.yaml", "a\0b", "x" * 5000])
def test_missing_file_is_an_error(tmp_path, name):
    with pytest.raises(ReadError, match=r"1:1: error\[no-file\]"):
        read_source(tmp_path / name)


def test_folder_is_not_a_file(tmp_path):
    with pytest.raises(ReadError, match=r"error\[not-a-file\]: this is a folder"):
        read_source(tmp_path)


def test_symlink_cycle_is_an_error(tmp_path):
    (tmp_path / "a.yaml").symlink_to(tmp_path / "b.yaml")
    (tmp_path / "b.yaml").symlink_to(tmp_path / "a.yaml")
    with pytest.raises(ReadError, match=r"error\[no-file\]: the file cannot be read"):
        read_source(tmp_path / "a.yaml")


def test_symlink_to_file_is_accepted(tmp_path):
    (tmp_path / "a.yaml").write_text("a: 1")
    (tmp_path / "b.yaml").symlink_to(tmp_path / "a.yaml")
    assert read_source(tmp_path / "b.yaml").text == "a: 1"
