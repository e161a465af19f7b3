# SPDX-License-Identifier: Apache-2.0
"""Bids as arrays: those of one host as they are checked, and all that a round accepts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from bt_agents_core.errors import Refused
from bt_agents_core.scene import MAX_WEIGHT, SceneSpace, Vector
from marketplace_node.round.decision import AcceptedBid, Bids, Terms
from marketplace_node.strategies import RoundArrays
from marketplace_node.strategies.arrays import Floats

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class BidTable:
    """Accepted bids by column, in the order of the agents' names.

    Attributes:
        instances: The starts of the hosts.
        vectors: [N, n], stored parameter by parameter, as they are added up.
        weights: [N, n], stored alike; None when no agent states any.
    """

    agents: tuple[str, ...]
    agent_ids: tuple[int, ...]
    hosts: tuple[str, ...]
    instances: tuple[str, ...]
    vectors: Floats
    weights: Floats | None = None

    @classmethod
    def of(cls, bids: Sequence[AcceptedBid], space: SceneSpace) -> BidTable:
        """Return the table of bids that come in any order."""
        ordered = sorted(bids, key=lambda bid: bid.agent)
        common = weights_of(space)
        stated = any(bid.weights for bid in ordered)
        return cls(
            agents=tuple(bid.agent for bid in ordered),
            agent_ids=tuple(bid.agent_id for bid in ordered),
            hosts=tuple(bid.host for bid in ordered),
            instances=tuple(bid.instance for bid in ordered),
            vectors=_rows([bid.vector for bid in ordered], space),
            weights=_rows([bid.weights or common for bid in ordered], space) if stated else None,
        )

    def __len__(self) -> int:
        return len(self.agents)

    def column(self, of_agents: Mapping[str, int]) -> Floats:
        """Return a number for each bidder, 0 for those that are not in the mapping; [N]."""
        if not of_agents:
            return np.zeros(len(self))
        return np.array([of_agents.get(agent, 0) for agent in self.agents], dtype=np.float64)

    def field(self, space: SceneSpace, terms: Terms) -> RoundArrays:
        """Return what a strategy is given; nothing in it can be written to."""
        scene = space.compared(terms.scene)
        field = RoundArrays(
            scene=np.array(scene.vector),
            std=np.nan_to_num(np.array(scene.std), nan=0.0),
            bids=self.vectors.view(),
            weights=np.array(weights_of(space)) if self.weights is None else self.weights.view(),
            widths=np.array([p.maximum - p.minimum for p in space.parameters]),
            runs=self.column(terms.runs),
            rounds=np.array(float(terms.rounds_run)),
            idle=terms.rounds_run - self.column(terms.last_run),
        )
        for values in vars(field).values():
            values.flags.writeable = False
        return field


def _rows(rows: Sequence[Vector], space: SceneSpace) -> Floats:
    return np.array(rows, dtype=np.float64, order="F").reshape((len(rows), len(space)), order="F")


def weights_of(space: SceneSpace) -> tuple[float, ...]:
    """Return the weights that ``scene.yaml`` gives the parameters."""
    return tuple(parameter.weight for parameter in space.parameters)


class BidColumns:
    """Builder of a bid table, which takes all bids of a host at once."""

    def __init__(self, space: SceneSpace) -> None:
        self._weights = np.array(weights_of(space))
        self._agents: list[str] = []
        self._agent_ids: list[int] = []
        self._hosts: list[str] = []
        self._instances: list[str] = []
        self._vectors: list[Floats] = [np.empty((0, len(space)))]
        self._stated: list[Floats] = [np.empty((0, len(space)))]
        self._any_stated = False

    def add(
        self,
        agents: Sequence[str],
        agent_ids: Sequence[int],
        host: str,
        instance: str,
        vectors: Floats,
        weights: Floats | None,
    ) -> None:
        """Add bids of one host: k names and ids, vectors [k, n] and weights [k, n] or None."""
        self._agents += agents
        self._agent_ids += agent_ids
        self._hosts += [host] * len(agents)
        self._instances += [instance] * len(agents)
        self._vectors.append(vectors)
        self._stated.append(
            np.broadcast_to(self._weights, vectors.shape) if weights is None else weights
        )
        self._any_stated |= weights is not None

    def table(self) -> BidTable:
        """Return all bids, in the order of their names."""
        places = None
        if sorted(self._agents) != self._agents:
            places = sorted(range(len(self._agents)), key=self._agents.__getitem__)
        return BidTable(
            agents=_in_order(self._agents, places),
            agent_ids=_in_order(self._agent_ids, places),
            hosts=_in_order(self._hosts, places),
            instances=_in_order(self._instances, places),
            vectors=_by_parameter(self._vectors, places),
            weights=_by_parameter(self._stated, places) if self._any_stated else None,
        )


def _in_order(values: list[T], places: list[int] | None) -> tuple[T, ...]:
    return tuple(values if places is None else [values[place] for place in places])


def _by_parameter(blocks: Sequence[Floats], places: list[int] | None) -> Floats:
    rows = np.concatenate(blocks)
    return np.asfortranarray(rows if places is None else rows[places])


class BidRows:
    """Vectors and weights of one host's answer, one row an agent, checked all at once.

    The lengths of the answer have to be right.

    Attributes:
        vectors: [k, n]; a row counts only when :meth:`check` has passed.
        weights: The same for weights; None when the host states none.
    """

    def __init__(self, space: SceneSpace, bids: Bids) -> None:
        self._space = space
        self._bids = bids
        shape = (len(bids.agents), len(space))
        low = [parameter.minimum for parameter in space.parameters]
        high = [parameter.maximum for parameter in space.parameters]
        self.vectors, self._fine = _within(bids.vectors, shape, low, high)
        self.weights: Floats | None = None
        if len(bids.weights):
            self.weights, fine = _within(bids.weights, shape, [0.0], [MAX_WEIGHT])
            self._fine &= fine

    @property
    def all_fine(self) -> bool:
        """True when every row is valid."""
        return bool(self._fine.all())

    def check(self, row: int, agent: str) -> None:
        """Check the row of one agent.

        Raises:
            Refused: As :meth:`SceneSpace.vector`, or ``BAD_WEIGHT``.
        """
        if self._fine[row]:
            return
        width = len(self._space)
        cells = slice(row * width, (row + 1) * width)
        self.vectors[row] = self._space.vector(self._bids.vectors[cells], what=f"bid of {agent}")
        for name, weight in zip(self._space.names, self._bids.weights[cells], strict=False):
            if not (math.isfinite(weight) and 0.0 <= weight <= MAX_WEIGHT):
                raise Refused(
                    "BAD_WEIGHT",
                    f"bid of {agent}: the weight of {name} is {weight:g}, expected 0 to "
                    f"{MAX_WEIGHT:g}",
                )


def _within(
    values: Sequence[float], shape: tuple[int, int], low: list[float], high: list[float]
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return the values [k, n] and which rows are numbers within the limits, [k]."""
    try:
        table = np.array(values, dtype=np.float64).reshape(shape)
    except (TypeError, ValueError, OverflowError):
        return np.full(shape, math.nan), np.zeros(shape[0], dtype=np.bool_)
    fine: npt.NDArray[np.bool_] = np.all((table >= low) & (table <= high), axis=1)
    return table, fine
