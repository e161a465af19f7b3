# SPDX-License-Identifier: Apache-2.0
"""The names that the nodes of an agent give values: keys of ``set`` and outputs of leaves."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

from bt_agents.language.drafts import Draft
from bt_agents.language.inputs import read_new_name
from bt_agents.language.scalars import scalar_type
from bt_agents.language.shape import FileReading
from bt_agents.language.specs import FieldType
from bt_agents.language.yaml_reader import Entry, Mapping, Scalar


def written_names(
    reading: FileReading, drafts: Iterable[Draft | None], tunables: Collection[str]
) -> dict[str, FieldType]:
    """Return every name that some node gives a value, with its type where all agree on one.

    A name that is reserved or that of a tunable is reported.
    """
    written: dict[str, FieldType] = {}
    nodes = (node for draft in drafts if draft is not None for node in draft.walk())
    for node in nodes:
        for name, place, field_type in _written_by(reading, node):
            if name in tunables:
                reading.error(
                    "name-taken",
                    place,
                    f"'{node.key.text}' gives '{name}' a value, but '{name}' is a tunable",
                    "rename the tunable",
                )
            same = written.get(name, field_type) is field_type
            written[name] = field_type if same else FieldType.ANY
    return written


def _written_by(reading: FileReading, node: Draft) -> Iterator[tuple[str, Scalar, FieldType]]:
    if node.skill is not None:
        for output in node.skill.outputs:
            yield output.name, node.key, output.type
        return
    entries: tuple[Entry, ...] = ()
    if isinstance(node.value, Mapping):
        if node.key.text == "set":
            entries = node.value.entries
        elif node.key.text in ("action", "service"):
            outputs = node.value.get("outputs")
            entries = outputs.entries if isinstance(outputs, Mapping) else ()
    for entry in entries:
        name = read_new_name(reading, entry.key, "a value")
        if name is not None:
            known = node.key.text == "set"
            yield name, entry.key, scalar_type(entry.value) if known else FieldType.ANY
