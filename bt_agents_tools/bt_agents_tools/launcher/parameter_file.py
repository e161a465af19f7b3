# SPDX-License-Identifier: Apache-2.0
"""ROS parameter file of a system, and which of its parameters no node has."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.text import ellipsize, printable_line, quote

UnknownByNode = Mapping[str, Mapping[str, str] | None]
"""Full name of a node → each parameter that it was given and does not have → the nearest one.

The nearest is empty for none. A node that has not declared its parameters yet has None.
"""

MOST_NAMED = 10
"""Most unknown parameters of a file that are named one by one."""

_MAX_BYTES = 1_000_000
_VALUES = "ros__parameters"
_MAX_NESTED = 16


@dataclass(frozen=True, kw_only=True)
class ParameterFile:
    """A ROS parameter file that nodes can read.

    Attributes:
        sections: Names of nodes, without the first slash and perhaps with wildcards, and their
            parameters.
    """

    path: Path
    sections: Sequence[tuple[str, Sequence[str]]]


def read_parameters(path: Path) -> ParameterFile:
    """Return a parameter file.

    Raises:
        BtAgentsError: It is too large, not YAML, has an alias, or does not have the form that ROS
            expects.
    """
    try:
        with path.open("rb") as file:
            text = file.read(_MAX_BYTES + 1)
        if len(text) > _MAX_BYTES:
            raise BtAgentsError(f"{path.name} is larger than {_MAX_BYTES:,} bytes")
        events = yaml.parse(text, Loader=yaml.CSafeLoader)
        if any(isinstance(one, yaml.AliasEvent) for one in events):
            raise BtAgentsError(f"{path.name}: it has an alias such as '*name', which ROS refuses")
        document = yaml.load(text, Loader=yaml.CSafeLoader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f", line {mark.line + 1}" if mark is not None else ""
        raise BtAgentsError(
            f"{path.name}{place}: it is not YAML, expected a ROS parameter file"
        ) from None
    return ParameterFile(path=path, sections=list(_sections(path, document)))


def unknown_in(file: ParameterFile, unknown: UnknownByNode) -> dict[str, str]:
    """Return the parameters of a file that no node of their section has.

    Args:
        file: The file.
        unknown: What all nodes reported; all of them are in one namespace.

    Returns:
        Section and parameter → a sentence, for the first :data:`MOST_NAMED`; the last one counts
        the others.
    """
    file_name = file.path.name
    found: dict[str, str] = {}
    others = 0
    for section, names in file.sections:
        base = section.rpartition("/")[2]
        is_for_all = "*" in base
        reports = [
            report
            for node, report in unknown.items()
            if is_for_all or node.rpartition("/")[2] == base
        ]
        for name in names:
            near = [report.get(name) for report in reports if report is not None]
            if not near or len(near) < len(reports) or None in near:
                continue
            if len(found) == MOST_NAMED:
                others += 1
                continue
            meant = difflib.get_close_matches(name, [one for one in near if one], n=1)
            found[f"{section} {name}"] = (
                f"{file_name}: {'no node here has a' if is_for_all else f'{base} has no'} "
                f"parameter {quote(ellipsize(printable_line(name)))}, so its value counts for "
                "nothing" + (f"; did you mean '{meant[0]}'?" if meant else "")
            )
    if others:
        text = f"{others} more such parameters; the logs of the nodes name them"
        found["others"] = f"{file_name}: {text}"
    return found


def _sections(
    path: Path, document: object, name: str = "", depth: int = 0
) -> Iterator[tuple[str, Sequence[str]]]:
    """Yield the sections of a document.

    Raises:
        BtAgentsError: A name contains neither ``ros__parameters`` nor another name.
    """
    if not isinstance(document, Mapping) or not document or depth > _MAX_NESTED:
        place = f"below {quote(printable_line(name.rpartition('/')[2]))}" if name else "in it"
        raise BtAgentsError(
            f"{path.name}: there is no '{_VALUES}' {place}, expected a ROS parameter file such as "
            f"'marketplace: {{{_VALUES}: {{bid_deadline: 3.0}}}}'"
        )
    if _VALUES in document:
        yield name, list(_parameters(document[_VALUES]))
        return
    for key, value in document.items():
        yield from _sections(path, value, f"{name}/{key}".strip("/"), depth + 1)


def _parameters(values: Any, prefix: str = "", depth: int = 0) -> Iterator[str]:
    """Yield the name of each parameter; nested ones have names with points."""
    if isinstance(values, Mapping) and depth <= _MAX_NESTED:
        for key, value in values.items():
            if isinstance(value, Mapping):
                yield from _parameters(value, f"{prefix}{key}.", depth + 1)
            else:
                yield f"{prefix}{key}"
