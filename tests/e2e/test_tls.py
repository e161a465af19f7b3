# SPDX-License-Identifier: Apache-2.0
"""TLS between processes, by the profiles that `bt-agents security tls` writes."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from bt_agents_tools.cli.commands.security import security

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl for certificates"),
]

NODE = """
import sys, time, rclpy
from std_msgs.msg import String
talks, limit_s = sys.argv[1] == "talk", float(sys.argv[2])
rclpy.init()
node = rclpy.create_node(sys.argv[1], start_parameter_services=False, enable_rosout=False)
heard = []
if talks:
    words = node.create_publisher(String, "words", 10)
    node.create_timer(0.05, lambda: words.publish(String(data="hello")))
else:
    node.create_subscription(String, "words", heard.append, 10)
end = time.monotonic() + limit_s
while time.monotonic() < end and not heard:
    rclpy.spin_once(node, timeout_sec=0.1)
print("heard" if heard else "nothing", flush=True)
"""


def openssl(*arguments: str | Path) -> None:
    subprocess.run(["openssl", *arguments], check=True, capture_output=True, timeout=60)


def make_authority(folder: Path, name: str) -> None:
    openssl(
        *("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", f"/CN={name}"),
        *("-keyout", folder / f"{name}.key", "-out", folder / f"{name}.pem"),
    )


def make_certificate(folder: Path, name: str, authority: str) -> None:
    request = folder / f"{name}.csr"
    openssl(
        *("req", "-newkey", "rsa:2048", "-nodes", "-subj", f"/CN={name}"),
        *("-keyout", folder / f"{name}.key", "-out", request),
    )
    openssl(
        *("x509", "-req", "-in", request, "-days", "2", "-CAcreateserial"),
        *("-CA", folder / f"{authority}.pem", "-CAkey", folder / f"{authority}.key"),
        *("-out", folder / f"{name}.pem"),
    )


def write_profile(folder: Path, name: str, authority: str, *options: str) -> Path:
    make_certificate(folder, name, authority)
    run = CliRunner().invoke(
        security,
        [
            *("tls", "--ca", str(folder / f"{authority}.pem")),
            *("--cert", str(folder / f"{name}.pem"), "--key", str(folder / f"{name}.key")),
            *options,
            *("-o", str(folder / f"{name}.xml")),
        ],
    )
    assert run.exit_code == 0, run.output
    return folder / f"{name}.xml"


def start(what: str, profile: Path, limit_s: float) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", NODE, what, str(limit_s)],
        env={
            **os.environ,
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def hear(*profiles: Path, limit_s: float) -> list[tuple[bool, str]]:
    """Listen with several profiles at once; return for each whether it hears, and what it says."""
    listening = [start("listen", profile, limit_s) for profile in profiles]
    try:
        said = [one.communicate(timeout=limit_s + 60.0)[0] for one in listening]
    finally:
        for one in listening:
            one.kill()
            one.wait()
    return [(text.rstrip().endswith("heard"), text) for text in said]


def test_only_processes_with_a_certificate_of_the_authority_hear_each_other(
    tmp_path: Path,
) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        place = f"127.0.0.1:{free.getsockname()[1]}"
    make_authority(tmp_path, "ours")
    make_authority(tmp_path, "theirs")
    server = write_profile(tmp_path, "server", "ours", "--listen", place)
    friend = write_profile(tmp_path, "friend", "ours", "--peer", place)
    stranger = write_profile(tmp_path, "stranger", "theirs", "--peer", place)
    plain = tmp_path / "plain.xml"
    plain.write_text(re.sub(r"<tls>.*</tls>", "", friend.read_text(), flags=re.DOTALL))
    talker = start("talk", server, 300.0)
    try:
        [(heard, _)] = hear(friend, limit_s=60.0)
        assert heard
        [(by_stranger, said), (without_tls, _)] = hear(stranger, plain, limit_s=5.0)
        assert not by_stranger
        assert "certificate verify failed" in said
        assert not without_tls
        [(heard, _)] = hear(friend, limit_s=60.0)
        assert heard
    finally:
        talker.kill()
        talker.communicate()
