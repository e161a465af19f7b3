# SPDX-License-Identifier: Apache-2.0
"""Reason for a decision on one line, and the distance of a bid as a sum that people can check."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bt_agents_core.scene import Scene
from bt_agents_core.text import format_number, join_first
from marketplace_node.formatting import ALL_DIGITS, FEW, distance
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy, Decision, RankedBid, RefusedBid, RoundKind
from marketplace_node.settings import RULES

_TERMS_SHOWN = 12


def reason_of(decision: Decision) -> str:
    """Return the whole decision as one line for a terminal.

    Example:
        ``attentive_guide 1.5 = |4−5| + |1.5−1| + |3−3|; next: professional_express 4.0
        (margin 2.5)``
    """
    if decision.closed_by is ClosedBy.STOPPED:
        parts = [f"stopped before the round closed: {decision.stopped}"]
    elif decision.winner is not None:
        parts = _award(decision, decision.winner)
    else:
        parts = nobody(decision)
    if decision.terms.intervention:
        parts.insert(0, decision.terms.intervention)
    return _follows(decision) + "; ".join(parts)


def preemption_reason(
    decision: Decision, running: str, margin: float, *, obstacle: str = "", no_room: str = ""
) -> str:
    """Return the decision about a scene that arrived during a run as one line for a terminal.

    Args:
        decision: Decision of the challenge; its outcome says whether the run is stopped.
        running: The running agent.
        margin: How much nearer to the scene another agent must be.
        obstacle: Why a run is not stopped even for a better bid; empty for no obstacle.
        no_room: Why the scene cannot wait; empty when it can.

    Example:
        ``mira 0.5 for the new scene, leo who runs has 2.5: better by 2.0, margin 1.0: leo is
        stopped``
    """
    if decision.closed_by is ClosedBy.STOPPED:
        return f"stopped before the round closed: {decision.stopped}"
    goes_on = f"{running} goes on, " + (f"but {no_room}" if no_room else "the scene waits")
    if decision.winner is None:
        return "; ".join([*nobody(decision), goes_on])
    verdict = f"{running} is stopped" if decision.outcome is AuctionOutcome.PREEMPTS else goes_on
    parts = [_comparison(decision, running, margin), obstacle, verdict]
    return "; ".join([": ".join(part for part in parts if part), *_not_taken(decision)])


def tie_rule(decision: Decision, winner: RankedBid, tied: Sequence[RankedBid]) -> str:
    """Return why the winner precedes equally good bids."""
    if decision.terms.tie_break == "name":
        return f"{winner.agent} is first by name"
    if any(bid.last_run == winner.last_run for bid in tied):
        return f"{winner.agent} is first by name among those that have not run yet"
    if winner.last_run == 0:
        return f"{winner.agent} has not run yet"
    return f"{winner.agent} has not run for the longest time"


def nobody(decision: Decision) -> list[str]:
    """Return why there is no bid, as parts of one line."""
    parts = []
    for first, agents in declined(decision).values():
        names = join_first(agents)
        if first.unmet:
            parts.append(f"{names} {'needs' if len(agents) == 1 else 'need'} {first.unmet}")
        else:
            parts.append(f"{names}: {first.reason}")
    parts += _not_taken(decision)
    parts += [f"{host} is not asked: {why}" for host, why in decision.terms.unasked.items()]
    if not parts:
        other = "other " if decision.terms.follows else ""
        return [f"no {other}agents are registered"]
    parts[0] = f"nobody bids: {parts[0]}"
    return parts


def declined(decision: Decision) -> dict[str, tuple[RefusedBid, list[str]]]:
    """Return the agents that declined the scene by reason, with the first refused bid of each."""
    groups: dict[str, tuple[RefusedBid, list[str]]] = {}
    for bid in decision.refused:
        if bid.kind is RoundKind.DECLINED and bid.agent not in decision.terms.excluded:
            groups.setdefault(bid.reason, (bid, []))[1].append(bid.agent)
    return groups


def calculation(bid: RankedBid, scene: Scene, by: str) -> str:
    """Return the distance of a bid as a sum, and what exploration subtracts from it.

    ``by`` is the name of the strategy that ranked the bid.

    Example:
        ``1.5 = |4−5| + |1.5−1|; mood is missing and left out``
    """
    known: list[int] = []
    missing: list[int] = []
    for index, value in enumerate(scene.values[: len(bid.vector)]):
        (missing if math.isnan(value.value) else known).append(index)
    if not known:
        return f"{distance(bid.distance)}, as every value of the scene is missing"
    terms = [_term(bid, index, scene, by) for index in known[:_TERMS_SHOWN]]
    if len(known) > _TERMS_SHOWN:
        terms.append(f"{len(known) - _TERMS_SHOWN} more")
    text = " + ".join(terms)
    if by == "euclidean":
        text = f"√({text})"
    text = f"{distance(bid.distance)} = {text}"
    if bid.bonus:
        sign = "less" if bid.bonus > 0.0 else "plus"
        text += f", {sign} {format_number(abs(bid.bonus), FEW)} is {distance(bid.score, FEW)}"
    if missing:
        names = join_first(scene.values[index].name for index in missing)
        text += f"; {names} {'is' if len(missing) == 1 else 'are'} missing and left out"
    return text


def _term(bid: RankedBid, index: int, scene: Scene, by: str) -> str:
    wanted, own = scene.vector[index], bid.vector[index]
    shown = f"({format_number(wanted)})" if wanted < 0 else format_number(wanted)
    difference = f"|{format_number(own)}−{shown}|"
    if by == "euclidean":
        return f"{difference}²"
    weight = bid.weights[index] if by == "weighted_manhattan" and bid.weights else 1.0
    if not math.isclose(bid.contributions[index], weight * abs(own - wanted), abs_tol=1e-9):
        # Uncertain values and the strategies of packages add something else.
        return format_number(bid.contributions[index], FEW)
    return difference if weight == 1.0 else f"{format_number(weight)}·{difference}"


def _comparison(decision: Decision, running: str, margin: float) -> str:
    winner = decision.ranking[0]
    urgent = "urgent: " if decision.terms.scene.urgent else ""
    best = f"{winner.agent} {distance(winner.distance)} for the new scene"
    if winner.agent == running:
        return f"{urgent}{best}, it is the one that runs"
    own = next((bid for bid in decision.ranking if bid.agent == running), None)
    if own is None:
        return f"{urgent}{best}, {running} who runs {_silence(decision, running)}"
    compared = f"{urgent}{best}, {running} who runs has {distance(own.distance)}"
    if urgent:
        return compared
    better = distance(own.distance - winner.distance)
    return f"{compared}: better by {better}, margin {distance(margin)}"


def _silence(decision: Decision, agent: str) -> str:
    for bid in decision.refused:
        if bid.agent == agent:
            verb = "declines" if bid.kind is RoundKind.DECLINED else "is refused"
            return f"{verb} ({bid.reason})"
    return "does not bid"


def _follows(decision: Decision) -> str:
    terms = decision.terms
    if not terms.follows:
        return ""
    without = join_first(f"{agent} ({why})" for agent, why in terms.excluded.items())
    return f"continues round {terms.follows}, without {without}: "


def _award(decision: Decision, winner: RankedBid) -> list[str]:
    ranked, others = decision.ranked, decision.ranking[1:]
    parts = [f"{ranked.fallback}, so {ranked.by} ranks"] if ranked.fallback else []
    if ranked.placed:
        outside = f"ranked outside: {ranked.precedence or 'no reason given'}"
        parts.append(ranked.precedence if ranked.by == RULES else outside)
        parts.append(f"{winner.agent} {distance(winner.distance)}")
    else:
        parts.append(f"{winner.agent} {calculation(winner, decision.terms.scene, ranked.by)}")
    if (nearest := decision.passed_over) is not None:
        parts.append(f"explored, {nearest.agent} {distance(nearest.distance)} is nearer")
    if not others:
        parts.append("no other bid")
    elif ranked.placed:
        parts.append(f"next: {others[0].agent} {distance(others[0].distance)}")
    elif others[0].score > winner.score:
        digits = FEW if others[0].bonus or winner.bonus else ALL_DIGITS
        behind = f"{others[0].agent} {distance(others[0].score, digits)}"
        parts.append(f"next: {behind} (margin {distance(decision.margin, digits)})")
    else:
        tied = [bid for bid in others if bid.score == winner.score]
        names = join_first(bid.agent for bid in tied)
        parts.append(f"tied with {names}: {tie_rule(decision, winner, tied)}")
    return parts + _not_taken(decision)


def _not_taken(decision: Decision) -> list[str]:
    """Return what else is worth knowing: refused bids and silent hosts."""
    people = {bid.agent for bid in decision.terms.operator_exclusions}
    refused = [
        f"{bid.agent or bid.host} ({bid.code}: {bid.reason})"
        for bid in decision.refused
        if bid.kind is RoundKind.REFUSED and bid.agent not in people
    ]
    parts = [f"refused: {join_first(refused)}"] if refused else []
    if decision.silent_hosts:
        parts.append(f"no answer in time from {join_first(decision.silent_hosts)}")
    return parts
