# SPDX-License-Identifier: Apache-2.0
"""Decides the rounds of a journal again and compares order, scores and winner."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from typing import Any

from bt_agents.errors import BtAgentsError, Refused
from bt_agents.scene import SceneSpace
from bt_agents_lab.replay.findings import Finding, Verdict
from bt_agents_lab.replay.scenes import bids_of, external_of, scene_of, terms_of
from bt_agents_lab.replay.story import Round
from marketplace_node.decision import ClosedBy, Ranked, RankedBid
from marketplace_node.ranking import decide
from marketplace_node.strategies import STRATEGIES

KIND = "decision"

_OUTSIDE = "external"


def decisions_again(rounds: Iterable[Round]) -> Iterator[Finding]:
    """Decide each round again and say whether everything about it is equal, bit for bit."""
    for one in rounds:
        auction = one.auction
        where = f"round {auction.round}" + (f", {auction.winner}" if auction.winner else "")
        if one.making is None:
            missing = "there is no scene.yaml, as no host has sent its texts before"
            yield _finding(where, Verdict.NOT_RECORDED, missing)
            continue
        try:
            yield _again(one, one.making.space, where)
        except Refused as refused:
            yield _finding(where, Verdict.DIFFERENT, refused.reason)
        except BtAgentsError as error:
            yield _finding(where, Verdict.NOT_RECORDED, str(error))


def _again(one: Round, space: SceneSpace, where: str) -> Finding:
    auction = one.auction
    if not auction.ranking:
        words = f"nobody bid, but {auction.winner} won" if auction.winner else ""
        return _finding(where, Verdict.DIFFERENT if words else Verdict.EQUAL, words)
    if auction.strategy not in STRATEGIES:
        missing = f"the strategy {auction.strategy} is not installed here"
        return _finding(where, Verdict.NOT_RECORDED, missing)
    scene = scene_of(auction.scene, space)
    runs = one.runs if one.runs is not None else 0
    ranked = decide(
        space,
        terms_of(one, scene, runs),
        bids_of(auction.ranking),
        external=external_of(auction) if auction.strategy == _OUTSIDE else None,
    )
    difference = _difference(auction, ranked)
    if difference and one.runs is None and any(bid.bonus for bid in auction.ranking):
        missing = "how many runs were before: the journal does not begin with this market"
        return _finding(where, Verdict.NOT_RECORDED, missing)
    return _finding(where, Verdict.DIFFERENT if difference else Verdict.EQUAL, difference)


def _difference(auction: Any, ranked: Ranked) -> str:
    """Return the first difference in words; empty when everything is equal."""
    for place, (was, now) in enumerate(zip_longest(auction.ranking, ranked.bids), 1):
        if was.agent != now.agent:
            return f"place {place} was {was.agent}, now {now.agent}"
        for name in ("distance", "bonus", "score"):
            if not _same(getattr(was, name), getattr(now, name)):
                return _differs(f"{name} of {was.agent}", getattr(was, name), getattr(now, name))
        for name in ("contributions", "weights"):
            if list(getattr(was, name)) != list(getattr(now, name)):
                return f"the {name} of {was.agent} are others"
    stopped = auction.closed_by == ClosedBy.STOPPED
    best = "" if stopped or not ranked.bids else ranked.bids[0].agent
    if auction.winner != best:
        return f"the winner was {auction.winner or 'nobody'}, now {best or 'nobody'}"
    margin = math.nan if stopped else _margin(ranked.bids)
    if not _same(auction.margin, margin):
        return _differs("the margin", auction.margin, margin)
    if auction.shadow_winner != ranked.shadow_winner:
        return f"the shadow chose {auction.shadow_winner}, now {ranked.shadow_winner}"
    names = list(ranked.change.names) if ranked.change else []
    values = list(ranked.change.values) if ranked.change else []
    if list(auction.change_names) != names or list(auction.change_values) != values:
        return "the change by which the runner-up would have won is another"
    return ""


def _margin(bids: tuple[RankedBid, ...]) -> float:
    return bids[1].score - bids[0].score if len(bids) > 1 else math.nan


def _same(one: float, other: float) -> bool:
    return one == other or (math.isnan(one) and math.isnan(other))


def _differs(what: str, was: float, now: float) -> str:
    return f"{what} was {was!r}, now {now!r}"


def _finding(where: str, verdict: Verdict, words: str = "") -> Finding:
    return Finding(kind=KIND, where=where, verdict=verdict, words=words)
