# SPDX-License-Identifier: Apache-2.0
"""Typed values read from located nodes; a value of another type becomes a diagnostic."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from enum import Enum
from functools import partial
from itertools import pairwise
from pathlib import Path
from traceback import walk_tb
from types import TracebackType
from typing import TypeVar

from bt_agents_core.diagnostic import Position, Severity
from bt_agents_core.errors import BtAgentsError
from bt_agents_core.field_types import FieldType
from bt_agents_core.scene import SceneParameter
from bt_agents_core.text import ellipsize, join_quoted, join_words, quote
from bt_agents_language.diagnostics.collection import Diagnostics, did_you_mean, nearest
from bt_agents_language.expression import quantities
from bt_agents_language.expression.units import DIMENSIONS
from bt_agents_language.yaml.field_tables import (
    Entries,
    Items,
    KeyTable,
    SceneValues,
    Single,
    Value,
    WordChoice,
)
from bt_agents_language.yaml.scalars import as_scalar, boolean
from bt_agents_language.yaml.source import Source, aligned, read_source
from bt_agents_language.yaml.yaml_reader import (
    Mapping,
    MappingEntry,
    Node,
    Scalar,
    Sequence,
    read_document,
)

FORMAT = 1
"""Version of the language that this package reads."""

MAX_NAME = 64
"""Longest name of an agent, skill or tunable in characters."""

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_PAIR = re.compile(r"([^\W\d][\w.]*)\s*(?:([-+*/])|:)?=\s*([^\s=][^=]*)")
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
_SKILLS = ("a skills file", "put it under skills/ or libraries/")
_FILES = {
    "agent": ("an agent file", "put it under agents/"),
    "skills": _SKILLS,
    "bindings": _SKILLS,
    "parameters": ("a scene.yaml", "name another file"),
    "visits": ("a script", "put it under scripts/"),
    "cases": ("a test file", "let its name end with .test.yaml"),
    "rules": ("a market.yaml", "put it beside scene.yaml"),
    "rounds": ("an experiment", "name another file"),
    "texts": ("a file of texts", "put it under texts/"),
    "preset": ("a preset", "put it under presets/"),
}
"""Key that only one kind of file has → that kind, and where it belongs."""

T = TypeVar("T")
NumberT = TypeVar("NumberT", int, float)


class Shape(Enum):
    """Shapes of YAML that a place may expect."""

    TEXT = "text"
    LIST = "list"
    MAPPING = "mapping"
    CONDITION = "condition"
    VALUE = "value"
    OTHER = "other"


class TypedReader:
    """File during reading: its source, its document and the problems found so far."""

    def __init__(self, source: Source) -> None:
        self.problems = Diagnostics(source)
        self.source, self.root = read_document(source, self.problems)
        # These leave the kind of a value open.
        spoiling = ("tag", "bad-character")
        self._spoilt = {d.position for d in self.problems.sorted() if d.code in spoiling}
        self._aligned_span = (-1, -1)
        self._aligned: list[int] = []
        self._inserted: tuple[str, ...] = ()

    def beside(self, source: Source, inserted: str) -> TypedReader:
        """Return a reader for values of another file, which shares the problems of this one.

        Args:
            source: The other file.
            inserted: Place in this file that inserts the values.
        """
        other = copy(self)
        other.source = source
        other.problems = self.problems.beside(source)
        other._aligned_span = (-1, -1)
        other._inserted = (inserted,)
        return other

    @classmethod
    @contextmanager
    def of(cls, file: Path | Source) -> Iterator[TypedReader]:
        """Open a file and read it within the block.

        Raises:
            ReadError: It cannot be opened or is not a text, or as in :meth:`guarded`.
        """
        reading = cls(file if isinstance(file, Source) else read_source(file))
        with reading.guarded():
            yield reading

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Turn an exception of the reading code into a problem of this file alone.

        Raises:
            ReadError: There is such an exception.
        """
        try:
            yield
        except BtAgentsError:
            raise
        except Exception as fault:
            self.problems.add(
                "reader-fault",
                _place_of(fault.__traceback__) or Position(self.source.file, 1, 1),
                f"bt-agents cannot read this: {type(fault).__name__}",
                "write it differently, and please report this file as a fault of bt-agents",
            )
            raise self.problems.error() from fault

    def error(self, code: str, where: Node | Position, message: str, hint: str = "") -> None:
        """Add a problem about a whole node, or at one position."""
        if isinstance(where, Position):
            self.problems.add(code, where, message, hint, inserted=self._inserted)
        elif where.position not in self._spoilt:
            # The value without the error is unknown.
            end = self.source.position(where.span[1])
            self.problems.add(code, where.position, message, hint, end, inserted=self._inserted)

    def error_in(
        self,
        code: str,
        scalar: Scalar,
        offset: int,
        width: int,
        message: str,
        hint: str = "",
        severity: Severity = Severity.ERROR,
    ) -> None:
        """Add a problem about ``width`` characters from ``offset`` on in the text of a scalar."""
        start = self._index(scalar, offset)
        last = self._index(scalar, offset + width - 1) if width > 1 else start
        end = self.source.position(last + 1)
        position = self.source.position(start)
        self.problems.add(code, position, message, hint, end, severity, self._inserted)

    def warning(self, code: str, node: Node, message: str, hint: str) -> None:
        """Add a warning about a whole node, which does not make the file unreadable."""
        end = self.source.position(node.span[1])
        self.problems.add(code, node.position, message, hint, end, Severity.WARNING)

    def _index(self, scalar: Scalar, offset: int) -> int:
        if scalar.span != self._aligned_span:
            self._aligned_span = scalar.span
            self._aligned = aligned(scalar.text, self.source.text[slice(*scalar.span)])
        return scalar.span[0] + self._aligned[min(max(offset, 0), len(self._aligned) - 1)]

    def file(self, kind: KeyTable) -> MappingReader:
        """Return the keys of the whole file according to its table; check ``format``.

        Raises:
            ReadError: The file is not a mapping, so it is unreadable.
        """
        if self.root is None:
            raise self.problems.error()
        other = _other_file(self.root, kind.values)
        if other is not None:
            entry, what, hint = other
            message = f"expected {kind.what}, found {what}: it has the key '{entry.key.text}'"
            self.error("wrong-type", entry.key, message, hint)
            raise self.problems.error()
        known, required = ("format", *kind.values), ("format", *kind.required)
        fields = self.fields(self.root, kind.what, known, required)
        if fields is None:
            raise self.problems.error()
        fields.table = kind
        version = fields.integer("format")
        if version is not None and version != FORMAT:
            self.error(
                "wrong-format",
                fields.nodes["format"],
                f"the file has format {version}, this program reads format {FORMAT}",
                "write format: 1",
            )
        return fields

    def keys(
        self,
        node: Node,
        table: KeyTable,
        what: str = "",
        *,
        required: Collection[str] | None = None,
        more: Collection[str] = (),
    ) -> MappingReader | None:
        """Return the keys of a mapping according to its table, like :meth:`fields`.

        The name of the mapping and its required keys come from the table unless they are given.
        """
        needed = table.required if required is None else required
        known = (*table.values, *more) if more else table.values
        fields = self.fields(node, what or table.what, known, needed)
        if fields is not None:
            fields.table = table
        return fields

    def fields(
        self,
        node: Node,
        what: str,
        known: Collection[str],
        required: Collection[str] = (),
        beside: Collection[str] = (),
    ) -> MappingReader | None:
        """Return the keys of a mapping; unknown and missing ones become problems.

        Keys in ``beside`` belong next to the key with the mapping, not into it.
        """
        if not isinstance(node, Mapping):
            expected = f"a mapping with the keys {join_quoted(required or known)}"
            self.wrong_type(node, what, expected, Shape.MAPPING)
            return None
        nodes: dict[str, Node] = {}
        keys: dict[str, Scalar] = {}
        unknown: list[MappingEntry] = []
        for entry in node.entries:
            word = entry.key.text
            keys[word] = entry.key
            if word in known:
                nodes[word] = entry.value
            else:
                unknown.append(entry)
        missing = [key for key in required if key not in nodes]
        if not unknown and not missing:
            return MappingReader(self, node, nodes, keys)
        if unknown and not nodes and all(map(_without_value, unknown)):
            self.error(
                "wrong-type",
                node,
                f"{what}: expected a mapping with the keys {join_quoted(required or known)}, "
                "found words in braces",
                _as_mapping(unknown[0].key.text) or "put a text in quotes instead of braces",
            )
            return None
        for entry in unknown:
            word = entry.key.text
            # A misspelled key is not missing, and is read as the intended one.
            meant = nearest(word, [key for key in known if key not in nodes])
            place = node.entries.index(entry)
            before = node.entries[place - 1] if place else None
            above = _left_empty(before, nodes)
            hint = did_you_mean(word, known)
            if cut := _comma_hint(before, entry):
                hint = cut
            elif word in beside:
                hint = f"'{word}' stands beside {what}, not in it"
            elif meant is not None:
                missing = [key for key in missing if key != meant]
                nodes[meant], keys[meant] = entry.value, entry.key
            elif above is not None:
                hint = f"indent it, if it belongs to '{above}:'"
                del nodes[above]
            elif missing and len(unknown) == 1:
                asked = f"did you mean {join_quoted(missing)}? That is missing"
                hint = _as_quantity(entry) or asked
                missing = []
            self.error("unknown-key", entry.key, f"{what} has no key {quote(word)}", hint)
        if missing:
            self.error(
                "missing-key",
                node.entries[0].key if node.entries and node is not self.root else node.position,
                f"{what} needs the key{'s' * (len(missing) > 1)} {join_quoted(missing)}",
                adding(missing),
            )
        return MappingReader(self, node, nodes, keys)

    def wrong_type(self, node: Node, what: str, expected: str, shape: Shape = Shape.OTHER) -> None:
        """Report an unexpected value; its shape determines the hint."""
        if isinstance(node, Scalar) and node.empty:
            self.error(
                "missing-value", node, f"{what}: nothing is written here, expected {expected}"
            )
            return
        hint = ""
        if isinstance(node, Mapping) and shape is Shape.TEXT:
            hint = "if it is meant as text, put it in quotes"
        elif isinstance(node, Sequence) and shape is Shape.MAPPING:
            hint = "write 'key: value' without '- ' or [ ] around it"
        elif isinstance(node, Sequence) and shape is Shape.CONDITION:
            hint = "write one condition, and join its parts with 'and' or 'or'"
        elif isinstance(node, Sequence) and shape is Shape.VALUE:
            hint = "write one value, without [ ] or '- '"
        elif isinstance(node, Scalar) and shape is Shape.MAPPING:
            hint = _as_mapping(node.text)
        elif shape is Shape.LIST:
            hint = "start each item with '- ', or write [ … ] around them"
        self.error("wrong-type", node, f"{what}: expected {expected}, found {found(node)}", hint)

    def text(self, node: Node, what: str, *, empty: bool = False) -> str | None:
        """Return a text; a number or ``true`` is taken as written."""
        if not isinstance(node, Scalar):
            self.wrong_type(node, what, "a text", Shape.TEXT)
            return None
        if node.text.strip() and not node.empty:
            return node.text
        if node.empty and node.text not in ("", "~") and not empty:
            self.error(
                "missing-value", node, f"{quote(node.text)} means nothing", 'quote it: "null"'
            )
            return None
        if not node.text.strip() and not empty:
            # The usual mistake is a colour: light: #ff0000
            comment = node.plain and self.source.text[node.span[1] :].lstrip(" ")[:1] == "#"
            hint = "a # starts a comment; put the text in quotes" if comment else "write a text"
            self.error("missing-value", node, f"{what} is empty", hint)
            return None
        return node.text

    def name(self, node: Node, what: str) -> str | None:
        """Return an identifier: small letters, digits and ``_``, a letter first."""
        text = self.text(node, what)
        if text is None:
            return None
        if _NAME.fullmatch(text) and len(text) <= MAX_NAME:
            return text
        meant = name_meant(text)
        hint = f"write {meant}" if _NAME.fullmatch(meant) and len(meant) <= MAX_NAME else ""
        self.error(
            "bad-name",
            node,
            f"{what} is {quote(text)}, expected small letters a-z, digits and '_', "
            f"a letter first, at most {MAX_NAME} characters",
            _as_mapping(text) or hint,
        )
        return None

    def integer(
        self, node: Node, what: str, minimum: float | None = None, maximum: float | None = None
    ) -> int | None:
        """Return a whole number in a range."""
        return self._converted(
            node, what, "a whole number", "bad-number", quantities.integer, minimum, maximum
        )

    def number(
        self, node: Node, what: str, minimum: float | None = None, maximum: float | None = None
    ) -> float | None:
        """Return a finite number in a range."""
        return self._converted(
            node, what, "a number", "bad-number", quantities.number, minimum, maximum
        )

    def amount(
        self, node: Node, what: str, field_type: FieldType, minimum: float | None = None
    ) -> int | float | None:
        """Return a number of a type, or a time [s], length [m] or angle [rad] of any size."""
        if field_type is FieldType.INTEGER:
            return self.integer(node, what, None if minimum is None else int(minimum))
        dimension = DIMENSIONS.get(field_type)
        if dimension is None:
            return self.number(node, what, minimum)
        convert = partial(quantities.quantity, field_type=field_type)
        return self._converted(node, what, dimension.wanted, dimension.code, convert)

    def _converted(
        self,
        node: Node,
        what: str,
        expected: str,
        code: str,
        convert: Callable[[str], NumberT],
        minimum: float | None = None,
        maximum: float | None = None,
    ) -> NumberT | None:
        if not isinstance(node, Scalar) or node.empty:
            self.wrong_type(node, what, expected, Shape.VALUE)
            return None
        try:
            value = convert(node.text)
        except quantities.QuantityError as error:
            self.error(code, node, f"{what}: {error.message}", error.hint)
            return None
        return value if self.in_range(node, what, value, minimum, maximum) else None

    def in_range(
        self,
        node: Node,
        what: str,
        value: float,
        minimum: float | None,
        maximum: float | None,
        field_type: FieldType = FieldType.NUMBER,
    ) -> bool:
        """Return whether a number of a type is in a range; report it if not."""
        if (minimum is None or value >= minimum) and (maximum is None or value <= maximum):
            return True
        low, high = (
            None if one is None else _shown(one, field_type) for one in (minimum, maximum)
        )
        expected = f"{low} to {high}" if low and high else low and f"{low} or more"
        self.error(
            "out-of-range",
            node,
            f"{what} is {_shown(value, field_type)}, expected {expected or f'{high} or less'}",
        )
        return False

    def boolean(self, node: Node, what: str) -> bool | None:
        """Return true or false."""
        if not isinstance(node, Scalar) or node.empty:
            self.wrong_type(node, what, "true or false")
            return None
        value = boolean(node.text)
        if value is None:
            meant = {"yes": "true", "on": "true", "no": "false", "off": "false"}
            word = meant.get(node.text.lower()) or nearest(node.text, ("true", "false"))
            self.error(
                "wrong-type",
                node,
                f"{what}: expected true or false, found {quote(node.text)}",
                f"write {word or 'true or false'}",
            )
        return value

    def choice(self, node: Node, what: str, words: Collection[str]) -> str | None:
        """Return one of some words."""
        text = self.text(node, what)
        if text is None or text in words:
            return text
        near = nearest(text, words) or (next(iter(words)) if len(words) == 1 else None)
        self.error(
            "bad-choice",
            node,
            f"{what} is {quote(text)}, expected {join_words([*words], 'or')}",
            f"did you mean '{near}'?" if near is not None else "",
        )
        return None

    def items(self, node: Node, what: str) -> tuple[Node, ...]:
        """Return the items of a list; none if it is not a list."""
        if isinstance(node, Sequence):
            return node.items
        self.wrong_type(node, what, "a list", Shape.LIST)
        return ()

    def entries(self, node: Node, what: str, of: str) -> tuple[MappingEntry, ...]:
        """Return the entries of a mapping; none if it is not a mapping.

        The rest of a number that a comma cuts, as in {a: 2,5}, is reported and left out.
        """
        if isinstance(node, Mapping):
            found = []
            for before, entry in pairwise((None, *node.entries)):
                assert entry is not None
                hint = _comma_hint(before, entry)
                if hint and entry.key.text[:1].isdecimal():
                    message = f"{what}: {quote(entry.key.text)} has no value"
                    self.error("missing-value", entry.key, message, hint)
                else:
                    found.append(entry)
            return tuple(found)
        self.wrong_type(node, what, f"a mapping of {of}", Shape.MAPPING)
        return ()


