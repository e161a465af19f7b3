# SPDX-License-Identifier: Apache-2.0
"""YAML reader: located nodes, without features such as anchors and tags."""

from __future__ import annotations

import re
import string
import unicodedata
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import yaml
from yaml.events import (
    CollectionEndEvent,
    CollectionStartEvent,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)

from bt_agents_core.diagnostic import Position
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.yaml.precheck import BAD_CHARACTER, looks_like_yaml
from bt_agents_language.yaml.source import PatchedSource, Source, without_section
from bt_agents_language.yaml.syntax_hints import SyntaxHint
from bt_agents_language.yaml.yaml_syntax import report_syntax

MAX_DEPTH = 64
"""Maximum nesting of lists and mappings."""

MAX_NODES = 50_000
"""Maximum number of scalars, lists and mappings in one file."""

MAX_TEXT = 20_000
"""Longest scalar in characters."""

MAX_READ_AGAIN = 50_000
"""Characters to read again after syntax errors; in a large file only the first ones count."""

MAX_SYNTAX_ERRORS = 20
"""Number of syntax errors after which reading ends, because the file is not YAML."""

_STRANGE_SPACE = re.compile("-?[\u00a0\u1680\u2000-\u200b\u202f\u205f\u2060\u3000]")
_LOST_SPACE = re.compile("-(?=[^\\W\\d_])|[\u2010-\u2015\u2212] ?")
_STANDARD_TAG = re.compile("^tag:yaml.org,2002:")
_NOTHING = frozenset(("", "~", "null", "Null", "NULL"))
_LETTERS = frozenset(string.ascii_letters)


class _Located:
    """Part of a file; its place is computed only on demand."""

    __slots__ = ()
    source: Source
    start: int
    end: int

    @property
    def position(self) -> Position:
        """Position of its first character; for a quoted text, of the quotation mark."""
        return self.source.position(self.start)

    @property
    def span(self) -> tuple[int, int]:
        """Index of its first character in the file's text and of the one after its last."""
        return self.start, self.end


# Never changed, but not frozen: most of what is made for a file are these, and freezing them
# takes three times as long.
@dataclass(slots=True)
class Scalar(_Located):
    """Text, number or word as written.

    Attributes:
        text: Its content, with resolved quotes and line folding.
        style: Empty for a plain scalar, else ``'``, ``"``, ``|`` or ``>``.
    """

    source: Source = field(compare=False)
    start: int
    end: int
    text: str
    style: str

    @property
    def plain(self) -> bool:
        """True if it has no quotes."""
        return not self.style

    @property
    def empty(self) -> bool:
        """True if it is empty, or a word for null."""
        return self.text in _NOTHING and not self.style


@dataclass(slots=True)
class Sequence(_Located):
    """List; see :class:`Scalar`."""

    source: Source = field(compare=False)
    start: int
    end: int
    items: tuple[Node, ...]


@dataclass(slots=True)
class MappingEntry:
    """Key of a mapping, with its value."""

    key: Scalar
    value: Node


@dataclass(slots=True)
class Mapping(_Located):
    """Mapping with distinct keys; see :class:`Scalar`."""

    source: Source = field(compare=False)
    start: int
    end: int
    entries: tuple[MappingEntry, ...]

    def get(self, key: str) -> Node | None:
        """Return the value of a key; None if it is missing."""
        return next((entry.value for entry in self.entries if entry.key.text == key), None)


Node = Scalar | Sequence | Mapping


def entries_of(node: Node | None) -> tuple[MappingEntry, ...]:
    """Return the entries of a mapping; none for anything else."""
    return node.entries if isinstance(node, Mapping) else ()


def several(node: Node) -> tuple[Node, ...]:
    """Return the items of a list, or the only value in its place."""
    return node.items if isinstance(node, Sequence) else (node,)


def key_or_node(node: Node, name: str) -> Node:
    """Return a key of a mapping as written in the file; the whole node if it is missing."""
    return next((entry.key for entry in entries_of(node) if entry.key.text == name), node)


def read_yaml(source: Source, problems: Diagnostics) -> Node | None:
    """Return the only document of a file; problems of its form go to ``problems``.

    Returns:
        The document without refused parts; None if it is unusable or has a syntax error.
    """
    if not looks_like_yaml(source, problems):
        return None
    return _read_once(source, problems)[0]


def read_document(source: Source, problems: Diagnostics) -> tuple[Source, Node | None]:
    """Return the only document of a file as far as it is readable; report every problem.

    If a syntax error has only one possible fix, reading continues as if it was applied; otherwise
    the other keys of the file are still searched for syntax errors.

    Returns:
        The text to which the document's spans refer, and the document without refused parts; None
        if it is unusable.
    """
    if not looks_like_yaml(source, problems):
        return source, None
    whole = True
    left = MAX_READ_AGAIN
    for _ in range(MAX_SYNTAX_ERRORS):
        root, hint = _read_once(source, problems)
        if hint is None:
            return source, root if whole else None
        left -= len(source.text)
        if left < 0:
            break
        if hint.fix is not None:
            source = PatchedSource(source, hint.fix)
            continue
        whole = False
        rest = without_section(source, hint.index)
        if rest is None:
            break
        source = rest
    return source, None


