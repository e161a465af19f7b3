# SPDX-License-Identifier: Apache-2.0
"""Options of a rehearsal, such as ``--at "2s mood=1.5"``, written out as a test file would."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from bt_agents_core.diagnostic import Diagnostic
from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_core.scene import SceneSpace
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.diagnostics.renderers import columns
from bt_agents_language.files.testing.path_patterns import nodes_of
from bt_agents_language.model.specs import AgentSpec, Literal

_PLAIN = re.compile(r"[\w.+][\w.+ /%-]*")
_TIME = re.compile(r"\s*([0-9.]+\s*(?:ms|s|min|h))\b\s*(.*)", re.DOTALL)
_TIMELIKE = re.compile(r"([0-9.,]+)\s*([a-z]*)")
_BEGIN = re.compile(r"\s*(?:tune\s+)?([^\s=]+)\s*(=?)")
_ASSIGNMENT = re.compile(r"([^\s=]+)=((?:\"[^\"]*\"|'[^']*'|[^\s])*)")


@dataclass(frozen=True, kw_only=True)
class Words:
    """What was typed, written out as YAML.

    Attributes:
        text: The YAML.
        origins: For each of its lines what was typed for it; empty for the others.
    """

    text: str
    origins: tuple[str, ...]

    def explained(self, error: ReadError) -> str:
        """Return the problems of the text, shown where they were typed."""
        return "\n".join(self._explained(one) for one in error.diagnostics)

    def _explained(self, problem: Diagnostic) -> str:
        blocks = [f"{problem.severity.value}[{problem.code}]: {problem.message}"]
        line = problem.position.line
        typed = self.origins[line - 1] if line <= len(self.origins) else ""
        if typed:
            start, width = _place(problem, typed)
            blocks += [f"      {typed}", f"      {' ' * start}{'^' * width}"]
        if problem.hint:
            blocks.append(f"      hint: {problem.hint}")
        return "\n".join(blocks)


def _place(problem: Diagnostic, typed: str) -> tuple[int, int]:
    """Return where in what was typed a problem is, and how many columns it takes."""
    first = problem.position.column - 1
    end = problem.end
    last = end.column - 1 if end is not None and end.line == problem.position.line else first + 1
    wrong = problem.excerpt[first:last].strip("\"'")
    before = problem.excerpt[:first].count(wrong) if wrong else 0
    places = [found.start() for found in re.finditer(re.escape(wrong), typed)] if wrong else []
    if not places:
        return 0, columns(typed)
    # What was written out has more words before it, never fewer.
    start = places[min(before, len(places) - 1)]
    return columns(typed[:start]), max(1, columns(wrong))


def scenario_words(
    agent: AgentSpec,
    *,
    scene: Iterable[str] = (),
    tunables: Iterable[str] = (),
    answers: Iterable[str] = (),
    happenings: Iterable[str] = (),
    seed: int | None = None,
) -> Words:
    """Return the options of a rehearsal as YAML, which is then read like any other file.

    Raises:
        BtAgentsError: An option has not the form that it needs.
    """
    lines = [("format: 1", "")]
    lines += _section("scene", "--scene", scene, "age=4")
    lines += _section("tunables", "--tune", tunables, "patience=5s")
    lines += _section("answers", "--answer", answers, "ask=yes")
    if seed is not None:
        lines.append((f"seed: {seed}", f"--seed {seed}"))
    during = [(f"  - {happening_text(agent, text)}", _option("--at", text)) for text in happenings]
    lines += [("during:", ""), *during] if during else []
    return _words(lines)


def typed_answer(path: str, typed: str) -> Words:
    """Return what somebody types as the answer of a node, as YAML."""
    line = f"  {_value(path)}: {_value(typed)}"
    return _words([("format: 1", ""), ("answers:", ""), (line, typed)])


def typed_happening(agent: AgentSpec, typed: str) -> Words:
    """Return what somebody types to happen, as YAML.

    Raises:
        BtAgentsError: It has not the form that it needs.
    """
    line = f"  - {happening_text(agent, typed)}"
    return _words([("format: 1", ""), ("during:", ""), (line, typed)])


def _words(lines: Iterable[tuple[str, str]]) -> Words:
    texts, origins = zip(*lines, strict=True)
    return Words(text="\n".join(texts) + "\n", origins=origins)


def happens(agent: AgentSpec, space: SceneSpace, typed: str) -> bool:
    """Return whether what somebody types says what happens, and not what is answered."""
    match = _TIME.fullmatch(typed)
    begin = _BEGIN.match(match[2] if match else typed)
    if begin is None:
        return False
    word, equals = begin.groups()
    if equals:
        return word in (*space.names, "person", *(one.name for one in agent.tunables))
    return word == "cancel" or Literal(value=word) in _topics(agent)


def happening_text(agent: AgentSpec, text: str) -> str:
    """Return what happens as one YAML mapping.

    ``2s mood=1.5``, ``3s person=false``, ``4s patience=10s`` (a tunable), ``5s cancel``, ``6s
    buttons/confirm data=true`` (a message); without a time it happens at once.

    Raises:
        BtAgentsError: It has another form.
    """
    match = _TIME.fullmatch(text)
    after, rest = (match[1], match[2]) if match else ("0 s", text.strip())
    rest = rest.removeprefix("tune ").lstrip()
    word, _, more = rest.partition(" ")
    if word == "cancel":
        reason = more.strip() or "cancelled by hand"
        return f"{{after: {after}, cancel: {json.dumps(reason, ensure_ascii=False)}}}"
    if word and "=" not in word:
        if match is None:
            _refuse_slip(agent, text, word)
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


def _refuse_slip(agent: AgentSpec, text: str, word: str) -> None:
    """Refuse a first word that is neither a time nor what may stand without one."""
    slip = _TIMELIKE.match(text.strip())
    if slip is not None:
        number, unit = slip.groups()
        meant = f"{number.replace(',', '.')} {'min' if unit.startswith('m') else 's'}"
        raise BtAgentsError(
            f"'{slip[0].strip()}' in '{text}' is no time; write a number with ms, s, min or h, "
            f"such as '{meant}'"
        )
    topics = [str(one.value) for one in _topics(agent)]
    if word not in topics:
        hint = did_you_mean(word, ["cancel", *topics])
        raise BtAgentsError(
            f"'{word}' in '{text}' is no time such as '5 s', no 'cancel', and no topic that the "
            f"agent waits for; {hint}"
        )


def _topics(agent: AgentSpec) -> list[Literal]:
    """Return the topics that nodes wait for, in order, each once."""
    fields = (one.fields.get("topic") for one in nodes_of(agent))
    return list(dict.fromkeys(one for one in fields if isinstance(one, Literal)))


def _assigned(words: str, text: str) -> Mapping[str, str]:
    """Return ``a=1 b='x y'`` as names and YAML values."""
    if _ASSIGNMENT.sub("", words).strip():
        raise _unclear(text)
    return {name: _value(value.strip("\"'")) for name, value in _ASSIGNMENT.findall(words)}


def _section(key: str, option: str, given: Iterable[str], example: str) -> list[tuple[str, str]]:
    """Return names and values as the lines of one key, each with the option it comes from."""
    lines: dict[str, tuple[str, str]] = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise BtAgentsError(
                f"'{text}' is not written as a name and a value; write {option} {example}"
            )
        key_text = _value(name.strip())
        lines[key_text] = (f"  {key_text}: {_value(value.strip())}", _option(option, text))
    return [(f"{key}:", ""), *lines.values()] if lines else []


def _option(option: str, text: str) -> str:
    """Return an option as it is typed in a shell."""
    return f'{option} "{text}"' if re.search(r"[\s{}\[\]*]", text) else f"{option} {text}"


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
