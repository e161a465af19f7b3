# SPDX-License-Identifier: Apache-2.0
"""Messages on topics of the nodes, typed by people."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from bt_agents_core.errors import Refused
from bt_agents_ros.types import to_plain
from bt_agents_tools.client.publication import typed_message


@pytest.mark.parametrize(
    ("type_name", "texts", "fields"),
    [
        ("std_msgs/msg/Bool", ["true"], {"data": True}),
        ("std_msgs/msg/Bool", ["data=true"], {"data": True}),
        ("std_msgs/msg/Bool", [], {"data": False}),
        ("std_msgs/msg/Float64", ["70"], {"data": 70.0}),
        ("std_msgs/msg/String", ["a=b"], {"data": "a=b"}),
        ("std_msgs/msg/String", ["5"], {"data": "5"}),
        ("std_msgs/msg/Empty", [], {}),
        ("std_msgs/msg/ColorRGBA", ["r=1", "a=0.5"], {"r": 1.0, "g": 0.0, "b": 0.0, "a": 0.5}),
        (
            "std_msgs/msg/Header",
            ["frame_id=7", "stamp.sec=3"],
            {"frame_id": "7", "stamp": {"sec": 3, "nanosec": 0}},
        ),
    ],
)
def test_typed_values_become_a_message(
    type_name: str, texts: Sequence[str], fields: dict[str, object]
) -> None:
    assert to_plain(typed_message(type_name, texts)) == fields


@pytest.mark.parametrize(
    ("type_name", "text", "code"),
    [
        ("std_msgs/msg/Bool", "yes", "WRONG_TYPE"),
        ("std_msgs/msg/Bool", "data=1", "WRONG_TYPE"),
        ("std_msgs/msg/Int8", "300", "OUT_OF_RANGE"),
        ("std_msgs/msg/Int8", "[" * 50_000, "WRONG_TYPE"),
        ("std_msgs/msg/ColorRGBA", "1", "NO_ASSIGNMENT"),
        ("std_msgs/msg/ColorRGBA", "red=1", "UNKNOWN_FIELD"),
        ("std_msgs/msg/Empty", "1", "NO_ASSIGNMENT"),
    ],
)
def test_mismatched_value_is_refused(type_name: str, text: str, code: str) -> None:
    with pytest.raises(Refused) as refused:
        typed_message(type_name, [text])
    assert refused.value.code == code
