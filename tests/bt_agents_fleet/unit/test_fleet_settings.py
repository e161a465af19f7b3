# SPDX-License-Identifier: Apache-2.0
"""Settings of a robot in a fleet, and the layers that it shares."""

from __future__ import annotations

import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from bt_agents_core.errors import Refused
from bt_agents_core.feedback import Share
from bt_agents_core.state_folder import FLEET_SETTINGS
from bt_agents_fleet import commands
from bt_agents_fleet.fleet_settings import (
    FleetSettings,
    checked_robot,
    read_settings,
    read_status,
    write_settings,
)
from bt_agents_fleet.shares import Shares, includes

ROOT = Path(__file__).parents[3]
ANNA = FleetSettings(robot="anna", address="host=db.example sslmode=verify-full")


def test_settings_round_trip_and_are_owner_only(tmp_path):
    folder = tmp_path / "state"
    file = write_settings(folder, ANNA)
    write_settings(folder, ANNA)
    assert read_settings(folder) == ANNA
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_missing_settings_error_explains_how_to_join(tmp_path):
    with pytest.raises(Refused, match=r"NOT_JOINED.*bt-agents fleet join"):
        read_settings(tmp_path)


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"robot": "a", "address": 3}', '{"robot": "a", "address": "b", "c": 1}'],
)
def test_invalid_settings_are_refused(tmp_path, text):
    (tmp_path / FLEET_SETTINGS).write_text(text)
    with pytest.raises(Refused, match="BAD_SETTINGS"):
        read_settings(tmp_path)


@pytest.mark.parametrize("name", ["", "Anna", "a b", "-a", "a" * 64, "ä", "a/b", "a\n"])
def test_invalid_robot_name_is_refused(name):
    with pytest.raises(Refused, match="BAD_ROBOT"):
        checked_robot(name)


def test_joining_without_trees_uses_no_database(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(commands, "_database", pytest.fail)
    joined = CliRunner().invoke(commands.fleet, ["join", "host=a", "--robot", "anna"])
    assert "no trees folder here" in str(joined.exception)


def test_missing_or_damaged_status_reads_as_empty(tmp_path):
    assert read_status(tmp_path) == {}
    (tmp_path / "fleet-status.json").write_text("{")
    assert read_status(tmp_path) == {}


def test_changed_agent_file_changes_shared_layers(tmp_path):
    trees = Path(shutil.copytree(ROOT / "trees", tmp_path / "trees"))
    shares = Shares(trees)
    assert shares.read() == {}
    agent = trees / "agents" / "attentive_guide.yaml"
    text = agent.read_text()
    agent.write_text(text.replace("update: huber}", "update: huber, share: place}"))
    assert shares.read() == {"attentive_guide": Share.PLACE}
    agent.write_text("broken: [")
    assert shares.read() == {}


@pytest.mark.parametrize("share", Share)
def test_persons_are_never_shared(share):
    assert not includes(share, "person/anna")
    assert includes(share, "place/lobby") is (share is not Share.NOTHING)
    assert includes(share, "") is (share is Share.EVERYTHING)


def test_missing_database_client_is_named_by_command():
    program = (
        "import sys; sys.modules['psycopg'] = None; sys.argv = ['bt-agents', 'fleet', 'status']\n"
        "from bt_agents_tools.cli import main\n"
        "main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 1
    assert done.stderr.startswith("error: this command needs the package psycopg; install it with")
    assert "pip install 'bt-agents[fleet]'" in done.stderr