@dataclass(eq=False)
class MappingReader:
    """Keys of one mapping, each readable as its expected type.

    Attributes:
        nodes: Value of each known key.
        keys: Every key as written in the file.
        table: Allowed values of its keys; None if callers state them each time.
    """

    _reading: TypedReader
    mapping: Mapping
    nodes: dict[str, Node]
    keys: dict[str, Scalar]
    table: KeyTable | None = None

    def get(self, key: str) -> Node | None:
        """Return the value of a key."""
        return self.nodes.get(key)

    def check_range(
        self,
        what: str,
        minimum: float | None,
        maximum: float | None,
        field_type: FieldType = FieldType.NUMBER,
    ) -> bool:
        """Return whether 'min' is below 'max', if both are known; note it if not."""
        if minimum is None or maximum is None or minimum < maximum:
            return True
        low, high = _shown(minimum, field_type), _shown(maximum, field_type)
        self._reading.error(
            "out-of-range",
            self.nodes["max"],
            f"'max' of {what} is {high}, which is not more than 'min', {low}",
            "make 'max' the larger one",
        )
        return False

    def text(self, key: str, default: str = "") -> str:
        """Return a text; ``default`` if it is missing or wrong."""
        return self.read(key, self._reading.text) or default

    def name(self, key: str) -> str | None:
        """Return an identifier."""
        return self.read(key, self._reading.name)

    def known(
        self, key: str, known: Collection[str], problem: str, otherwise: str = ""
    ) -> str | None:
        """Return one of some names; report another one as ``problem``, such as ``no input``.

        The hint ``otherwise`` is for a name that is similar to none.
        """
        name = self.text(key)
        if not name or name in known:
            return name or None
        hint = did_you_mean(name, known) or otherwise
        self._reading.error("unknown-name", self.nodes[key], f"{problem} {quote(name)}", hint)
        return None

    def integer(self, key: str) -> int | None:
        """Return an integer within the limits of the table."""
        return self.read(key, lambda n, w: self._reading.integer(n, w, *self._limits(key)))

    def number(
        self, key: str, minimum: float | None = None, maximum: float | None = None
    ) -> float | None:
        """Return a number; limits that are not given come from the table."""
        low, high = self._limits(key)
        low, high = low if minimum is None else minimum, high if maximum is None else maximum
        return self.read(key, lambda n, w: self._reading.number(n, w, low, high))

    def duration(self, key: str) -> float | None:
        """Return a time [s]."""
        return self.read(key, lambda n, w: self._reading.amount(n, w, FieldType.DURATION))

    def boolean(self, key: str) -> bool | None:
        """Return true or false."""
        return self.read(key, self._reading.boolean)

    def choice(self, key: str) -> str | None:
        """Return one of the words of the table."""
        declared = self._declared(key)
        words = declared.words if isinstance(declared, WordChoice) else ()
        return self.read(key, lambda n, w: self._reading.choice(n, w, words))

    def items(self, key: str) -> tuple[Node, ...]:
        """Return the items of a list; none if it is missing.

        An empty list is reported if the table refuses it.
        """
        items = self.read(key, self._reading.items) or ()
        declared = self._declared(key)
        if isinstance(declared, Items) and declared.empty:
            node = self.nodes.get(key)
            if isinstance(node, Sequence) and not items:
                self._reading.error("missing-value", node, declared.empty, declared.add)
        return items

    def entries(self, key: str, of: str = "") -> tuple[MappingEntry, ...]:
        """Return the entries of a mapping; none if it is missing.

        An empty mapping is reported if the table refuses it. The name of the entries also comes
        from the table unless it is given.
        """
        declared = self._declared(key)
        if not of and isinstance(declared, Entries):
            of = declared.of
        entries = self.read(key, lambda n, w: self._reading.entries(n, w, of)) or ()
        if isinstance(declared, Entries) and declared.empty:
            node = self.nodes.get(key)
            if isinstance(node, Mapping) and not entries:
                self._reading.error("missing-value", node, declared.empty, declared.add)
        return entries

    def limits_for(
        self, key: str, parameter: SceneParameter
    ) -> tuple[float, float] | tuple[None, None]:
        """Return the smallest and largest allowed number of a key for a scene parameter."""
        declared = self._declared(key)
        if not isinstance(declared, SceneValues):
            return None, None
        if declared.limits is None:
            return parameter.minimum, parameter.maximum
        return declared.limits(parameter)

    def _declared(self, key: str) -> Value | None:
        return None if self.table is None else self.table.values.get(key)

    def _limits(self, key: str) -> tuple[float | None, float | None]:
        declared = self._declared(key)
        if not isinstance(declared, Single):
            return None, None
        return declared.minimum, declared.maximum

    def read(self, key: str, read: Callable[[Node, str], T | None]) -> T | None:
        """Return the result of a function for a value and its name in messages."""
        node = self.nodes.get(key)
        return None if node is None else read(node, f"'{key}'")


