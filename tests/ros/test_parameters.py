# SPDX-License-Identifier: Apache-2.0
"""Parameter services of every node: hostile requests are answered, and no value is lost."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import rclpy
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter as NodeParameter

from active_nodes import active_feedback, active_host, active_market, active_scene_layer
from bt_agents_core.errors import Refused
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.model.specs import Script
from bt_agents_robot.robot import RobotNode
from bt_agents_robot.visitors import VisitorsNode
from bt_agents_ros import qos
from bt_agents_ros.base_node import BaseNode
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.parameters import declare, describe, report_unknown
from feedback_node.ledger import Ledger
from marketplace_node.external_ranking.openai_protocol import Endpoint
from marketplace_node.node.parameters import declare_settings, watch_settings
from marketplace_node.node.selector import SelectorNode
from tree_harness import SPACE, TREES

SILENT_ROBOT = NodeParameter("voice", value="off")
NODES = {
    "agents": lambda: active_host(read_trees(TREES, InstalledInterfaces())),
    "marketplace": lambda: active_market(SPACE),
    "selector": lambda: SelectorNode(
        SPACE, Endpoint(base_url="http://127.0.0.1:9/v1", model="none")
    ),
    "scene_layer": lambda: active_scene_layer(read_scene(TREES / "scene.yaml")),
    "feedback": lambda: active_feedback(SPACE, Ledger(":memory:")),
    "robot": lambda: RobotNode(parameter_overrides=[SILENT_ROBOT]),
    "visitors": lambda: VisitorsNode(
        read_scene(TREES / "scene.yaml"), Script(title="", visits=())
    ),
}

DOUBLE = ParameterType.PARAMETER_DOUBLE


def parameter(name: str, **value: Any) -> Parameter:
    return Parameter(name=name, value=ParameterValue(**value))


def number(name: str, value: float) -> Parameter:
    return parameter(name, type=DOUBLE, double_value=value)


class Asking:
    """The clients of the parameter services of one node."""

    def __init__(self, ros: Any, node: str) -> None:
        self._ros = ros
        self._clients = {
            kind: ros.node.create_client(kind, f"{node}/{name}", qos_profile=qos.SERVICE)
            for kind, name in (
                (DescribeParameters, "describe_parameters"),
                (GetParameters, "get_parameters"),
                (GetParameterTypes, "get_parameter_types"),
                (ListParameters, "list_parameters"),
                (SetParameters, "set_parameters"),
                (SetParametersAtomically, "set_parameters_atomically"),
            )
        }

    def ask(self, kind: Any, **request: Any) -> Any:
        return self._ros.call(self._clients[kind], kind.Request(**request))

    def set_each(self, *parameters: Parameter) -> list[Any]:
        return list(self.ask(SetParameters, parameters=list(parameters)).results)

    def set_all(self, *parameters: Parameter) -> Any:
        return self.ask(SetParametersAtomically, parameters=list(parameters)).result

    def values(self) -> dict[str, Any]:
        names = self.ask(ListParameters, depth=0).result.names
        return dict(zip(names, self.ask(GetParameters, names=names).values, strict=True))


MALFORMED = [
    (parameter("use_sim_time", type=200), "UNKNOWN_TYPE"),
    (parameter("use_sim_time", type=255), "UNKNOWN_TYPE"),
    (parameter("use_sim_time", type=ParameterType.PARAMETER_NOT_SET), "undeclared"),
    (number("use_sim_time", 1.0), "type"),
    (parameter("", type=1, bool_value=True), "UNKNOWN_PARAMETER"),
    (number("no_such_parameter", 1.0), "UNKNOWN_PARAMETER"),
    (number("x" * 100_000, 1.0), "UNKNOWN_PARAMETER"),
    (parameter("use_sim_time.\n../\u202e", type=200), "UNKNOWN_PARAMETER"),
    (parameter("use_sim_time", type=9, string_array_value=["x"] * 2000), "type"),
]


@pytest.mark.parametrize("name", NODES)
def test_hostile_parameter_requests_change_nothing(ros: Any, name: str) -> None:
    ros.add(NODES[name]())
    asking = Asking(ros, name)
    before = asking.values()
    for malformed, reason in MALFORMED:
        [single] = asking.set_each(malformed)
        together = asking.set_all(malformed)
        for result in (single, together):
            assert not result.successful
            assert reason in result.reason
            assert len(result.reason) < 1000
    numbers = [name for name, value in before.items() if value.type == DOUBLE]
    for value in (math.nan, math.inf, -math.inf, 1e308):
        for result in asking.set_each(*(number(name, value) for name in numbers)):
            assert not result.successful
            assert result.reason
    for names in (
        [""],
        ["no_such_parameter"],
        ["use_sim_time", "x" * 100_000],
        ["\udfff".encode(errors="replace").decode(), "use_sim_time.."],
    ):
        assert asking.ask(DescribeParameters, names=names).descriptors == []
        assert asking.ask(GetParameters, names=names).values == []
        assert len(asking.ask(GetParameterTypes, names=names).types) == 0
    for prefixes in (["x" * 100_000], [".", "..", "\n"]):
        result = asking.ask(ListParameters, prefixes=prefixes, depth=2**64 - 1).result
        assert result.names == []
    assert asking.ask(ListParameters, prefixes=["use_sim_time"]).result.names == ["use_sim_time"]
    assert asking.ask(GetParameterTypes, names=["use_sim_time"]).types[0] == 1
    assert asking.values() == before


@pytest.mark.parametrize(
    ("value", "default", "reason"),
    [
        (math.inf, 1.0, "OUT_OF_RANGE: .*NOT_FINITE: parameter 'size' is inf"),
        ("x", 1.0, "WRONG_TYPE: .*'STRING', expecting type 'DOUBLE': size$"),
        (False, "auto", """WRONG_TYPE: .*; a text needs quotes: -p "size:='off'"$"""),
    ],
)
def test_wrong_start_value_is_a_readable_error(
    ros: Any, value: object, default: float | str, reason: str
) -> None:
    node = ros.add(BaseNode("sample", parameter_overrides=[NodeParameter("size", value=value)]))
    with pytest.raises(Refused, match=reason):
        declare(node, "size", default, describe("its size"))


def test_whole_number_at_start_is_a_double(ros: Any) -> None:
    node = ros.add(BaseNode("sample", parameter_overrides=[NodeParameter("size", value=12)]))
    assert str(declare(node, "size", 1.0, describe("its size"))) == "12.0"


def test_parameter_lists_apply_individually_and_atomic_sets_together(ros: Any) -> None:
    ros.add(NODES["marketplace"]())
    asking = Asking(ros, "marketplace")
    good, bad = number("bid_deadline", 2.0), parameter("bid_deadline", type=200)
    assert [r.successful for r in asking.set_each(good, bad)] == [True, False]
    assert asking.values()["bid_deadline"].double_value == 2.0
    assert not asking.set_all(number("bid_deadline", 3.0), bad).successful
    assert asking.values()["bid_deadline"].double_value == 2.0
    assert asking.set_all(number("bid_deadline", 3.0)).successful
    assert asking.values()["bid_deadline"].double_value == 3.0


def test_failing_parameter_callback_is_answered_and_node_continues(ros: Any) -> None:
    node: Any = ros.add(BaseNode("sample"))
    node.declare_parameter("size", 1.0)

    def fail(_parameters: Any) -> Any:
        raise ZeroDivisionError("no way")

    node.add_on_set_parameters_callback(fail)
    asking = Asking(ros, "sample")
    [result] = asking.set_each(number("size", 2.0))
    assert result.reason.startswith("FAILED: ZeroDivisionError: no way")
    assert asking.values()["size"].double_value == 1.0


def test_unknown_parameter_is_named_with_closest_match(
    ros: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    given = [NodeParameter("hieght", value=1.0), NodeParameter("use_sim_time", value=False)]
    node = ros.add(BaseNode("tower", parameter_overrides=given))
    declare(node, "height", 2.0, describe("how high it is [m]"))
    assert report_unknown(node) == {"hieght": "height"}
    log = capfd.readouterr().err
    assert "UNKNOWN_PARAMETER: tower has no parameter 'hieght'" in log
    assert "did you mean 'height'?" in log
    assert "use_sim_time" not in log


def test_slow_network_extends_market_timeouts(ros: Any) -> None:
    slow = NodeParameter("slow_network", value=4.0)
    node = ros.add(rclpy.create_node("market", parameter_overrides=[slow]))
    settings = declare_settings(node)
    waits = (settings.bid_deadline_s, settings.host_lease_s, settings.collect_deadline_s)
    assert waits == (2.0, 3.2, 2.0)
    taken: list[Any] = []
    watch_settings(node, lambda: settings, taken.append)
    node.set_parameters([NodeParameter("bid_deadline", value=1.0)])
    assert taken[-1] == replace(settings, bid_deadline_s=4.0)
    node.set_parameters([NodeParameter("host_lease", value=60.0)])
    assert taken[-1].host_lease_s == 60.0, "the longest that there is"
