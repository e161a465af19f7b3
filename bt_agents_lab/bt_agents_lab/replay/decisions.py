# SPDX-License-Identifier: Apache-2.0
"""Replay of the decisions in a journal: compares order, scores, winner and reason."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import zip_longest
from typing import Any

from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.scene import Scene, SceneSpace
from bt_agents_lab.replay.findings import ReplayFinding, ReplayVerdict, compared, not_recorded
from bt_agents_lab.replay.recording_index import NO_TEXTS, Round
from bt_agents_lab.replay.scenes import bids_of, external_of, scene_of, terms_of
from marketplace_node.explanation.explanation import explanation
from marketplace_node.explanation.reason import calculation, reason_of
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import (
    ClosedBy,
    Decision,
    Ranked,
    RankedBid,
    RefusedBid,
    RoundKind,
    Terms,
)
from marketplace_node.round.ranking import decide
from marketplace_node.settings import EXTERNAL, RULES
from marketplace_node.strategies import STRATEGIES

KIND = "decision"

_NOT_ASKED = " is not asked: "
"""Part of lines about hosts that the message does not mention elsewhere."""


def replay_decisions(rounds: Iterable[Round]) -> Iterator[ReplayFinding]:
    """Decide each round again and yield whether all of it is equal, bit for bit."""
    for one in rounds:
        auction = one.auction
        where = one.name + (f", {auction.winner}" if auction.winner else "")
        if one.space is None:
            yield not_recorded(KIND, where, NO_TEXTS)
            continue
        try:
            yield _by_any_rules(one, one.space, where)
        except Refused as refused:
            yield compared(KIND, where, refused.reason)
        except BtAgentsError as error:
            yield not_recorded(KIND, where, str(error))
        except AttributeError as error:
            yield not_recorded(KIND, where, f"another version recorded it, without {error.name}")


def _by_any_rules(one: Round, space: SceneSpace, where: str) -> ReplayFinding:
    """Return the finding with the best fitting of the possible rules of the market."""
    findings = (
        _again(replace(one, possible_rules=(rules,)), space, where) for rules in one.possible_rules
    )
    first = next(findings)
    if RULES not in (one.auction.strategy, one.auction.shadow_strategy):
        return first
    equal = (other for other in findings if other.verdict is ReplayVerdict.EQUAL)
    return first if first.verdict is ReplayVerdict.EQUAL else next(equal, first)


def _again(one: Round, space: SceneSpace, where: str) -> ReplayFinding:
    auction = one.auction
    if not auction.ranking:
        won = f"nobody bid, but {auction.winner} won" if auction.winner else ""
        return compared(KIND, where, won or _outcome_difference(auction, None))
    if auction.strategy not in STRATEGIES:
        missing = f"the strategy {auction.strategy} is not installed here"
        return not_recorded(KIND, where, missing)
    scene = scene_of(auction.scene, space)
    if auction.shadow_strategy not in ("", *STRATEGIES):
        missing = f"the shadow strategy {auction.shadow_strategy} is not installed here"
        return not_recorded(KIND, where, missing)
    terms = terms_of(one, scene, one.runs or 0)
    ranked = decide(
        space.profiles,
        terms,
        bids_of(auction.ranking),
        external=external_of(auction) if auction.strategy == EXTERNAL else None,
    )
    shadow = ""
    if auction.shadow_winner != ranked.shadow_winner:
        shadow = f"the shadow chose {auction.shadow_winner}, now {ranked.shadow_winner}"
    for strategy, difference in (
        (auction.strategy, _difference(one, ranked, scene)),
        (auction.shadow_strategy, shadow),
    ):
        if one.runs is None and strategy and STRATEGIES[strategy].counts:
            missing = (
                f"how many runs were before, on which {strategy} depends: the journal does not "
                "begin with this market"
            )
            return not_recorded(KIND, where, missing)
        if difference:
            return compared(KIND, where, difference)
    # The explanation states which agents the call left out, and why.
    text = _reason_difference(auction, terms, ranked, space) if one.excluded == () else ""
    return compared(KIND, where, text)


def _difference(one: Round, ranked: Ranked, scene: Scene) -> str:
    """Return the first difference as text; empty if everything is equal."""
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
    if text := _outcome_difference(auction, best):
        return text
    margin = math.nan
    if not stopped and len(ranked.bids) > 1:
        margin = ranked.bids[1].score - ranked.bids[0].score
    if not _same(auction.margin, margin):
        return _differs("the margin", auction.margin, margin)
    names = list(ranked.change.names) if ranked.change else []
    values = list(ranked.change.values) if ranked.change else []
    if list(auction.change_names) != names or list(auction.change_values) != values:
        return "another change would have made the runner-up win"
    return ""


def _outcome_difference(auction: Any, best: RankedBid | None) -> str:
    """Return how the outcome contradicts the winner; its effect on a run is not compared."""
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


def _reason_difference(auction: Any, terms: Terms, ranked: Ranked, space: SceneSpace) -> str:
    """Return the difference in the reason and explanation of a plain award; empty if none.

    Those of other rounds depend on more than their message holds: an earlier scene, a stopped or
    continuing run, commands of operators, the answer of an external program.
    """
    plain = auction.outcome == AuctionOutcome.AWARDED and auction.strategy != EXTERNAL
    if not plain or auction.follows or auction.intervention:
        return ""
    decision = Decision(
        terms=terms,
        outcome=AuctionOutcome.AWARDED,
        closed_by=ClosedBy(auction.closed_by),
        duration_s=auction.duration_s,
        ranked=ranked,
        refused=tuple(
            RefusedBid(
                agent=bid.agent,
                host=bid.host,
                kind=RoundKind(bid.kind),
                code=bid.code,
                reason=bid.reason,
            )
            for bid in auction.refused
        ),
        silent_hosts=tuple(auction.silent_hosts),
    )
    again = reason_of(decision)
    if auction.reason != again:
        return f"the reason was '{auction.reason}', now '{again}'"
    was, now = _lines(auction.explanation), _lines(explanation(decision, space))
    for before, after in zip([*was, ""], [*now, ""], strict=False):
        if before != after:
            return f"the explanation said '{before}', now '{after}'"
    return ""


def _lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if _NOT_ASKED not in line]


def _same(one: float, other: float) -> bool:
    return one == other or (math.isnan(one) and math.isnan(other))


def _differs(what: str, was: float, now: float) -> str:
    return f"{what} was {was!r}, now {now!r}"
