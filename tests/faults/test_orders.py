# SPDX-License-Identifier: Apache-2.0
"""Acknowledged pins and vetoes: they outlive a market that is killed right afterwards."""

from __future__ import annotations

import pytest

from bt_agents_interfaces.srv import OperateMarket
from bt_agents_ros import qos
from processes import System, write_trees

pytestmark = pytest.mark.e2e

ORDERS = (
    (OperateMarket.Request.PIN, "leo", "leo", []),
    (OperateMarket.Request.VETO, "mira", "leo", ["mira"]),
    (OperateMarket.Request.UNPIN, "leo", "", ["mira"]),
    (OperateMarket.Request.ALLOW, "mira", "", []),
)
"""Order and its agent → the pinned and the vetoed agents after it."""


def test_acknowledged_pin_or_veto_survives_immediate_kill(system: System) -> None:
    trees = write_trees(system.folder / "a", leo=(4.5, "wait: 0 s"), mira=(2.0, "wait: 0 s"))
    market = system.market(trees, orders=str(system.folder / "orders.json"))
    system.host("agents", trees)
    system.until_ready(hosts=1, agents=2)
    orders = system.ros.node.create_client(
        OperateMarket, "marketplace/operate", qos_profile=qos.SERVICE
    )
    for action, agent, pinned, vetoed in ORDERS:
        answer = system.ask(orders, OperateMarket.Request(action=action, agent=agent))
        market.kill()
        epoch = system.epoch
        assert answer.accepted, answer.message
        market.start()
        system.until(
            lambda dead=epoch: system.epoch != dead and system.statuses[-1].agents == 2,
            "the next market with all agents",
        )
        last = system.statuses[-1]
        assert (last.pinned, list(last.vetoed)) == (pinned, vetoed)
