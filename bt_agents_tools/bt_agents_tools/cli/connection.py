# SPDX-License-Identifier: Apache-2.0
"""Commands that speak to a running system join its ROS graph here."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_ros.signals import loading
from bt_agents_tools.launcher.domain_lock import holder
from bt_agents_tools.launcher.supervisor import keep_local

if TYPE_CHECKING:
    from bt_agents_tools.client.observer import Observer

FIND_LIMIT_S = 3.0
"""How long something is looked for that may not be there at all [s]."""

BUSY_LIMIT_S = 10.0
"""How long something is waited for that is known to be there, or is being started again [s]."""


@contextmanager
def running_system() -> Iterator[Observer]:
    """Join the ROS graph of a running system.

    Raises:
        BtAgentsError: There is none on this ROS domain, or it does not answer.
    """
    keep_local(os.environ)
    with loading():
        from bt_agents_tools.client.observer import Observer

    observer = Observer()
    try:
        wait_for_market(observer, int(os.environ.get("ROS_DOMAIN_ID") or "0"))
        yield observer
    finally:
        observer.close()


def wait_for_market(observer: Observer, domain: int) -> None:
    """Turn until the market has been heard; longer when something says that it must be there.

    Args:
        observer: In the graph of the system.
        domain: The ROS domain of that graph.

    Raises:
        BtAgentsError: It has not been heard; why, as far as that can be known.
    """

    def heard() -> bool:
        return observer.market is not None

    def there() -> str:
        return holder(domain) or (
            "a marketplace" if observer.namespace in observer.namespaces_of_markets() else ""
        )

    if observer.turn_until(heard, FIND_LIMIT_S):
        return
    if there() and observer.turn_until(heard, BUSY_LIMIT_S - FIND_LIMIT_S):
        return
    raise BtAgentsError(_unheard(domain, observer, there()))


def _unheard(domain: int, observer: Observer, there: str) -> str:
    others = ", ".join(n for n in observer.namespaces_of_markets() if n != observer.namespace)
    if others:
        whose = f"namespace '{observer.namespace}' of ROS domain {domain}"
        return f"no running system in {whose}; set ROS_NAMESPACE, there is one in {others}"
    if there:
        return (
            f"{there} is on ROS domain {domain}, but its marketplace has not been heard for "
            f"{BUSY_LIMIT_S:g} s: it is being started, or the machine is very busy; try again"
        )
    return (
        f"no running system on ROS domain {domain}; start one with 'bt-agents up', or set "
        "ROS_DOMAIN_ID to its domain"
    )


def accepted(answer: Any, who: str) -> Any:
    """Return an answer that says yes.

    Raises:
        BtAgentsError: There is no answer, or it is a refusal, with its reason.
    """
    if answer is None:
        raise BtAgentsError(f"{who} does not answer; look at 'bt-agents status'")
    if not answer.accepted:
        raise Refused(getattr(answer, "code", "") or "REFUSED", answer.message)
    return answer


def hosts(observer: Observer) -> list[str]:
    """Return the hosts that live, by name.

    Raises:
        BtAgentsError: There is none.
    """
    observer.turn_until(lambda: _all_cards(observer), BUSY_LIMIT_S)
    if not observer.cards:
        raise BtAgentsError("no host of agents is running; look at 'bt-agents status'")
    return sorted(observer.cards)


def _all_cards(observer: Observer) -> bool:
    """Whether each host that the market knows has introduced its agents."""
    return bool(observer.cards) and len(observer.cards) >= observer.market.hosts


def host_of(observer: Observer, agent: str) -> str:
    """Return the host of an agent.

    Raises:
        BtAgentsError: No host has it.
    """

    def found() -> str:
        cards = observer.cards.items()
        return next((h for h, card in cards if any(a.name == agent for a in card.agents)), "")

    observer.turn_until(lambda: bool(found()) or _all_cards(observer), BUSY_LIMIT_S)
    if not found():
        names = sorted(a.name for card in observer.cards.values() for a in card.agents)
        raise BtAgentsError(f"no agent '{agent}' here; {did_you_mean(agent, names)}".rstrip("; "))
    return found()
