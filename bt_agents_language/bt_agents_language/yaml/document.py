# SPDX-License-Identifier: Apache-2.0
"""Document of a file, read in one pass that goes on behind syntax errors."""

from __future__ import annotations

from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.yaml.patched_source import PatchedSource, without_section
from bt_agents_language.yaml.precheck import looks_like_yaml
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Node, read_once

MAX_READ_AGAIN = 50_000
"""Characters that are read again after syntax errors; of a large file only the first are told."""

MAX_SLIPS = 20
"""After so many syntax errors reading ends: the file is something else than YAML."""


def read_document(source: Source, problems: Diagnostics) -> tuple[Source, Node | None]:
    """Return the one document of a file as far as it can be read; every problem is reported.

    Where a syntax error is a slip that can only mean one thing, reading goes on as if it was
    mended; where not, the other keys of the file are still looked through for syntax errors.

    Returns:
        The text that the document's spans are about, and the document without what was refused
        in it; None when nothing can be made of it.
    """
    if not looks_like_yaml(source, problems):
        return source, None
    whole = True
    left = MAX_READ_AGAIN
    for _ in range(MAX_SLIPS):
        root, slip = read_once(source, problems)
        if slip is None:
            return source, root if whole else None
        left -= len(source.text)
        if left < 0:
            break
        if slip.fix is not None:
            source = PatchedSource(source, slip.fix)
            continue
        whole = False
        rest = without_section(source, slip.index)
        if rest is None:
            break
        source = rest
    return source, None
