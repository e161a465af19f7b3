# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents security`: files for DDS security, and for TLS between machines."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import click

from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros.fastdds_profile import PROFILE
from bt_agents_ros.signals import loading
from bt_agents_tools.cli.trees_choice import take_trees
from bt_agents_tools.launcher.supervisor import set_discovery
from bt_agents_tools.security.access_table import access_table
from bt_agents_tools.security.dds_policies import governance_xml, permissions_xml, policy_xml
from bt_agents_tools.security.tls_profile import Credentials, tls_profile

_FILE = click.Path(dir_okay=False, path_type=Path)


class _Place(click.ParamType):  # type: ignore[type-arg]
    name = "ADDRESS:PORT"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, int]:
        address, _, port = value.rpartition(":")
        if not address or not port.isdecimal() or not 0 < int(port) < 65536:
            self.fail(f"'{value}' is no place; expected an address and a port: 10.0.0.7:5100")
        return address, int(port)


@click.group()
def security() -> None:
    """Write files that say who may do what, and encrypt between machines."""


@security.command()
@click.argument("directory", required=False, default="")
@click.option("--output", "-o", type=click.Path(file_okay=False, path_type=Path), required=True)
@click.option("--host", "hosts", multiple=True, default=("agents",), help="Name of each host.")
@click.option("--namespace", default="/", show_default=True, help="Of all nodes.")
@click.option("--domain", type=click.IntRange(0, 232), help="ROS domain; else ROS_DOMAIN_ID or 0.")
def policies(
    directory: str, output: Path, hosts: Sequence[str], namespace: str, domain: int | None
) -> None:
    """Write policies of SROS2 for a trees folder: every node, and the roles of the commands."""
    trees = take_trees(directory)
    environment = dict(os.environ)
    set_discovery(environment)
    number = int(environment.get("ROS_DOMAIN_ID") or 0) if domain is None else domain
    with loading():
        from bt_agents_ros.installed import InstalledInterfaces
    table = access_table(read_trees(trees, InstalledInterfaces()), hosts)
    texts = {
        "policy.xml": policy_xml(table, namespace),
        "governance.xml": governance_xml(number),
        **{
            f"permissions/{access.name}.xml": permissions_xml(access, number, namespace)
            for access in table
        },
    }
    for name, text in texts.items():
        _write(output / name, text)
    click.echo(f"{output}: policy.xml, governance.xml, and permissions of {len(table)} enclaves")


@security.command()
@click.option("--ca", "authority", type=_FILE, required=True, help="Certificate of the authority.")
@click.option("--cert", "certificate", type=_FILE, required=True, help="Of this machine.")
@click.option("--key", type=_FILE, required=True, help="Private key of this machine.")
@click.option("--listen", type=_Place(), help="Own address and port.")
@click.option("--peer", "peers", type=_Place(), multiple=True, help="Who to connect to.")
@click.option("--output", "-o", type=_FILE, required=True)
def tls(
    authority: Path,
    certificate: Path,
    key: Path,
    listen: tuple[str, int] | None,
    peers: Sequence[tuple[str, int]],
    output: Path,
) -> None:
    """Write a profile of Fast DDS that speaks TLS over TCP, for one process."""
    if listen is None and not peers:
        raise click.UsageError("expected --listen, --peer or both: else nobody is connected")
    credentials = Credentials(authority=authority, certificate=certificate, key=key)
    credentials.check()
    _write(output, tls_profile(credentials, listen, peers))
    click.echo(f"export {PROFILE}={output.resolve()}")
    click.echo("export ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT")


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
