# SPDX-License-Identifier: Apache-2.0
"""`scripts/demo`: what it says where it cannot install, and that it never half-installs.

The Python of these tests is a few lines of shell that answer as the real one does; what it was
asked to do is in the file `asked`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

pytestmark = pytest.mark.packaging

COMMANDS = (
    "basename bash cat chmod cp dirname env find flock ln mkdir rm sed sha256sum sleep sort tail "
    "uname xargs"
)

PYTHON = """#!/bin/sh
case "$*" in
  "-I -S"*) ;;
  -I*) echo "{answer}" ;;
  "-m venv"*)
    echo venv >> "$ASKED"
    mkdir -p "$3/bin" "$3/share" && cp "$0" "$3/bin/python"
    printf '#!/bin/sh\\necho played "$@"\\n' > "$3/bin/bt-agents" && chmod +x "$3/bin/bt-agents" ;;
  "-m pip install --editable"*)
    echo install >> "$ASKED"
    [ ! -e "$ASKED.offline" ] || {{ echo "no network"; exit 1; }} ;;
esac
"""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A checkout on a machine that has the given commands only."""

    checkout: Path
    commands: Path
    asked: Path

    def has_python(self, command: str, answer: str) -> None:
        """Install a Python that describes itself with ``answer``."""
        self.has(command, PYTHON.format(answer=answer))

    def has(self, command: str, text: str = "#!/bin/sh\n") -> None:
        """Install a command."""
        (self.commands / command).write_text(text, encoding="utf-8")
        (self.commands / command).chmod(0o755)

    def demo(self, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        """Run ``scripts/demo`` to its end."""
        return subprocess.run(
            [self.checkout / "scripts" / "demo", *arguments],
            env={"PATH": str(self.commands), "ASKED": str(self.asked), **environment},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )

    def was_asked(self) -> list[str]:
        """Return what Python was asked to do since the last time."""
        lines = self.asked.read_text(encoding="utf-8").split() if self.asked.exists() else []
        self.asked.unlink(missing_ok=True)
        return lines


@pytest.fixture
def machine(source: Path, tmp_path: Path) -> Machine:
    """A machine with a C compiler and without Python."""
    commands = tmp_path / "commands"
    commands.mkdir()
    for command in COMMANDS.split():
        found = shutil.which(command)
        assert found
        os.symlink(found, commands / command)
    checkout = shutil.copytree(source, tmp_path / "check out")
    machine = Machine(checkout=checkout, commands=commands, asked=tmp_path / "asked")
    machine.has("cc")
    machine.has("c++")
    return machine


def refusal(machine: Machine, **environment: str) -> str:
    """Return the one sentence with which the demo refuses to start; nothing is left behind."""
    done = machine.demo(**environment)
    assert done.returncode == 1
    assert done.stdout == ""
    assert not (machine.checkout / ".venv").exists()
    (line,) = done.stderr.splitlines()
    return line


def test_without_python_it_names_what_to_install(machine: Machine):
    assert refusal(machine) == (
        "demo: missing: a Python from 3.11 to 3.14; "
        "on Debian or Ubuntu: sudo apt install python3 python3-venv python3-dev"
    )


def test_with_an_old_python_it_asks_for_a_newer_one_by_its_version(machine: Machine):
    machine.has("python3")
    assert refusal(machine).endswith("sudo apt install python3.11 python3.11-venv python3.11-dev")


def test_with_half_a_python_it_names_the_other_half(machine: Machine):
    machine.has_python("python3", "3.12 venv dev")
    assert refusal(machine) == (
        "demo: missing: the venv of Python 3.12, the headers of Python 3.12; "
        "on Debian or Ubuntu: sudo apt install python3.12-venv python3.12-dev"
    )


def test_without_a_compiler_it_names_it(machine: Machine):
    machine.has_python("python3", "3.12")
    (machine.commands / "c++").unlink()
    assert refusal(machine) == (
        "demo: missing: a C and C++ compiler; on Debian or Ubuntu: sudo apt install g++"
    )


def test_everything_missing_is_one_command(machine: Machine):
    (machine.commands / "cc").unlink()
    assert refusal(machine).endswith("sudo apt install python3 python3-venv python3-dev g++")


@pytest.mark.parametrize("sourced", ["ROS_DISTRO", "AMENT_PREFIX_PATH"])
def test_where_ros_is_sourced_it_gives_the_commands_of_colcon(machine: Machine, sourced: str):
    line = refusal(machine, **{sourced: "jazzy"})
    assert f"cd '{machine.checkout}' && rosdep install" in line
    assert (
        "colcon build && source install/setup.bash && ros2 run bt_agents_tools bt-agents" in line
    )


def test_the_first_run_installs_and_the_second_only_plays(machine: Machine):
    machine.has_python("python3.13", "3.13 dev")
    machine.has_python("python3", "3.11")
    done = machine.demo("--help")
    assert [line.partition(" ...")[0] for line in done.stdout.splitlines()] == [
        "Creating .venv with python3",
        "Installing ROS 2 and bt-agents",
        "played demo --help",
    ]
    assert machine.was_asked() == ["venv", "install"]
    assert machine.demo().stdout == "played demo\n"
    assert machine.was_asked() == []


def test_a_changed_interface_is_installed_into_the_same_environment(machine: Machine):
    machine.has_python("python3", "3.11")
    machine.demo()
    machine.was_asked()
    (machine.checkout / "bt_agents_interfaces" / "msg" / "New.msg").write_text("bool new\n")
    assert machine.demo().stdout.endswith("played demo\n")
    assert machine.was_asked() == ["install"]


def test_a_failed_install_ends_with_the_log_and_is_done_anew(machine: Machine):
    machine.has_python("python3", "3.11")
    offline = machine.asked.with_suffix(".offline")
    offline.touch()
    done = machine.demo()
    assert done.returncode == 1
    assert "played" not in done.stdout
    assert done.stderr.splitlines()[-2:] == [
        "  | no network",
        "demo: 'Installing ROS 2 and bt-agents' failed; "
        f"everything it said is in {machine.checkout / '.venv' / 'install.log'}",
    ]
    offline.unlink()
    assert machine.was_asked() == ["venv", "install"]
    assert machine.demo().stdout.endswith("played demo\n")
    assert machine.was_asked() == ["venv", "install"]


def test_an_environment_whose_python_is_gone_is_made_anew(machine: Machine):
    machine.has_python("python3", "3.11")
    machine.demo()
    machine.was_asked()
    (machine.checkout / ".venv" / "bin" / "python").unlink()
    assert machine.demo().returncode == 0
    assert machine.was_asked() == ["venv", "install"]
