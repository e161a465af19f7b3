# SPDX-License-Identifier: Apache-2.0
"""Converts between the messages of the market and its data."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

from rclpy.serialization import deserialize_message

from bt_agents_core.errors import Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_core.stop_cause import StoppedBy
from bt_agents_core.text import single_spaced
from bt_agents_interfaces.action import RunAgent
from bt_agents_interfaces.msg import Auction as AuctionMsg
from bt_agents_interfaces.msg import Bids as BidsMsg
from bt_agents_interfaces.msg import (
    CallForBids,
    FileProblem,
    Heartbeat,
    MarketStatus,
    StrategyInfo,
)
from bt_agents_interfaces.msg import RankedBid as RankedBidMsg
from bt_agents_interfaces.msg import RefusedBid as RefusedBidMsg
from bt_agents_interfaces.msg import Run as RunMsg
from bt_agents_interfaces.msg import SceneEnd as SceneEndMsg
from bt_agents_interfaces.srv import OperateMarket, RegisterHost, SelectAgent
from bt_agents_ros import bid_encoding
from bt_agents_ros.messages import header_at, scene_from_msg, scene_to_msg, seconds
from marketplace_node.effects import (
    AnnounceRun,
    EarlierRun,
    OpenCall,
    PublishAuction,
    RequestRanking,
    SceneEnded,
    SendGoal,
    StatusChanged,
)
from marketplace_node.explanation.reason import calculation
from marketplace_node.formatting import shown
from marketplace_node.hosts.host_effects import RunGoal
from marketplace_node.hosts.registry import TOKEN_BYTES, HostEntry, Registration
from marketplace_node.interaction.phases import RunEnd
from marketplace_node.operator_overrides import OperatorAction, OperatorCommand
from marketplace_node.outcomes import RunOutcome
from marketplace_node.round.decision import Bids, Decision, External, RankedBid
from marketplace_node.round.precedence import check_ranking
from marketplace_node.strategies import STRATEGIES

_ENDED = (RunMsg.SUCCEEDED, RunMsg.FAILED, RunMsg.CANCELLED, RunMsg.LOST)

_TOKEN = slice(4, 4 + TOKEN_BYTES)
"""Place of the token in a serialised heartbeat: the first field, after the header."""


class BidDecoder:
    """Decoder of bids; caches the last answer of each host that ``is_known`` accepts."""

    def __init__(self, epoch: str, is_known: Callable[[str], bool]) -> None:
        self._epoch = epoch
        self._is_known = is_known
        self._last: dict[str, tuple[bytes, Bids]] = {}

    def read(self, message: bytes) -> Bids:
        """Return the answer in a serialised message; the auction checks it.

        Raises:
            Refused: ``MALFORMED``.
        """
        for last, bids in self._last.values():
            number = bid_encoding.round_of(message, last, self._epoch)
            if number is not None:
                return replace(bids, round=number)
        try:
            bids = bids_from_msg(deserialize_message(message, BidsMsg))
        except Exception as error:
            raise Refused(RefusalCode.MALFORMED, f"bids that are not a message: {error}") from None
        if bids.epoch == self._epoch and self._is_known(bids.host):
            self._last[bids.host] = (message, bids)
        return bids

    def forget(self, host: str) -> None:
        """Drop the cached answer of a host."""
        self._last.pop(host, None)


def bids_from_msg(message: BidsMsg) -> Bids:
    """Return a host's answer; the auction checks it."""
    return Bids(
        epoch=message.epoch,
        round=message.round,
        host=message.host,
        instance=message.host_instance,
        agents=tuple(message.agents),
        agent_ids=tuple(message.agent_ids),
        vectors=message.vectors,
        weights=message.weights,
        declined=tuple(message.declined),
        decline_reasons=tuple(message.decline_reasons),
        unmet=tuple(message.unmet),
        token=bytes(message.token),
    )


def heartbeat_of(entry: HostEntry, message: bytes) -> Heartbeat:
    """Return a serialised heartbeat of a host; a false one is refused before it is converted.

    Raises:
        Refused: ``WRONG_TOKEN`` or ``MALFORMED``.
    """
    entry.check_token(message[_TOKEN])
    try:
        return deserialize_message(message, Heartbeat)
    except Exception as error:
        raise Refused(
            RefusalCode.MALFORMED, f"a heartbeat that is not a message: {error}"
        ) from None


def registration_from_msg(request: RegisterHost.Request) -> Registration:
    """Return a host's registration; the registry checks it."""
    return Registration(
        host=request.host,
        instance=request.host_instance,
        run_action=request.run_action,
        heartbeat=request.heartbeat,
        parameters=tuple(request.parameters),
        agents=tuple(request.agents),
        token=bytes(request.token),
    )


