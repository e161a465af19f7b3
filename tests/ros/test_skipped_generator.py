# SPDX-License-Identifier: Apache-2.0
"""Type support of messages: our processes do not load the generator of messages."""

from __future__ import annotations

import sys

from programs import HANG_S, output_of

CREATE_NODE = """
import sys, rclpy
rclpy.init()
rclpy.create_node("asked")
print(*sorted({"em", "lark"} & sys.modules.keys()))
rclpy.shutdown()
"""


def run(code: str) -> str:
    return output_of([sys.executable, "-c", code], HANG_S).strip()


def test_spinner_loads_no_generator() -> None:
    assert run(f"import bt_agents_ros.spinner\n{CREATE_NODE}") == ""


def test_rclpy_alone_still_loads_the_generator() -> None:
    assert run(CREATE_NODE) == "em lark", "remove workarounds/skipped_generator.py"


def test_generator_stays_importable() -> None:
    module = "rosidl_generator_py.generate_py_impl"
    assert run(f"import bt_agents_ros.spinner, {module}\nprint({module}.generate_py.__name__)")
