# SPDX-License-Identifier: Apache-2.0
"""Definition of a type: contains every type that it uses, once."""

from __future__ import annotations

import pytest
from mcap_ros2._dynamic import generate_dynamic

from bt_agents_core.errors import Refused
from bt_agents_lab.node import definition_text
from bt_agents_lab.recorder.file import definition
from bt_agents_ros.types import types_of

TYPES = {
    "a/msg/Top": "b/Part part\nLeaf[] leaves  # of a\nb/msg/Part[<=3] more\nuint8 X=1\nstring s",
    "a/msg/Leaf": "float64 value\nwstring w\nuint8[16] id",
    "b/msg/Part": "Inner inner\nstring<=10 short",
    "b/msg/Inner": "bool x",
}


def test_nested_types_follow_their_type_once() -> None:
    text = definition("a/msg/Top", TYPES.get)
    heads = [line for line in text.splitlines() if line.startswith("MSG: ")]
    assert heads == ["MSG: b/Part", "MSG: a/Leaf", "MSG: b/Inner"]
    assert text.startswith("b/Part part\n")
    assert text.count("=" * 80) == 3


def test_type_without_definition_is_reported() -> None:
    with pytest.raises(Refused, match="no definition of b/msg/Part, which a/msg/Top needs"):
        definition("a/msg/Top", {"a/msg/Top": "b/Part part"}.get)


@pytest.mark.parametrize("name", [t for t in types_of("bt_agents_interfaces") if "msg/" in t])
def test_every_own_message_decodes_from_its_definition(name: str) -> None:
    text = definition(f"bt_agents_interfaces/{name}", definition_text)
    assert f"bt_agents_interfaces/{name}" in generate_dynamic(f"bt_agents_interfaces/{name}", text)
