# SPDX-License-Identifier: Apache-2.0
"""`scripts/demo`: messages where it cannot install, and no partial installation.

The Python and uv of these tests are short shell scripts with the answers of the real ones; they
write their arguments to the file `asked`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

pytestmark = pytest.mark.packaging

COMMANDS = (
    "basename bash cat chmod cp cut dirname env find flock grep ln mkdir mv rm sed sha256sum "
    "sleep sort tail tee uname xargs"
)

PYTHON = """#!/bin/sh
case "$*" in
  "-I -S"*) ;;
  -I*) echo "{answer}" ;;
  "-m venv"*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" ;;
  "-m pip install"*) echo bootstrap >> "$ASKED" && cp "$UV" "${{0%/*}}/uv" ;;
esac
"""

UV = r"""#!/bin/sh
[ "$1" = --version ] || echo "$1" >> "$ASKED"
case "$1" in
  venv)
    mkdir -p "$5/bin" "$5/share" "$5/lib/python3/site-packages"
    cp "$(command -v "$4")" "$5/bin/python" && : > "$5/pyvenv.cfg" ;;
  sync)
    [ ! -e "$ASKED.offline" ] || { echo "no network"; exit 1; }
    case "$*" in *" --inexact"*) ;; *) echo "rclpy is removed"; exit 1 ;; esac ;;
  build)
    while [ "$1" != --out-dir ]; do shift; done
    mkdir "$2" && : > "$2/bt_agents.whl" ;;
  pip)
    printf '#!/bin/sh\necho played "$@"\n' > "${4%python}bt-agents"
    chmod +x "${4%python}bt-agents" ;;
  export)
    while [ "$1" != --output-file ]; do shift; done
    echo requirement > "$2" ;;
