# SPDX-License-Identifier: Apache-2.0
"""Naming rules of both languages, and conversions: ``SaySomething``, ``say_something``."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection

from bt_agents_language.fields.scope import RESERVED
from bt_agents_language.yaml.typed_reader import MAX_NAME

_BORDER = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_OURS = re.compile(rf"[a-z][a-z0-9_]{{0,{MAX_NAME - 1}}}")
_OTHER = re.compile(r"[^a-z0-9]+")
_OUT = "_out"


def snake(text: str) -> str:
    """Return a text as a name of our language: lower case letters, digits and ``_``.

    A text without suitable letters becomes ``x``.
    """
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = _OTHER.sub("_", _BORDER.sub("_", plain).lower()).strip("_")[:MAX_NAME].rstrip("_")
    if not name:
        return "x"
    return name if name[0].isalpha() else f"n{name}"[:MAX_NAME]


def pascal(name: str, taken: Collection[str]) -> str:
    """Return an ID for a name: ``say_something`` becomes ``SaySomething``.

    If the ID is taken or not reversible, the name itself is the ID.
    """
    capitalised = "".join(word.capitalize() for word in name.split("_"))
    if capitalised not in taken and snake(capitalised) == name:
        return capitalised
    while name in taken:
        name += "_tree"
    return name


def port(name: str) -> str:
    """Return the port name of a field; ``name`` has another meaning in BehaviorTree.CPP."""
    return f"{name}_" if re.fullmatch("name_*", name) else name


def output_name(name: str, inputs: Collection[str]) -> str:
    """Return the port name of an output, which differs from an input's."""
    return f"{name}{_OUT}" if name in inputs else name


def output_of(name: str, inputs: Collection[str]) -> str:
    """Return the output with a port name, given some inputs; the inverse of `output_name`."""
    own = name.removesuffix(_OUT)
    return own if own in inputs else name


def field_of(port_name: str) -> str:
    """Return the field name of a port, the inverse of :func:`port`.

    A port with the name of a word of expressions gets another name.
    """
    name = entry_of(port_name)
    name = name if _OURS.fullmatch(name) else snake(name)
    return f"{name}_value" if name in RESERVED else name


def entry_of(port_name: str) -> str:
    """Return the name of a port inside a subtree."""
    return port_name[:-1] if re.fullmatch("name_+", port_name) else port_name


class Renaming:
    """Injective mapping of names to valid names of our language."""

    def __init__(self) -> None:
        self._taken = set(RESERVED)
        self._given: dict[str, str] = {}

    def __call__(self, name: str) -> str:
        """Return the name in our language, always the same for the same name."""
        if name not in self._given:
            valid = name if _OURS.fullmatch(name) else snake(name)
            given = valid
            number = 2
            while given in self._taken:
                given = f"{valid[: MAX_NAME - 4]}_{number}"
                number += 1
            self._taken.add(given)
            self._given[name] = given
        return self._given[name]
