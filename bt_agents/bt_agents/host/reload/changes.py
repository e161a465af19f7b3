# SPDX-License-Identifier: Apache-2.0
"""Difference between two good versions of an agent as text, and whether it affects the tree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from bt_agents_core.scene import SceneSpace
from bt_agents_core.text import ellipsize
from bt_agents_language.expression.quantities import format_quantity
from bt_agents_language.files.agent_file import AgentFile
from bt_agents_language.model.specs import AgentSpec, Tunable
from bt_agents_language.tree.tree_fingerprint import difference

_LONGEST = 300
_DIGITS = 6


def changes_tree(before: AgentFile, after: AgentFile) -> bool:
    """Return whether the tree, its clean-up or its names differ; a running tree cannot change."""
    return before.prints != after.prints or _types(before.agent) != _types(after.agent)


def change_text(before: AgentFile, after: AgentFile, space: SceneSpace) -> str:
    """Return the difference between two good versions for people; never empty."""
    old, new = before.agent, after.agent
    assert old is not None
    assert new is not None
    tree = difference(before.prints[0], after.prints[0])
    clean_up = difference(before.prints[1], after.prints[1])
    parts = [f"tree changed: {tree}"] if tree else []
    parts += [f"on_cancel changed: {clean_up}"] if clean_up else []
    parts += _tunables(old, new)
    if old.learning_rate != new.learning_rate:
        parts.append(f"learning_rate: {old.learning_rate:g} → {new.learning_rate:g}")
    parts += [
        f"profile {name}: {was:g} → {now:g}"
        for name, was, now in zip(space.profiles.names, old.profile, new.profile, strict=True)
        if was != now
    ]
    parts += [f"{key} changed" for key, was, now in _others(old, new) if was != now]
    if not parts:
        same = before.text == after.text
        parts = ["only places in files differ" if same else "only comments or layout changed"]
    return ellipsize("; ".join(parts), _LONGEST)


def _types(spec: AgentSpec | None) -> dict[str, object]:
    assert spec is not None
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
        ("on_cancel_within", old.clean_up_s, new.clean_up_s),
        ("skills that the robot offers", old.unoffered, new.unoffered),
    )
