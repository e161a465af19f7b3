# SPDX-License-Identifier: Apache-2.0
"""What a YAML syntax error most likely means, in words that say how to mend it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import yaml

from bt_agents.language.diagnostics import Diagnostics, shown
from bt_agents.language.line_slips import Slip, key_slip, line_slip
from bt_agents.language.mended_source import Edit
from bt_agents.language.source import Source

_INDENTED_TAB = re.compile(r" *\t")
_FIT = "indent it like the key behind the '-' above, or start a new '-' item"
_LAST_WORD = re.compile(r"[^\s,;:{}\[\]]+$")
_WRONG_QUOTES = re.compile("(?<=[:,\\-\\[{(] )[\u201c\u201d\u201e\u2018\u2019\u00ab]")
_CONFLICT = ("<<<<<<<", "=======", ">>>>>>>")
_QUOTE_INSIDE = "inside { … } and [ … ], quote texts with ':', '?', ',' or brackets in them"
_CLOSING = {"{": "}", "[": "]"}

Explain = Callable[[Source, int, int], Slip]
"""Source, index where the parser stopped, index where the thing began that it was reading."""


def report_syntax(source: Source, problems: Diagnostics, error: yaml.MarkedYAMLError) -> Slip:
    """Add what a parser error means, and return it."""
    slip = _slip(source, error)
    end = source.position(slip.index + slip.width)
    problems.add(slip.code, source.position(slip.index), slip.message, slip.hint, end)
    return slip


def _slip(source: Source, error: yaml.MarkedYAMLError) -> Slip:
    stopped = error.problem_mark or error.context_mark
    index = stopped.index if stopped is not None else 0
    begun = error.context_mark.index if error.context_mark is not None else index
    position = source.position(index)
    start = _line_start(source, index)
    tab = _INDENTED_TAB.match(_line_at(source, start))
    if tab is not None and position.column <= tab.end():
        return Slip(
            code="tab",
            index=start + tab.end() - 1,
            message="a tab indents this line",
            hint="use spaces (most editors can turn tabs into spaces)",
        )
    problem = f"{error.context or ''}: {error.problem or ''}"
    for part, explain in _EXPLANATIONS.items():
        if part in problem:
            return explain(source, index, begun)
    message = error.problem or "this is not valid YAML"
    return Slip(index=index, message=message, hint="look at the line above")


def _second_colon(source: Source, index: int, begun: int) -> Slip:
    start = _line_start(source, index)
    line = _line_at(source, start)
    before = source.text[start:index]
    if re.search(r":(\s|$)", before):
        wrong = _WRONG_QUOTES.search(before)
        if wrong is not None:
            return Slip(
                index=start + wrong.start(),
                message=f"'{wrong[0]}' is no quotation mark in this language",
                hint='use straight ones: "…"',
            )
        quoted = _quoted_value(source, start, line)
        return Slip(
            index=index,
            message="a second ':' stands in this line",
            hint="quote a text with ': ' in it: \"…: …\"",
            mend=quoted,
        )
    above = _line_above(source, start)
    if above is not None:
        # What looks like a text over two lines is a key above whose colon does not count as one.
        slip = _of_key(source, above)
        if slip is not None:
            return slip
    own = key_slip(before, start)
    if own is not None and ":" in before:
        return own
    return Slip(
        index=start + len(before) - len(before.lstrip()),
        message="this line is indented deeper than the one it follows",
        hint="write it below the first letter of the line above",
    )


def _quoted_value(source: Source, start: int, line: str) -> Edit | None:
    """Return the edit that quotes everything behind the first colon of a line."""
    match = re.match(r"\s*(?:- +)*[\w-]+: +(?=[^\s'\"{\[|>&*!#])", line)
    text = line[match.end() :].rstrip() if match is not None else ""
    mark = next((one for one in ('"', "'") if one not in text and "\\" not in text), "")
    if match is None or not mark or " #" in text:
        return None
    at = start + match.end()
    return Edit(start=at, stop=at + len(text), text=f"{mark}{text}{mark}")


def _dash(source: Source, index: int, begun: int) -> Slip:
    return Slip(
        index=index,
        message="a '-' item starts in the middle of a line",
        hint="start it on a line of its own, or quote a text that starts with '- '",
    )


def _no_colon(source: Source, index: int, begun: int) -> Slip:
    if source.text.startswith(_CONFLICT, begun):
        return Slip(
            index=begun,
            width=len(_CONFLICT[0]),
            message="two versions of the file were merged, and this place is not decided yet",
            hint="keep one of the two versions, and delete the lines <<<<<<<, ======= and >>>>>>>",
        )
    slip = _of_line(source, _line_start(source, begun))
    return slip or Slip(
        index=begun,
        message="this line is neither 'key: value' nor a '-' item",
        hint="put a ': ' behind the key, or indent the line if it belongs to the text above",
    )


def _flow(source: Source, index: int, begun: int) -> Slip:
    text = source.text
    found = text[index : index + 1]
    if found == "{" and text[max(0, index - 2) : index].endswith("$"):
        return Slip(
            index=index - 1,
            message="${…} stands without quotes inside { … } or [ … ]",
            hint='quote it there: "${name}"',
        )
    bracket = text[begun : begun + 1] or "{"
    closing = _CLOSING.get(bracket, "}")
    word = _LAST_WORD.search(text, begun + 1, index) if found == ":" else None
    at_end = index >= len(text.rstrip())
    if at_end or (word is not None and _no_deeper(source, word.start(), begun)):
        end = len(text.rstrip()) if word is None else _end_above(text, word.start())
        return Slip(
            index=begun,
            message=f"this '{bracket}' is not closed",
            hint=f"close it with '{closing}' at the end of the value",
            mend=_inserted(text, begun, end, closing) if not at_end else None,
        )
    if word is not None:
        end = len(text[: word.start()].rstrip())
        return Slip(
            index=word.start(),
            width=len(word[0]),
            message=f"a ',' is expected before {shown(word[0])}",
            hint="put a ',' between two values, and quote a text with ': ' in it",
            mend=_inserted(text, begun, end, ",") if _is_key(text, word) else None,
        )
    if found in _CLOSING.values():
        return Slip(
            index=index,
            message=f"the '{bracket}' of column {source.position(begun).column} is closed by "
            f"'{found}'",
            hint=f"close it with '{closing}'",
            mend=Edit(start=index, stop=index + 1, text=closing),
        )
    return Slip(
        index=index, message="a ',' or the closing bracket is expected here", hint=_QUOTE_INSIDE
    )


def _is_key(text: str, word: re.Match[str]) -> bool:
    """Return whether a word with a colon behind it looks like the next key, not like a text."""
    before = text[: word.start()].rstrip()
    return "\n" in text[len(before) : word.start()] and word[0].strip("'\"").isidentifier()


def _inserted(text: str, begun: int, at: int, closing: str) -> Edit | None:
    return None if "#" in text[begun:at] else Edit(start=at, stop=at, text=closing)


def _no_deeper(source: Source, index: int, begun: int) -> bool:
    """Return whether a place stands no deeper than the line in which something began."""
    line = _line_at(source, _line_start(source, begun))
    return source.position(index).column <= _indentation(line) + 1


def _misfit(source: Source, index: int, begun: int) -> Slip:
    start = _line_start(source, index)
    line = _line_at(source, start)
    before = source.text[start:index]
    if before.strip(" -"):
        return _behind_value(source, index)
    if line.lstrip().startswith("- "):
        return Slip(
            index=index,
            message="this '-' item does not line up with the block above",
            hint="indent it like the others",
        )
    return Slip(index=index, message="this line fits no block above it", hint=_FIT)


def _no_item(source: Source, index: int, begun: int) -> Slip:
    start = _line_start(source, index)
    line = _line_at(source, start)
    slip = line_slip(line, start)
    if slip is not None and "'-'" in slip.message:
        return slip
    if source.position(index).column == source.position(
        begun
    ).column and not line.lstrip().startswith("-"):
        return Slip(
            index=index,
            width=len(line.strip().partition(":")[0]) or 1,
            message="this line stands in a list of '-' items, but does not start with '- '",
            hint="put '- ' in front of it, or indent it if it belongs to the item above",
        )
    return _misfit(source, index, begun)


def _behind_value(source: Source, index: int) -> Slip:
    found = source.text[index : index + 1]
    message, hint = "something stands behind the end of a value", ""
    if found in _CLOSING.values():
        message, hint = f"there is no open bracket that this '{found}' could close", "remove it"
        return Slip(
            index=index,
            message=message,
            hint=hint,
            mend=Edit(start=index, stop=index + 1, text=" "),
        )
    quote = source.text[index - 1 : index]
    opened = source.text.rfind(quote, 0, index - 1) if quote in ("'", '"') else index
    line = source.position(index).line
    if quote == "'":
        hint = 'put a text with an apostrophe in double quotes: "…"'
    elif quote != '"':
        hint = "put quotes around the whole text, or start a new line"
    elif source.position(opened).line < line:
        index = opened
        message, hint = f"this quotation mark is closed only in line {line}", "close it before"
    else:
        hint = 'write the quotation marks inside of a text as \\"'
    return Slip(index=index, message=message, hint=hint)


def _unclosed(source: Source, index: int, begun: int) -> Slip:
    return Slip(
        index=begun,
        message="this quotation mark is not closed",
        hint="add one at the end of the text",
    )


def _bad_start(source: Source, index: int, begun: int) -> Slip:
    character = source.text[index : index + 1]
    if character == "\t":
        return Slip(index=index, message="a tab stands here", hint="use spaces")
    return _unquoted(source, index, character)


def _mark_at_start(source: Source, index: int, begun: int) -> Slip:
    return _unquoted(source, begun, source.text[begun : begun + 1])


def _question(source: Source, index: int, begun: int) -> Slip:
    return _unquoted(source, index, source.text[index : index + 1] + " ")


def _unquoted(source: Source, index: int, found: str) -> Slip:
    start = _line_start(source, index)
    return Slip(
        index=index,
        message=f"a text cannot start with {shown(found)}",
        hint='quote it: "…"',
        mend=_quoted_rest(source, start, index),
    )


def _quoted_rest(source: Source, start: int, index: int) -> Edit | None:
    text = _line_at(source, start)[index - start :].rstrip()
    alone = re.fullmatch(r"\s*(?:- +)*(?:[\w-]+: +)?", source.text[start:index]) is not None
    if not alone or " #" in text or '"' in text or "\\" in text:
        return None
    return Edit(start=index, stop=index + len(text), text=f'"{text}"')


def _escape(source: Source, index: int, begun: int) -> Slip:
    backslash = source.text.find("\\", index)
    while backslash >= 0 and source.text[backslash + 1 : backslash + 2] in _KNOWN_ESCAPES:
        backslash = source.text.find("\\", backslash + 2)
    at = backslash if backslash >= 0 else index
    return Slip(
        index=at,
        width=2,
        message=f"'{source.text[at : at + 2]}' means nothing inside \"…\"",
        hint="write the backslash twice, or use '…'",
        mend=Edit(start=at, stop=at, text="\\") if backslash >= 0 else None,
    )


_KNOWN_ESCAPES = set('0abt\tnvfre "/\\N_LPxuU\n\r')


def _no_content(source: Source, index: int, begun: int) -> Slip:
    found = source.text[index : index + 1]
    return Slip(
        index=index,
        message=f"a value is expected here, found '{found}'",
        hint=_QUOTE_INSIDE if found not in ("]", "}", ",") else "remove it, or quote the text",
    )


def _after_the_end(source: Source, index: int, begun: int) -> Slip:
    return Slip(
        index=index,
        message="something stands behind the end of the file's one value",
        hint="remove a line '...' above; put quotes around a whole text",
    )


def _directive(source: Source, index: int, begun: int) -> Slip:
    return Slip(
        index=begun,
        message="a line cannot start with '%'",
        hint="remove the line, or quote the text",
    )


def _text_block(source: Source, index: int, begun: int) -> Slip:
    return Slip(
        index=index,
        message="a text block ('|' or '>') starts wrongly",
        hint="write only '|' or '>' in that line",
    )


_EXPLANATIONS: dict[str, Explain] = {
    "mapping values are not allowed": _second_colon,
    "block sequence entries are not allowed": _dash,
    "mapping keys are not allowed": _question,
    "could not find expected ':'": _no_colon,
    "did not find expected ',' or": _flow,
    "did not find expected '-' indicator": _no_item,
    "did not find expected key": _misfit,
    "unexpected end of stream": _unclosed,
    "unexpected document indicator": _unclosed,
    "cannot start any token": _bad_start,
    "while scanning an alias": _mark_at_start,
    "while scanning an anchor": _mark_at_start,
    "while scanning a tag": _mark_at_start,
    "while parsing a tag": _mark_at_start,
    "unknown escape character": _escape,
    "did not find expected node content": _no_content,
    "did not find expected comment or line break": _text_block,
    "indentation indicator": _text_block,
    "did not find expected <document start>": _after_the_end,
    "incompatible YAML document": _directive,
    "undefined tag handle": _bad_start,
    "directive": _directive,
}
"""Part of the parser's message → what it means."""


