# SPDX-License-Identifier: Apache-2.0
"""YAML as editors read it: the core schema of YAML 1.2, without the rules of a file kind."""

from __future__ import annotations

import re

from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Sequence, read_yaml

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS = {"": None, "~": None, "null": None, "true": True, "false": False}


def loaded(text: str) -> object:
    """Return the value of a document; mappings have text keys, as in JSON."""
    source = Source("text.yaml", text)
    node = read_yaml(source, Diagnostics(source))
    assert node is not None
    return _value(node)


def _value(node: Node) -> object:
    if isinstance(node, Mapping):
        return {entry.key.text: _value(entry.value) for entry in node.entries}
    if isinstance(node, Sequence):
        return [_value(item) for item in node.items]
    text = node.text
    if not node.plain:
        return text
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    if _INTEGER.fullmatch(text):
        return int(text)
    return float(text) if _FLOAT.fullmatch(text) else text