def _read_once(source: Source, problems: Diagnostics) -> tuple[Node | None, SyntaxHint | None]:
    """Return the document, or a hint for the syntax error in it."""
    builder = _Builder(source, problems)
    try:
        builder.take(_events(source.text))
    except yaml.MarkedYAMLError as error:
        start = _start_of_excess_depth(source.text, error)
        if start is not None:
            builder.refuse_depth(start)
            return None, None
        return None, report_syntax(source, problems, error)
    except yaml.YAMLError as error:
        problems.add("syntax", source.position(0), f"the file cannot be read: {quote(str(error))}")
        return None, None
    if builder.root is None and not problems:
        problems.add(
            "empty-file", source.position(0), "nothing is written here", "start with 'format: 1'"
        )
    return None if builder.hopeless else builder.root, None


def _start_of_excess_depth(text: str, error: yaml.MarkedYAMLError) -> yaml.Event | None:
    """Return the event that starts the first level beyond the limit in front of an error.

    From 0.2.6 on, libyaml ends with an error of its own at 1,000 levels, before it delivers the
    events of the levels in front of it: it still looks for a ':' that makes a key of them.
    """
    if error.problem_mark is None:
        return None
    depth = 0
    with suppress(yaml.YAMLError):
        for event in _events(text[: error.problem_mark.index]):
            if isinstance(event, CollectionStartEvent):
                depth += 1
                if depth > MAX_DEPTH:
                    return event
            elif isinstance(event, CollectionEndEvent):
                depth -= 1
    return None


def _events(text: str) -> Iterable[yaml.Event]:
    # The C parser is iterative, so depth is checked here before anything recursive is built.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    next_event: Callable[[], yaml.Event | None] = loader(text).get_event
    return iter(next_event, None)


@dataclass(slots=True)
class _Open:
    """List or mapping whose end has not been read yet."""

    start: int
    is_list: bool
    items: list[Node] = field(default_factory=list)
    entries: dict[str, MappingEntry] = field(default_factory=dict)
    key: Scalar | None = None
    # A refused key still has a value, which must not be taken for the next key.
    value_is_next: bool = False


