# SPDX-License-Identifier: Apache-2.0
"""Options of a rehearsal, such as ``--at "2s mood=1.5"``, written out as a test file would."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping

from bt_agents.errors import BtAgentsError
from bt_agents.language.specs import AgentSpec

_PLAIN = re.compile(r"[\w.+][\w.+ /%-]*")
_TIME = re.compile(r"\s*([0-9.]+\s*(?:ms|s|min|h))\b\s*(.*)", re.DOTALL)
_ASSIGNMENT = re.compile(r"([^\s=]+)=((?:\"[^\"]*\"|'[^']*'|[^\s])*)")


def scenario_text(
    agent: AgentSpec,
    *,
    scene: Iterable[str],
    tunables: Iterable[str],
    answers: Iterable[str],
    happenings: Iterable[str],
    seed: int | None,
) -> str:
    """Return the options of a rehearsal as YAML, which is then read like any other file.

    Raises:
        BtAgentsError: An option has not the form that it needs.
    """
    lines = ["format: 1"]
    lines += _section("scene", _pairs(scene, "--scene age=4"))
    lines += _section("tunables", _pairs(tunables, "--tune patience=5s"))
    lines += _section("answers", _pairs(answers, "--answer ask=yes"))
    if seed is not None:
        lines.append(f"seed: {seed}")
    during = [f"  - {happening_text(agent, text)}" for text in happenings]
    lines += ["during:", *during] if during else []
    return "\n".join(lines) + "\n"


def happening_text(agent: AgentSpec, text: str) -> str:
    """Return what happens as one YAML mapping.

    ``2s mood=1.5``, ``3s person=false``, ``4s patience=10s`` (a tunable), ``5s cancel``, ``6s
    buttons/confirm data=true`` (a message); without a time it happens at once.

    Raises:
        BtAgentsError: It has another form.
    """
    match = _TIME.fullmatch(text)
    after, rest = (match[1], match[2]) if match else ("0 s", text.strip())
    word, _, more = rest.partition(" ")
    if word == "cancel":
        reason = more.strip() or "cancelled by hand"
        return f"{{after: {after}, cancel: {json.dumps(reason, ensure_ascii=False)}}}"
    if word and "=" not in word:
        message = ", ".join(f"{name}: {value}" for name, value in _assigned(more, text).items())
        return f"{{after: {after}, publish: {{topic: {_value(word)}, message: {{{message}}}}}}}"
    values = _assigned(rest, text)
    if not values:
        raise _unclear(text)
    tuned = {one.name for one in agent.tunables} & values.keys()
    parts = [f"{name}: {value}" for name, value in values.items() if name not in tuned]
    if tuned:
        tune = ", ".join(f"{name}: {value}" for name, value in values.items() if name in tuned)
        parts.append(f"tune: {{{tune}}}")
    return f"{{after: {after}, {', '.join(parts)}}}"


def _assigned(words: str, text: str) -> Mapping[str, str]:
    """Return ``a=1 b='x y'`` as names and YAML values."""
    if _ASSIGNMENT.sub("", words).strip():
        raise _unclear(text)
    return {name: _value(value.strip("\"'")) for name, value in _ASSIGNMENT.findall(words)}


def _pairs(options: Iterable[str], example: str) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for option in options:
        name, equals, value = option.partition("=")
        if not equals or not name.strip():
            raise BtAgentsError(
                f"'{option}' is not written as a name and a value; write {example}"
            )
        pairs[_value(name.strip())] = _value(value.strip())
    return pairs


def _section(key: str, pairs: Mapping[str, str]) -> list[str]:
    return [f"{key}:", *(f"  {name}: {value}" for name, value in pairs.items())] if pairs else []


def _value(text: str) -> str:
    """Return a text as YAML; a list or mapping is taken as it is."""
    if text.startswith(("{", "[")) or _PLAIN.fullmatch(text):
        return text
    return json.dumps(text, ensure_ascii=False)


def _unclear(text: str) -> BtAgentsError:
    return BtAgentsError(
        f"'{text}' does not say what happens; write a time and then 'mood=1.5', 'person=false', "
        "'patience=10s' (a tunable), 'buttons/confirm data=true' (a message) or 'cancel'"
    )
