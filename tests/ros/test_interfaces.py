# SPDX-License-Identifier: Apache-2.0
"""ROS types by name, and messages from plain data: strict, atomic, with helpful errors."""

from __future__ import annotations

import math
import os
import sys
from dataclasses import replace

import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import Bool, Byte, Empty, Float32, Float64, Int8, String, UInt16MultiArray

from bt_agents_core.errors import ReadError, Refused
from bt_agents_core.field_types import BindingKind
from bt_agents_interfaces.msg import Scene
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_ros.types import fill, load_type, read_field, to_plain, types_of
from file_texts import read_agent_text, read_skills_text
from tree_harness import SYMBOLS

POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"


def refusal(call, *arguments):
    with pytest.raises(Refused) as refused:
        call(*arguments)
    return refused.value


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nav2_msgs/action/NavigateToPose", "apt install ros-jazzy-nav2-msgs, or source"),
        ("std_msg/msg/Bool", "did you mean std_msgs/msg/Bool?"),
        ("std_msgs/msg/Boolean", "did you mean std_msgs/msg/Bool?"),
        ("std_msgs/Bool", "std_msgs/msg/Bool"),
        ("Bool", "expected package/msg/Name"),
        ("", "expected package/msg/Name"),
        ("std_msgs.msg/msg/Bool", "expected package/msg/Name"),
        ("../../etc/msg/Passwd", "expected package/msg/Name"),
        ("std_msgs/msg/Bool\n", "expected package/msg/Name"),
        (None, "expected package/msg/Name"),
    ],
)
def test_missing_type_error_says_how_to_install_it(name, words):
    refused = refusal(load_type, name)
    assert refused.code == "UNKNOWN_TYPE"
    assert words in refused.reason


