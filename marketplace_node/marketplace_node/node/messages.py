# SPDX-License-Identifier: Apache-2.0
"""Messages of the market: what comes in unchecked, and what goes out."""

from __future__ import annotations

import math
from typing import Any

from bt_agents.errors import Refused
from bt_agents.ros.messages import scene_from_msg, scene_to_msg, seconds
from bt_agents.scene import SceneSpace
from bt_agents.stop_words import CUT_OFF
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Auction as AuctionMsg
from bt_agents_interfaces.msg import Bids as BidsMsg
from bt_agents_interfaces.msg import MarketStatus
from bt_agents_interfaces.msg import RankedBid as RankedBidMsg
from bt_agents_interfaces.msg import RefusedBid as RefusedBidMsg
from bt_agents_interfaces.msg import Run as RunMsg
from bt_agents_interfaces.msg import SceneEnd as SceneEndMsg
from bt_agents_interfaces.srv import RegisterHost
from marketplace_node import explain
from marketplace_node.auction import Bids
from marketplace_node.award import RunEnd
from marketplace_node.effects import (
    AnnounceRun,
    EarlierRun,
    Goal,
    PublishAuction,
    RunEventKind,
    RunOutcome,
    SceneEnded,
    SendGoal,
    StatusChanged,
)
from marketplace_node.registry import Registration

_ENDED = (RunMsg.SUCCEEDED, RunMsg.FAILED, RunMsg.CANCELLED, RunMsg.LOST)


def bids_from_msg(message: BidsMsg) -> Bids:
    """Return a host's answer; the auction checks it."""
    return Bids(
        epoch=message.epoch,
        round=message.round,
        host=message.host,
        instance=message.host_instance,
        agents=tuple(message.agents),
        agent_ids=tuple(message.agent_ids),
        vectors=tuple(message.vectors),
        declined=tuple(message.declined),
        decline_reasons=tuple(message.decline_reasons),
    )


def registration_from_msg(request: RegisterHost.Request) -> Registration:
    """Return a host's registration; the registry checks it."""
    return Registration(
        host=request.host,
        instance=request.host_instance,
        run_action=request.run_action,
        heartbeat=request.heartbeat,
        parameters=tuple(request.parameters),
        agents=tuple(request.agents),
    )


def run_end_from_msg(result: RunAgent.Result) -> RunEnd:
    """Return how a host says that a run ended; the interaction checks it."""
    return RunEnd(
        outcome=result.outcome,
        message=result.message,
        orphans=tuple(result.orphans),
        ticks=result.ticks,
        overruns=result.overruns,
    )


def earlier_run_from_msg(message: RunMsg, space: SceneSpace, now_s: float) -> EarlierRun:
    """Check a run of an earlier market and return it.

    Args:
        message: As the host hands it over.
        space: The scene parameters.
        now_s: Time on the clock of its stamp [s].

    Raises:
        Refused: ``NOT_ENDED``, ``UNKNOWN_OUTCOME``, ``EMPTY``, ``NOT_FINITE``, or as in
            :func:`scene_from_msg`.
    """
    if message.event != RunMsg.ENDED:
        raise Refused(
            "NOT_ENDED", f"event is {message.event}, expected {RunMsg.ENDED}: a run that has ended"
        )
    if message.outcome not in _ENDED:
        raise Refused("UNKNOWN_OUTCOME", f"outcome is {message.outcome}, expected 1 to 4")
    if not (message.epoch and message.round and message.agent):
        raise Refused("EMPTY", "epoch, round or agent is empty; they name the run")
    if not math.isfinite(message.duration_s):
        raise Refused("NOT_FINITE", f"duration_s is {message.duration_s}, expected seconds")
    return EarlierRun(
        epoch=message.epoch,
        goal=Goal(
            round=message.round,
            agent=message.agent,
            agent_id=message.agent_id,
            host=message.host,
            instance=message.host_instance,
        ),
        outcome=RunOutcome(message.outcome),
        scene=scene_from_msg(message.scene, space),
        message=message.message,
        cut_off=_cut_off(message),
        orphans=tuple(message.orphans),
        ticks=message.ticks,
        overruns=message.overruns,
        duration_s=message.duration_s,
        age_s=now_s - seconds(message.stamp),
    )


