# SPDX-License-Identifier: Apache-2.0
"""Text of an XML document, as all security files are written."""

from __future__ import annotations

from xml.etree import ElementTree as Xml


def xml_text(root: Xml.Element) -> str:
    """Return a document with its declaration, indented."""
    Xml.indent(root)
    body = Xml.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'
