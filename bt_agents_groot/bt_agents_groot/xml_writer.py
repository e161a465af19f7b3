# SPDX-License-Identifier: Apache-2.0
"""Elements that are to be written, and their text as XML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from xml.sax.saxutils import escape

_ESCAPES = {'"': "&quot;", "\n": "&#10;", "\t": "&#9;", "\r": "&#13;"}


@dataclass(frozen=True, kw_only=True)
class Xml:
    """One element."""

    tag: str
    attributes: Mapping[str, str] = field(default_factory=dict)
    children: tuple[Xml, ...] = ()
    text: str = ""

    def having(self, **attributes: str) -> Xml:
        """Return the element with more attributes."""
        return replace(self, attributes={**self.attributes, **attributes})


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
