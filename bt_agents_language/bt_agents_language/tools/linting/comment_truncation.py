# SPDX-License-Identifier: Apache-2.0
"""Texts that a '#' cuts short, which YAML takes for the start of a comment."""

from __future__ import annotations

import re
from collections.abc import Iterator

from bt_agents_core.diagnostic import Diagnostic, Severity
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence, read_yaml

# A comment starts with a word; a number behind it, as in "gate #4", is part of what is said.
_NUMBER = re.compile(r"[ \t]+#\d\w*")
_SIGN = re.compile(r"[ \t]#\d")


def cut_texts(source: Source) -> tuple[Diagnostic, ...]:
    """Return a warning for each text of a file that was probably meant to go on."""
    if _SIGN.search(source.text) is None:
        return ()
    root = read_yaml(source, Diagnostics(source))
    if root is None:
        return ()
    return tuple(
        _warning(source, scalar, match)
        for scalar in _values(root)
        if scalar.plain
        and scalar.text
        and (match := _NUMBER.match(source.text, scalar.span[1])) is not None
    )


def _values(root: Node) -> Iterator[Scalar]:
    open_nodes: list[Node] = [root]
    while open_nodes:
        match open_nodes.pop():
            case Scalar() as scalar:
                yield scalar
            case Sequence(items=items):
                open_nodes += reversed(items)
            case Mapping(entries=entries):
                open_nodes += [entry.value for entry in reversed(entries)]


def _warning(source: Source, scalar: Scalar, match: re.Match[str]) -> Diagnostic:
    lost = match[0].strip()
    start = match.end() - len(lost)
    return Diagnostic(
        code="cut-text",
        position=source.position(start),
        end=source.position(match.end()),
        message=f"the text ends before '{lost[:20]}', because ' #' starts a comment",
        hint='put quotes around the whole text: "…"',
        severity=Severity.WARNING,
    )
