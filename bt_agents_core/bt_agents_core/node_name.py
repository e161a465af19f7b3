# SPDX-License-Identifier: Apache-2.0
"""Name of a node for people, with its current values."""

from __future__ import annotations

import re

_REFERENCE = re.compile(r'wait \$\{.*|\S+ (?P<text>".*\$\{.*")', re.DOTALL)
"""Name of a node that is named by a reference: ``wait ${patience}``, ``say "${words}"``."""


def filled_name(name: str, message: str) -> str:
    """Return a name whose reference is replaced by the message of the node: ``wait 8 s``.

    The message of a node that is named by a reference gives its current value; without a message,
    the name stays as the author wrote it.
    """
    reference = _REFERENCE.fullmatch(name)
    if reference is None or not message:
        return name
    quotes = '"' if reference["text"] else ""
    return f"{name.partition(' ')[0]} {quotes}{message}{quotes}"