def test_a_package_without_interfaces_is_never_imported(tmp_path, monkeypatch):
    (tmp_path / "trap").mkdir()
    (tmp_path / "trap" / "__init__.py").write_text("raise SystemExit('imported')")
    (tmp_path / "trap" / "msg.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    assert refusal(load_type, "trap/msg/Bool").code == "UNKNOWN_TYPE"
    assert "trap" not in sys.modules


def test_listed_package_without_python_code_is_reported(tmp_path, monkeypatch):
    entry = tmp_path / "share/ament_index/resource_index/rosidl_interfaces/half_msgs"
    entry.parent.mkdir(parents=True)
    entry.write_text("msg/Half.idl\nmsg/Half.msg\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert refusal(load_type, "half_msgs/msg/Half").code == "TYPE_NOT_LOADABLE"


def test_types_installed_later_are_found(tmp_path, monkeypatch):
    entry = tmp_path / "share/ament_index/resource_index/rosidl_interfaces/late_msgs"
    entry.parent.mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert list(types_of("late_msgs")) == []
    for second, files in enumerate(("msg/Half.msg", "msg/Half.idl\nmsg/Other.msg\nREADME")):
        entry.write_text(files)
        os.utime(entry, (second, second))
        assert list(types_of("late_msgs")) == ["msg/Half", "msg/Other"][: second + 1]
    entry.unlink()
    assert list(types_of("late_msgs")) == []


def test_a_type_of_another_kind_is_refused():
    assert refusal(load_type, "std_msgs/msg/Bool", BindingKind.ACTION).code == "WRONG_KIND"


def test_setting_nested_fields_keeps_other_fields():
    message = PoseWithCovarianceStamped()
    message.header.frame_id = "map"
    fill(message, {"header": {"stamp": 2.5}, "pose": {"pose": {"position": {"x": 1}}}})
    assert message.header.frame_id == "map"
    assert message.header.stamp == Time(sec=2, nanosec=500_000_000)
    assert message.pose.pose.position.x == 1.0
    assert message.pose.pose.orientation.w == 1.0


@pytest.mark.parametrize(
    ("message", "values", "code", "words"),
    [
        (Bool(), {"dat": True}, "UNKNOWN_FIELD", "no field 'dat'; did you mean data?"),
        (Empty(), {"data": 1}, "UNKNOWN_FIELD", "the message has no fields"),
        (Bool(), {"data": 1}, "WRONG_TYPE", "'data' is 1, expected true or false"),
        (Float64(), {"data": True}, "WRONG_TYPE", "'data' is true, expected a number"),
        (Float64(), {"data": "1"}, "WRONG_TYPE", "'data' is '1', expected a number"),
        (Float32(), {"data": 1e39}, "OUT_OF_RANGE", "too large"),
        (Float64(), {"data": 10**400}, "OUT_OF_RANGE", "too large"),
        (Int8(), {"data": 1.5}, "WRONG_TYPE", "'data' is 1.5, expected a whole number"),
        (Int8(), {"data": math.inf}, "WRONG_TYPE", "expected a whole number"),
        (Int8(), {"data": 128.0}, "OUT_OF_RANGE", "-128 to 127"),
        (Int8(), {"data": 128}, "OUT_OF_RANGE", "-128 to 127"),
        (Byte(), {"data": 256}, "OUT_OF_RANGE", "0 to 255"),
        (String(), {"data": 5}, "WRONG_TYPE", "'data' is 5, expected text"),
        (String(), {"data": None}, "WRONG_TYPE", "'data' is empty, expected text"),
        (String(), {"data": "a\0b"}, "WRONG_TYPE", "character"),
        (String(), {"data": "\ud800"}, "WRONG_TYPE", "character"),
        (Bool(), True, "WRONG_TYPE", "expected a mapping of fields"),
        (UInt16MultiArray(), {"data": 5}, "WRONG_TYPE", "expected a list"),
        (UInt16MultiArray(), {"data": [1, -1]}, "OUT_OF_RANGE", "'data.1'"),
        (Duration(), math.nan, "NOT_FINITE", "expected seconds"),
        (Time(), -1.0, "OUT_OF_RANGE", "-1 s"),
        (
            PoseWithCovarianceStamped(),
            {"pose": {"pose": {"positon": {}}}},
            "UNKNOWN_FIELD",
            "no field 'positon' in 'pose.pose'; did you mean position?",
        ),
        (
            PoseWithCovarianceStamped(),
            {"pose": {"covariance": [1.0]}},
            "WRONG_LENGTH",
            "'pose.covariance' has 1 items, expected 36",
        ),
        (Scene(), {"values": [{"nam": "x"}]}, "UNKNOWN_FIELD", "in 'values.0'"),
        (Scene(), {"label": "new", "person": "yes"}, "WRONG_TYPE", "'person' is 'yes'"),
    ],
)
def test_mismatched_value_is_refused_with_field_path(message, values, code, words):
    before = str(message)
    refused = refusal(fill, message, values)
    assert refused.code == code
    assert words in refused.reason
    assert str(message) == before


def test_float_fields_accept_nan_and_infinity():
    message = Float64()
    fill(message, {"data": math.nan})
    assert math.isnan(message.data)
    fill(message, {"data": math.inf})
    assert message.data == math.inf


def test_integer_field_takes_whole_float() -> None:
    message = Int8()
    fill(message, {"data": 6 / 2})
    assert message.data == 3


def test_a_negative_duration_has_positive_nanoseconds():
    message = Duration()
    fill(message, -1.5)
    assert (message.sec, message.nanosec) == (-2, 500_000_000)


def test_message_round_trips_through_plain_data():
    plain = {
        "header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": ""},
        "scene_id": "s",
        "label": "words",
        "person": True,
        "urgent": True,
        "person_id": "anna",
        "place": "lobby",
        "persons": 2,
        "visits": 3,
        "remembered": [],
        "values": [
            {
                "name": "mood",
                "value": 2.0,
                "origin": 2,
                "age_s": 0.0,
                "std": 0.5,
                "confidence": 0.75,
                "source": "words",
            }
        ],
    }
    message = Scene()
    fill(message, plain)
    assert to_plain(message) == plain
    byte = Byte()
    fill(byte, {"data": 200})
    assert to_plain(byte) == {"data": 200}
    assert to_plain(PoseWithCovarianceStamped())["pose"]["covariance"] == [0.0] * 36


def test_a_field_is_read_by_its_path():
    message = Scene()
    fill(message, {"values": [{"name": "mood"}], "header": {"stamp": 3}})
    assert read_field(message, "values.0.name") == "mood"
    assert read_field(message, "header.stamp") == {"sec": 3, "nanosec": 0}
    assert read_field(PoseWithCovarianceStamped(), "pose.covariance.35") == 0.0


@pytest.mark.parametrize(
    ("path", "code"),
    [
        ("values.1.name", "NO_SUCH_ITEM"),
        ("values.name", "UNKNOWN_FIELD"),
        ("person.x", "UNKNOWN_FIELD"),
        ("persn", "UNKNOWN_FIELD"),
        ("__class__", "UNKNOWN_FIELD"),
        ("", "UNKNOWN_FIELD"),
    ],
)
def test_path_to_missing_field_is_refused(path, code):
    message = Scene()
    fill(message, {"values": [{"name": "mood"}]})
    assert refusal(read_field, message, path).code == code


@pytest.mark.parametrize(
    ("kind", "type_name", "section", "path", "words"),
    [
        (BindingKind.TOPIC, POSE, "message", "pose.pose.position.x", None),
        (BindingKind.TOPIC, POSE, "message", "pose.covariance.35", None),
        (BindingKind.TOPIC, POSE, "message", "pose.covariance.36", "at most 36 items"),
        (BindingKind.TOPIC, POSE, "message", "pose.covariance.x", "is a list"),
        (BindingKind.TOPIC, POSE, "message", "pose.pose.position.x.y", "single value"),
        (BindingKind.TOPIC, POSE, "message", "pose.position", "there are pose, covariance"),
        (BindingKind.TOPIC, "bt_agents_interfaces/msg/Scene", "message", "values.7.name", None),
        (BindingKind.ACTION, "bt_agents_interfaces/action/Ask", "result", "answer", None),
        (BindingKind.ACTION, "bt_agents_interfaces/action/Ask", "goal", "answer", "no field"),
        (BindingKind.SERVICE, "std_srvs/srv/SetBool", "request", "data", None),
        (BindingKind.SERVICE, "std_srvs/srv/SetBool", "goal", "data", "has no goal"),
        (BindingKind.TOPIC, "no_msgs/msg/Thing", "message", "data", "not installed"),
    ],
)
def test_paths_are_checked_without_a_message(kind, type_name, section, path, words):
    problem = InstalledInterfaces().field_problem(kind, type_name, section, path)
    assert problem is None if words is None else words in problem


def test_type_must_match_its_binding_kind():
    interfaces = InstalledInterfaces()
    assert interfaces.type_problem(BindingKind.TOPIC, "std_msgs/msg/Bool") is None
    assert "not the type" in interfaces.type_problem(BindingKind.SERVICE, "std_msgs/msg/Bool")


def test_scalar_fields_have_types_and_others_are_any():
    known = InstalledInterfaces()

    def of(path: str, type_name: str = "geometry_msgs/msg/PoseWithCovarianceStamped") -> str:
        return known.field_type(BindingKind.TOPIC, type_name, "message", path).value

    assert of("header.frame_id") == "text"
    assert of("pose.pose.position.x") == "number"
    assert of("header.stamp.sec") == "integer"
    assert of("pose.covariance") == "any"
    assert of("pose.covariance.3") == "number"
    assert of("pose.nothing") == "any"
    assert of("data", "std_msgs/msg/Bool") == "boolean"


@pytest.mark.parametrize(
    ("tree", "expected"),
    [
        ("publish: {topic: t, type: std_msgs/msg/Bool, message: {data: 'yes'}}", "wrong-value"),
        ("publish: {topic: t, type: std_msgs/msg/UInt8, message: {data: 300}}", "wrong-value"),
        (
            "publish: {topic: t, type: geometry_msgs/msg/Pose, "
            "message: {position: {x: 1.0, y: left, z: '${scene.age}'}}}",
            "wrong-value",
        ),
        ("wait_for: {topic: t, type: std_msgs/msg/Bool, until: msg.data > 3}", "bad-expression"),
        ("wait_for: {topic: t, type: std_msgs/msg/Float64, until: msg.data}", "bad-expression"),
        ("service: {name: s, type: std_srvs/srv/SetBool, request: {data: 1}}", "wrong-value"),
        (
            "service: {name: s, type: std_srvs/srv/SetBool, succeed_when: result.message}",
            "bad-expression",
        ),
    ],
)
def test_values_and_conditions_are_checked_against_installed_types(tree, expected):
    symbols = replace(SYMBOLS, interfaces=InstalledInterfaces())
    head = "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\ntree: {"
    with pytest.raises(ReadError) as caught:
        read_agent_text(head + tree + "}\n", "a.yaml", symbols)
    assert [line.split("error[")[1].split("]")[0] for line in caught.value.lines] == [expected]
    read_agent_text(head + "say: x}\n", "a.yaml", symbols)


def test_numbers_of_skills_must_fit_their_field():
    topic = "topic: {name: t, type: std_msgs/msg/UInt8, message: {data: '${n}'}}"
    skills = f"format: 1\nskills: {{tally: {{main: n, inputs: {{n: integer}}, {topic}}}}}\n"
    skills = read_skills_text(skills, "s.yaml")
    symbols = replace(SYMBOLS, interfaces=InstalledInterfaces(), skills=skills)
    head = "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\ntree: "
    read_agent_text(head + "{tally: 200}\n", "a.yaml", symbols)
    with pytest.raises(ReadError, match="'data' does not fit, expected 0 to 255"):
        read_agent_text(head + "{tally: 300}\n", "a.yaml", symbols)


@pytest.mark.parametrize(
    ("choices", "found", "hint"),
    [
        ("[1, 2]", "'choices.0' is 1, expected text", 'write ["1", "2"]'),
        ("ja", "'choices' is 'ja', expected a list", 'write ["ja"]'),
        ("'ja, nein'", "'choices' is 'ja, nein', expected a list", 'write ["ja", "nein"]'),
        ("[[a]]", "'choices.0' is a list, expected text", ""),
    ],
)
def test_choices_are_checked_against_installed_type(choices, found, hint):
    symbols = replace(SYMBOLS, interfaces=InstalledInterfaces())
    head = "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\n"
    tree = f"tree: {{ask: {{text: A?, choices: {choices}}}}}\n"
    with pytest.raises(ReadError) as caught:
        read_agent_text(head + tree, "a.yaml", symbols)
    [problem] = caught.value.diagnostics
    assert problem.message == f"the robot does not take this: {found}"
    assert problem.hint == hint