def _of_key(source: Source, start: int) -> Slip | None:
    line = _line_at(source, start)
    return _sure(source, start, key_slip(line, start))


def _of_line(source: Source, start: int) -> Slip | None:
    line = _line_at(source, start)
    return _sure(source, start, line_slip(line, start))


def _sure(source: Source, start: int, slip: Slip | None) -> Slip | None:
    """Return a slip without its edit where a lonely word may be part of a text."""
    if slip is None or slip.mend is None:
        return slip
    added = slip.mend.text == ":" and slip.mend.start == slip.mend.stop
    if not added:
        return slip
    line = _line_at(source, start)
    below = source.text[start + len(line) :].lstrip("\r\n")
    next_line = below.splitlines()[0] if below else ""
    is_key = _indentation(next_line) > _indentation(line) or next_line.lstrip().startswith("- ")
    return slip if is_key else replace(slip, mend=None)


def _line_start(source: Source, index: int) -> int:
    text = source.text
    return max(text.rfind("\n", 0, index), text.rfind("\r", 0, index)) + 1


def _line_at(source: Source, start: int) -> str:
    match = re.compile(r"[^\r\n]*").match(source.text, start)
    return match[0] if match is not None else ""


def _line_above(source: Source, start: int) -> int | None:
    """Return the start of the last line above that is not empty."""
    end = len(source.text[:start].rstrip())
    return _line_start(source, end) if end else None


def _end_above(text: str, index: int) -> int:
    """Return the end of what stands above the line of a character."""
    return len(text[: max(text.rfind("\n", 0, index), text.rfind("\r", 0, index)) + 1].rstrip())


def _indentation(line: str) -> int:
    return len(line) - len(line.lstrip())
