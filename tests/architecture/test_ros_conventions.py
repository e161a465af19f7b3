# SPDX-License-Identifier: Apache-2.0
"""Conventions of all nodes in the sources: one runner, one table of QoS, steady timers."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator

import pytest

from checkout import PYTHON_PACKAGES, ROOT
from product_modules import product_modules

PACKAGES = (
    "bt_agents_ros",
    "bt_agents",
    "marketplace_node",
    "scene_layer",
    "feedback_node",
    "bt_agents_tools",
    "bt_agents_robot",
)
RUNNER = "bt_agents_ros/bt_agents_ros/spinner.py"
QOS = "bt_agents_ros/bt_agents_ros/qos.py"
BUS = "bt_agents_ros/bt_agents_ros/workarounds/local_endpoints.py"
"""It creates its endpoints as its nodes specify."""

RELOADING = "bt_agents/bt_agents/host/reload/reload_service.py"
"""Its thread yields to the node's own."""

PLAIN = ("rclpy", "executor")
ACTION_SERVERS = ("ActionServer", "QuietActionServer")

SOURCES = {
    str(path.relative_to(ROOT)): ast.parse(path.read_text())
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
    if re.search(r"rclpy|bt_agents_ros\.spinner", path.read_text())
    or path.is_relative_to(ROOT / "bt_agents_ros")
}
"""All sources that use ROS."""


def name_of(node: ast.expr) -> str:
    """Return the last name of ``a.b.c`` or ``c``; empty for anything else."""
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def calls(tree: ast.AST) -> Iterator[tuple[str, ast.Call, list[ast.expr]]]:
    """Yield the name, the call and the arguments of each call, including those by ``partial``."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        if name_of(node.func) == "partial" and node.args:
            yield name_of(node.args[0]), node, node.args[1:]
        else:
            yield name_of(node.func), node, node.args


def from_the_table(value: ast.expr | None) -> bool:
    """Return whether a quality of service is ``qos.SOMETHING`` or an argument."""
    if isinstance(value, ast.Attribute):
        return name_of(value.value) == "qos"
    return isinstance(value, ast.Name)


def keyword(call: ast.Call, *names: str) -> ast.expr | None:
    return next((k.value for k in call.keywords if k.arg in names), None)


def own_qos(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield profiles outside the table."""
    for name, call, _ in calls(tree):
        if name == "QoSProfile":
            yield call
    for node in ast.walk(tree):
        if isinstance(node, ast.alias) and node.name.startswith("qos_profile_"):
            yield node


def topics_without_table(tree: ast.AST) -> Iterator[ast.AST]:
    places = {"create_publisher": 2, "create_subscription": 3}
    for name, call, arguments in calls(tree):
        if name in places:
            place = places[name]
            given = arguments[place] if len(arguments) > place else keyword(call, "qos_profile")
            if not from_the_table(given):
                yield call


def services_without_table(tree: ast.AST) -> Iterator[ast.AST]:
    kinds = [f"{kind}_service_qos_profile" for kind in ("goal", "result", "cancel")]
    wanted = {
        "create_client": ["qos_profile"],
        "create_service": ["qos_profile"],
        **dict.fromkeys(("ActionClient", *ACTION_SERVERS), kinds),
    }
    for name, call, _ in calls(tree):
        if any(not from_the_table(keyword(call, option)) for option in wanted.get(name, [])):
            yield call


def endless_servers(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield actions that keep each result for 15 minutes, as rclpy does by default."""
    for name, call, _ in calls(tree):
        if name in ACTION_SERVERS and keyword(call, "result_timeout") is None:
            yield call


def unsteady_timers(tree: ast.AST) -> Iterator[ast.AST]:
    for name, call, _ in calls(tree):
        if name == "create_timer" and keyword(call, "clock") is None:
            yield call
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and name_of(node.value) == "ClockType":
            yield from [node] * (node.attr != "STEADY_TIME")


def spinning(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield executors, and spinning outside the project's own spinner and observer."""
    for name, call, _ in calls(tree):
        by = name_of(getattr(call.func, "value", call.func))
        ours = name in ("spin_once", "spin_until") and not by.endswith(PLAIN)
        if name.endswith("Executor") or (name.startswith("spin") and not ours):
            yield call


def initialising(tree: ast.AST) -> Iterator[ast.AST]:
    for name, call, _ in calls(tree):
        if name == "init" and name_of(getattr(call.func, "value", call.func)) == "rclpy":
            yield call


def blocking(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield waits that block the executor, and calls that wait for their answer."""
    for name, call, _ in calls(tree):
        waits = name in ("wait_for_service", "wait_for_server", "sleep", "send_goal")
        if waits or (name == "call" and name_of(getattr(call.func, "value", call)) == "client"):
            yield call


def plain_nodes(tree: ast.AST) -> Iterator[ast.AST]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and any(name_of(base) == "Node" for base in node.bases):
            yield node


def served_nodes(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield nodes with rclpy's parameter services, which one malformed request crashes."""
    for name, call, _ in calls(tree):
        off = keyword(call, "start_parameter_services")
        if name == "create_node" and not (isinstance(off, ast.Constant) and off.value is False):
            yield call


@pytest.mark.parametrize(
    ("offences", "allowed"),
    [
        (own_qos, (QOS,)),
        (topics_without_table, (BUS,)),
        (services_without_table, (BUS,)),
        (endless_servers, ()),
        (unsteady_timers, ()),
        (spinning, (RUNNER,)),
        (initialising, (RUNNER,)),
        (plain_nodes, (BUS,)),
        (served_nodes, ()),
        (blocking, (RELOADING,)),
    ],
)
def test_all_sources_follow_convention(
    offences: Callable[[ast.AST], Iterator[ast.AST]], allowed: tuple[str, ...]
) -> None:
    found = {
        path: [getattr(node, "lineno", 0) for node in offences(tree)]
        for path, tree in SOURCES.items()
        if path not in allowed
    }
    assert {path: lines for path, lines in found.items() if lines} == {}
    for path in allowed:
        assert list(offences(SOURCES[path])), f"{path} needs no exception any more"


def test_every_executable_of_the_packages_is_loaded_silently() -> None:
    modules = product_modules()
    for package in PYTHON_PACKAGES:
        if package.name in PACKAGES:
            scripts = package.executables()
            assert scripts or package.name == "bt_agents_ros"
            for script, target in scripts.items():
                module, _, function = target.partition(":")
                text = modules[module].read_text()
                assert "rclpy" not in text, f"{script} imports rclpy before it is silent"
                assert function
