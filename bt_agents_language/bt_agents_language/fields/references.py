# SPDX-License-Identifier: Apache-2.0
"""References ``${…}`` in texts: names and expressions, split from plain text and checked."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache

from bt_agents_core.diagnostic import Severity
from bt_agents_core.field_types import FieldType
from bt_agents_core.text import ellipsize, join_words, quote
from bt_agents_language.expression.expression_tokens import NAME, ExpressionError
from bt_agents_language.expression.expressions import Expression, Foregone, Mention, MisfitError
from bt_agents_language.expression.quantities import COMMENT
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.fields.texts import TEXT_PREFIX, NoText
from bt_agents_language.model.specs import Computed, Literal, Reference, Text, Variants
from bt_agents_language.yaml.source import line_at
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Scalar

Part = str | Reference | Computed | Variants
"""Part of a text: plain text, a name, an expression, or one of several texts."""

_REFERENCE = re.compile(r"\$\$\{|\$\{([^{}$]*)(\}?)")
_WHERE_TEXTS_STAND = re.compile(rf"(?:({NAME})\s*)?(?:==|!=|\[|,)\s*$")
_LOOKED_AT = 100
_DOTTED = re.compile(NAME)
_COMPUTES = re.compile(r"[a-z]\w*(\.\w|.*[-+*/%<>=(])")

_COMMENT_IN_BLOCK = re.compile(rf"{COMMENT.pattern}|(?<=\S )#(?=\s)")
_INSERTED = re.compile(rf"\$\{{\s*({re.escape(TEXT_PREFIX)}\w+)\s*\}}")

ONE_NAME = re.compile(rf"\$\{{\s*({NAME})\s*\}}")
"""Text that is only a name."""


def read_parts(
    reading: TypedReader, node: Scalar, names: NameScope, *, variants: bool = False
) -> tuple[Part, ...] | None:
    """Return the parts of a text, or report a wrong ``${…}`` in it and return None.

    ``$${`` means the plain text ``${``. A text may insert one of several texts only if
    ``variants`` are possible.
    """
    warn_of_comment(reading, node)
    if "${" not in node.text:
        return (node.text,)
    alone = ONE_NAME.fullmatch(node.text)
    is_text = alone is not None and alone[1].startswith(TEXT_PREFIX)
    if alone is not None and not is_text and names.problem(alone[1]) is None:
        return (_reference(alone[1], names.type_of(alone[1]) or FieldType.ANY),)
    parts: list[Part] = []
    plain = ""
    at = 0
    sound = True
    for match in _REFERENCE.finditer(node.text):
        plain += node.text[at : match.start()]
        at = match.end()
        if match[1] is None:
            plain += "${"
            continue
        read = _read_one(reading, node, match, names, variants)
        if read is None:
            sound = False
            continue
        for part in read:
            if isinstance(part, str):
                plain += part
                continue
            if plain:
                parts.append(plain)
                plain = ""
            parts.append(part)
    plain += node.text[at:]
    if plain:
        parts.append(plain)
    return tuple(parts) if sound else None


def _read_one(
    reading: TypedReader, node: Scalar, match: re.Match[str], names: NameScope, variants: bool
) -> tuple[Part, ...] | None:
    inner = match[1].strip()
    offset = match.start(1) + len(match[1]) - len(match[1].lstrip())
    problem, hint = "", ""
    if not match[2] and node.text.startswith("${", match.end()):
        problem, hint = "a ${…} is inside another one", "write one ${ } around the whole"
    elif not match[2]:
        problem = "this '${' is not closed"
        hint = "close it: ${name}; for the plain text ${ write $${"
    elif not inner:
        problem, hint = "there is no name in ${ }", "write one: ${name}"
    if problem:
        reading.error_in("bad-reference", node, match.start(), len(match[0]), problem, hint)
        return None
    if _DOTTED.fullmatch(inner) and inner.startswith(TEXT_PREFIX):
        return _read_text(reading, node, inner, offset, names, variants)
    if _DOTTED.fullmatch(inner):
        unknown = names.problem(inner)
        if unknown is None:
            return (_reference(inner, names.type_of(inner) or FieldType.ANY),)
        _report_name(reading, node, inner, offset, unknown)
        return None
    expression = read_expression(reading, node, inner, offset, quote(inner), names)
    return None if expression is None else (Computed(expression=expression),)


def _read_text(
    reading: TypedReader, node: Scalar, name: str, offset: int, names: NameScope, variants: bool
) -> tuple[Part, ...] | None:
    """Return the parts of a named text; report errors at their place in that text."""
    try:
        written = names.text(name)
    except NoText as problem:
        _report_name(reading, node, name, offset, (problem.code, problem.message, problem.hint))
        return None
    if len(written.scalars) > 1 and not variants:
        problem_here = (
            "bad-reference",
            f"'{name}' is one of several texts, which only the main text of a skill may be",
            "insert it there, or write one text for it",
        )
        _report_name(reading, node, name, offset, problem_here)
        return None
    place = f"{node.position.file}:{node.position.line}"
    other = reading.beside(written.source, place)
    inner = names.without_texts()
    read = [read_parts(other, scalar, inner) for scalar in written.scalars]
    found = [one for one in read if one is not None]
    if len(found) < len(read):
        return None
    return found[0] if len(found) == 1 else (Variants(texts=tuple(map(text_of, found))),)


def warn_of_comment(reading: TypedReader, node: Scalar) -> None:
    """Report comments that are part of a text without quotes."""
    match = (COMMENT if node.plain else _COMMENT_IN_BLOCK).search(node.text)
    if match is None or node.style in ("'", '"'):
        return
    hint = "write '# …' in a line above"
    if node.plain and not line_at(node.source, node.end).strip():
        before, note = node.text[: match.start()].strip(), node.text[match.end() :].strip(" */")
        hint = f"a comment starts with ' #': write '{ellipsize(f'{before} # {note}'.lstrip())}'"
    reading.error_in(
        "comment-in-text",
        node,
        match.start(),
        len(match[0]),
        f"'{match[0]}' starts no comment, so this is part of the text",
        f"{hint}, or put the text in quotes",
        Severity.WARNING,
    )


def unmarked_expression(node: Scalar, names: NameScope) -> tuple[str, str] | None:
    """Return message and hint for a text that is an expression with known names: ``x + 1``."""
    text = node.text
    if not (any(map(names.knows, _DOTTED.findall(text))) and _COMPUTES.search(text)):
        return None
    try:
        mentions = names.parse(text).mentions
    except ExpressionError:
        return None
    if not mentions or not all(names.knows(one.name) for one in mentions):
        return None
    return (
        f"this is the text {quote(text)}, which is not computed",
        f"write ${{{ellipsize(text)}}}{', or put the text in quotes' if node.plain else ''}",
    )


def inserted_texts(text: str) -> list[str]:
    """Return the names of the texts that a text inserts: ``t.hello`` of ``${t.hello}``."""
    return _INSERTED.findall(text)


def text_of(parts: tuple[Part, ...]) -> Literal | Reference | Text:
    """Return parts as one text."""
    if all(isinstance(part, str) for part in parts):
        return Literal(value="".join(map(str, parts)))
    match parts:
        case (Reference(type=FieldType.TEXT) as only,):
            return only
    return Text(parts=parts)


@lru_cache(maxsize=1024)
def _reference(name: str, field_type: FieldType) -> Reference:
    """Return a name from a cache, because files repeat the same names."""
    return Reference(name=name, type=field_type)


def read_expression(
    reading: TypedReader, node: Scalar, text: str, offset: int, what: str, names: NameScope
) -> Expression | None:
    """Return the expression from ``offset`` on in a scalar's text.

    Returns:
        The expression; None, after a report, if it is invalid or a name is unknown.
    """
    try:
        expression = names.parse(text)
    except MisfitError as error:
        for one in error.errors:
            _report_error(reading, node, offset, what, one)
        _check_names(reading, node, text, offset, error.mentions, names)
        return None
    except ExpressionError as error:
        _report_error(reading, node, offset, what, error)
        return None
    if not _check_names(reading, node, text, offset, expression.mentions, names):
        return None
    for foregone in expression.foregone:
        _warn_of_foregone(reading, node, text, offset, foregone, names)
    return expression


def _report_error(
    reading: TypedReader, node: Scalar, offset: int, what: str, error: ExpressionError
) -> None:
    place = offset + error.column - 1
    message = f"{what}: {error.message}"
    reading.error_in("bad-expression", node, place, error.width, message, error.hint)


def _check_names(
    reading: TypedReader,
    node: Scalar,
    text: str,
    offset: int,
    mentions: Iterable[Mention],
    names: NameScope,
) -> bool:
    """Return whether all names of an expression are known; report unknown ones."""
    sound = True
    for mention in mentions:
        before = text[: mention.column - 1]
        place = _WHERE_TEXTS_STAND.search(before[-_LOOKED_AT:])
        beside = place[1] or "" if place is not None else ""
        problem = names.problem(
            mention.name, maybe_text=place is not None, beside=beside, may_miss=mention.may_miss
        )
        if problem is None:
            continue
        sound = False
        _report_name(reading, node, mention.name, offset + len(before), problem)
    return sound


def _warn_of_foregone(
    reading: TypedReader, node: Scalar, text: str, offset: int, one: Foregone, names: NameScope
) -> None:
    start = one.column - 1
    domains = [f"{name} is {domain}" for name in one.names if (domain := names.domain_of(name))]
    told = f"{quote(text[start : start + one.width])} is "
    told += "always true" if one.always else "never true"
    hint = "compare with another value"
    if one.joint:
        hint = f"did you mean '{'or' if one.joint == 'and' else 'and'}'?"
    elif one.always:
        hint += ", or remove the comparison"
    reading.error_in(
        "constant-condition",
        node,
        offset + start,
        one.width,
        f"{told}: {join_words(domains, 'and')}" if domains else told,
        hint,
        Severity.WARNING,
    )


def _report_name(
    reading: TypedReader, node: Scalar, name: str, offset: int, problem: tuple[str, str, str]
) -> None:
    code, message, hint = problem
    reading.error_in(code, node, offset, len(name), message, hint)
