# SPDX-License-Identifier: Apache-2.0
"""Decides the rounds of a journal again and compares order, scores and winner."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import zip_longest
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_lab.replay.compare_reasons import words_difference
from bt_agents_lab.replay.findings import ReplayFinding, ReplayVerdict
from bt_agents_lab.replay.recording_index import NO_MAKING, Round
from bt_agents_lab.replay.scenes import bids_of, external_of, scene_of, terms_of
from marketplace_node.explanation.calculation import calculation
from marketplace_node.round.decision import AuctionOutcome, ClosedBy, Ranked, RankedBid
from marketplace_node.round.ranking import decide
from marketplace_node.settings import EXTERNAL
from marketplace_node.strategies import STRATEGIES

KIND = "decision"


def decisions_again(rounds: Iterable[Round]) -> Iterator[ReplayFinding]:
    """Decide each round again and say whether everything about it is equal, bit for bit."""
    for one in rounds:
        auction = one.auction
        where = f"round {auction.round}" + (f", {auction.winner}" if auction.winner else "")
        if one.making is None:
            yield _finding(where, ReplayVerdict.NOT_RECORDED, NO_MAKING)
            continue
        try:
            yield _again(one, one.making.space, where)
        except Refused as refused:
            yield _finding(where, ReplayVerdict.DIFFERENT, refused.reason)
        except BtAgentsError as error:
            yield _finding(where, ReplayVerdict.NOT_RECORDED, str(error))


def _again(one: Round, space: SceneSpace, where: str) -> ReplayFinding:
    auction = one.auction
    if not auction.ranking:
        words = f"nobody bid, but {auction.winner} won" if auction.winner else ""
        words = words or _outcome_difference(auction, None)
        return _finding(where, ReplayVerdict.DIFFERENT if words else ReplayVerdict.EQUAL, words)
    if auction.strategy not in STRATEGIES:
        missing = f"the strategy {auction.strategy} is not installed here"
        return _finding(where, ReplayVerdict.NOT_RECORDED, missing)
    scene = scene_of(auction.scene, space)
    if auction.shadow_strategy not in ("", *STRATEGIES):
        missing = f"the shadow strategy {auction.shadow_strategy} is not installed here"
        return _finding(where, ReplayVerdict.NOT_RECORDED, missing)
    terms = terms_of(one, scene, one.runs or 0)
    ranked = decide(
        space,
        terms,
        bids_of(auction.ranking),
        external=external_of(auction) if auction.strategy == EXTERNAL else None,
    )
    for strategy, difference in (
        (auction.strategy, partial(_difference, one, ranked, scene)),
        (auction.shadow_strategy, partial(_shadow_difference, auction, ranked)),
    ):
        if one.runs is None and strategy and STRATEGIES[strategy].counts:
            missing = (
                f"how many runs were before, on which {strategy} depends: the journal does not "
                "begin with this market"
            )
            return _finding(where, ReplayVerdict.NOT_RECORDED, missing)
        if words := difference():
            return _finding(where, ReplayVerdict.DIFFERENT, words)
    words = words_difference(auction, terms, ranked, space) if one.format > 1 else ""
    return _finding(where, ReplayVerdict.DIFFERENT if words else ReplayVerdict.EQUAL, words)


def _difference(one: Round, ranked: Ranked, scene: Scene) -> str:
    """Return the first difference in words; empty when everything is equal."""
    auction = one.auction
    for place, (was, now) in enumerate(zip_longest(auction.ranking, ranked.bids), 1):
        if was.agent != now.agent:
            return f"place {place} was {was.agent}, now {now.agent}"
        for name in ("distance", "bonus", "score"):
            if not _same(getattr(was, name), getattr(now, name)):
                return _differs(f"{name} of {was.agent}", getattr(was, name), getattr(now, name))
        for name in ("contributions", "weights"):
            if list(getattr(was, name)) != list(getattr(now, name)):
                return f"the {name} of {was.agent} are others"
        sum_of_it = calculation(now, scene, ranked.by)
        if was.calculation != sum_of_it:
            return f"the sum of {was.agent} was {was.calculation}, now {sum_of_it}"
    stopped = auction.closed_by == ClosedBy.STOPPED
    best = None if stopped or not ranked.bids else ranked.bids[0]
    if auction.winner != (best.agent if best else ""):
        return (
            f"the winner was {auction.winner or 'nobody'}, now {best.agent if best else 'nobody'}"
        )
    if words := _outcome_difference(auction, best):
        return words
    margin = math.nan if stopped else _margin(ranked.bids)
    if not _same(auction.margin, margin):
        return _differs("the margin", auction.margin, margin)
    if one.format == 1:
        return ""
    names = list(ranked.change.names) if ranked.change else []
    values = list(ranked.change.values) if ranked.change else []
    if list(auction.change_names) != names or list(auction.change_values) != values:
        return "the change by which the runner-up would have won is another"
    return ""


def _outcome_difference(auction: Any, best: RankedBid | None) -> str:
    """Return what does not fit to who wins; whether a run stops for it is not looked at."""
    expected = (best.agent_id, best.host) if best else (0, "")
    if (auction.winner_id, auction.host) != expected:
        was = f"{auction.winner_id} of '{auction.host}'"
        return f"the winner was {was}, now {expected[0]} of '{expected[1]}'"
    fitting = (
        (AuctionOutcome.AWARDED, AuctionOutcome.PREEMPTS, AuctionOutcome.WAITS)
        if best
        else (AuctionOutcome.NO_BIDS, AuctionOutcome.WAITS)
    )
    if auction.outcome not in fitting:
        who = f"{best.agent} as winner" if best else "no winner"
        return f"the outcome was {auction.outcome}, which does not go with {who}"
    return ""


def _shadow_difference(auction: Any, ranked: Ranked) -> str:
    """Return the same of the strategy that only looked on."""
    if auction.shadow_winner != ranked.shadow_winner:
        return f"the shadow chose {auction.shadow_winner}, now {ranked.shadow_winner}"
    return ""


def _margin(bids: Sequence[RankedBid]) -> float:
    return bids[1].score - bids[0].score if len(bids) > 1 else math.nan


def _same(one: float, other: float) -> bool:
    return one == other or (math.isnan(one) and math.isnan(other))


def _differs(what: str, was: float, now: float) -> str:
    return f"{what} was {was!r}, now {now!r}"


def _finding(where: str, verdict: ReplayVerdict, words: str = "") -> ReplayFinding:
    return ReplayFinding(kind=KIND, where=where, verdict=verdict, words=words)