def run_end_from_msg(result: RunAgent.Result) -> RunEnd:
    """Return the end of a run, as its host reports it; the interaction checks it."""
    return RunEnd(
        outcome=result.outcome,
        message=result.message,
        stop_cause=result.stop_cause,
        host_reason=result.host_reason,
        orphans=tuple(result.orphans),
        ticks=result.ticks,
        overruns=result.overruns,
    )


def earlier_run_from_msg(message: RunMsg, space: SceneSpace, now_s: float) -> EarlierRun:
    """Check and return a run of an earlier market that a host reports at ``now_s`` [s].

    Raises:
        Refused: ``NOT_ENDED``, ``UNKNOWN_OUTCOME``, ``EMPTY``, ``NOT_FINITE``, or as in
            :func:`scene_from_msg`.
    """
    if message.event != RunMsg.ENDED:
        raise Refused(
            RefusalCode.NOT_ENDED,
            f"event is {message.event}, expected {RunMsg.ENDED}: a run that has ended",
        )
    if message.outcome not in _ENDED:
        raise Refused(
            RefusalCode.UNKNOWN_OUTCOME, f"outcome is {message.outcome}, expected 1 to 4"
        )
    if not (message.epoch and message.round and message.agent):
        raise Refused(RefusalCode.EMPTY, "epoch, round or agent is empty; they name the run")
    if not math.isfinite(message.duration_s):
        raise Refused(
            RefusalCode.NOT_FINITE, f"duration_s is {message.duration_s}, expected seconds"
        )
    return EarlierRun(
        epoch=message.epoch,
        goal=RunGoal(
            round=message.round,
            agent=message.agent,
            agent_id=message.agent_id,
            host=message.host,
            instance=message.host_instance,
        ),
        outcome=RunOutcome(message.outcome),
        scene=scene_from_msg(message.scene, space),
        message=message.message,
        stop_cause=message.stop_cause,
        stopped_by=StoppedBy.of(message.stopped_by),
        stop_reason=message.stop_reason,
        orphans=tuple(message.orphans),
        ticks=message.ticks,
        overruns=message.overruns,
        duration_s=message.duration_s,
        age_s=now_s - seconds(message.header.stamp),
    )


def call_to_msg(effect: OpenCall, epoch: str, space: SceneSpace, stamp: Any) -> CallForBids:
    """Return the message of a call for bids."""
    return CallForBids(
        header=header_at(stamp),
        epoch=epoch,
        round=effect.round,
        scene=scene_to_msg(effect.scene),
        parameters=list(space.profiles.names),
        deadline_s=effect.deadline_s,
        excluded=list(effect.excluded),
    )


def goal_to_msg(effect: SendGoal, epoch: str, token: bytes) -> RunAgent.Goal:
    """Return the message of a goal."""
    goal = effect.goal
    return RunAgent.Goal(
        epoch=epoch,
        round=goal.round,
        host_instance=goal.instance,
        agent=goal.agent,
        agent_id=goal.agent_id,
        token=list(token),
        scene=scene_to_msg(effect.scene),
    )


def status_to_msg(
    status: StatusChanged, epoch: str, stamp: Any, *, supervised: bool = False
) -> MarketStatus:
    """Return the message of the market's state since ``stamp``; see ``MarketStatus.msg``."""
    problems = [FileProblem(**vars(one)) for one in status.problems]
    return MarketStatus(
        **{**vars(status), "problems": problems},
        header=header_at(stamp),
        epoch=epoch,
        strategies=strategies_to_msg(),
        supervised=supervised,
    )


@cache
def strategies_to_msg() -> list[StrategyInfo]:
    """Return the messages of all strategies; plug-ins must have been loaded before."""
    return [
        StrategyInfo(
            name=name,
            description=single_spaced(spec.description),
            options=[option.name for option in spec.options],
        )
        for name, spec in STRATEGIES.items()
    ]