def goal_to_msg(effect: SendGoal, epoch: str) -> RunAgent.Goal:
    """Return the message of a goal."""
    goal = effect.goal
    return RunAgent.Goal(
        epoch=epoch,
        round=goal.round,
        host_instance=goal.instance,
        agent=goal.agent,
        agent_id=goal.agent_id,
        scene=scene_to_msg(effect.scene),
    )


def status_to_msg(status: StatusChanged, epoch: str, stamp: Any) -> MarketStatus:
    """Return the message of what the market is doing since ``stamp``."""
    return MarketStatus(
        stamp=stamp,
        epoch=epoch,
        state=int(status.state),
        round=status.round,
        scene_id=status.scene_id,
        agent=status.agent,
        host=status.host,
        finished_scene_id=status.finished_scene_id,
        queued=status.queued,
        hosts=status.hosts,
        agents=status.agents,
        message=status.message,
    )


def auction_to_msg(effect: PublishAuction, stamp: Any) -> AuctionMsg:
    """Return the message of the outcome of a round."""
    decision, terms = effect.decision, effect.decision.terms
    winner = decision.winner
    return AuctionMsg(
        stamp=stamp,
        epoch=terms.epoch,
        round=terms.round,
        follows=terms.follows,
        scene=scene_to_msg(terms.scene),
        outcome=int(decision.outcome),
        closed_by=int(decision.closed_by),
        duration_s=decision.duration_s,
        strategy=terms.strategy,
        ranking=[
            RankedBidMsg(
                agent=bid.agent,
                agent_id=bid.agent_id,
                host=bid.host,
                vector=list(bid.vector),
                distance=bid.distance,
                calculation=explain.calculation(bid.distance, bid.vector, terms.scene),
            )
            for bid in decision.ranking
        ],
        refused=[
            RefusedBidMsg(
                agent=bid.agent,
                host=bid.host,
                kind=int(bid.kind),
                code=bid.code,
                reason=bid.reason,
            )
            for bid in decision.refused
        ],
        silent_hosts=list(decision.silent_hosts),
        winner=winner.agent if winner else "",
        winner_id=winner.agent_id if winner else 0,
        host=winner.host if winner else "",
        margin=decision.margin,
        reason=effect.reason,
    )


def _cut_off(message: RunMsg) -> bool:
    """Whether a run was broken off without anybody having wanted it."""
    cancelled = message.outcome == RunMsg.CANCELLED and str(message.message).startswith(CUT_OFF)
    return cancelled or message.outcome == RunMsg.LOST


def run_to_msg(effect: AnnounceRun, epoch: str, stamp: Any) -> RunMsg:
    """Return the message of an event in the life of a run."""
    return RunMsg(
        stamp=stamp,
        epoch=epoch,
        round=effect.goal.round,
        event=int(effect.event),
        outcome=int(effect.outcome),
        scene=scene_to_msg(effect.scene),
        agent=effect.goal.agent,
        agent_id=effect.goal.agent_id,
        host=effect.goal.host,
        host_instance=effect.goal.instance,
        message=effect.message,
        orphans=list(effect.orphans),
        ticks=effect.ticks,
        overruns=effect.overruns,
        duration_s=effect.duration_s,
    )


def earlier_run_to_msg(run: EarlierRun, stamp: Any) -> RunMsg:
    """Return the message of the end of a run of an earlier market."""
    end = AnnounceRun(
        event=RunEventKind.ENDED,
        outcome=run.outcome,
        goal=run.goal,
        scene=run.scene,
        message=run.message,
        orphans=run.orphans,
        ticks=run.ticks,
        overruns=run.overruns,
        duration_s=run.duration_s,
    )
    return run_to_msg(end, run.epoch, stamp)


def scene_end_to_msg(effect: SceneEnded, epoch: str, stamp: Any) -> SceneEndMsg:
    """Return the message of the end of a scene."""
    return SceneEndMsg(
        stamp=stamp,
        epoch=epoch,
        scene_id=effect.scene_id,
        code=effect.code,
        round=effect.round,
        agent=effect.agent,
        message=effect.message,
    )
