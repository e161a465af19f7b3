# SPDX-License-Identifier: Apache-2.0
"""Search for a person by name in texts."""

from __future__ import annotations

import json
import re


class PersonMention:
    """Pattern for the name of a person, as a word of a text or as the whole text.

    A name without letters, such as the number of a tracker, looks like any other number; within a
    text it counts only after ``person/``.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        forms = {name, json.dumps(name)[1:-1], json.dumps(name, ensure_ascii=False)[1:-1]}
        self._forms = tuple(form.encode() for form in forms)
        either = "|".join(re.escape(form) for form in sorted(forms))
        has_letter = any(character.isalpha() for character in name)
        before = r"(?<!\w)" if has_letter else r"(?:\A|\bperson/)"
        after = r"(?!\w)" if has_letter else r"(?:\Z|(?<=/" + re.escape(name) + r")(?!\w))"
        self._pattern = re.compile(f"{before}(?:{either}){after}")

    def may_be_in(self, data: bytes) -> bool:
        """Return whether the name may occur in serialized data; False is certain."""
        return any(form in data for form in self._forms)

    def is_in(self, text: str) -> bool:
        """Return whether a text mentions the person."""
        return self._pattern.search(text) is not None