def _shown(value: float, field_type: FieldType) -> str:
    # Use more digits than rounding for people would keep.
    return quantities.format_quantity(value, field_type, digits=6)


def readable(values: Iterable[T | None]) -> tuple[T, ...]:
    """Return what could be read, without the None for each wrong value."""
    return tuple(value for value in values if value is not None)


def adding(keys: Iterable[str]) -> str:
    """Return a hint that names every missing key."""
    lines = (f"'{key}: {FORMAT if key == 'format' else '…'}'" for key in keys)
    return "add " + " and ".join(lines)


def found(node: Node) -> str:
    """Return the kind of a node in words for a message."""
    match node:
        case Sequence():
            return "a list"
        case Mapping():
            return "a mapping"
        case Scalar():
            return "nothing" if node.empty else quote(node.text)


def _as_mapping(text: str) -> str:
    """Return how to write ``x = 3`` or ``x += 1`` here; empty for any other text."""
    pair = _PAIR.fullmatch(text)
    if pair is None:
        return ""
    name, sign, value = pair.groups()
    value = f"${{{name} {sign} {value}}}" if sign else value
    return f"write {{{name}: {as_scalar(ellipsize(value))}}}"


def _other_file(root: Node, known: Collection[str]) -> tuple[MappingEntry, str, str] | None:
    """Return the key that reveals another kind of file, that kind, and a hint; or None."""
    if not isinstance(root, Mapping) or any(e.key.text in known for e in root.entries):
        return None
    for entry in root.entries:
        if entry.key.text in _FILES:
            return entry, *_FILES[entry.key.text]
    return None


