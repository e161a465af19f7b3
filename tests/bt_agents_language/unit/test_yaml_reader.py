# SPDX-License-Identifier: Apache-2.0
"""YAML with places: positions of nodes, refusals, and robustness."""

from __future__ import annotations

import pytest

from agent_texts import refusal
from bt_agents_core.errors import ReadError
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.expression.quantities import QuantityError
from bt_agents_language.yaml.scalars import plain_value
from bt_agents_language.yaml.source import Source, read_source
from bt_agents_language.yaml.yaml_reader import MAX_DEPTH, Mapping, Scalar, read_yaml


def read(text: str) -> Mapping:
    problems = Diagnostics(None)
    node = read_yaml(Source("a.yaml", text), problems)
    problems.raise_if_any()
    assert isinstance(node, Mapping)
    return node


def codes(text: str) -> list[str]:
    return [one.code for one in refusal(read, text).diagnostics]


def scalar(text: str) -> Scalar:
    node = read(f"k: {text}\n").get("k")
    assert isinstance(node, Scalar)
    return node


def test_nodes_know_their_positions():
    text = "a: 1\nb:\n  - x\n  - {c: 'y z'}\n"
    inner = read(text).get("b").items[1]
    value = inner.get("c")
    assert isinstance(value, Scalar)
    assert (value.text, value.style, str(value.position)) == ("y z", "'", "a.yaml:4:9")
    assert text[slice(*inner.span)] == "{c: 'y z'}"


def test_crlf_line_ends_and_bom_are_accepted(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_bytes("\ufeffa: 1\r\nb: x\r\n".encode())
    source = read_source(path)
    root = read_yaml(source, Diagnostics(source))
    assert isinstance(root, Mapping)
    assert [str(e.key.position) for e in root.entries] == [f"{path}:1:1", f"{path}:2:1"]
    assert source.line(2) == "b: x"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("true", True),
        ("False", False),
        ("~", None),
        ("0x1F", 31),
        ("0o17", 15),
        ("5 s", 5.0),
        ("'5 s'", "5 s"),
        ('"1"', "1"),
        ("yes", "yes"),
        ("1_000", "1_000"),
        ("5 m", 5.0),
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
    (one,) = refusal(read, text).diagnostics
    assert (one.code, one.position.column) == ("too-deep", first + 1)


def test_reading_stops_early_with_error_per_line():
    assert len(refusal(read, "a: 1\n" * 200_000).lines) < 200


def test_lone_surrogate_escape_is_an_error():
    assert codes('a: "\\ud800"') == ["syntax"]


@pytest.mark.parametrize("name", ["absent.yaml", "a\0b", "x" * 5000])
def test_missing_file_is_an_error(tmp_path, name):
    with pytest.raises(ReadError, match=r"1:1: error\[no-file\]"):
        read_source(tmp_path / name)
