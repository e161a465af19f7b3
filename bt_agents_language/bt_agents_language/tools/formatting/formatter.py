# SPDX-License-Identifier: Apache-2.0
"""Formatter: one canonical style for the YAML files of this project, with every comment."""

from __future__ import annotations

from bisect import bisect
from typing import TypeGuard

from bt_agents_core.errors import BtAgentsError
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.tools.formatting.comments import Comment, blank_before, find_comments
from bt_agents_language.tools.formatting.node_order import ordered_nodes
from bt_agents_language.tools.formatting.scalar_style import (
    fits_one_line,
    in_one_line,
    key_in_one_line,
    needs_quotes,
    quoted,
    reindented,
    reindented_block,
)
from bt_agents_language.yaml.scalars import value_type
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import (
    Mapping,
    MappingEntry,
    Node,
    Scalar,
    Sequence,
    read_yaml,
)

WIDTH = 99
"""Columns of a line; only a long text may take more."""

STEP = 2
"""Spaces of one level."""


def format_source(source: Source) -> str:
    """Return the text of a file in canonical style.

    Two spaces a level, lists indented below their key. Short lists and mappings that are written
    in ``{}`` or ``[]`` stay in one line. Comments, the order of keys (but see
    :func:`ordered_nodes`), the line breaks of long texts and single blank lines stay. A comment
    stands two blanks behind its line, or where those of neighbouring lines do that were lined up.

    Raises:
        ReadError: It is no YAML that this project reads; it lists all problems of its form.
        BtAgentsError: The canonical text would not say the same.
    """
    source = Source(source.file, source.text.replace("\r\n", "\n").replace("\r", "\n"))
    root = _read(source)
    text = _Writer(source, root).write()
    if not same_meaning(root, _read(Source(source.file, text))):
        raise BtAgentsError(
            f"{source.file}: left as it is, because it would not say the same in canonical style; "
            "write its keys as short words without line breaks"
        )
    return text


def same_meaning(one: Node, other: Node) -> bool:
    """Return whether two documents say the same; the keys of a mapping may be in another order."""
    match one, other:
        case Scalar(), Scalar():
            return one.text == other.text and value_type(one) is value_type(other)
        case Sequence(), Sequence():
            return len(one.items) == len(other.items) and all(
                map(same_meaning, one.items, other.items)
            )
        case Mapping(), Mapping():
            values = {entry.key.text: entry.value for entry in other.entries}
            return len(one.entries) == len(values) and all(
                entry.key.text in values and same_meaning(entry.value, values[entry.key.text])
                for entry in one.entries
            )
    return False


def _read(source: Source) -> Node:
    problems = Diagnostics(source)
    root = read_yaml(source, problems)
    problems.raise_if_any()
    assert root is not None
    return root