esac
"""

INSTALLED = ["bootstrap", "venv", "sync", "export", "build", "pip"]


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A checkout on a machine with only the given commands."""

    checkout: Path
    commands: Path
    asked: Path
    uv: Path

    def has_python(self, command: str, answer: str) -> None:
        """Install a Python that describes itself with ``answer``."""
        self.has(command, PYTHON.format(answer=answer))

    def has(self, command: str, text: str = "#!/bin/sh\n") -> None:
        """Install a command."""
        (self.commands / command).write_text(text, encoding="utf-8")
        (self.commands / command).chmod(0o755)

    def demo(self, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        """Run ``scripts/demo`` to its end."""
        return self.run(str(self.checkout / "scripts" / "demo"), *arguments, **environment)

    def run(self, *command: str, **environment: str) -> subprocess.CompletedProcess[str]:
        """Run a command to its end."""
        return subprocess.run(
            command,
            env={
                "PATH": str(self.commands),
                "ASKED": str(self.asked),
                "UV": str(self.uv),
                **environment,
            },
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )

    def was_asked(self) -> list[str]:
        """Return the requests to Python and uv since the last call."""
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
    uv = tmp_path / "uv"
    uv.write_text(UV, encoding="utf-8")
    uv.chmod(0o755)
    machine = Machine(checkout=checkout, commands=commands, asked=tmp_path / "asked", uv=uv)
    machine.has("cc")
    machine.has("c++")
    return machine


def refusal(machine: Machine, **environment: str) -> str:
    """Return the one sentence with which the demo refuses to start; no files may remain."""
    done = machine.demo(**environment)
    assert done.returncode == 1
    assert done.stdout == ""
    assert not (machine.checkout / ".venv").exists()
    (line,) = done.stderr.splitlines()
    return line


def test_missing_python_is_named_with_install_command(machine: Machine):
    assert refusal(machine) == (
        "demo: missing: a Python from 3.11 to 3.14; "
        "on Debian or Ubuntu: sudo apt install python3 python3-venv python3-dev"
    )


def test_old_python_leads_to_versioned_install_command(machine: Machine):
    machine.has("python3")
    assert refusal(machine).endswith("sudo apt install python3.11 python3.11-venv python3.11-dev")


def test_incomplete_python_names_missing_parts(machine: Machine):
    machine.has_python("python3", "3.12 venv dev")
    assert refusal(machine) == (
        "demo: missing: the venv of Python 3.12, the headers of Python 3.12; "
        "on Debian or Ubuntu: sudo apt install python3.12-venv python3.12-dev"
    )


def test_missing_compiler_is_named(machine: Machine):
    machine.has_python("python3", "3.12")
    (machine.commands / "c++").unlink()
    assert refusal(machine) == (
        "demo: missing: a C and C++ compiler; on Debian or Ubuntu: sudo apt install g++"
    )


def test_one_command_installs_everything_missing(machine: Machine):
    (machine.commands / "cc").unlink()
    assert refusal(machine).endswith("sudo apt install python3 python3-venv python3-dev g++")


@pytest.mark.parametrize("sourced", ["ROS_DISTRO", "AMENT_PREFIX_PATH"])
def test_sourced_ros_leads_to_colcon_commands(machine: Machine, sourced: str):
    line = refusal(machine, **{sourced: "jazzy"})
    assert f"cd '{machine.checkout}' && rosdep install" in line
    assert (
        "colcon build && source install/setup.bash && ros2 run bt_agents_tools bt-agents" in line
    )


def test_first_run_installs_and_second_only_plays(machine: Machine):
    machine.has_python("python3.13", "3.13 dev")
    machine.has_python("python3", "3.11")
    done = machine.demo("--help")
    assert [line.partition(" ...")[0] for line in done.stdout.splitlines()] == [
        "Installing about 700 MB into .venv; the first time takes one to two minutes",
        "Installing uv",
        "Creating .venv with python3",
        "Installing ROS 2",
        "Compiling the interfaces",
        "Installing bt-agents",
        "played demo --help",
    ]
    assert machine.was_asked() == INSTALLED
    assert machine.demo().stdout == "played demo\n"
    assert machine.was_asked() == []


@pytest.fixture
def prepared(machine: Machine) -> Machine:
    """A machine on which the demo has run once."""
    machine.has_python("python3", "3.11")
    machine.demo()
    machine.was_asked()
    return machine


@pytest.mark.parametrize(
    ("change", "asked"),
    [
        ("echo bool new > bt_agents_interfaces/msg/New.msg", ["sync", "export", "build", "pip"]),
        ("echo >> uv.lock", ["sync", "export", "pip"]),
        ("rm .venv/bin/python", ["venv", "sync", "export", "pip"]),
    ],
    ids=["interface", "without compilation", "no Python"],
)
def test_demo_installs_only_what_a_change_needs(
    prepared: Machine, change: str, asked: list[str]
) -> None:
    assert subprocess.run(change, shell=True, cwd=prepared.checkout).returncode == 0
    assert prepared.demo().stdout.endswith("played demo\n")
    assert prepared.was_asked() == asked


def test_test_tools_are_added_to_existing_environment(prepared: Machine) -> None:
    setup = prepared.checkout / "scripts" / "setup.bash"
    done = prepared.run("bash", "-c", f"source '{setup}' && set_up dev")
    assert done.returncode == 0, done.stdout
    assert prepared.was_asked() == ["sync", "export", "pip"]


def test_second_checkout_of_user_compiles_nothing(machine: Machine, tmp_path: Path):
    machine.has_python("python3", "3.11")
    shared = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    other = replace(machine, checkout=shutil.copytree(machine.checkout, tmp_path / "other"))
    machine.demo(**shared)
    assert machine.was_asked() == INSTALLED
    assert other.demo(**shared).stdout.endswith("played demo\n")
    assert other.was_asked() == ["venv", "sync", "export", "pip"]
    paths = next((other.checkout / ".venv").rglob("bt_agents_checkout.pth")).read_text()
    assert str(other.checkout / "bt_agents_core") in paths.splitlines()


def test_failed_install_shows_log_and_is_repeated(machine: Machine):
    machine.has_python("python3", "3.11")
    offline = machine.asked.with_suffix(".offline")
    offline.touch()
    done = machine.demo()
    assert done.returncode == 1
    assert "played" not in done.stdout
    assert done.stderr.splitlines()[-2:] == [
        "  | no network",
        "demo: 'Installing ROS 2' failed; "
        f"everything it said is in {machine.checkout / '.venv' / 'install.log'}",
    ]
    offline.unlink()
    assert machine.was_asked() == ["bootstrap", "venv", "sync"]
    assert machine.demo().stdout.endswith("played demo\n")
    assert machine.was_asked() == ["venv", "sync", "export", "build", "pip"]