class _Builder:
    """Builder of nodes from events, without recursion."""

    def __init__(self, source: Source, problems: Diagnostics) -> None:
        self.root: Node | None = None
        self.hopeless = False
        self._source = source
        self._problems = problems
        self._documents = 0

    def take(self, events: Iterable[Any]) -> None:
        """Build from all events of the parser, or until the file turns out to be hopeless."""
        # One loop without calls for the usual cases, because it handles every word of the file.
        source = self._source
        waiting: list[_Open | None] = []
        parent: _Open | None = None
        count = 0
        node: Node
        for event in events:
            kind = type(event)
            if kind is ScalarEvent:
                text, style = event.value, event.style or ""
                if event.anchor is not None or event.tag is not None:
                    self._refuse_extras(event)
                if style == '"':
                    self._refuse_escapes(event)
                if len(text) > MAX_TEXT:
                    self._refuse_length(event)
                count += 1
                if count > MAX_NODES:
                    self._refuse_count(event)
                node = Scalar(source, event.start_mark.index, event.end_mark.index, text, style)
            elif kind is MappingStartEvent or kind is SequenceStartEvent:
                if event.anchor is not None or event.tag is not None:
                    self._refuse_extras(event)
                count += 1
                if count > MAX_NODES:
                    self._refuse_count(event)
                waiting.append(parent)
                parent = _Open(event.start_mark.index, kind is SequenceStartEvent)
                if len(waiting) > MAX_DEPTH:
                    self.refuse_depth(event)
                if self.hopeless:
                    return
                continue
            elif kind is MappingEndEvent or kind is SequenceEndEvent:
                assert parent is not None
                start, end = parent.start, event.end_mark.index
                if parent.is_list:
                    node = Sequence(source, start, end, tuple(parent.items))
                else:
                    node = Mapping(source, start, end, tuple(parent.entries.values()))
                parent = waiting.pop()
            else:
                self._other(event)
                if self.hopeless:
                    return
                continue
            if parent is None:
                self.root = node
            elif parent.is_list:
                parent.items.append(node)
            elif parent.value_is_next:
                parent.value_is_next = False
                if parent.key is not None:
                    parent.entries[parent.key.text] = MappingEntry(parent.key, node)
            else:
                parent.value_is_next = True
                parent.key = self._key(parent.entries, node)
            if self.hopeless:
                return

    def refuse_depth(self, event: yaml.Event) -> None:
        """Refuse a list or mapping that is nested too deep, and end reading."""
        self._give_up(
            event,
            "too-deep",
            f"lists and mappings are nested more than {MAX_DEPTH} deep",
            "move inner parts to subtrees",
        )

    def _other(self, event: yaml.Event) -> None:
        """Refuse an alias and a second document; other events have no meaning."""
        match event:
            case yaml.AliasEvent():
                self._give_up(
                    event,
                    "anchor",
                    f"{quote(f'*{event.anchor}')} is an alias, which is not part of this language",
                    "write the value again, use a tunable or subtree, or quote a text that starts "
                    "with '*'",
                )
            case yaml.DocumentStartEvent():
                self._documents += 1
                if self._documents > 1:
                    self._give_up(
                        event,
                        "several-documents",
                        "a second document starts here",
                        "put it into a file of its own, or remove the line '---'",
                    )

    def _refuse_count(self, event: yaml.Event) -> None:
        self._give_up(
            event,
            "too-many-values",
            f"the file holds more than {MAX_NODES:,} values",
            "split it over several files",
        )

    def _key(self, entries: dict[str, MappingEntry], node: Node) -> Scalar | None:
        """Return a key, or None if it is refused and its value must be left out."""
        if not isinstance(node, Scalar):
            template = self._source.text.startswith("{{", node.span[0] - 1)
            self._refuse(
                "bad-key",
                node,
                "a word is expected before ':', found a list or mapping",
                'a value is named by "${name}", not by {{ name }}'
                if template
                else "quote a text that starts with '{', '[' or '?'",
            )
            # Without this key, any further report about its mapping is guesswork.
            self.hopeless = True
            return None
        text = node.text
        if text[:1] in _LETTERS and text not in entries and text not in _NOTHING:
            return node
        strange = _STRANGE_SPACE.match(text) if node.plain else None
        dash = _LOST_SPACE.match(text) if node.plain else None
        first = entries.get(text)
        if node.empty or not text.strip():
            self._refuse(
                "bad-key",
                node,
                "a word is expected before ':', found nothing",
                "write one, or quote a text that starts with ':'",
            )
        elif strange is not None:
            space = strange[0][-1]
            name = unicodedata.name(space, "strange space")
            where, typed = "indents this line", "spaces"
            if strange[0] != space:
                where, typed = "follows '-'", "'- '"
            self._refuse(
                "bad-character",
                node,
                f"a {name.lower()} (U+{ord(space):04X}) {where}",
                f"delete what is in front of the first word, and type {typed}",
            )
            self.hopeless = True
        elif dash is not None:
            self._refuse(
                "syntax",
                node,
                f"{quote(text)} is not a '-' item",
                f"write '- {text[dash.end() : dash.end() + 20]}: …', with a plain '-' and a "
                "space after it",
            )
            self.hopeless = True
        elif node.plain and text == "<<":
            self._refuse(
                "merge-key",
                node,
                "'<<' is a merge key, which is not part of this language",
                "write the keys out, or use a subtree",
            )
        elif first is not None:
            self._refuse(
                "duplicate-key",
                node,
                f"the key {quote(text)} stands here a second time "
                f"(first in line {first.key.position.line})",
                "remove one of them; a second node starts with a new '-' item",
                self._source.position(node.span[1]),
            )
        else:
            return node
        return None

    def _refuse(
        self, code: str, node: Node, message: str, hint: str, end: Position | None = None
    ) -> None:
        self._problems.add(code, node.position, message, hint, end)

    def _refuse_extras(self, event: ScalarEvent | CollectionStartEvent) -> None:
        if event.anchor is not None:
            self._problems.add(
                "anchor",
                self._position(event),
                f"{quote(f'&{event.anchor}')} is an anchor, which is not part of this language",
                "remove it, or quote a text that starts with '&'",
            )
        if event.tag is not None:
            tag = _STANDARD_TAG.sub("!!", event.tag)
            self._problems.add(
                "tag",
                self._position(event),
                f"{quote(tag)} is a tag, which is not part of this language",
                "remove it, or quote a text that starts with '!'",
            )

    def _refuse_escapes(self, event: ScalarEvent) -> None:
        bad = BAD_CHARACTER.search(event.value)
        if bad is not None:
            self._problems.add(
                "bad-character",
                self._position(event),
                f"the text holds an invisible character (U+{ord(bad[0]):04X})",
                "remove the backslash and the code after it",
            )

    def _refuse_length(self, event: ScalarEvent) -> None:
        self._give_up(
            event,
            "too-long",
            f"one text has {len(event.value):,} characters, at most {MAX_TEXT:,} are possible",
            "split it; close a quotation mark that is still open",
        )

    def _give_up(self, event: yaml.Event, code: str, message: str, hint: str) -> None:
        self._problems.add(code, self._position(event), message, hint)
        self.hopeless = True

    def _position(self, event: yaml.Event) -> Position:
        mark = event.start_mark
        assert mark is not None
        return self._source.position(mark.index)
