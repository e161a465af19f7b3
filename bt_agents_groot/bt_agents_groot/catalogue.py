# SPDX-License-Identifier: Apache-2.0
"""Catalogue of the built-in nodes of BehaviorTree.CPP v4 and their equivalents in our language."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum


class PortKind(Enum):
    """Kind of value that a port of a built-in node takes; the value is text for messages."""

    TEXT = "a text"
    SCRIPT = "a script"
    COUNT = "a whole number above 0, or -1 for without end"
    THRESHOLD = "a whole number; below 0 it counts from the number of children"
    MILLISECONDS = "a whole number of milliseconds"
    BOOLEAN = "true or false"
    STATUS = "SUCCESS, FAILURE, RUNNING or SKIPPED"


Limits = tuple[int, int | None]
"""Smallest and largest number of children; None is any number."""


@dataclass(frozen=True, kw_only=True)
class Builtin:
    """Built-in node.

    Attributes:
        id: Name of its element.
        ours: Equivalent in our language; empty when there is none.
        ports: Port → kind of its value.
        required: Ports that must be given.
        children: How many it has.
        note: Difference between the two; empty when they do the same.
    """

    id: str
    ours: str
    ports: Mapping[str, PortKind] = field(default_factory=dict)
    required: tuple[str, ...] = ()
    children: Limits = (0, 0)
    note: str = ""


_ONE: Limits = (1, 1)
_SOME: Limits = (1, None)


_ASYNC = "ours does not wait for the next tick between its children"


def _switch(cases: int) -> Builtin:
    keys = [f"case_{number}" for number in range(1, cases + 1)]
    return Builtin(
        id=f"Switch{cases}",
        ours="`choose` with `otherwise`",
        ports=dict.fromkeys(["variable", *keys], PortKind.TEXT),
        required=("variable", *keys),
        children=(cases + 1, cases + 1),
        note="ours stays with its case until that ends; Groot's looks again at every tick",
    )


BUILTINS: Mapping[str, Builtin] = {
    one.id: one
    for one in (
        Builtin(id="Sequence", ours="`sequence`", children=_SOME),
        Builtin(id="AsyncSequence", ours="`sequence`", children=_SOME, note=_ASYNC),
        Builtin(id="ReactiveSequence", ours="`sequence` with `memory: false`", children=_SOME),
        Builtin(
            id="SequenceWithMemory",
            ours="`sequence`",
            children=_SOME,
            note="after a failure ours starts over at the first child; this one goes on at the "
            "child that failed",
        ),
        Builtin(id="Fallback", ours="`selector`", children=_SOME),
        Builtin(id="AsyncFallback", ours="`selector`", children=_SOME, note=_ASYNC),
        Builtin(id="ReactiveFallback", ours="`selector` with `memory: false`", children=_SOME),
        Builtin(
            id="Parallel",
            ours="`parallel` with `succeed_on`",
            ports={"success_count": PortKind.THRESHOLD, "failure_count": PortKind.THRESHOLD},
            children=_SOME,
            note="ours does every child at a tick before it decides, and fails when so many can "
            "no longer succeed, whatever `failure_count` is",
        ),
        Builtin(
            id="ParallelAll",
            ours="`parallel`",
            ports={"max_failures": PortKind.THRESHOLD},
            children=_SOME,
            note="ours stops the other children as soon as one has failed",
        ),
        Builtin(id="IfThenElse", ours="`choose` with `otherwise`", children=(2, 3)),
        Builtin(id="WhileDoElse", ours="`while`, two of them in a `selector`", children=(2, 3)),
        *(_switch(cases) for cases in range(2, 7)),
        Builtin(
            id="TryCatch",
            ours="`sequence` with `on_failure`",
            ports={"catch_on_halt": PortKind.BOOLEAN},
            children=(2, None),
        ),
        Builtin(id="Inverter", ours="`invert`", children=_ONE),
        Builtin(id="ForceSuccess", ours="`succeed`", children=_ONE),
        Builtin(id="ForceFailure", ours="`fail`", children=_ONE),
        Builtin(
            id="Repeat",
            ours="`repeat`",
            ports={"num_cycles": PortKind.COUNT},
            required=("num_cycles",),
            children=_ONE,
        ),
        Builtin(
            id="RetryUntilSuccessful",
            ours="`retry`",
            ports={"num_attempts": PortKind.COUNT},
            required=("num_attempts",),
            children=_ONE,
        ),
        Builtin(id="KeepRunningUntilFailure", ours="`repeat: forever`", children=_ONE),
        Builtin(
            id="Timeout",
            ours="`timeout`",
            ports={"msec": PortKind.MILLISECONDS},
            required=("msec",),
            children=_ONE,
        ),
        Builtin(
            id="Delay",
            ours="`sequence` of `wait` and the node",
            ports={"delay_msec": PortKind.MILLISECONDS},
            required=("delay_msec",),
            children=_ONE,
        ),
        Builtin(
            id="RunOnce",
            ours="`once`",
            ports={"then_skip": PortKind.BOOLEAN},
            children=_ONE,
            note="with `then_skip` false it ends again as at first; ours is always left out",
        ),
        Builtin(
            id="Precondition",
            ours="`when`, `check` or `wait_for`, by what `else` says",
            ports={"if": PortKind.SCRIPT, "else": PortKind.STATUS},
            required=("if",),
            children=_ONE,
        ),
        Builtin(
            id="Sleep",
            ours="`wait`",
            ports={"msec": PortKind.MILLISECONDS},
            required=("msec",),
        ),
        Builtin(
            id="Script",
            ours="`set`",
            ports={"code": PortKind.SCRIPT},
            required=("code",),
        ),
        Builtin(
            id="ScriptCondition",
            ours="`check`",
            ports={"code": PortKind.SCRIPT},
            required=("code",),
        ),
        Builtin(
            id="SetBlackboard",
            ours="`set`",
            ports={"value": PortKind.TEXT, "output_key": PortKind.TEXT},
            required=("value", "output_key"),
        ),
        Builtin(id="AlwaysSuccess", ours="`check: true`"),
        Builtin(id="AlwaysFailure", ours="`check: false`"),
        Builtin(
            id="UnsetBlackboard", ours="", ports={"key": PortKind.TEXT}, required=("key",)
        ),
        *(
            Builtin(
                id=f"Loop{word}",
                ours="",
                ports={
                    "queue": PortKind.TEXT,
                    "if_empty": PortKind.STATUS,
                    "value": PortKind.TEXT,
                },
                children=_ONE,
            )
            for word in ("Int", "Bool", "Double", "String")
        ),
        Builtin(
            id="WasEntryUpdated", ours="", ports={"entry": PortKind.TEXT}, required=("entry",)
        ),
        *(
            Builtin(
                id=name, ours="", ports={"entry": PortKind.TEXT}, required=("entry",),
                children=_ONE,
            )
            for name in ("SkipUnlessUpdated", "WaitValueUpdate")
        ),
    )
}  # fmt: skip
"""Nodes that every BehaviorTree.CPP 4 program knows, by id."""

EXPLICIT = ("Action", "Condition", "Control", "Decorator")
"""Elements of the explicit form, with the name of the node in ``ID``."""

SKIP_IF, FAILURE_IF, SUCCESS_IF, WHILE = "_skipIf", "_failureIf", "_successIf", "_while"
ON_SUCCESS, ON_FAILURE, ON_HALTED, POST = "_onSuccess", "_onFailure", "_onHalted", "_post"

CONDITIONS: Mapping[str, tuple[str, str]] = {
    SKIP_IF: ("`when`, negated", ""),
    FAILURE_IF: ("a `check` before the node", ""),
    SUCCESS_IF: ("a `selector` of `check` and the node", ""),
    WHILE: (
        "`when` and `while`",
        "a node that is stopped has failed here; Groot's counts as left out",
    ),
    ON_SUCCESS: ("`set` behind the node", ""),
    ON_FAILURE: ("`on_failure` with `set`", ""),
    POST: ("`set` behind the node and in `on_failure`", ""),
    ON_HALTED: ("", ""),
}
"""Attribute of any node → equivalent in our language (may be empty), and the difference."""

OTHER_ATTRIBUTES = ("ID", "name", "_autoremap", "_description", "_fullpath", "_uid", "_collapsed")
"""Attributes of any node without an effect on the tree, or that are read elsewhere."""

_HEAD = "| BehaviorTree.CPP | here | difference |\n|---|---|---|\n"
_TABLE = re.compile(re.escape(_HEAD) + r"(\|.*\n)*")


def with_table(page: str) -> str:
    """Return the documentation page about Groot2 with its table generated anew."""
    return _TABLE.sub(lambda _: groot_table(), page)


def groot_table() -> str:
    """Return the table of nodes and attributes of BehaviorTree.CPP with their equivalents."""
    rows = [(f"<{one.id}{_ports(one)}>", one.ours, one.note) for one in BUILTINS.values()]
    rows.append(('<SubTree ID="…">', "`subtree` with `with` and `outputs`", ""))
    rows += [(_with_value(name).strip(), *words) for name, words in CONDITIONS.items()]
    lines = (f"| `{theirs}` | {ours or 'nothing'} | {note} |\n" for theirs, ours, note in rows)
    return _HEAD + "".join(lines)


def _ports(one: Builtin) -> str:
    shown = "".join(map(_with_value, one.required[:2]))
    return f"{shown} …" if len(one.required) > 2 else shown


def _with_value(name: str) -> str:
    return f' {name}="…"'
