# SPDX-License-Identifier: Apache-2.0
"""Default answers of skills: the duration of a use, and its outputs."""

from __future__ import annotations

from collections.abc import Mapping

from bt_agents_core.field_types import BindingKind, FieldType, Plain
from bt_agents_language.model.specs import FieldSpec, NodeSpec

_SPEECH_START_S = 0.4
"""Time before the first word of a text [s]."""

_CHARACTER_S = 0.06
"""Time for a character of a text at normal speed, about 170 words a minute [s]."""

_THINKING_S = 2.0
"""Time that a person needs to answer after the question [s]."""

_ACTION_S = 1.0
"""Time of any other action [s]."""

_TEXT = "yes"
_VALUES: Mapping[FieldType, Plain] = {
    FieldType.BOOLEAN: True,
    FieldType.INTEGER: 1,
    FieldType.NUMBER: 1.0,
    FieldType.DURATION: 1.0,
    FieldType.LENGTH: 1.0,
    FieldType.ANGLE: 0.0,
}


def duration_s(node: NodeSpec, inputs: Mapping[str, Plain], *, fails: bool) -> float:
    """Return the duration of a use of a skill [s].

    Services and messages take no time. An action takes its input ``duration`` if that is positive;
    an action with a text as main input takes as long as the text, at the speed of its input
    ``rate``, plus the time to think if it returns an answer. If it fails although it would wait
    for an answer, it takes its whole waiting time.
    """
    skill = node.skill
    if skill is None:
        return 0.0
    if skill.binding is not None and skill.binding.kind is not BindingKind.ACTION:
        return 0.0
    set_s = _number(inputs.get("duration"))
    if set_s > 0.0:
        return set_s
    if skill.main != "text" or not skill.main_is_text:
        return _ACTION_S
    text = inputs.get(skill.main or "")
    rate = _number(inputs.get("rate")) or 1.0
    spoken_s = (_SPEECH_START_S + _CHARACTER_S * len(str(text or ""))) / rate
    if not returned(node):
        return spoken_s
    return spoken_s + (_number(inputs.get("wait")) if fails else _THINKING_S)


def outputs(node: NodeSpec, inputs: Mapping[str, Plain]) -> dict[str, Plain]:
    """Return the outputs of a use of a skill: the first of its choices, else a value by type.

    Outputs from feedback have no default.
    """
    if node.skill is None:
        return {}
    types = {one.name: one.type for one in returned(node)}
    types = types or dict.fromkeys(node.outputs, FieldType.ANY)
    choices = inputs.get("choices")
    text = choices[0] if isinstance(choices, tuple | list) and choices else _TEXT
    return {name: _VALUES.get(field_type, text) for name, field_type in types.items()}


def returned(node: NodeSpec) -> tuple[FieldSpec, ...]:
    """Return the outputs of a skill that are in its result."""
    if node.skill is None:
        return ()
    binding = node.skill.binding
    of_feedback = binding.feedback if binding is not None else {}
    return tuple(one for one in node.skill.outputs if one.name not in of_feedback)


def _number(value: Plain) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else 0.0