def auction_to_msg(effect: PublishAuction, stamp: Any) -> AuctionMsg:
    """Return the message of the outcome of a round."""
    decision, terms = effect.decision, effect.decision.terms
    winner, change = decision.winner, decision.ranked.change
    draws = any(STRATEGIES[name].draws for name in (terms.strategy, terms.shadow) if name)
    return AuctionMsg(
        header=header_at(stamp),
        epoch=terms.epoch,
        round=terms.round,
        follows=terms.follows,
        scene=scene_to_msg(terms.scene),
        outcome=int(decision.outcome),
        closed_by=int(decision.closed_by),
        preview=terms.preview,
        duration_s=decision.duration_s,
        strategy=terms.strategy,
        option_names=list(terms.options),
        option_values=[float(value) for value in terms.options.values()],
        earlier_runs=terms.earlier_runs,
        tie_break=terms.tie_break,
        seed=terms.seed if draws else "",
        intervention=terms.intervention,
        ranking=[_ranked_to_msg(bid, decision) for bid in decision.ranking],
        refused=[
            RefusedBidMsg(
                agent=bid.agent, host=bid.host, kind=bid.kind, code=bid.code, reason=bid.reason
            )
            for bid in decision.refused
        ],
        silent_hosts=list(decision.silent_hosts),
        winner=winner.agent if winner else "",
        winner_id=winner.agent_id if winner else 0,
        host=winner.host if winner else "",
        margin=decision.margin,
        shadow_strategy=terms.shadow,
        shadow_option_names=list(terms.shadow_options),
        shadow_option_values=[float(value) for value in terms.shadow_options.values()],
        shadow_winner=decision.ranked.shadow_winner,
        shadow_rounds=effect.shadow_rounds,
        shadow_disagreements=effect.shadow_disagreements,
        change_names=list(change.names) if change else [],
        change_values=list(change.values) if change else [],
        reason=effect.reason,
        explanation=effect.explanation,
    )


def selection_to_msg(effect: RequestRanking, epoch: str) -> SelectAgent.Request:
    """Return the request to rank the bids of a round."""
    return SelectAgent.Request(
        epoch=epoch,
        round=effect.round,
        limit_s=effect.limit_s,
        scene=scene_to_msg(effect.scene),
        agents=list(effect.agents),
        vectors=[value for vector in effect.vectors for value in vector],
        distances=list(effect.distances),
    )


def selection_from_msg(answer: SelectAgent.Response, bidders: Sequence[str]) -> External:
    """Return the answer of an external program, whatever it contains."""
    message = shown(answer.message)
    if not answer.accepted:
        return External(failure=f"the selector says: {message or 'no'}")
    try:
        return External(ranking=check_ranking(answer.ranking, bidders), message=message)
    except Refused as refused:
        return External(failure=f"the selector's answer is of no use: {refused.reason}")


def operator_command_from_msg(
    request: OperateMarket.Request, space: SceneSpace
) -> OperatorCommand:
    """Check and return the command of an operator.

    Raises:
        Refused: ``UNKNOWN_ACTION``, or as in :func:`scene_from_msg`.
    """
    if request.action not in set(OperatorAction):
        raise Refused(RefusalCode.UNKNOWN_ACTION, f"action is {request.action}, expected 0 to 4")
    action = OperatorAction(request.action)
    return OperatorCommand(
        action=action,
        agent=request.agent,
        author=shown(request.author),
        reason=shown(request.reason),
        scene=scene_or_last(request.scene, space) if action is OperatorAction.AWARD else None,
    )


def scene_or_last(message: Any, space: SceneSpace) -> Scene | None:
    """Return the scene of a request; None when it names none, which means the last scene.

    Missing fields get the values that the scene layer has for an unknown person.

    Raises:
        Refused: As in :func:`scene_from_msg`; also ``EMPTY`` for values without a scene_id.
    """
    if not message.scene_id and not message.values:
        return None
    scene = scene_from_msg(message, space)
    return space.completed(scene, met=scene.person)


def _ranked_to_msg(bid: RankedBid, decision: Decision) -> RankedBidMsg:
    fields = bid._asdict()
    del fields["instance"]  # the message names only the host
    sum_of_it = calculation(bid, decision.terms.scene, decision.ranked.by)
    return RankedBidMsg(**fields, calculation=sum_of_it)


def run_to_msg(effect: AnnounceRun, epoch: str, stamp: Any) -> RunMsg:
    """Return the message of an event in the life of a run."""
    return RunMsg(
        header=header_at(stamp),
        epoch=epoch,
        round=effect.goal.round,
        event=int(effect.event),
        outcome=int(effect.outcome),
        stop_cause=int(effect.stop_cause),
        stopped_by=int(effect.stopped_by),
        stop_reason=effect.stop_reason,
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


def scene_end_to_msg(effect: SceneEnded, epoch: str, stamp: Any) -> SceneEndMsg:
    """Return the message of the end of a scene."""
    fields = {**vars(effect), "epoch": effect.epoch or epoch}
    return SceneEndMsg(header=header_at(stamp), **fields)
