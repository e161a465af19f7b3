# SPDX-License-Identifier: Apache-2.0
"""People and a language model operate a running system from the command line."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from model_server import model_server, says, sends
from programs import Ask, Start, node_of

pytestmark = pytest.mark.e2e

MRS_SMITH = ("age=4.5", "familiarity=1", "mood=3")


def test_model_ranks_bids_and_veto_survives_market_restart(
    start_up: Start, ask: Ask, tmp_path: Path
) -> None:
    params = tmp_path / "my.yaml"
    params.write_text("marketplace: {ros__parameters: {external.limit: 20.0}}\n")
    with model_server() as server:
        server.reply = says("professional_express", "silent_text", reason="she looks at her watch")
        model = ("--selector", server.url, "--model", "small")
        up = start_up("--params", str(params), *model)
        # It waits for an answer until it is vetoed.
        ask("tune", "professional_express", "patience=30")
        assert "round 1: professional_express" in ask("trigger", *MRS_SMITH)
        assert "she looks at her watch" in ask("why")
        told = json.loads(server.questions[0]["messages"][1]["content"])
        assert "attentive_guide" in [one["name"] for one in told["characters"]]
        assert all(one["description"] for one in told["characters"])

        said = ask("veto", "professional_express", "--reason", "too quick")
        assert "stopping professional_express" in said
        server.reply = sends(b"no", 503)
        os.kill(node_of(up.process.pid, "marketplace_node.node"), signal.SIGKILL)
        up.until("marketplace is back")
        assert "vetoed: professional_express may not bid" in ask("status")

        # The old market's run ends first; until then the host gets no call.
        up.until("attentive_guide starts")
        preview = ask("preview", *MRS_SMITH)
        assert "attentive_guide would win" in preview
        assert "503" in preview
        assert "the operator vetoes professional_express: too quick" in preview
    assert "> ranks: ucb" in ask("strategy", "ucb", "c=0.5")
    assert "no strategy 'ucbb'; did you mean 'ucb'?" in ask("strategy", "ucbb", code=1)
