# SPDX-License-Identifier: Apache-2.0
"""The reference of the ROS graph is what the nodes offer and say of themselves."""

from __future__ import annotations

import runpy

from checkout import ROOT

OF_NODES = runpy.run_path(str(ROOT / "scripts" / "generated.py"))["OF_NODES"]


def test_the_reference_names_every_topic_service_action_and_parameter() -> None:
    for name, made in OF_NODES.items():
        written = (ROOT / name).read_text(encoding="utf-8")
        assert written == made(), "run scripts/generate"
