# SPDX-License-Identifier: Apache-2.0
"""Translation of options of a rehearsal, such as ``--at "2s mood=1.5"``, into YAML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from bt_agents_core.diagnostic import Diagnostic
from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_core.scene import SceneSpace
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.diagnostics.renderers import columns
from bt_agents_language.files.testing.path_patterns import nodes_of
from bt_agents_language.model.specs import AgentSpec, Literal

_PLAIN = re.compile(r"[\w.+][\w.+ /%-]*")
_OF_A_PERSON = ("person:", "  name:", "  visits:")
_TIME = re.compile(r"\s*([0-9.]+\s*(?:ms|s|min|h))\b\s*(.*)", re.DOTALL)
_CANCELLED_BY = re.compile(r"by=(\"[^\"]*\"|'[^']*'|\S+)")
_QUOTES = "\"'"
_ASSIGNMENT = re.compile(r"([^\s=]+)=((?:\"[^\"]*\"|'[^']*'|[^\s])*)")


@dataclass(frozen=True, kw_only=True)
class TypedYaml:
    """YAML made from typed options or answers, with the origin of each line, if any."""

    text: str
    origins: tuple[str, ...]

    def explained(self, error: ReadError) -> str:
        """Return the problems of the YAML with their places in the typed text."""
        return "\n".join(self._explained(one) for one in error.diagnostics)

    def _explained(self, problem: Diagnostic) -> str:
        blocks = [f"{problem.severity.value}[{problem.code}]: {problem.message}"]
        line = problem.position.line
        typed = self.origins[line - 1] if line <= len(self.origins) else ""
        if typed:
            start, width = _typed_span(problem, typed)
            blocks += [f"      {typed}", f"      {' ' * start}{'^' * width}"]
        if problem.hint:
            blocks.append(f"      hint: {problem.hint}")
        return "\n".join(blocks)


def _typed_span(problem: Diagnostic, typed: str) -> tuple[int, int]:
    """Return the column of a problem in the typed text, and its width."""
    first = problem.position.column - 1
    end = problem.end
    last = end.column - 1 if end is not None and end.line == problem.position.line else first + 1
    wrong = problem.excerpt[first:last].strip("\"'")
    before = problem.excerpt[:first].count(wrong) if wrong else 0
    places = [found.start() for found in re.finditer(re.escape(wrong), typed)] if wrong else []
    if not places:
        return 0, columns(typed)
    # The YAML has more text before it than the option, never less.
    start = places[min(before, len(places) - 1)]
    return columns(typed[:start]), max(1, columns(wrong))


def scenario_yaml(
    agent: AgentSpec,
    *,
    scene: Iterable[str] = (),
    person: Iterable[str] = (),
    clock: Iterable[str] = (),
    tunables: Iterable[str] = (),
    answers: Iterable[str] = (),
    events: Iterable[str] = (),
    seed: int | None = None,
    picks: Iterable[str] = (),
) -> TypedYaml:
    """Return the options of a rehearsal as YAML, which is read like any other file.

    Raises:
        BtAgentsError: An option has the wrong form.
    """
    lines = [("format: 1", "")]
    lines += _section("scene", "--scene", scene, "age=4")
    lines += _person_section(person)
    lines += _section("clock", "--clock", clock, "hour=22")
    lines += _section("tunables", "--tune", tunables, "patience=5s")
    lines += _answers_section(answers)
    if seed is not None:
        lines.append((f"seed: {seed}", f"--seed {seed}"))
    paths = [(f"  - {_value(path)}", _option("--pick", path)) for path in picks]
    lines += [("picks:", ""), *paths] if paths else []
    during = [(f"  - {event_yaml(agent, text)}", _option("--at", text)) for text in events]
    lines += [("during:", ""), *during] if during else []
    return _with_origins(lines)


def typed_answer(path: str, typed: str) -> TypedYaml:
    """Return a typed answer of a node as YAML."""
    line = f"  {_value(path)}: {_value(typed)}"
    return _with_origins([("format: 1", ""), ("answers:", ""), (line, typed)])


def typed_event(agent: AgentSpec, typed: str) -> TypedYaml:
    """Return a typed event as YAML.

    Raises:
        BtAgentsError: Its form is wrong.
    """
    line = f"  - {event_yaml(agent, typed)}"
    return _with_origins([("format: 1", ""), ("during:", ""), (line, typed)])


def _with_origins(lines: Iterable[tuple[str, str]]) -> TypedYaml:
    texts, origins = zip(*lines, strict=True)
    return TypedYaml(text="\n".join(texts) + "\n", origins=origins)


def is_event(agent: AgentSpec, space: SceneSpace, typed: str) -> bool:
    """Return whether a typed text is an event instead of an answer."""
    match = _TIME.fullmatch(typed)
    begin = re.match(r"\s*(?:tune\s+)?([^\s=]+)\s*(=?)", match[2] if match else typed)
    if begin is None:
        return False
    word, equals = begin.groups()
    if equals:
        return word in (*space.names, "person", *(one.name for one in agent.tunables))
    return word == "cancel" or Literal(value=word) in _topics(agent)


def event_yaml(agent: AgentSpec, text: str) -> str:
    """Return a typed event as one YAML mapping.

    ``2s mood=1.5``, ``3s person=false``, ``4s patience=10s`` (a tunable), ``5s cancel``, ``5s
    cancel by='mood rule' annoyed``, ``6s buttons/confirm data=true`` (a message); without a time
    the event happens at once.

    Raises:
        BtAgentsError: Its form is wrong.
    """
    match = _TIME.fullmatch(text)
    after, rest = (match[1], match[2]) if match else ("0 s", text.strip())
    rest = rest.removeprefix("tune ").lstrip()
    word, _, more = rest.partition(" ")
    if word == "cancel":
        by = _CANCELLED_BY.match(more.strip())
        reason = more.strip()[by.end() if by else 0 :].strip() or "cancelled by hand"
        cancel = json.dumps(reason, ensure_ascii=False)
        if by:
            cancel = f"{{by: {_value(by[1].strip(_QUOTES))}, reason: {cancel}}}"
        return f"{{after: {after}, cancel: {cancel}}}"
    if word and "=" not in word:
        if match is None:
            _refuse_unknown(agent, text, word)
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


def _refuse_unknown(agent: AgentSpec, text: str, word: str) -> None:
    """Raise an error for a first word that is neither a time nor valid without one."""
    near = re.match(r"([0-9.,]+)\s*([a-z]*)", text.strip())
    if near is not None:
        number, unit = near.groups()
        meant = f"{number.replace(',', '.')} {'min' if unit.startswith('m') else 's'}"
        raise BtAgentsError(
            f"'{near[0].strip()}' in '{text}' is not a time; write a number with ms, s, min or h, "
            f"such as '{meant}'"
        )
    topics = [str(one.value) for one in _topics(agent)]
    if word not in topics:
        hint = did_you_mean(word, ["cancel", *topics])
        raise BtAgentsError(
            f"'{word}' in '{text}' is neither a time such as '5 s', nor 'cancel', nor a topic "
            f"that the agent waits for; {hint}"
        )


def _topics(agent: AgentSpec) -> list[Literal]:
    fields = (one.fields.get("topic") for one in nodes_of(agent))
    return list(dict.fromkeys(one for one in fields if isinstance(one, Literal)))


def _assigned(assignments: str, text: str) -> Mapping[str, str]:
    """Return ``a=1 b='x y'`` as names and YAML values."""
    if _ASSIGNMENT.sub("", assignments).strip():
        raise _unclear(text)
    return {name: _value(value.strip(_QUOTES)) for name, value in _ASSIGNMENT.findall(assignments)}


def _section(key: str, option: str, given: Iterable[str], example: str) -> list[tuple[str, str]]:
    """Return assignments as the lines of one YAML key, each with its option."""
    lines = {
        name: (f"  {name}: {value}", _option(option, text))
        for name, value, text in _assignments(option, given, example)
    }
    return [(f"{key}:", ""), *lines.values()] if lines else []


def _answers_section(given: Iterable[str]) -> list[tuple[str, str]]:
    """Return answers as lines, each with its option; answers of one skill keep their order."""
    answers: dict[str, list[tuple[str, str]]] = {}
    for name, value, text in _assignments("--answer", given, "ask=yes"):
        answers.setdefault(name, []).append((value, _option("--answer", text)))
    lines = []
    for name, (first, *more) in answers.items():
        if not more:
            lines.append((f"  {name}: {first[0]}", first[1]))
            continue
        items = [(f"    {_items(value)},", origin) for value, origin in (first, *more)]
        lines += [(f"  {name}: [", ""), *items, ("  ]", "")]
    return [("answers:", ""), *lines] if lines else []


def _items(value: str) -> str:
    """Return a YAML value as list items; a list gives all of its items."""
    inner = value[1:-1].strip() if value.startswith("[") and value.endswith("]") else ""
    return inner or value


def _assignments(
    option: str, given: Iterable[str], example: str
) -> Iterator[tuple[str, str, str]]:
    """Yield the name and value of each assignment as YAML, with the typed text."""
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise BtAgentsError(
                f"'{text}' is not written as a name and a value; write {option} {example}"
            )
        yield _value(name.strip()), _value(value.strip()), text


def _person_section(given: Iterable[str]) -> list[tuple[str, str]]:
    """Return the lines about the person, with remembered facts below their own key."""
    lines = _section("person", "--person", given, "name=anna")
    own = [line for line in lines if line[0].startswith(_OF_A_PERSON)]
    others = [(f"  {text}", origin) for text, origin in lines if (text, origin) not in own]
    return own + ([("  remembers:", ""), *others] if others else [])


def _option(option: str, text: str) -> str:
    """Return an option as typed in a shell."""
    return f'{option} "{text}"' if re.search(r"[\s{}\[\]*]", text) else f"{option} {text}"


def _value(text: str) -> str:
    """Return a text as a YAML value; a list or mapping stays unchanged."""
    if text.startswith(("{", "[")) or _PLAIN.fullmatch(text):
        return text
    return json.dumps(text, ensure_ascii=False)


def _unclear(text: str) -> BtAgentsError:
    return BtAgentsError(
        f"'{text}' does not say what happens; write a time and then 'mood=1.5', 'person=false', "
        "'patience=10s' (a tunable), 'buttons/confirm data=true' (a message) or 'cancel'"
    )
