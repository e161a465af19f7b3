# SPDX-License-Identifier: Apache-2.0
"""ROS parameter files that a command passes to its nodes: what belongs to no node."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.params_file import params_option
from bt_agents_tools.launcher import parameter_file
from bt_agents_tools.launcher.parameter_file import ParameterFile


def judged(folder: Path, text: str, unknown: parameter_file.UnknownByNode) -> dict[str, str]:
    file = folder / "my.yaml"
    file.write_text(text)
    return parameter_file.unknown_in(parameter_file.read_parameters(file), unknown)


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
        ("/**", "deadlin", True),
        ("/library/*", "deadlin", True),
        ("market", "deadline", False),
        ("market", "pace", True),
        ("/library/market", "pace", True),
        ("/**/market", "pace", True),
        ("elsewhere", "pace", False),
    ],
)
def test_parameter_that_no_meant_node_has_is_unknown(
    tmp_path: Path, section: str, given: str, left: bool
) -> None:
    text = f"{section}: {{ros__parameters: {{{given}: 1.0}}}}"
    expected = {f"{section.strip('/')} {given}"} if left else set()
    assert judged(tmp_path, text, UNKNOWN).keys() == expected


def test_nested_parameters_have_names_with_points(tmp_path: Path) -> None:
    text = "robot: {ros__parameters: {voice: {rate: 1.0, volum: {left: 1}}}}"
    unknown = {"/robot": {"voice.volum.left": ""}}
    assert [*judged(tmp_path, text, unknown)] == ["robot voice.volum.left"]


@pytest.mark.parametrize("section", ["/**", "agents"])
def test_inactive_node_may_have_any_parameter(tmp_path: Path, section: str) -> None:
    text = f"{section}: {{ros__parameters: {{tick_rate: 1.0}}}}"
    assert [*judged(tmp_path, text, {"/agents": None, "/robot": {"tick_rate": ""}})] == []


def test_most_unknown_parameters_are_counted_only(tmp_path: Path) -> None:
    given = {f"x{number}": "" for number in range(10_000)}
    text = f"robot: {{ros__parameters: {{{', '.join(f'{name}: 1' for name in given)}}}}}"
    found = judged(tmp_path, text, {"/robot": given})
    assert len(found) == parameter_file.MOST_NAMED + 1
    assert found["others"].startswith("my.yaml: 9990 more such parameters")


def test_hostile_name_is_printable_and_short(tmp_path: Path) -> None:
    name = "\x1b[31m" + "x" * 1_000
    text = f'robot: {{ros__parameters: {{"\\e[31m{"x" * 1_000}": 1}}}}'
    [told] = judged(tmp_path, text, {"/robot": {name: ""}}).values()
    assert told.isprintable()
    assert len(told) < 500


@click.command()
@params_option
def command(params: ParameterFile | None) -> None:
    click.echo(f"started with {params and params.path.name}")


def told(folder: Path, text: str) -> str:
    file = folder / "params.yaml"
    file.write_text(text)
    result = CliRunner().invoke(command, ["--params", str(file)])
    if isinstance(result.exception, BtAgentsError):
        return str(result.exception)
    return result.output


@pytest.mark.parametrize(
    ("namespace", "text"),
    [
        ("", "/**: {ros__parameters: {tick_rate: 20.0}}"),
        ("", "library: {marketplace: {ros__parameters: {}}, agents: {ros__parameters: {}}}"),
        ("", "a_host_of_mine: {ros__parameters: {}}"),
        ("/library", "/**/marketplace: {ros__parameters: {}}"),
        ("/library", "/library/marketplace: {ros__parameters: {}}"),
        ("/library", "library/agents: {ros__parameters: {}}"),
    ],
)
def test_ros_parameter_file_is_accepted_silently(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, namespace: str, text: str
) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", namespace)
    assert told(tmp_path, text) == "started with params.yaml\n"


def test_misspelt_node_is_reported(tmp_path: Path) -> None:
    assert told(tmp_path, "/library/marketplce: {ros__parameters: {}}") == (
        "params.yaml: no node is called 'marketplce'; did you mean 'marketplace'?\n"
        "started with params.yaml\n"
    )


@pytest.mark.parametrize("key", ["marketplace", "/marketplace"])
def test_node_outside_the_namespace_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str
) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", "/library")
    assert told(tmp_path, f"{key}: {{ros__parameters: {{}}}}") == (
        "params.yaml: 'marketplace' names no node, as ROS_NAMESPACE is 'library', so its values "
        "count for nothing; write '/**/marketplace' or '/library/marketplace'\n"
        "started with params.yaml\n"
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("marketplace: {bid_deadline: 3.0}", "there is no 'ros__parameters' below 'bid_deadline'"),
        ("[1, 2]", "there is no 'ros__parameters' in it"),
        ("a: {b: 1\nc: }", "line 2: it is not YAML"),
        ("a: \x07", "it is not YAML"),
        ("a: &x {ros__parameters: {}}\nb: *x", "it has an alias such as '*name'"),
        (f"a: {'{a: ' * 40}1{'}' * 40}", "there is no 'ros__parameters' below 'a'"),
        ("#" * 1_000_001, "is larger than 1,000,000 bytes"),
    ],
)
def test_malformed_file_is_refused_with_explanation(tmp_path: Path, text: str, words: str) -> None:
    assert words in told(tmp_path, text)