def name_meant(text: str) -> str:
    """Return a text in the form of an identifier: ``SetLight`` → ``set_light``."""
    plain = unicodedata.normalize("NFKD", _HUMP.sub("_", text.strip()))
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    return re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_")


def _without_value(entry: MappingEntry) -> bool:
    start, end = entry.value.span
    return isinstance(entry.value, Scalar) and entry.value.plain and start == end


def _as_quantity(entry: MappingEntry) -> str:
    """Return a hint for a unit that is written as a key, as in {minutes: 5}; empty for others."""
    amount = entry.value.text if isinstance(entry.value, Scalar) else ""
    found = quantities.quantity_type(f"{amount} {entry.key.text}", strict=False)
    if found and entry.key.text == "m":
        return f"write {amount} min for minutes, or {amount} m for metres"
    return f"write {amount} {DIMENSIONS[found].meant(entry.key.text)}" if found else ""


def _comma_hint(before: MappingEntry | None, entry: MappingEntry) -> str:
    """Return a hint for an entry that seems to be the rest of the value before; else empty.

    It is in {a: 2,5} and {a: b, c}.
    """
    if (
        before is None
        or not _without_value(entry)
        or ":" in entry.key.source.text[entry.key.end :][:1]
    ):
        return ""
    value, rest = before.value, entry.key.text
    between = entry.key.source.text[value.end : entry.key.start]
    if not isinstance(value, Scalar) or not value.plain or value.empty or between.strip() != ",":
        return ""
    if between == "," and rest[:1].isdecimal() and value.text.lstrip("+-").isdecimal():
        return f"use a point: {value.text}.{ellipsize(rest)}"
    return f"a comma ends a text: put the whole text after '{before.key.text}:' in quotes"


def _left_empty(above: MappingEntry | None, known: Collection[str]) -> str | None:
    """Return the key of the entry directly above another if it is known and has no value."""
    if above is None or above.key.text not in known or not _without_value(above):
        return None
    return above.key.text


def _place_of(traceback: TracebackType | None) -> Position | None:
    """Return the place in the file where the innermost function with a place was working."""
    for frame, _ in reversed(list(walk_tb(traceback))):
        for value in frame.f_locals.values():
            if isinstance(value, Scalar | Sequence | Mapping):
                return value.position
            if isinstance(value, MappingEntry):
                return value.key.position
    return None
