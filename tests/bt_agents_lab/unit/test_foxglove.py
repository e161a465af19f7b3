# SPDX-License-Identifier: Apache-2.0
"""The layout for Foxglove: its topics and fields exist, and its page lists them all."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

import pytest
import yaml

from bt_agents_interfaces.msg import MarketStatus
from bt_agents_ros.system_topics import TOPICS, topic_called
from bt_agents_ros.types import load_type
from checkout import ROOT

TEXT = (files("bt_agents_lab") / "foxglove" / "bt_agents.json").read_text()
LAYOUT: dict[str, Any] = json.loads(TEXT)
PANELS: dict[str, dict[str, Any]] = LAYOUT["configById"]
PAGE = (ROOT / "docs" / "journal.md").read_text()

TOPIC = re.compile(r"(?:/[A-Za-z0-9_]+)+")
STEP = re.compile(
    r"\.(?P<name>[A-Za-z0-9_]+)|\[(?P<slice>-?\d*:?-?\d*)\]"
    r"|\{(?P<field>\w+)(?:==|!=|<=|>=|<|>)(?P<value>[^}]+)\}"
)
WHOLE = re.compile(r"u?int\d+|octet")
NUMBER = re.compile(r"(u?int\d+|octet|float|double)")


def paths_of(panel: dict[str, Any]) -> list[str]:
    """Return the message paths and topics of a panel."""
    return [
        *(one["value"] for one in panel.get("paths", ())),
        *(panel[key] for key in ("path", "topicPath", "topicToRender") if key in panel),
    ]


PATHS = [(name, path) for name, panel in PANELS.items() for path in paths_of(panel)]


def field_type(type_name: str, field: str) -> str:
    """Return the type of a message field, such as ``float64[]``; KeyError if there is none."""
    assert "/" in type_name, f"{type_name} has no fields"
    package, name = type_name.split("/")[:: 2 if "/msg/" in type_name else 1]
    fields = load_type(f"{package}/msg/{name}").get_fields_and_field_types()
    return re.sub(r"^sequence<(.+?)(?:, \d+)?>$", r"\1[]", fields[field])


def check_filter(type_name: str, field: str, value: str) -> None:
    found = field_type(type_name, field)
    if value.startswith("$"):
        assert value[1:] in LAYOUT["globalVariables"]
    elif found == "boolean":
        assert value in ("true", "false")
    else:
        assert found == "string"
        assert re.fullmatch(r'"[^"]*"', value)


def end_type(path: str) -> str:
    """Return the type at the end of a message path, after checking all its parts."""
    topic = TOPIC.match(path)
    assert topic
    found, place = topic_called(topic[0]).type, topic.end()
    while place < len(path):
        step = STEP.match(path, place)
        assert step, path[place:]
        if step["name"]:
            assert not found.endswith("[]"), f"{found} has no fields"
            found = field_type(found, step["name"])
        elif step["slice"] is not None:
            assert found.endswith("[]")
            found = found.removesuffix("[]")
        else:
            check_filter(found, step["field"], step["value"])
        place = step.end()
    return found


@pytest.mark.parametrize(("panel", "path"), PATHS)
def test_every_message_path_fits_its_panel(panel: str, path: str) -> None:
    found = end_type(path)
    match panel.partition("!")[0]:
        case "Plot":
            assert NUMBER.fullmatch(found)
        case "StateTransitions" | "Indicator":
            assert found in ("string", "boolean") or WHOLE.fullmatch(found)
        case "Table":
            assert found.endswith("[]")
            assert "/" in found
        case "DiagnosticSummary":
            assert found == "diagnostic_msgs/msg/DiagnosticArray"
        case other:
            assert other == "RawMessages"


def test_journal_holds_topics_shown_by_panels() -> None:
    own = {one.name for one in TOPICS if "journal" in one.publishers}
    for _, path in PATHS:
        match = TOPIC.match(path)
        assert match
        topic = topic_called(match[0])
        assert "journal" in topic.listeners or topic.name in own, path


def test_every_panel_stands_in_layout_once() -> None:
    def leaves(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
            return
        assert node["direction"] in ("row", "column")
        assert 0 < node["splitPercentage"] < 100
        yield from leaves(node["first"])
        yield from leaves(node["second"])

    assert sorted(leaves(LAYOUT["layout"])) == sorted(PANELS)
    assert len({panel["foxglovePanelTitle"] for panel in PANELS.values()}) == len(PANELS)


def test_market_states_match_their_message_constants() -> None:
    for rule in PANELS["Indicator!market"]["rules"]:
        assert getattr(MarketStatus, rule["label"].upper()) == int(rule["rawValue"])


def test_plots_show_parameters_and_agent_of_shipped_trees() -> None:
    parameters = list(yaml.safe_load((ROOT / "trees" / "scene.yaml").read_text())["parameters"])
    assert [one["label"] for one in PANELS["Plot!profile"]["paths"]] == parameters
    assert [re.findall(r'"(\w+)"', one["value"]) for one in PANELS["Plot!scene"]["paths"]] == [
        [name] for name in parameters
    ]
    assert (ROOT / "trees" / "agents" / f"{LAYOUT['globalVariables']['agent']}.yaml").exists()


def test_page_has_row_with_message_paths_per_panel() -> None:
    rows = {
        cells[0]: re.findall("`([^`]+)`", cells[-1])
        for line in PAGE.splitlines()
        if (cells := [one.strip() for one in line.strip("|").split("|")]) and len(cells) == 3
    }
    for panel in PANELS.values():
        assert rows[panel["foxglovePanelTitle"]] == paths_of(panel)


def test_namespaced_layout_has_all_topics_in_namespace() -> None:
    [script] = re.findall(r"^sed -E '(.+)' bt_agents.json", PAGE, re.MULTILINE)
    text = subprocess.run(
        ["sed", "-E", script], input=TEXT, capture_output=True, text=True, check=True, timeout=10
    ).stdout
    for panel in json.loads(text)["configById"].values():
        for path in paths_of(panel):
            assert path.startswith("/robot1/") != (path == "/diagnostics")
