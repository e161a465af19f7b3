# SPDX-License-Identifier: Apache-2.0
"""Core schema of YAML 1.2: values of plain scalars, and texts as scalars."""

from __future__ import annotations

import json
import re

from bt_agents_core.field_types import FieldType, Plain
from bt_agents_language.expression import quantities
from bt_agents_language.yaml.yaml_reader import Node, Scalar

_BOOLEANS = {
    "true": True, "True": True, "TRUE": True,
    "false": False, "False": False, "FALSE": False,
}  # fmt: skip
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|(0|[1-9][0-9]*)(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_PLAIN = re.compile(r"(?!(?:null|Null|NULL)$)-?[A-Za-z0-9](?:[\w ./-]*[\w./-])?")
_OTHER_BASE = re.compile(r"0o[0-7]{1,20}|0x[0-9a-fA-F]{1,15}")


def boolean(text: str) -> bool | None:
    """Return the boolean for a word, None for any other word."""
    return _BOOLEANS.get(text)


def plain_value(scalar: Scalar) -> Plain:
    """Return the value of a scalar without any ``${…}``.

    ``yes``, ``on``, ``1:30``, ``010`` and dates are texts, unlike in YAML 1.1; ``5 s`` is a time,
    ``1.5 m`` a length and ``90 deg`` an angle, all in SI.

    Raises:
        QuantityError: It has the form of a number or quantity, but is not finite or too large.
    """
    text = scalar.text
    if not scalar.plain:
        return text
    if scalar.empty:
        return None
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    if _INTEGER.fullmatch(text):
        return quantities.integer(text)
    if _FLOAT.fullmatch(text) or _NOT_FINITE.fullmatch(text):
        return quantities.number(text)
    if _OTHER_BASE.fullmatch(text):
        return int(text, 0)
    quantity_type = quantities.quantity_type(text)
    return text if quantity_type is None else quantities.quantity(text, quantity_type)


def scalar_type(node: Node) -> FieldType:
    """Return the type of a value at a place for any type."""
    if not isinstance(node, Scalar):
        return FieldType.ANY
    if "${" in node.text:
        whole = node.text.startswith("${") and node.text.find("}") == len(node.text) - 1
        return FieldType.ANY if whole else FieldType.TEXT
    quantity = quantities.quantity_type(node.text) if node.plain else None
    if quantity is not None:
        return quantity
    try:
        value = plain_value(node)
    except quantities.QuantityError:
        return FieldType.ANY
    match value:
        case bool():
            return FieldType.BOOLEAN
        case int():
            return FieldType.INTEGER
        case float():
            return FieldType.NUMBER
        case str():
            return FieldType.TEXT
    return FieldType.ANY


def quoted(text: str) -> str:
    """Return a text in quotes, in one line: double ones unless they would need a backslash."""
    if text.isprintable():
        if '"' not in text and "\\" not in text:
            return f'"{text}"'
        if "'" not in text:
            return f"'{text}'"
    return json.dumps(text, ensure_ascii=False)


def as_scalar(text: str) -> str:
    """Return a text as a scalar: without quotes where it can mean nothing else."""
    return text if _PLAIN.fullmatch(text) else quoted(text)


def value_type(scalar: Scalar) -> type:
    """Return the type of a value at a place for any type; for an invalid number, an error's."""
    try:
        return type(plain_value(scalar))
    except quantities.QuantityError:
        return quantities.QuantityError
