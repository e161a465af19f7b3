# SPDX-License-Identifier: Apache-2.0
"""Detection of speech that a time limit cuts off, by the estimates of rehearsals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from bt_agents_core.diagnostic import Diagnostic
from bt_agents_core.field_types import Plain
from bt_agents_language.diagnostics.collection import warning
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.files.testing.default_answers import duration_s
from bt_agents_language.files.testing.scenarios import SPOKEN
from bt_agents_language.model.specs import (
    MOST_CLEAN_UP_S,
    AgentSpec,
    Literal,
    NodeSpec,
    Reference,
    Text,
    Value,
    Variants,
    iter_nodes,
)
from bt_agents_language.nodes.catalogue import type_of
from bt_agents_language.nodes.endings import Outcome
from bt_agents_language.nodes.node_type import Role, Waits
from bt_agents_language.nodes.timeout import TIMEOUT


def cut_speech(agent: AgentSpec) -> Iterator[Diagnostic]:
    """Yield a warning for each time limit that is too short for its speech."""
    defaults = {tunable.name: tunable.default for tunable in agent.tunables}
    for root in filter(None, (agent.tree, agent.on_cancel)):
        took: dict[int, float] = {}
        for spec in reversed(list(iter_nodes(root))):
            took[id(spec)] = _usual_s(spec, [took[id(child)] for child in spec.children], defaults)
            if spec.kind == TIMEOUT.key:
                limit_s = took[id(spec)]
                inner_s = took[id(spec.children[0])]
                yield from _cut(spec, f"'{spec.kind}'", inner_s, limit_s, ", or give it more time")
        if root is agent.on_cancel:
            can_have_more = agent.clean_up_s < MOST_CLEAN_UP_S
            hint = ", or give it more time with 'on_cancel_within'" if can_have_more else ""
            yield from _cut(root, "'on_cancel'", took[id(root)], agent.clean_up_s, hint)


def _cut(
    spec: NodeSpec, what: str, takes_s: float, limit_s: float, hint: str
) -> Iterator[Diagnostic]:
    speech = next((one for one in iter_nodes(spec) if speaks(one)), None)
    if speech is None or takes_s <= limit_s:
        return
    yield warning(
        "cut-speech",
        spec.position,
        len(spec.kind),
        f"{what} ends after {limit_s:g} s, but what it holds takes about {takes_s:.1f} s "
        f"with '{speech.kind}' in line {speech.position.line}",
        f"say less{hint}",
    )


def _usual_s(spec: NodeSpec, children: Sequence[float], defaults: Mapping[str, Plain]) -> float:
    """Return the duration of a node if all of it succeeds, and other skills take no time."""
    node_type = type_of(spec)
    if speaks(spec):
        inputs = {name: _plain(value, defaults) for name, value in spec.fields.items()}
        return duration_s(spec, inputs, fails=False)
    if node_type.waits is Waits.TIME:
        return _seconds(_plain(spec.fields.get("duration"), defaults))
    if not children:
        return 0.0
    if spec.kind == TIMEOUT.key:
        return min(children[0], _seconds(_plain(spec.fields.get("limit"), defaults), children[0]))
    if node_type.exclusive or node_type.concurrent:
        return max(children)
    if node_type.role is Role.COMPOSITE and node_type.continues_on is Outcome.SUCCESS:
        return sum(children)
    return children[0]


def speaks(spec: NodeSpec) -> bool:
    """Return whether a node is a skill that says something."""
    return spec.skill is not None and spec.skill.name in SPOKEN


def _seconds(value: Plain, otherwise: float = 0.0) -> float:
    return float(value) if isinstance(value, int | float) else otherwise


def _plain(value: Value | Expression | str | None, defaults: Mapping[str, Plain]) -> Plain:
    """Return a value as far as known before a run, with tunables at their defaults.

    The longest variant counts.
    """
    match value:
        case str():
            return value
        case Literal(value=plain):
            return plain
        case Reference(name=name):
            return defaults.get(name)
        case Text(parts=parts):
            known = (_plain(part, defaults) for part in parts if isinstance(part, str | Variants))
            return "".join(filter(None, map(str, known)))
        case Variants(texts=texts):
            return max((str(_plain(text, defaults) or "") for text in texts), key=len)
    return None
