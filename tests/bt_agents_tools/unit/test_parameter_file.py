# SPDX-License-Identifier: Apache-2.0
"""ROS parameter files: which parameters belong to no node."""

from __future__ import annotations

from pathlib import Path

import pytest

from bt_agents_tools.launcher.parameter_file import (
    MOST_NAMED,
    UnknownByNode,
    read_parameters,
    unknown_in,
)


def judged(folder: Path, text: str, unknown: UnknownByNode) -> dict[str, str]:
    file = folder / "my.yaml"
    file.write_text(text)
    return unknown_in(read_parameters(file), unknown)


def names(folder: Path, text: str, unknown: UnknownByNode) -> list[str]:
    return list(judged(folder, text, unknown))


# Parameters that the market and the robot lack: one of its own each, and 'shared' in both.
UNKNOWN = {
    "/library/market": {"pace": "", "deadlin": "deadline", "paec": ""},
    "/library/robot": {"deadline": "", "deadlin": "", "paec": "pace"},
}


@pytest.mark.parametrize(
    ("section", "given", "left"),
    [
        ("/**", "shared", False),
        ("/**", "pace", False),
        ("/**", "deadline", False),
        ("/**", "deadlin", True),
        ("/library/*", "deadlin", True),
        ("market", "deadline", False),
        ("market", "pace", True),
        ("/library/market", "pace", True),
        ("/**/market", "pace", True),
        ("/**/robot", "pace", False),
        ("elsewhere", "pace", False),
    ],
)
def test_parameter_that_no_meant_node_has_is_unknown(
    tmp_path: Path, section: str, given: str, left: bool
) -> None:
    text = f"{section}: {{ros__parameters: {{{given}: 1.0}}}}"
    expected = [f"{section.strip('/')} {given}"] if left else []
    assert names(tmp_path, text, UNKNOWN) == expected


def test_sentence_names_node_and_nearest_parameter(tmp_path: Path) -> None:
    text = "market: {ros__parameters: {deadlin: 1.0}}\n/**: {ros__parameters: {paec: 1.0}}"
    assert list(judged(tmp_path, text, UNKNOWN).values()) == [
        "my.yaml: market has no parameter 'deadlin', so its value counts for nothing; did you "
        "mean 'deadline'?",
        "my.yaml: no node here has a parameter 'paec', so its value counts for nothing; did you "
        "mean 'pace'?",
    ]


def test_nested_parameters_have_names_with_points(tmp_path: Path) -> None:
    text = "robot: {ros__parameters: {voice: {rate: 1.0, volum: {left: 1}}}}"
    unknown = {"/robot": {"voice.volum.left": ""}}
    assert names(tmp_path, text, unknown) == ["robot voice.volum.left"]


@pytest.mark.parametrize("section", ["/**", "agents"])
def test_inactive_node_may_have_any_parameter(tmp_path: Path, section: str) -> None:
    text = f"{section}: {{ros__parameters: {{tick_rate: 1.0}}}}"
    assert names(tmp_path, text, {"/agents": None, "/robot": {"tick_rate": ""}}) == []


def test_most_unknown_parameters_are_counted_only(tmp_path: Path) -> None:
    given = {f"x{number}": "" for number in range(10_000)}
    text = f"robot: {{ros__parameters: {{{', '.join(f'{name}: 1' for name in given)}}}}}"
    found = judged(tmp_path, text, {"/robot": given})
    assert len(found) == MOST_NAMED + 1
    assert found["others"].startswith("my.yaml: 9990 more such parameters")


def test_hostile_name_is_printable_and_short(tmp_path: Path) -> None:
    name = "\x1b[31m" + "x" * 1_000
    text = f'robot: {{ros__parameters: {{"\\e[31m{"x" * 1_000}": 1}}}}'
    [told] = judged(tmp_path, text, {"/robot": {name: ""}}).values()
    assert told.isprintable()
    assert len(told) < 500
