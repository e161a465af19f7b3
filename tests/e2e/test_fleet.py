# SPDX-License-Identifier: Apache-2.0
"""A robot of a fleet: a running system, `bt-agents fleet`, and a database."""

from __future__ import annotations

import json
import os
import re
import signal
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from command_server import CommandServer
from postgres_server import running_server
from programs import ROOT, Program, Start, children, wait_for

pytestmark = pytest.mark.e2e

AGENT = ROOT / "trees" / "agents" / "attentive_guide.yaml"


@pytest.fixture
def run(
    tmp_path: Path, commands: CommandServer, environment: dict[str, str]
) -> Callable[..., str]:
    """Return a function that runs a command alongside others, and returns its output."""

    def made(*arguments: str, code: int = 0) -> str:
        ended = commands.run(*arguments, folder=tmp_path, environment=environment, together=True)
        assert ended.code == code, ended.out
        return str(ended.out)

    return made


def test_robot_joins_fleet_shares_learning_and_shows_origins(
    trees: Path, tmp_path: Path, start: Start, start_up: Start, run: Callable[..., str]
) -> None:
    agent = trees / "agents" / AGENT.name
    text = agent.read_text()
    assert "update: huber}" in text
    agent.write_text(text.replace("update: huber}", "update: huber, share: everything}"))

    with running_server() as server:
        up = start_up(folder=tmp_path)
        assert "NOT_JOINED" in run("fleet", "status", code=1)
        assert "joined as anna" in run("fleet", "join", server.address, "--robot", "anna")
        (settings,) = (tmp_path / "state").rglob("fleet.json")
        assert stat.S_IMODE(settings.stat().st_mode) == 0o600
        fleet = start("fleet", "run", folder=tmp_path)
        fleet.until("up to date")

        run("feedback", "direct", "age=5", "--agent", "attentive_guide", "--reason", "for Anna")
        wait_for(lambda: server.execute("SELECT 1 FROM step WHERE event = 'feedback'"))
        assert "for Anna" not in str(server.execute("SELECT row_to_json(step)::text FROM step"))

        server.execute("INSERT INTO robot (robot) VALUES ('ben')")
        server.execute(
            "INSERT INTO step (robot, number, agent, layer, base, event, kind, target, weight, "
            "changes, stamp) SELECT 'ben', of_ben.n, agent, layer, base, event, kind, target, "
            "weight, changes, stamp - of_ben.n FROM step, generate_series(1, 200) AS of_ben (n) "
            "WHERE event = 'feedback'"
        )
        wait_for(lambda: "ben" in run("profile", "history", "attentive_guide"))
        history = run("profile", "history", "attentive_guide")
        assert re.search(r"201 .* fleet +ben +age .* direct there, its step 1, with 199", history)

        server.kill()
        fleet.until("DATABASE_AWAY")
        run("feedback", "direct", "age=5", "--agent", "attentive_guide")
        server.start()
        wait_for(lambda: server.execute("SELECT 1 FROM step WHERE robot = 'anna' OFFSET 1") != [])
        status = run("fleet", "status")
        assert re.search(r"^anna +2 ", status, re.M)
        assert "200 steps of other robots taken in, 0 refused" in status
        assert fleet.stop()[0] == 0, fleet.output
        found = json.loads(run("fleet", "status", "--json"))
        assert [one["robot"] for one in found["robots"]] == ["anna", "ben"]
        assert "anna has left the fleet" in run("fleet", "leave", "--erase", "--yes")
        assert not settings.exists()
        assert up.stop()[0] == 0, up.output


def test_up_syncs_joined_robot_and_restarts_fleet_process(
    trees: Path, tmp_path: Path, start: Start, start_up: Start, run: Callable[..., str]
) -> None:
    agent = trees / "agents" / AGENT.name
    agent.write_text(agent.read_text().replace("huber}", "huber, share: everything}"))

    def teach() -> None:
        run("feedback", "direct", "age=5", "--agent", "attentive_guide")

    with running_server() as server:
        run("fleet", "join", server.address, "--robot", "anna")
        up = start_up(folder=tmp_path)
        up.until("fleet up to date")
        teach()
        wait_for(lambda: server.execute("SELECT 1 FROM step"))
        second = start("fleet", "run", folder=tmp_path)
        second.until("FLEET_RUNS")
        assert second.stop()[0] == 0, second.output
        server.kill()
        up.until("fleet DATABASE_AWAY")
        server.start()
        up.until("fleet up to date")
        [fleet] = fleet_processes(up)
        os.kill(fleet, signal.SIGKILL)
        up.until("fleet ended .killed by signal 9.: starting it again")
        up.until("fleet is back")
        teach()
        wait_for(lambda: server.execute("SELECT 1 FROM step OFFSET 1"))
        assert up.stop()[0] == 0, up.output
        assert "had to be killed" not in up.output
        for options, count in (
            (("--no-voice", "--no-studio", "--no-fleet"), 0),
            (("--only", "market"), 0),
            (("--only", "feedback"), 1),
        ):
            other = start("up", *options, folder=tmp_path)
            other.until("fleet up to date" if count else "ready")
            assert len(fleet_processes(other)) == count
            assert other.stop()[0] == 0, other.output


def fleet_processes(up: Program) -> list[int]:
    """Return the processes of a system that learn together with others."""
    return [
        one
        for one in children(up.process.pid)
        if b"bt_agents_fleet.process" in Path(f"/proc/{one}/cmdline").read_bytes()
    ]
