# SPDX-License-Identifier: Apache-2.0
"""Commands that speak to a running system join its ROS graph here."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from bt_agents.cli.supervisor import keep_local
from bt_agents.errors import BtAgentsError, Refused
from bt_agents.interrupt import loading

if TYPE_CHECKING:
    from bt_agents.ros.observer import Observer

FIND_LIMIT_S = 3.0
"""How long something of a running system is looked for [s]."""


@contextmanager
def running_system() -> Iterator[Observer]:
    """Join the ROS graph of a running system.

    Raises:
        BtAgentsError: There is none on this ROS domain.
    """
    keep_local(os.environ)
    with loading():
        from bt_agents.ros.observer import Observer

    observer = Observer()
    try:
        observer.turn_until(lambda: observer.market is not None, FIND_LIMIT_S)
        if observer.market is None:
            raise BtAgentsError(
                f"no running system on ROS domain {os.environ.get('ROS_DOMAIN_ID', '0')}; start "
                "one with 'bt-agents up', or set ROS_DOMAIN_ID to its domain"
            )
        yield observer
    finally:
        observer.close()


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
    observer.turn_until(lambda: bool(observer.cards), FIND_LIMIT_S)
    if not observer.cards:
        raise BtAgentsError("no host of agents is running; look at 'bt-agents status'")
    return sorted(observer.cards)


def host_of(observer: Observer, agent: str) -> str:
    """Return the host of an agent.

    Raises:
        BtAgentsError: No host has it.
    """

    def found() -> str:
        cards = observer.cards.items()
        return next((h for h, card in cards if any(a.name == agent for a in card.agents)), "")

    observer.turn_until(lambda: bool(found()), FIND_LIMIT_S)
    if not found():
        names = sorted(a.name for card in observer.cards.values() for a in card.agents)
        raise BtAgentsError(
            f"no agent '{agent}' is running; there are {', '.join(names) or 'none'}"
        )
    return found()
