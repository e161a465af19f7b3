# SPDX-License-Identifier: Apache-2.0
"""XML files: parsing into elements that know their place, with limits; and writing."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import escape

from bt_agents_core.diagnostic import Position
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.yaml.precheck import BAD_CHARACTER
from bt_agents_language.yaml.source import MAX_BYTES, TOO_LARGE, Source

MAX_DEPTH = 64
"""Maximum nesting of elements."""

MAX_ELEMENTS = 10_000
"""Maximum number of elements in a file."""

MAX_TEXT = 20_000
"""Maximum length of an attribute in characters."""

_ATTRIBUTE = re.compile(r"""([^\s=<>"'/]+)\s*=\s*("[^"]*"|'[^']*')""")
_PROLOGUE = re.compile(r"\A[^<]*(?:<\?xml\b[^<>]*\?>|(?=<))")
_ENTITY = r"&(?:#[0-9]+|#x[0-9a-fA-F]+|amp|lt|gt|quot|apos);"
_WRITTEN_CHARACTER = re.compile(rf"{_ENTITY}|\r\n|.", re.DOTALL)
_VALUE = re.compile(
    r"""<!--.*?-->|<!\[CDATA\[.*?\]\]>|=\s*(?P<value>"[^"]*"|'[^']*')""", re.DOTALL
)
_BARE = re.compile(rf"(?!{_ENTITY})[&<]")
_STAND_INS = str.maketrans("&<", "\ue000\ue001")
_MEANT = str.maketrans("\ue000\ue001", "&<")
_ESCAPE_HINT = "write &lt; for '<', &amp; for '&' and &quot; for '\"' inside an attribute"
_ESCAPES = {'"': "&quot;", "\n": "&#10;", "\t": "&#9;", "\r": "&#13;"}


@dataclass(frozen=True, kw_only=True, slots=True)
class Attribute:
    """Attribute with its place.

    Attributes:
        value: Its value with resolved escapes.
        position: Position of the first character of its name.
        span: Index of the first character of its value in the file's text, and of the one after
            its last, without quotation marks.
    """

    name: str
    value: str
    position: Position
    span: tuple[int, int]


@dataclass(frozen=True, kw_only=True, slots=True)
class Element:
    """XML element.

    Attributes:
        position: Position of its ``<``.
        end: Position after its name.
        attributes: Attributes by name, in the order of the file.
        text: Text directly inside it, without surrounding spaces.
    """

    tag: str
    position: Position
    end: Position
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    children: tuple[Element, ...] = ()
    text: str = ""

    def get(self, name: str, default: str = "") -> str:
        """Return the value of an attribute."""
        attribute = self.attributes.get(name)
        return default if attribute is None else attribute.value


class XmlReading:
    """XML file with its root element and the problems so far.

    Attributes:
        root: Root element; None if the file cannot be parsed, which is one of the problems.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.problems = Diagnostics(source)
        self.root = _Parser(source, self.problems).root()

    def error(self, code: str, where: Element | Attribute, message: str, hint: str = "") -> None:
        """Add a problem about an element (its name is marked) or about a whole attribute."""
        end = where.end if isinstance(where, Element) else self.source.position(where.span[1] + 1)
        self.problems.add(code, where.position, message, hint, end)

    def error_in(
        self, code: str, attribute: Attribute, offset: int, message: str, hint: str = ""
    ) -> None:
        """Add a problem about the character at ``offset`` in the value of an attribute."""
        start, end = attribute.span
        index = start
        for _ in range(offset):
            written = _WRITTEN_CHARACTER.match(self.source.text, index, end)
            if written is None:
                break
            index = written.end()
        self.problems.add(code, self.source.position(index), message, hint)


class _Refused(Exception):
    """Raised to end the parsing; the reason is one of the problems."""


@dataclass
class _Open:
    """Element whose end tag has not been parsed yet."""

    tag: str
    index: int
    attributes: dict[str, Attribute]
    children: list[Element]
    text: list[str]


class _Parser:
    """Builder of elements from the events of expat, without recursion."""

    def __init__(self, source: Source, problems: Diagnostics) -> None:
        self._source = source
        self._problems = problems
        self._data = _with_stand_ins(source.text).encode("utf-8", "replace")
        # Expat counts bytes, only forwards: the part before this index is not decoded again.
        self._counted = (0, 0)
        self._open: list[_Open] = []
        self._count = 0
        self._root: Element | None = None
        # The text is already decoded, whatever encoding the file declares.
        self._expat = expat.ParserCreate(encoding="utf-8")
        self._expat.ordered_attributes = True
        self._expat.StartDoctypeDeclHandler = self._doctype
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = self._end
        self._expat.CharacterDataHandler = self._text

    def root(self) -> Element | None:
        """Return the root element; None if there is none, which is one of the problems."""
        if len(self._data) > MAX_BYTES:
            self._problems.add("too-large", self._source.position(0), *TOO_LARGE)
            return None
        if not self._source.text.strip():
            self._problems.add(
                "empty-file",
                self._source.position(0),
                "nothing is written here",
                "save the trees from Groot2 once more",
            )
            return None
        try:
            self._expat.Parse(self._data, True)
        except expat.ExpatError as error:
            self._report_syntax(error)
            return None
        except _Refused:
            return None
        return self._root

    def _index(self, byte: int) -> int:
        """Return the index in the text for an offset in bytes."""
        from_byte, from_index = self._counted
        index = from_index + len(self._data[from_byte:byte].decode("utf-8", "replace"))
        self._counted = (byte, index)
        return index

    def _refuse(self, code: str, index: int, message: str, hint: str) -> None:
        self._problems.add(code, self._source.position(index), message, hint)
        raise _Refused

    def _doctype(self, name: str, *_: object) -> None:
        index = self._index(self._expat.CurrentByteIndex)
        self._refuse(
            "xml-doctype",
            max(self._source.text.rfind("<!DOCTYPE", 0, index + len("<!DOCTYPE")), 0),
            "the file declares a document type, and with it possibly entities or other files",
            "remove <!DOCTYPE …>; files of Groot2 have none",
        )

    def _start(self, tag: str, pairs: list[str]) -> None:
        index = self._index(self._expat.CurrentByteIndex)
        self._count += 1
        if self._count > MAX_ELEMENTS:
            self._refuse(
                "too-many-values",
                index,
                f"the file holds more than {MAX_ELEMENTS:,} elements",
                "split it over several files",
            )
        if len(self._open) >= MAX_DEPTH:
            self._refuse(
                "too-deep",
                index,
                f"elements are nested more than {MAX_DEPTH} deep",
                "move inner parts to a <BehaviorTree> of their own, and use them by <SubTree>",
            )
        attributes = self._attributes(index + 1 + len(tag), pairs)
        self._open.append(_Open(tag, index, attributes, [], []))

    def _attributes(self, index: int, pairs: list[str]) -> dict[str, Attribute]:
        attributes: dict[str, Attribute] = {}
        for name, parsed in zip(pairs[::2], pairs[1::2], strict=True):
            value = parsed.translate(_MEANT)
            written = _ATTRIBUTE.search(self._source.text, index)
            assert written is not None
            index = written.end()
            start = written.start(2) + 1
            if len(value) > MAX_TEXT:
                self._refuse(
                    "too-long",
                    start,
                    f"one text has {len(value):,} characters, at most {MAX_TEXT:,} are possible",
                    "split it",
                )
            invalid = BAD_CHARACTER.search(value)
            if invalid is not None:
                self._problems.add(
                    "bad-character",
                    self._source.position(start),
                    f"the text holds an invisible character (U+{ord(invalid[0]):04X})",
                    "delete it; it may have come in by copying from another program",
                )
            attributes[name] = Attribute(
                name=name,
                value=value,
                position=self._source.position(written.start()),
                span=(start, written.end() - 1),
            )
        return attributes

    def _end(self, tag: str) -> None:
        opened = self._open.pop()
        element = Element(
            tag=tag,
            position=self._source.position(opened.index),
            end=self._source.position(opened.index + 1 + len(tag)),
            attributes=opened.attributes,
            children=tuple(opened.children),
            text=" ".join("".join(opened.text).split()),
        )
        if self._open:
            self._open[-1].children.append(element)
        else:
            self._root = element

    def _text(self, text: str) -> None:
        self._open[-1].text.append(text)

    def _report_syntax(self, error: expat.ExpatError) -> None:
        index = self._index(max(self._expat.ErrorByteIndex, self._counted[0]))
        message, hint = self._explanation(expat.ErrorString(error.code) or "")
        self._problems.add("xml-syntax", self._source.position(index), message, hint)

    def _explanation(self, expat_message: str) -> tuple[str, str]:
        still_open = self._open[-1].tag if self._open else ""
        match expat_message:
            case "no element found":
                if not still_open:
                    return "there is no element in the file", 'start with <root BTCPP_format="4">'
                return f"the file ends, but <{still_open}> is still open", f"add </{still_open}>"
            case "mismatched tag":
                return (
                    f"something else is closed here, but <{still_open}> is the one that is open",
                    f"write </{still_open}>, or remove this end",
                )
            case "junk after document element":
                return "something follows the end of the root element", "remove it"
            case "duplicate attribute":
                return "this element has the same attribute twice", "remove one of them"
            case "undefined entity":
                return "a '&name;' stands here that XML does not know", _ESCAPE_HINT
            case "unclosed token" | "unclosed CDATA section":
                return "what starts here is not closed", "add the missing '>' or quotation mark"
        return f"this is not XML ({quote(expat_message)})", _ESCAPE_HINT


def _with_stand_ins(text: str) -> str:
    """Return a text in which other characters replace bare ``&`` and ``<`` inside attributes.

    XML forbids the two there, but BehaviorTree.CPP reads them. A ``<`` before a ``>`` is more
    likely the next element after a missing quotation mark. Text before the first element is
    blanked, because BehaviorTree.CPP skips it.
    """

    def replaced(match: re.Match[str]) -> str:
        value = match["value"]
        if value is None or not _BARE.search(value) or re.search("<[^>]*>", value):
            return match[0]
        bare = _BARE.sub(lambda one: one[0].translate(_STAND_INS), value)
        return match[0].removesuffix(value) + bare

    text = _PROLOGUE.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    if not _MEANT.keys().isdisjoint(map(ord, text)):
        return text
    return _VALUE.sub(replaced, text)


@dataclass(frozen=True)
class Xml:
    """XML element to write."""

    tag: str
    attributes: Mapping[str, str] = field(default_factory=dict)
    children: tuple[Xml, ...] = ()
    text: str = ""


def xml_text(root: Xml) -> str:
    """Return a file with one root element."""
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', *_lines(root, 0)]) + "\n"


def _lines(element: Xml, indent: int) -> list[str]:
    pad = " " * indent
    pairs = [f' {name}="{escape(value, _ESCAPES)}"' for name, value in element.attributes.items()]
    start = f"{pad}<{element.tag}{''.join(pairs)}"
    if element.text:
        return [f"{start}>{escape(element.text)}</{element.tag}>"]
    if not element.children:
        return [f"{start}/>"]
    inner = [line for child in element.children for line in _lines(child, indent + 2)]
    return [f"{start}>", *inner, f"{pad}</{element.tag}>"]
