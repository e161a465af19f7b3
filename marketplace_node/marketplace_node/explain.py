# SPDX-License-Identifier: Apache-2.0
"""Says in words and numbers why a round of the marketplace ended as it did."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from bt_agents.scene import Scene, Vector
from marketplace_node.auction import ClosedBy, Decision, Kind, Outcome, RankedBid

_NAMES_SHOWN = 4


def calculation(distance: float, bid: Vector, scene: Scene) -> str:
    """Return a Manhattan distance as a sum that people can check.

    Example:
        ``1.5 = |4−5| + |1.5−1|; mood is missing and left out``
    """
    terms, missing = [], []
    for offered, value in zip(bid, scene.values, strict=True):
        if math.isnan(value.value):
            missing.append(value.name)
        else:
            wanted = f"({_number(value.value)})" if value.value < 0 else _number(value.value)
            terms.append(f"|{_number(offered)}−{wanted}|")
    if not terms:
        return f"{_distance(distance)}, as every value of the scene is missing"
    text = f"{_distance(distance)} = {' + '.join(terms)}"
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        text += f"; {_enumerate(missing)} {verb} missing and left out"
    return text


def reason(decision: Decision) -> str:
    """Return the whole decision as one line for a terminal.

    Example:
        ``attentive_guide 1.5 = |4−5| + |1.5−1| + |3−3|; next: professional_express 4.0
        (margin 2.5)``
    """
    if decision.closed_by is ClosedBy.STOPPED:
        parts = [f"stopped before the round closed: {decision.stopped}"]
    elif decision.outcome is Outcome.AWARDED:
        parts = _award(decision)
    else:
        parts = _nobody(decision)
    return _follows(decision) + "; ".join(parts)


def challenge(
    decision: Decision, running: str, margin: float, *, obstacle: str = "", line: str = ""
) -> str:
    """Return the decision about a scene that came during a run as one line for a terminal.

    Args:
        decision: Of the challenge; its outcome says whether the run is stopped.
        running: The agent that runs.
        margin: By how much another agent has to be nearer to the scene.
        obstacle: Why a run is not stopped even for a better bid; empty when nothing is in the way.
        line: Why the scene cannot wait; empty when it can.

    Example:
        ``mira 0.5 for the new scene, leo who runs has 2.5: better by 2.0, margin 1.0: leo is
        stopped``
    """
    if decision.closed_by is ClosedBy.STOPPED:
        return f"stopped before the round closed: {decision.stopped}"
    goes_on = f"{running} goes on, " + (f"but {line}" if line else "the scene waits")
    if decision.winner is None:
        return "; ".join([*_nobody(decision), goes_on])
    verdict = f"{running} is stopped" if decision.outcome is Outcome.PREEMPTS else goes_on
    parts = [_comparison(decision, running, margin), obstacle, verdict]
    return "; ".join([": ".join(part for part in parts if part), *_not_taken(decision)])


def _comparison(decision: Decision, running: str, margin: float) -> str:
    winner = decision.ranking[0]
    urgent = "urgent: " if decision.terms.scene.urgent else ""
    best = f"{winner.agent} {_distance(winner.distance)} for the new scene"
    if winner.agent == running:
        return f"{urgent}{best}, it is the one that runs"
    own = next((bid for bid in decision.ranking if bid.agent == running), None)
    if own is None:
        return f"{urgent}{best}, {running} who runs {_silence(decision, running)}"
    compared = f"{urgent}{best}, {running} who runs has {_distance(own.distance)}"
    if urgent:
        return compared
    better = _distance(own.distance - winner.distance)
    return f"{compared}: better by {better}, margin {_distance(margin)}"


def _silence(decision: Decision, agent: str) -> str:
    for bid in decision.refused:
        if bid.agent == agent:
            verb = "declines" if bid.kind is Kind.DECLINED else "is refused"
            return f"{verb} ({bid.reason})"
    return "does not bid"


def _follows(decision: Decision) -> str:
    terms = decision.terms
    if not terms.follows:
        return ""
    without = _enumerate(f"{agent} ({why})" for agent, why in terms.excluded.items())
    return f"continues round {terms.follows}, without {without}: "


def _award(decision: Decision) -> list[str]:
    winner, others = decision.ranking[0], decision.ranking[1:]
    scene = decision.terms.scene
    parts = [f"{winner.agent} {calculation(winner.distance, winner.vector, scene)}"]
    if not others:
        parts.append("no other bid")
    elif others[0].distance > winner.distance:
        parts.append(
            f"next: {others[0].agent} {_distance(others[0].distance)} "
            f"(margin {_distance(decision.margin)})"
        )
    else:
        parts.append(_tie(decision, winner, others))
    parts += _not_taken(decision)
    return parts


def _tie(decision: Decision, winner: RankedBid, others: Sequence[RankedBid]) -> str:
    tied = [bid for bid in others if bid.distance == winner.distance]
    text = f"tied with {_enumerate(bid.agent for bid in tied)}: "
    if decision.terms.tie_break == "name":
        return text + f"{winner.agent} is first by name"
    if any(bid.last_run == winner.last_run for bid in tied):
        return text + f"{winner.agent} is first by name among those that have not run yet"
    if winner.last_run == 0:
        return text + f"{winner.agent} has not run yet"
    return text + f"{winner.agent} has not run for the longest time"


def _nobody(decision: Decision) -> list[str]:
    parts = []
    for why, agents in _declined(decision).items():
        names = _enumerate(agents)
        if why.startswith("needs "):
            verb = "needs" if len(agents) == 1 else "need"
            parts.append(f"{names} {verb} {why.removeprefix('needs ')}")
        else:
            parts.append(f"{names}: {why}")
    parts += _not_taken(decision)
    parts += [f"{host} is not asked: {why}" for host, why in decision.terms.unasked.items()]
    if not parts:
        other = "other " if decision.terms.follows else ""
        return [f"no {other}agents are registered"]
    parts[0] = f"nobody bids: {parts[0]}"
    return parts


def _declined(decision: Decision) -> dict[str, list[str]]:
    groups: dict[str, list[str]] = {}
    for bid in decision.refused:
        if bid.kind is Kind.DECLINED and bid.agent not in decision.terms.excluded:
            groups.setdefault(bid.reason, []).append(bid.agent)
    return groups


def _not_taken(decision: Decision) -> list[str]:
    """Return what is worth knowing beside the ranking: refused bids and silent hosts."""
    refused = [
        f"{bid.agent or bid.host} ({bid.code}: {bid.reason})"
        for bid in decision.refused
        if bid.kind is Kind.REFUSED
    ]
    parts = [f"refused: {_enumerate(refused)}"] if refused else []
    if decision.silent_hosts:
        parts.append(f"no answer in time from {_enumerate(decision.silent_hosts)}")
    return parts


def _enumerate(words: Iterable[str]) -> str:
    listed = list(words)
    if len(listed) <= _NAMES_SHOWN:
        return ", ".join(listed)
    return f"{', '.join(listed[:_NAMES_SHOWN])} and {len(listed) - _NAMES_SHOWN} more"


def _number(value: float) -> str:
    return f"{value:g}".replace("-", "−")


def _distance(value: float) -> str:
    text = _number(value)
    return text if set(text) & set(".e") else f"{text}.0"
