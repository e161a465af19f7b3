# SPDX-License-Identifier: Apache-2.0
"""Search for a person by name in texts."""

from __future__ import annotations

import json
import re
from unicodedata import normalize

from bt_agents_core.text import folded


class PersonMention:
    """Pattern for the name of a person, as a word of a text or as the whole text.

    Case and the encoding of accents do not matter.

    A name without letters, such as the number of a tracker, looks like any other number; within a
    text it counts only after ``person/``.
    """

    def __init__(self, name: str) -> None:
        self.name = name = normalize("NFC", name)
        cases = (name, name.lower(), name.upper(), name.title())
        escaped = {json.dumps(normalize(f, one))[1:-1] for one in cases for f in ("NFC", "NFD")}
        quoted = json.dumps(name, ensure_ascii=False)[1:-1]
        self._forms = {folded(form) for form in (name, quoted, repr(name)[1:-1], *escaped)}
        either = "|".join(re.escape(form) for form in sorted(self._forms))
        has_letter = any(character.isalpha() for character in name)
        before = r"(?<!\w)" if has_letter else r"(?:\A|\bperson/)"
        itself = re.escape(folded(name))
        after = r"(?!\w)" if has_letter else rf"(?:\Z|(?<=/{itself})(?!\w))"
        self._pattern = re.compile(f"{before}(?:{either}){after}")

    def may_be_in(self, data: bytes) -> bool:
        """Return whether the name may occur in serialized data; False is certain."""
        text = folded(data.decode(errors="ignore"))
        return any(form in text for form in self._forms)

    def is_in(self, text: str) -> bool:
        """Return whether a text mentions the person."""
        return self._pattern.search(folded(text)) is not None
