# SPDX-License-Identifier: Apache-2.0
"""Profile values that were tuned and that the feedback node has not recorded yet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from bt_agents_core.scene import MISSING, Vector


@dataclass(frozen=True, kw_only=True)
class Order:
    """Values that the feedback node is to record as one change.

    Attributes:
        values: Scene parameter → value.
        reason: Who wants them, and why.
    """

    values: Mapping[str, float]
    reason: str

    def vector(self, names: Sequence[str]) -> Vector:
        """Return the values in order, NaN where there is none."""
        return tuple(self.values.get(name, MISSING) for name in names)


@dataclass(kw_only=True)
class _Orders:
    wanted: dict[str, float] = field(default_factory=dict)
    reason: str = ""
    under_way: Order | None = None


class ProfileOrders:
    """One order an agent is under way; what is wanted meanwhile is one order after it."""

    def __init__(self) -> None:
        self._agents: dict[str, _Orders] = {}

    def want(self, agent: str, values: Mapping[str, float], reason: str) -> None:
        """Note values that were tuned; newer ones take the place of older ones."""
        orders = self._agents.setdefault(agent, _Orders())
        orders.wanted |= values
        orders.reason = reason

    def next(self, agent: str) -> Order | None:
        """Return the order to send now; None while one is under way, or nothing is wanted."""
        orders = self._agents.get(agent)
        if orders is None or orders.under_way is not None or not orders.wanted:
            return None
        orders.under_way = Order(values=orders.wanted, reason=orders.reason)
        orders.wanted = {}
        return orders.under_way

    def done(self, agent: str) -> None:
        """Note that the order under way has its answer."""
        orders = self._agents.get(agent)
        if orders is not None:
            orders.under_way = None
            if not orders.wanted:
                del self._agents[agent]

    def again(self, agent: str) -> None:
        """Note that the order under way was not taken and is still wanted."""
        orders = self._agents.get(agent)
        if orders is not None and orders.under_way is not None:
            orders.wanted = {**orders.under_way.values, **orders.wanted}
            orders.under_way = None

    @property
    def agents(self) -> Sequence[str]:
        """The agents of which something is wanted."""
        return tuple(self._agents)

    def forget(self, agent: str) -> None:
        """Want nothing more for an agent that is gone."""
        self._agents.pop(agent, None)

    def over(self, agent: str, names: Sequence[str], vector: Vector) -> Vector:
        """Return a profile with the values that are wanted and not recorded yet."""
        orders = self._agents.get(agent)
        if orders is None:
            return vector
        under_way = orders.under_way.values if orders.under_way is not None else {}
        ahead = {**under_way, **orders.wanted}
        return tuple(ahead.get(name, value) for name, value in zip(names, vector, strict=True))
