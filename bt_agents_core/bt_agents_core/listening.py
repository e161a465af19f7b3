# SPDX-License-Identifier: Apache-2.0
"""Listening sockets of servers that people open at an address with a port."""

from __future__ import annotations

import errno
import socket
from collections.abc import Sequence

from bt_agents_core.errors import BtAgentsError

STUDIO_PORTS = range(8770, 8790)
"""Ports for studios; each takes the first free one."""


def listen(host: str, ports: Sequence[int]) -> socket.socket:
    """Return a socket that listens on the first free port.

    Raises:
        BtAgentsError: The address or all of the ports are unavailable.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for port in ports:
        try:
            return socket.create_server((host, port), family=family)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise BtAgentsError(f"{host}: {error.strerror}") from None
    taken = f"port {ports[0]} is" if len(ports) == 1 else f"ports {ports[0]} to {ports[-1]} are"
    raise BtAgentsError(f"{taken} taken")
