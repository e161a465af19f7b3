# SPDX-License-Identifier: Apache-2.0
"""The reference of the ROS graph matches the nodes."""

from __future__ import annotations

import runpy

from checkout import ROOT

OF_NODES = runpy.run_path(str(ROOT / "scripts" / "generated.py"))["OF_NODES"]


def test_reference_page_covers_complete_ros_interface() -> None:
    for name, made in OF_NODES.items():
        written = (ROOT / name).read_text(encoding="utf-8")
        assert written == made(), "run scripts/generate"
