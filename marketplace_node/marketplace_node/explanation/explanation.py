# SPDX-License-Identifier: Apache-2.0
"""Explanation of a decision in plain sentences, one per line."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from bt_agents_core.scene import Origin, SceneParameter, SceneSpace, SceneValue
from bt_agents_core.text import format_number, join_first, join_words, single_spaced
from marketplace_node.explanation.reason import declined, nobody, tie_rule
from marketplace_node.formatting import FEW, distance, percent
from marketplace_node.outcomes import AuctionOutcome
from marketplace_node.round.decision import ClosedBy, Decision, RankedBid, RoundKind
from marketplace_node.settings import RULES
from marketplace_node.strategies import STRATEGIES
from marketplace_node.strategies.catalogue import ranges_share

_PARAMETERS_SHOWN = 6
_REFUSED_SHOWN = 3
_LABEL_REACH = 0.05  # of the range


def explanation(decision: Decision, space: SceneSpace) -> str:
    """Return the explanation of a decision for authors and for people around the robot.

    It names the winner and the reason, the origin of each value of the scene, the contribution of
    each parameter, the runner-up and the change that would have made it win, the agents that may
    not bid, and the result of the shadow strategy.
    """
    return "\n".join(_lines(decision, space))


def _lines(decision: Decision, space: SceneSpace) -> Iterator[str]:
    winner, ranked = decision.winner, decision.ranked
    yield _head(decision)
    if decision.terms.intervention:
        yield _sentence(decision.terms.intervention)
    yield from _scene(decision, space)
    if winner is not None:
        yield from _why(decision, winner, space)
        yield from _next(decision, winner, space)
    yield from _others(decision)
    if ranked.shadow_winner and winner is not None:
        same = ranked.shadow_winner == winner.agent
        chosen = f"{winner.agent}, too" if same else ranked.shadow_winner
        yield f"The shadow strategy {decision.terms.shadow} would choose {chosen}."
    if ranked.shadow_failure:
        yield f"The shadow strategy fails: {ranked.shadow_failure}."


def _head(decision: Decision) -> str:
    terms, winner = decision.terms, decision.winner
    # A line break in a label would look like the start of a new sentence.
    label = single_spaced(terms.scene.label)
    which = f"'{label}'" if label else "the scene"
    which += f" (round {terms.round})"
    if terms.follows:
        which += f", which goes on after round {terms.follows}"
    if terms.preview and winner is None:
        return f"Nobody would get the run. {_sentence('; '.join(nobody(decision)))}"
    if decision.closed_by is ClosedBy.STOPPED:
        return f"Nobody gets {which}: the round was stopped. {_sentence(decision.stopped)}"
    if winner is None:
        return f"Nobody gets {which}. {_sentence('; '.join(nobody(decision)))}"
    if terms.preview:
        return f"{winner.agent} would get the run."
    if decision.outcome is AuctionOutcome.PREEMPTS:
        return f"{winner.agent} suits {which} best, so the run under way is stopped."
    if decision.outcome is AuctionOutcome.WAITS:
        return f"{winner.agent} suits {which} best, but the run under way goes on."
    return f"{winner.agent} gets {which}."


def _scene(decision: Decision, space: SceneSpace) -> Iterator[str]:
    scene = decision.terms.scene
    who = "" if scene.person else "nobody is there"
    if scene.person_id and scene.person:
        who = f"the person is {scene.person_id}"
    where = f"the place is {scene.place}" if scene.place else ""
    if who or where:
        yield _sentence("; ".join(filter(None, (who, where))))
    pairs = zip(space.parameters, scene.values, strict=True)
    known = [(p, value) for p, value in pairs if value.origin is not Origin.MISSING]
    compared = space.profiles.compared(scene).values
    missing = [value.name for value in compared if value.origin is Origin.MISSING]
    shown = [_value(parameter, value) for parameter, value in known[:_PARAMETERS_SHOWN]]
    if len(known) > _PARAMETERS_SHOWN:
        shown.append(f"and {len(known) - _PARAMETERS_SHOWN} more")
    if shown:
        yield f"The scene: {'; '.join(shown)}."
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        yield _sentence(f"{join_first(missing)} {verb} not known and left out")


def _value(parameter: SceneParameter, value: SceneValue) -> str:
    reach = _LABEL_REACH * (parameter.maximum - parameter.minimum)
    near = [
        (abs(at - value.value), label)
        for at, label in parameter.labels.items()
        if abs(at - value.value) <= reach
    ]
    label = f" ({min(near)[1]})" if near else ""
    text = f"{value.name} {_with_std(value.value, value.std)}{label}, {_origin(value)}"
    if value.confidence < 1.0:
        text += f", confidence {percent(value.confidence)}"
    return text


def _with_std(value: float, std: float) -> str:
    return format_number(value, FEW) + (f" ± {format_number(std, 2)}" if std > 0.0 else "")


def _origin(value: SceneValue) -> str:
    by = f" by {value.source}" if value.source else ""
    if value.origin is Origin.MEASURED:
        return f"measured{by} {value.age_s:.1f} s ago"
    if value.origin is Origin.ESTIMATED:
        return f"estimated from {value.source or 'earlier visits'}"
    if value.origin is Origin.DEFAULT:
        return "the default, as nothing better is known"
    return "given" if value.origin is Origin.GIVEN else "told by the person"


def _why(decision: Decision, winner: RankedBid, space: SceneSpace) -> Iterator[str]:
    ranked = decision.ranked
    if ranked.fallback:
        yield _sentence(f"{ranked.fallback}; so {ranked.by} ranks")
    if ranked.placed:
        reason = ranked.precedence or "it gave no reason"
        names = join_words([bid.agent for bid in decision.ranking[: ranked.placed]])
        if ranked.by == RULES:
            verb = "comes" if ranked.placed == 1 else "come"
            yield f"{names} {verb} first by {reason}."
        else:
            yield f"The external program puts {names} first: {reason}."
    elif ranked.by == RULES:
        yield "No rule applies to an agent that bids, so the nearest bid comes first."
    yield _parts(winner, decision, space)
    yield from _exploration(decision, winner, space)


def _parts(bid: RankedBid, decision: Decision, space: SceneSpace) -> str:
    space = space.profiles
    scene, by = space.compared(decision.terms.scene), decision.ranked.by
    known = [i for i in range(len(space)) if not math.isnan(scene.vector[i])]
    if not known:
        return f"Nothing is known about the scene, so {bid.agent} is as near as any other agent."
    adding = sorted(
        (i for i in known if bid.contributions[i]), key=lambda i: -bid.contributions[i]
    )
    others = [i for i in known if not bid.contributions[i]]
    fitting = [space.names[i] for i in others if bid.vector[i] == scene.vector[i]]
    ignored = [space.names[i] for i in others if bid.vector[i] != scene.vector[i]]
    parts = []
    for index in adding[:_PARAMETERS_SHOWN]:
        std = scene.std[index] if by == "expected_manhattan" else 0.0
        compared = f"profile {format_number(bid.vector[index], FEW)}, "
        compared += f"scene {_with_std(scene.vector[index], std)}"
        if by == "weighted_manhattan" and bid.weights:
            compared += f", weight {format_number(bid.weights[index], FEW)}"
        adds = format_number(bid.contributions[index], FEW)
        parts.append(f"{space.names[index]} adds {adds} ({compared})")
    if len(adding) > _PARAMETERS_SHOWN:
        parts.append(f"{len(adding) - _PARAMETERS_SHOWN} more parameters the rest")
    if fitting:
        parts.append(f"{join_first(fitting)} {'fits' if len(fitting) == 1 else 'fit'} exactly")
    if ignored:
        parts.append(f"{join_first(ignored)} {'adds' if len(ignored) == 1 else 'add'} nothing")
    metric = " by the straight line" if by == "euclidean" else ""
    away = f"{bid.agent} is {distance(bid.distance, FEW)} away{metric}"
    return f"{away}: {', '.join(parts)}."


def _exploration(decision: Decision, winner: RankedBid, space: SceneSpace) -> Iterator[str]:
    """Yield how exploration influenced the decision."""
    ranked = decision.ranked
    spec = STRATEGIES.get(ranked.by)
    options = spec.values(decision.terms.options) if spec is not None else {}
    score = distance(winner.score, FEW)
    if ranked.by == "softmax":
        share = softmax_share(decision.ranking, options["temperature"])
        yield (
            f"The order was drawn with temperature {format_number(options['temperature'])}; "
            f"{winner.agent} had a chance of {percent(share)}."
        )
    elif ranked.by == "epsilon_greedy":
        often = percent(options["epsilon"])
        left = "This was" if any(bid.bonus for bid in decision.ranking) else "This was not"
        yield f"{left} one of the {often} of the rounds with a random order."
    elif ranked.by == "thompson":
        yield (
            f"Profiles count as uncertain (sigma {format_number(options['sigma'])}); the one "
            f"drawn for {winner.agent} is {score} away."
        )
    elif ranked.by in ("ucb", "bounded_ucb") and winner.bonus:
        rounds = decision.terms.rounds_run
        ran = f"It {_ran(winner.runs)} in {rounds} {'run' if rounds == 1 else 'runs'}"
        forgiven = format_number(winner.bonus, FEW)
        yield f"{ran}, so its distance is reduced by {forgiven}, to {score}."
    elif winner.bonus and not ranked.placed:
        yield f"The strategy {ranked.by} takes {format_number(winner.bonus, FEW)} off: {score}."
    if (nearest := decision.passed_over) is not None:
        nearer = distance(winner.distance - nearest.distance, FEW)
        ran = _ran(nearest.runs)
        yield f"So exploration decided: {nearest.agent}, which {ran}, is nearer by {nearer}."
    if ranked.by == "bounded_ucb" and winner.bonus:
        yield _bound(decision, space, options["margin"])


def _bound(decision: Decision, space: SceneSpace, share: float) -> str:
    """Return how much farther than the nearest bid exploration lets a winner be."""
    profiles = space.profiles
    scene = profiles.compared(decision.terms.scene)
    limit = distance(ranges_share(scene.vector, profiles.widths, share), FEW)
    return f"An agent more than {limit} farther away than the nearest one cannot win."


def softmax_share(ranking: Sequence[RankedBid], temperature: float) -> float:
    """Return the probability (0..1) that softmax puts the first bid of a ranking first."""
    least = min(bid.distance for bid in ranking)
    shares = [math.exp((least - bid.distance) / temperature) for bid in ranking]
    return shares[0] / math.fsum(shares)


def _next(decision: Decision, winner: RankedBid, space: SceneSpace) -> Iterator[str]:
    others = decision.ranking[1:]
    if not others:
        yield "No other agent bids."
        return
    second = others[0]
    away = f"{distance(second.distance, FEW)} away"
    tied = [bid for bid in others if bid.score == winner.score]
    if tied:
        names = join_words([bid.agent for bid in tied])
        verb = "is" if len(tied) == 1 else "are"
        yield f"{names} {verb} as good, but {tie_rule(decision, winner, tied)}."
    elif decision.ranked.placed:
        yield f"Next comes {second.agent}, {away}."
    elif winner.bonus or second.bonus:
        behind = distance(decision.margin, FEW)
        score = distance(second.score, FEW)
        yield f"Next comes {second.agent}, {away}, ranked as {score}: behind by {behind}."
    else:
        behind = distance(decision.margin, FEW)
        yield f"Next comes {second.agent}, {away}: farther by {behind}."
    rest = others[max(1, len(tied)) :]
    if rest:
        yield f"Then {join_first(f'{b.agent} {distance(b.distance, FEW)}' for b in rest)}."
    yield from _change(decision, second, space)


def _change(decision: Decision, second: RankedBid, space: SceneSpace) -> Iterator[str]:
    change = decision.ranked.change
    if change is None:
        return
    if not change.names:
        if change.obstacle:
            yield f"The change that would make {second.agent} win is unknown: {change.obstacle}."
        else:
            yield f"No change to a single value would have made {second.agent} win."
        return
    now = dict(zip(space.names, decision.terms.scene.vector, strict=True))
    for name, value in zip(change.names, change.values, strict=True):
        then, before = format_number(value, FEW), format_number(now[name], FEW)
        other = f"about {then} instead of {before}"
        if then == before:
            other = f"a little {'lower' if value < now[name] else 'higher'}"
        yield f"If {name} had been {other}, {second.agent} would have won."


def _others(decision: Decision) -> Iterator[str]:
    """Yield the agents that may not bid, unless the first sentence has named them already."""
    if decision.winner is None:
        return
    for why, (_, agents) in declined(decision).items():
        yield f"{join_first(agents)} {'does' if len(agents) == 1 else 'do'} not bid: {why}."
    by_reason: dict[str, list[str]] = {}
    for bid in decision.terms.operator_exclusions:
        by_reason.setdefault(bid.reason, []).append(bid.agent)
    for why, agents in by_reason.items():
        yield f"{join_first(agents)} may not bid: {why}."
    people = {bid.agent for bid in decision.terms.operator_exclusions}
    named_elsewhere = {*decision.terms.excluded, *people}
    refused = [
        f"Refused: {bid.reason}."
        for bid in decision.refused
        if bid.kind is RoundKind.REFUSED and bid.agent not in named_elsewhere
    ]
    yield from refused[:_REFUSED_SHOWN]
    if len(refused) > _REFUSED_SHOWN:
        yield f"{len(refused) - _REFUSED_SHOWN} more are refused."
    for agent, why in decision.terms.excluded.items():
        if agent not in people:
            yield f"{agent} may not bid again: {why}."
    for host, why in decision.terms.unasked.items():
        yield f"{host} is not asked: {why}."
    if decision.silent_hosts:
        yield f"No answer came in time from {join_first(decision.silent_hosts)}."


def _ran(count: int) -> str:
    return {0: "never ran", 1: "ran once"}.get(count, f"ran {count} times")


def _sentence(text: str) -> str:
    """Return the words with a leading capital letter and a full stop."""
    start = text[:1] if text.partition(" ")[0].count("_") else text[:1].upper()
    return f"{start}{text[1:]}{'' if text.endswith(('.', '!', '?')) else '.'}"
