# SPDX-License-Identifier: Apache-2.0
"""Conversion of decoded messages into scenes, terms and bids of the market core."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from bt_agents_core.person_facts import facts, values_of
from bt_agents_core.scene import Origin, Scene, SceneSpace, SceneValue
from bt_agents_lab.replay.recording_index import Round
from marketplace_node.round.decision import AcceptedBid, External, Terms


def scene_of(message: Any, space: SceneSpace) -> Scene:
    """Return the scene of a message.

    Raises:
        Refused: As in :meth:`SceneSpace.scene` and :func:`facts`.
    """
    values = [
        SceneValue(
            name=value.name,
            value=value.value,
            origin=Origin(value.origin),
            age_s=value.age_s,
            std=value.std,
            confidence=value.confidence,
            source=value.source,
        )
        for value in message.values
    ]
    return Scene(
        scene_id=message.scene_id,
        label=message.label,
        person=message.person,
        values=space.scene(values),
        urgent=message.urgent,
        person_id=message.person_id,
        place=message.place,
        persons=message.persons,
        visits=message.visits,
        remembered=facts(values_of(message.remembered)),
        stamp=message.header.stamp.sec + message.header.stamp.nanosec * 1e-9,
    )


def terms_of(one: Round, scene: Scene, runs: int) -> Terms:
    """Return the fixed terms of a round at its opening, after a number of runs of this start."""
    auction = one.auction
    return Terms(
        epoch=auction.epoch,
        round=auction.round,
        follows=auction.follows,
        scene=scene,
        strategy=auction.strategy,
        tie_break=auction.tie_break,
        runs={bid.agent: bid.runs for bid in auction.ranking},
        last_run={bid.agent: bid.last_run for bid in auction.ranking},
        rounds_run=one.earlier + runs,
        earlier_runs=one.earlier,
        options=dict(zip(auction.option_names, auction.option_values, strict=True)),
        seed=auction.seed,
        shadow=auction.shadow_strategy,
        shadow_options=dict(
            zip(auction.shadow_option_names, auction.shadow_option_values, strict=True)
        ),
        rules=one.rules,
        intervention=auction.intervention,
        preview=auction.preview,
    )


def bids_of(ranking: Iterable[Any]) -> tuple[AcceptedBid, ...]:
    """Return the accepted bids of a round."""
    return tuple(
        AcceptedBid(
            agent=bid.agent,
            agent_id=bid.agent_id,
            host=bid.host,
            instance="",
            vector=tuple(bid.vector),
            weights=tuple(bid.weights),
        )
        for bid in ranking
    )


def external_of(auction: Any) -> External:
    """Return the external answer that ranked a round.

    Bids that such an answer puts first have scores below every distance, that is below 0.
    """
    first = tuple(bid.agent for bid in auction.ranking if bid.score < 0.0)
    return External(ranking=first) if first else External(failure="it gave no usable answer")
