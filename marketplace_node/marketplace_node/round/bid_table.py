# SPDX-License-Identifier: Apache-2.0
"""Accepted bids of a round as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bt_agents_core.scene import SceneSpace, Vector
from marketplace_node.round.decision import AcceptedBid, Terms
from marketplace_node.strategies import RoundArrays
from marketplace_node.strategies.arrays import Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class BidTable:
    """Accepted bids by column, sorted by the agents' names.

    Attributes:
        instances: The starts of the hosts.
        vectors: [N, n].
        weights: [N, n]; None when no agent states any.
    """

    agents: tuple[str, ...]
    agent_ids: tuple[int, ...]
    hosts: tuple[str, ...]
    instances: tuple[str, ...]
    vectors: Floats
    weights: Floats | None = None

    @classmethod
    def of(cls, bids: Sequence[AcceptedBid], space: SceneSpace) -> BidTable:
        """Return the table of bids given in any order."""
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
        """Return a number for each bidder, 0 for those not in the mapping; [N]."""
        if not of_agents:
            return np.zeros(len(self))
        return np.array([of_agents.get(agent, 0) for agent in self.agents], dtype=np.float64)

    def field(self, space: SceneSpace, terms: Terms) -> RoundArrays:
        """Return the read-only input of a strategy."""
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
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(space))


def weights_of(space: SceneSpace) -> tuple[float, ...]:
    """Return the weights of the parameters in ``scene.yaml``."""
    return tuple(parameter.weight for parameter in space.parameters)
