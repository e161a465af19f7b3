# SPDX-License-Identifier: Apache-2.0
"""Difference between two good versions of an agent, as text, and whether it is in the tree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from bt_agents_core.scene import SceneSpace
from bt_agents_core.text import ellipsize
from bt_agents_language.expression.quantities import format_quantity
from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.model.specs import AgentSpec, Tunable
from bt_agents_language.tree.tree_fingerprint import difference

_LONGEST = 300
_DIGITS = 6


@dataclass(frozen=True, kw_only=True)
class AgentChange:
    """Difference between two versions.

    Attributes:
        text: Description for people; never empty.
        changes_tree: True when the tree, its clean-up or the names it uses differ, so that a
            running tree cannot take the change.
    """

    text: str
    changes_tree: bool


def compare(before: AgentFile, after: AgentFile, space: SceneSpace) -> AgentChange:
    """Return the difference between two good versions."""
    old, new = before.agent, after.agent
    assert old is not None
    assert new is not None
    tree = difference(before.prints[0], after.prints[0])
    clean_up = difference(before.prints[1], after.prints[1])
    typed = _types(old) != _types(new)
    parts = [f"tree changed: {tree}"] if tree else []
    parts += [f"on_cancel changed: {clean_up}"] if clean_up else []
    parts += _tunables(old, new)
    if old.learning_rate != new.learning_rate:
        parts.append(f"learning_rate: {old.learning_rate:g} → {new.learning_rate:g}")
    parts += [
        f"profile {name}: {was:g} → {now:g}"
        for name, was, now in zip(space.names, old.profile, new.profile, strict=True)
        if was != now
    ]
    parts += [f"{key} changed" for key, was, now in _others(old, new) if was != now]
    if not parts:
        same = before.text == after.text
        parts = ["only places in files differ" if same else "only comments or layout changed"]
    return AgentChange(
        text=ellipsize("; ".join(parts), _LONGEST), changes_tree=bool(tree or clean_up or typed)
    )


def _types(spec: AgentSpec) -> dict[str, object]:
    return {tunable.name: tunable.type for tunable in spec.tunables}


def _tunables(old: AgentSpec, new: AgentSpec) -> Iterator[str]:
    was = {tunable.name: tunable for tunable in old.tunables}
    now = {tunable.name: tunable for tunable in new.tunables}
    yield from (f"tunable {name} added" for name in now if name not in was)
    yield from (f"tunable {name} removed" for name in was if name not in now)
    for name in was.keys() & now.keys():
        before, after = was[name], now[name]
        if before.type is not after.type:
            yield f"{name} is a {after.type.value}, was a {before.type.value}"
        elif before.default != after.default:
            yield f"{name}: {_default_text(before)} → {_default_text(after)}"
        if _range(before) != _range(after):
            yield f"range of {name} changed"
        if before.description != after.description:
            yield f"description of {name} changed"


def _default_text(tunable: Tunable) -> str:
    value = tunable.default
    if isinstance(value, str | bool):
        return str(value).lower() if isinstance(value, bool) else f"'{value}'"
    return format_quantity(value, tunable.type, _DIGITS)


def _range(tunable: Tunable) -> tuple[float | None, float | None, float]:
    return tunable.minimum, tunable.maximum, tunable.step


def _others(old: AgentSpec, new: AgentSpec) -> Iterable[tuple[str, object, object]]:
    return (
        ("title", old.title, new.title),
        ("description", old.description, new.description),
        ("tags", old.tags, new.tags),
        ("requires", old.requires, new.requires),
        ("learning", old.learning, new.learning),
        ("weights", old.weights, new.weights),
        ("feedback rules", old.rules, new.rules),
        ("skills that the robot offers", old.unoffered, new.unoffered),
    )
