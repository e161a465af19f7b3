# SPDX-License-Identifier: Apache-2.0
"""YAML nodes: nodes of our language made by an import, and their text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from bt_agents_language.nodes.catalogue import DECORATORS
from bt_agents_language.nodes.selector import SELECTOR
from bt_agents_language.nodes.sequence import SEQUENCE
from bt_agents_language.yaml.scalars import quoted


@dataclass(frozen=True)
class Raw:
    """Scalar without quotes if YAML allows it: a number, a time, a condition, ``${x}``."""

    text: str


_PLAIN = re.compile(r"[\w.(${+-](?:[^#:]|:(?! )|(?<! )#)*(?<![:\s])")
_NOT_PLAIN = re.compile(r"- |\{|\s#")
_WORDS = re.compile(r"[^\W\d][\w/-]*(?:[ .][\w/-]+)*")
_TRAPS = frozenset(
    ("true", "false", "null", "yes", "no", "on", "off", "y", "n", "nan", "inf", "infinity")
)
_ORDER = list(DECORATORS)
_SKIPPING = tuple(one.key for one in DECORATORS.values() if one.skips)
_HANDLERS = tuple(one.key for one in DECORATORS.values() if one.handler)


@dataclass(frozen=True, kw_only=True)
class YamlNode:
    """Node of our language.

    Attributes:
        value: Value of the key; for a composite, its options.
        name: Name for people; may be empty.
        siblings: Values of the sibling keys ``with``, ``outputs`` and ``weight``.
        comments: Comment lines above the node.
    """

    key: str
    value: Data = field(default_factory=dict)
    children: tuple[YamlNode, ...] = ()
    name: str = ""
    decorators: Mapping[str, Data] = field(default_factory=dict)
    siblings: Mapping[str, Data] = field(default_factory=dict)
    comments: tuple[str, ...] = ()

    def entries(self) -> dict[str, Data]:
        """Return the keys of the node in their usual order."""
        entries: dict[str, Data] = {"name": self.name} if self.name else {}
        if "weight" in self.siblings:
            entries["weight"] = self.siblings["weight"]
        ordered = {key: self.decorators[key] for key in _ORDER if key in self.decorators}
        handlers = {key: ordered.pop(key) for key in _HANDLERS if key in ordered}
        entries |= {**ordered, self.key: self._value()}
        entries |= {key: self.siblings[key] for key in ("with", "outputs") if key in self.siblings}
        return entries | handlers

    def _value(self) -> Data:
        if not self.children:
            return self.value
        children: list[Data] = list(self.children)
        if not isinstance(self.value, dict) or not self.value:
            return children
        options = dict(self.value)
        last = {"otherwise": options.pop("otherwise")} if "otherwise" in options else {}
        return {**options, "children": children, **last}


Data = Raw | str | bool | int | float | list["Data"] | dict[str, "Data"] | YamlNode
"""Value in a YAML file; a ``str`` is always a text."""


def sequence(*children: YamlNode) -> YamlNode:
    """Return a sequence with memory."""
    return YamlNode(key="sequence", children=children)


def selector(*children: YamlNode) -> YamlNode:
    """Return a selector with memory."""
    return YamlNode(key="selector", children=children)


def check(condition: Data) -> YamlNode:
    """Return a leaf that succeeds if a condition is true."""
    return YamlNode(key="check", value=condition)


def decorated(node: YamlNode, key: str, value: Data) -> YamlNode:
    """Return a node with one more decorator outside its others.

    If the order of decorators would put the new one inside another, or if two of them must not be
    combined, the node is put into its own sequence, and the decorator around that.
    """
    # Some decorators do not affect skipping, so decorators that skip stay outside of them.
    stays_outside = _SKIPPING if DECORATORS[key].unaffected else ()
    outer = {k: v for k, v in node.decorators.items() if k in stays_outside and k != key}
    inner = {k: v for k, v in node.decorators.items() if k not in outer}
    contrary = DECORATORS[key].contrary in inner
    if contrary or any(_ORDER.index(present) <= _ORDER.index(key) for present in inner):
        node, inner = sequence(replace(node, decorators=inner)), {}
    return replace(node, decorators={**outer, **inner, key: value})


def can_be_skipped(node: YamlNode) -> bool:
    """Return whether a decorator can skip a node, or each child of a sequence or selector."""
    if any(key in node.decorators for key in _SKIPPING):
        return True
    composite = node.key in (SEQUENCE.key, SELECTOR.key) and bool(node.children)
    return composite and all(map(can_be_skipped, node.children))


def with_comments(node: YamlNode, comments: Iterable[str]) -> YamlNode:
    """Return a node with more comment lines above it."""
    return replace(node, comments=(*comments, *node.comments))


def comment_lines(text: str) -> list[str]:
    """Return a text as lines of a comment."""
    return [f"# {line}".rstrip() for line in text.splitlines()]


def yaml_lines(data: Mapping[str, Data], indent: int = 0) -> list[str]:
    """Return the lines of a mapping in block style."""
    lines: list[str] = []
    for key, value in data.items():
        head = f"{' ' * indent}{scalar(key)}:"
        block = _block(value, indent + 2)
        if block:
            lines += [head, *_comments(value, indent + 2), *block]
        else:
            lines.append(f"{head} {scalar(value)}")
    return lines


def _block(value: Data, indent: int) -> list[str]:
    """Return the lines of a value in block style; none if it fits on one line after its key."""
    match value:
        case YamlNode():
            return yaml_lines(value.entries(), indent)
        case dict():
            return yaml_lines(value, indent)
        case list():
            return _list_lines(value, indent)
    return []


def _list_lines(items: list[Data], indent: int) -> list[str]:
    lines: list[str] = []
    for item in items:
        first, *rest = _block(item, indent + 2) or [f"{' ' * (indent + 2)}{scalar(item)}"]
        lines += [*_comments(item, indent), f"{' ' * indent}- {first[indent + 2 :]}", *rest]
    return lines


def _comments(value: Data, indent: int) -> list[str]:
    comments = value.comments if isinstance(value, YamlNode) else ()
    return [" " * indent + line for text in comments for line in comment_lines(text)]


def scalar(value: Data) -> str:
    """Return the text of a value that takes one line."""
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return repr(value)
        case str():
            is_plain = _WORDS.fullmatch(value) and value.lower() not in _TRAPS
            return value if is_plain else quoted(value)
        case Raw(text):
            return text if _PLAIN.fullmatch(text) and not _NOT_PLAIN.match(text) else quoted(text)
        case list():
            return "[]"
    return "{}"
