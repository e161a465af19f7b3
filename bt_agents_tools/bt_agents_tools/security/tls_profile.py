# SPDX-License-Identifier: Apache-2.0
"""Fast DDS profile for machines that speak to each other by TLS over TCP."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as Xml

from bt_agents_core.errors import Refused
from bt_agents_ros.fastdds_profile import NAMESPACE
from bt_agents_tools.security.xml_document import xml_text

_TRANSPORT = "tls"
_DEPTH = 2  # certificates between that of a machine and the authority


@dataclass(frozen=True, kw_only=True)
class Credentials:
    """Files of one machine, in PEM form: the authority of all, its own certificate and key."""

    authority: Path
    certificate: Path
    key: Path

    def check(self) -> None:
        """Check that the files are there.

        With files that it cannot read, Fast DDS may go on without TLS.

        Raises:
            Refused: ``NO_FILE``.
        """
        for path in (self.authority, self.certificate, self.key):
            if not path.is_file():
                raise Refused(
                    "NO_FILE",
                    f"there is no file {path}; expected a certificate or key in PEM form",
                )


def tls_profile(
    credentials: Credentials, listen: tuple[str, int] | None, peers: Sequence[tuple[str, int]]
) -> str:
    """Return a profile for one process of a machine.

    Args:
        credentials: Its files; both ends show a certificate of the same authority.
        listen: Own address and TCP port for others to connect to; None for a process that only
            connects. Each listening process of a machine needs a port of its own.
        peers: Address and TCP port of each process to connect to.
    """
    root = Xml.Element("dds", xmlns=NAMESPACE)
    profiles = Xml.SubElement(root, "profiles")
    descriptors = Xml.SubElement(profiles, "transport_descriptors")
    descriptor = Xml.SubElement(descriptors, "transport_descriptor")
    _add(descriptor, "transport_id", _TRANSPORT)
    _add(descriptor, "type", "TCPv4")
    if listen is not None:
        _add(Xml.SubElement(descriptor, "listening_ports"), "port", str(listen[1]))
    tls = Xml.SubElement(descriptor, "tls")
    _add(tls, "verify_file", str(credentials.authority.resolve()))
    _add(tls, "cert_chain_file", str(credentials.certificate.resolve()))
    _add(tls, "private_key_file", str(credentials.key.resolve()))
    _add(tls, "verify_depth", str(_DEPTH))
    modes = Xml.SubElement(tls, "verify_mode")
    for mode in ("VERIFY_PEER", "VERIFY_FAIL_IF_NO_PEER_CERT"):
        _add(modes, "verify", mode)
    options = Xml.SubElement(tls, "options")
    for option in ("DEFAULT_WORKAROUNDS", "NO_SSLV2", "NO_SSLV3", "SINGLE_DH_USE"):
        _add(options, "option", option)
    participant = Xml.SubElement(
        profiles, "participant", profile_name="tls_participant", is_default_profile="true"
    )
    rtps = Xml.SubElement(participant, "rtps")
    transports = Xml.SubElement(rtps, "userTransports")
    _add(transports, "transport_id", _TRANSPORT)
    _add(rtps, "useBuiltinTransports", "false")
    builtin = Xml.SubElement(rtps, "builtin")
    if listen is not None:
        _locators(builtin, "metatrafficUnicastLocatorList", [listen])
    if peers:
        _locators(builtin, "initialPeersList", peers)
    return xml_text(root)


def _locators(parent: Xml.Element, name: str, places: Sequence[tuple[str, int]]) -> None:
    listed = Xml.SubElement(parent, name)
    for address, port in places:
        tcp = Xml.SubElement(Xml.SubElement(listed, "locator"), "tcpv4")
        _add(tcp, "address", address)
        _add(tcp, "port", str(port))
        _add(tcp, "physical_port", str(port))


def _add(parent: Xml.Element, name: str, text: str) -> None:
    Xml.SubElement(parent, name).text = text
