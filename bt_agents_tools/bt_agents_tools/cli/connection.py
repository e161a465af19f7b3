# SPDX-License-Identifier: Apache-2.0
"""Connection of a command to a running system, and lookup of its hosts."""

from __future__ import annotations

import os
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import click

from bt_agents_core.errors import BtAgentsError, RefusedElsewhere
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_ros.fastdds_profile import PROFILE
from bt_agents_ros.signals import loading
from bt_agents_tools.cli.trees_choice import say_trees_of_system
from bt_agents_tools.launcher.domain_lock import current_domain, holder, turn_to_join
from bt_agents_tools.launcher.supervisor import LAN_PROFILE, set_discovery

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

FIND_LIMIT_S = 3.0
"""Longest time for discovery of something that may not exist [s]."""

BUSY_LIMIT_S = 10.0
"""Longest time for discovery of something that must exist or is restarting [s]."""


_CARDS_LIMIT_S = 2.0
"""Longest time for the arrival of the cards, which come with the status of the market [s]."""


class NoSystemError(BtAgentsError):
    """No running system was found."""


def connect() -> Observer:
    """Connect to the running system until the command ends, and print its trees folder.

    Raises:
        NoSystemError: None is on this ROS domain, or it does not answer.
    """
    set_discovery(os.environ)
    domain = current_domain()
    with turn_to_join(domain):
        observer = new_observer()
        wait_for_market(observer, domain)
    observer.spin_until(lambda: _all_cards(observer), _CARDS_LIMIT_S)
    say_trees_of_system(card.trees for card in observer.cards.values())
    return observer


def new_observer() -> Observer:
    """Return a new observer, which is closed when the command ends."""
    with loading():
        from bt_agents_tools.client.observer import Observer

    observer = Observer()
    click.get_current_context().ensure_object(ExitStack).callback(observer.close)
    return observer


def wait_for_market(observer: Observer, domain: int) -> None:
    """Spin until a status of the market arrives; wait longer if there are signs of a system.

    Raises:
        NoSystemError: None has arrived; the message gives the reason, if known.
    """

    def is_connected() -> bool:
        return observer.market is not None

    def sign() -> str:
        return holder(domain) or (
            "a marketplace" if observer.namespace in observer.namespaces_of_markets() else ""
        )

    # A network loses messages.
    is_open = os.environ.get(PROFILE) == str(LAN_PROFILE)
    if observer.spin_until(is_connected, BUSY_LIMIT_S if is_open else FIND_LIMIT_S):
        return
    if sign() and observer.spin_until(is_connected, BUSY_LIMIT_S - FIND_LIMIT_S):
        return
    raise NoSystemError(_not_connected(domain, observer, sign()))


def _not_connected(domain: int, observer: Observer, sign: str) -> str:
    others = ", ".join(n for n in observer.namespaces_of_markets() if n != observer.namespace)
    if others:
        whose = f"namespace '{observer.namespace}' of ROS domain {domain}"
        return f"no running system in {whose}; set ROS_NAMESPACE, there is one in {others}"
    if sign:
        return (
            f"{sign} is on ROS domain {domain}, but its marketplace has not been heard for "
            f"{BUSY_LIMIT_S:g} s: it is being started, was told to leave, or the machine is very "
            "busy; try again"
        )
    return (
        f"no running system on ROS domain {domain}; start one with 'bt-agents up', or set "
        "ROS_DOMAIN_ID to its domain; for one on other machines set "
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET"
    )


def accepted(answer: Any, who: str) -> Any:
    """Return an answer that accepts the request.

    Raises:
        BtAgentsError: There is no answer, or a refusal without a code.
        RefusedElsewhere: The answer is a refusal with a code.
    """
    if answer is None:
        raise BtAgentsError(f"{who} does not answer; look at 'bt-agents status'")
    if not answer.accepted:
        code = getattr(answer, "code", "")
        raise RefusedElsewhere(code, answer.message) if code else BtAgentsError(answer.message)
    return answer


def find_hosts(observer: Observer) -> list[str]:
    """Return the names of the hosts, sorted.

    Raises:
        BtAgentsError: There is none.
    """
    observer.spin_until(lambda: _all_cards(observer), BUSY_LIMIT_S)
    if not observer.cards:
        raise BtAgentsError("no host of agents is running; look at 'bt-agents status'")
    return sorted(observer.cards)


def _all_cards(observer: Observer) -> bool:
    """Return whether the cards of all hosts that the market knows have arrived."""
    return bool(observer.cards) and len(observer.cards) >= observer.market.hosts


def find_host(observer: Observer, agent: str) -> str:
    """Return the host of an agent.

    Raises:
        BtAgentsError: No host has it.
    """

    def found() -> str:
        cards = observer.cards.items()
        return next((h for h, card in cards if any(a.name == agent for a in card.agents)), "")

    observer.spin_until(lambda: bool(found()) or _all_cards(observer), BUSY_LIMIT_S)
    if not found():
        names = sorted(a.name for card in observer.cards.values() for a in card.agents)
        raise BtAgentsError(f"no agent '{agent}' here; {did_you_mean(agent, names)}".rstrip("; "))
    return found()
