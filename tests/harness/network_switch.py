# SPDX-License-Identifier: Apache-2.0
"""Switch in user space between network namespaces, with delay, loss and unplugged cables.

Its arguments are ``PID ADDRESS`` of each machine. It makes a TAP device in the network namespace
of each process, and reads settings from its standard input, one JSON object a line: ``delay``
[s], ``loss`` (0 to 1), ``out``, the numbers of the machines with unplugged cables, and
``multicast``, false on a network that does not carry multicast.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import json
import os
import random
import select
import struct
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

DEVICE = "cable"
SETTINGS: Mapping[str, Any] = {"delay": 0.0, "loss": 0.0, "out": (), "multicast": True}

_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
_CLONE_NEWNET = 0x40000000
_FRAME = 65_536
_QUEUE = 10_000
_MULTICAST = b"\x01\x00\x5e"
"""Prefix of multicast addresses; broadcast, which ARP uses, has another."""
_MOST_FRAMES = 64
"""Maximum number of frames to read from one machine before the next."""


def cable(pid: int, address: str) -> int:
    """Create a device in the namespace of a process, up and with an address; return its frames."""
    libc = ctypes.CDLL(None, use_errno=True)
    with Path(f"/proc/{pid}/ns/net").open("rb") as namespace:
        if libc.setns(namespace.fileno(), _CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), "the namespace cannot be entered")
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    request = struct.pack("16sH22x", DEVICE.encode(), _IFF_TAP | _IFF_NO_PI)
    fcntl.ioctl(device, _TUNSETIFF, request)
    for words in (
        f"addr add {address}/24 dev {DEVICE}",
        f"link set {DEVICE} txqueuelen {_QUEUE} up",
        f"route add 224.0.0.0/4 dev {DEVICE}",
    ):
        subprocess.run(["ip", *words.split()], check=True)
    return device


def waiting_frames(device: int) -> Iterator[bytes]:
    """Read the frames that a machine has sent."""
    with suppress(BlockingIOError):
        for _ in range(_MOST_FRAMES):
            yield os.read(device, _FRAME)


def forward(devices: list[int]) -> None:
    """Forward frames to all other devices until the standard input ends."""
    settings = SETTINGS
    chance = random.Random(7)
    numbers = count()
    seats: dict[bytes, int] = {}
    on_way: list[tuple[float, int, int, bytes]] = []
    commands = b""
    while True:
        wait_s = max(0.0, on_way[0][0] - time.monotonic()) if on_way else None
        readable, _, _ = select.select([0, *devices], [], [], wait_s)
        now = time.monotonic()
        if 0 in readable:
            read = os.read(0, _FRAME)
            if not read:
                return
            *lines, commands = (commands + read).split(b"\n")
            for line in lines:
                settings = json.loads(line)
                print("set", flush=True)
        for source, device in enumerate(devices):
            if device not in readable:
                continue
            for frame in waiting_frames(device):
                to, by = frame[:6], frame[6:12]
                seats[by] = source
                if to.startswith(_MULTICAST) and not settings["multicast"]:
                    continue
                for target in [seats[to]] if to in seats else range(len(devices)):
                    is_out = {source, target} & set(settings["out"])
                    if target != source and not is_out and chance.random() >= settings["loss"]:
                        due = now + settings["delay"]
                        heapq.heappush(on_way, (due, next(numbers), target, frame))
        while on_way and on_way[0][0] <= now:
            _, _, target, frame = heapq.heappop(on_way)
            if target not in settings["out"]:
                os.write(devices[target], frame)


if __name__ == "__main__":
    machines = list(zip(sys.argv[1::2], sys.argv[2::2], strict=True))
    with suppress(PermissionError):
        os.nice(-10)  # a real switch has a processor of its own
    opened = [cable(int(pid), address) for pid, address in machines]
    print("ready", flush=True)
    forward(opened)
