# SPDX-License-Identifier: Apache-2.0
"""Commands `bt-agents press` and `publish`: messages that running trees wait for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import click

from bt_agents_ros.signals import loading
from bt_agents_tools.cli.connection import connect, find_hosts

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

_BUTTON = "std_msgs/msg/Bool"
_DISCOVERY_S = 1.0
"""Time without a newly discovered topic after which all are considered discovered [s]."""

_MOST_CHANGES = 20


@click.command()
@click.argument("topic", default="")
def press(topic: str) -> None:
    """Press a button that a running tree waits for; without TOPIC show which there are.

    For example: bt-agents press buttons/confirm.
    """
    observer = connect()
    heard = _heard(observer, topic, sensors=False)
    buttons = {name: kind for name, kind in heard.items() if kind == _BUTTON}
    if topic:
        _publish(observer, buttons, topic, ("data=true",))
        click.echo(f"pressed {topic}")
    else:
        _show(buttons, "no tree waits for a button now")


@click.command()
@click.argument("topic", default="")
@click.argument("values", nargs=-1)
def publish(topic: str, values: tuple[str, ...]) -> None:
    """Publish a message that a tree waits for, or that a sensor would send; or show the topics.

    VALUES are fields, or the value of the only one: bt-agents publish person/age 70, bt-agents
    publish buttons/confirm data=true. Without TOPIC, list the topics that are listened to now.
    """
    observer = connect()
    heard = _heard(observer, topic, sensors=True)
    if topic:
        _publish(observer, heard, topic, values)
        click.echo(f"published on {topic}")
    else:
        _show(heard, "nothing is listened to now")


def _heard(observer: Observer, topic: str, *, sensors: bool) -> Mapping[str, str]:
    """Return topics with types that trees, and optionally the scene layer's sensors, listen to."""
    with loading():
        from bt_agents_tools.client.publication import heard_topics
    nodes = find_hosts(observer)
    if sensors:
        nodes = [*nodes, f"{observer.namespace.rstrip('/')}/scene_layer"]

    heard: Mapping[str, str] = {}

    def changed() -> bool:
        return heard_topics(observer.node, nodes) != heard

    for _ in range(_MOST_CHANGES):
        if topic in heard or not observer.spin_until(changed, _DISCOVERY_S):
            break
        heard = heard_topics(observer.node, nodes)
    return heard


def _show(heard: Mapping[str, str], nothing: str) -> None:
    click.echo("\n".join(f"{name}  ({kind})" for name, kind in sorted(heard.items())) or nothing)


def _publish(
    observer: Observer, heard: Mapping[str, str], topic: str, values: tuple[str, ...]
) -> None:
    from bt_agents_tools.client import publication

    message = publication.heard_message(heard, topic, values)
    if not publication.publish(observer, topic, message):
        raise publication.not_taken(topic)