class _Writer:
    """Writes one document line by line, with the comments at their places."""

    def __init__(self, source: Source, root: Node) -> None:
        self._source = source
        self._root = root
        self._comments = list(find_comments(source, root))
        self._places = [comment.index for comment in self._comments]
        self._order = ordered_nodes(root, source.text, self._places)
        self._next = 0
        self._lines: list[str] = []
        # Comments behind lines, by the index of the line.
        self._trailing_comments: dict[int, Comment] = {}
        # The dashes that the next line starts with.
        self._dashes = ""
        # Up to where the source has been written.
        self._end = -1
        self._takes_comment = False
        self._takes_blank = False

    def write(self) -> str:
        """Return the whole text."""
        self._flush(_first(self._root), 0)
        if self._is_block(self._root, 0):
            self._block(self._root, 0, -1)
        else:
            self._value("", -1, self._root, 0, blank=False)
        self._flush(len(self._source.text), 0)
        return "\n".join(self._with_trailing_comments()) + "\n"

    def _block(self, node: Mapping | Sequence, indent: int, outside: int) -> None:
        """Write a list or mapping over several lines."""
        column = node.position.column - 1
        if isinstance(node, Mapping):
            for entry in self._order.get(node.span, node.entries):
                self._flush(entry.key.span[0], indent)
                self._entry(entry, indent, column)
        else:
            keep = needs_quotes(node.items, flow=False)
            for item in node.items:
                self._flush(_first(item), indent)
                self._dashes = (self._dashes or " " * indent) + "- "
                blank = blank_before(self._source, _first(item))
                if self._is_block(item, indent + STEP):
                    self._block(item, indent + STEP, column)
                else:
                    self._value("", -1, item, indent, blank, keep)
        self._claim(node, indent, column, outside)

    def _entry(self, entry: MappingEntry, indent: int, column: int) -> None:
        key, value = entry.key, entry.value
        head = f"{key_in_one_line(key, self._source_text(key))}:"
        blank = blank_before(self._source, key.span[0])
        if self._is_block(value, indent + len(head) + 1):
            self._open(head, indent, key.span[1], blank)
            self._block(value, indent + STEP, column)
        else:
            self._value(head, key.span[1], value, indent, blank)

    def _value(
        self,
        head: str,
        head_end: int,
        node: Node,
        indent: int,
        blank: bool,
        keep_quotes: bool = False,
    ) -> None:
        """Write a value that is no block list or mapping behind its key or dash."""
        lines = self._value_lines(node, indent, indent + STEP, keep_quotes)
        start = node.span[0]
        if head and self._on_own_line(node, head, head_end, indent, lines):
            self._open(head, indent, head_end, blank)
            lines = self._value_lines(node, indent, indent + 2 * STEP, keep_quotes)
            self._flush(start, indent + STEP)
            self._line(indent + STEP, lines[0])
        else:
            space = " " if head and lines[0] else ""
            self._line(indent, f"{head}{space}{lines[0]}", blank)
        self._lines += lines[1:]
        self._reach(node.span[1])
        self._comment_inside(node, len(lines))
        if isinstance(node, Scalar) and node.style in ("|", ">") and len(lines) > 1:
            self._takes_comment = False
            self._takes_blank = bool(lines[-1].strip())

    def _comment_inside(self, node: Node, count: int) -> None:
        """Write the comment behind the sign of a text block, or inside of an empty ``{}``."""
        if self._next < len(self._comments) and self._comments[self._next].index < node.span[1]:
            comment = self._comments[self._next]
            self._next += 1
            self._trailing_comments[len(self._lines) - count] = comment
            self._takes_comment = False

    def _on_own_line(
        self, node: Node, head: str, head_end: int, indent: int, lines: list[str]
    ) -> bool:
        """Return whether a value stays on a line below its key."""
        if not lines[0]:
            return False
        if self._next < len(self._comments) and self._comments[self._next].index < node.span[0]:
            return True
        if "\n" not in self._source.text[head_end : node.span[0]]:
            return False
        return len(lines) > 1 or indent + len(head) + 1 + len(lines[0]) > WIDTH

    def _value_lines(self, node: Node, parent: int, indent: int, keep_quotes: bool) -> list[str]:
        if not isinstance(node, Scalar):
            text = self._flow(node)
            assert text is not None
            return [text]
        written = self._source_text(node)
        if node.style in ("|", ">"):
            block = reindented_block(written, node.text, indent, parent)
            return block if block is not None else [quoted(node.text)]
        if "\n" in written:
            return reindented(written, indent)
        return [in_one_line(node, written, flow=False, keep_quotes=keep_quotes)]

    def _flow(self, node: Node) -> str | None:
        """Return a value in one line, inside of ``{}`` or ``[]``; None when it needs several."""
        parts: list[str | None]
        match node:
            case Scalar():
                return self._flow_scalar(node, keep_quotes=False)
            case Sequence():
                keep = needs_quotes(node.items, flow=True)
                parts = [
                    self._flow_scalar(item, keep_quotes=keep)
                    if isinstance(item, Scalar)
                    else self._flow(item)
                    for item in node.items
                ]
                shape = "[{}]"
            case Mapping():
                parts = [self._flow_entry(e) for e in self._order.get(node.span, node.entries)]
                # A list may hold a single pair without braces.
                braces = self._source.text[node.span[0]] == "{"
                shape = "{{{}}}" if braces else "{}"
        known = [part for part in parts if part is not None]
        return shape.format(", ".join(known)) if len(known) == len(parts) else None

    def _flow_entry(self, entry: MappingEntry) -> str | None:
        value = self._flow(entry.value)
        key = key_in_one_line(entry.key, self._source_text(entry.key))
        return None if value is None else f"{key}: {value}"

    def _flow_scalar(self, scalar: Scalar, *, keep_quotes: bool) -> str | None:
        written = self._source_text(scalar)
        if not fits_one_line(scalar, written):
            return None
        return in_one_line(scalar, written, flow=True, keep_quotes=keep_quotes)

    def _is_block(self, node: Node, column: int) -> TypeGuard[Mapping | Sequence]:
        """Return whether a value is a list or mapping that is to take several lines."""
        match node:
            case Scalar() | Mapping(entries=()) | Sequence(items=()):
                return False
        if self._source.text[node.span[0]] not in "{[":
            return True
        if bisect(self._places, node.span[0]) < bisect(self._places, node.span[1]):
            return True
        text = self._flow(node)
        return text is None or column + len(text) > WIDTH

    def _open(self, head: str, indent: int, end: int, blank: bool) -> None:
        """Write a key whose value stands below it."""
        self._line(indent, head, blank)
        self._reach(end)
        self._takes_blank = False

    def _line(self, indent: int, text: str, blank: bool = False) -> None:
        if blank and self._takes_blank:
            self._lines.append("")
        self._lines.append(f"{self._dashes or ' ' * indent}{text}".rstrip())
        self._dashes = ""
        self._takes_blank = True
        self._takes_comment = True

    def _flush(self, until: int, indent: int) -> None:
        """Write the comments before an index of the source."""
        while self._next < len(self._comments) and self._comments[self._next].index < until:
            comment = self._comments[self._next]
            self._next += 1
            if self._takes_comment and self._same_line(self._end, comment.index):
                self._trailing_comments[len(self._lines) - 1] = comment
            else:
                self._line(indent, comment.text, comment.blank_before)
            self._takes_comment = False
            self._reach(comment.index + len(comment.text))

    def _claim(self, node: Mapping | Sequence, indent: int, column: int, outside: int) -> None:
        """Write the comments at the end of a block that belong to it, by where they stand."""
        in_flow = self._source.text[node.span[0]] in "{["
        while self._next < len(self._comments):
            comment = self._comments[self._next]
            beside = self._takes_comment and self._same_line(self._end, comment.index)
            inside = (
                comment.index < node.span[1]
                if in_flow
                else comment.column >= column > outside
                and not self._source.text[self._end : comment.index].strip()
            )
            if not (beside or inside):
                break
            self._flush(comment.index + 1, indent)
        if in_flow:
            self._reach(node.span[1])

    def _reach(self, end: int) -> None:
        self._end = max(self._end, end)

    def _same_line(self, start: int, end: int) -> bool:
        return 0 <= start <= end and "\n" not in self._source.text[start:end]

    def _with_trailing_comments(self) -> list[str]:
        """Return the lines with their comments, which stay lined up on neighbouring lines."""
        lines = list(self._lines)
        for run in _runs(self._trailing_comments):
            width = max(len(lines[number]) for number in run) + STEP
            for number in run:
                lines[number] = lines[number].ljust(width) + self._trailing_comments[number].text
        return lines

    def _source_text(self, scalar: Scalar) -> str:
        return self._source.text[slice(*scalar.span)]


def _runs(comments: dict[int, Comment]) -> list[list[int]]:
    """Return the neighbouring lines whose comments stood in one column; many are alone."""
    runs: list[list[int]] = []
    for number, comment in sorted(comments.items()):
        before = comments.get(number - 1)
        if before is not None and before.own_column == comment.own_column:
            runs[-1].append(number)
        else:
            runs.append([number])
    return runs


def _first(node: Node) -> int:
    """Return where the first scalar or bracket of a value starts."""
    match node:
        case Mapping(entries=(first, *_)):
            return first.key.span[0]
        case Sequence(items=(first, *_)):
            return _first(first)
    return node.span[0]
