# SPDX-License-Identifier: Apache-2.0
"""Presets, values of tunables that are applied together: ``presets/care_home.yaml``."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from bt_agents_core.diagnostic import Diagnostic, Position
from bt_agents_core.text import quote
from bt_agents_language.diagnostics.collection import did_you_mean, warning
from bt_agents_language.files.tunable_reader import check_setting, read_setting
from bt_agents_language.model.specs import AgentSpec, Tunable
from bt_agents_language.yaml.field_tables import TEXT, Entries, FieldDecl, FileKind
from bt_agents_language.yaml.scalars import as_scalar
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import FORMAT, TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping as MappingNode
from bt_agents_language.yaml.yaml_reader import MappingEntry, Scalar

PRESETS_FOLDER = "presets"
"""Folder of a trees folder with a file for each preset."""

LEARNING_RATE = "learning_rate"
"""Key of the learning rate, next to the tunables of an agent."""

LONGEST_NAME = 60
"""Longest name of a preset in characters."""

PRESET = FileKind(
    name="preset",
    what="a preset",
    title="Preset",
    description="Values of tunables that are applied together.",
    fields=(
        FieldDecl("preset", TEXT, "Name of the preset, such as care home.", required=True),
        FieldDecl(
            "values",
            Entries(
                Entries(TEXT, "tunables and values", empty="there is no value"),
                "agents and their values",
                empty="there is no value",
            ),
            "Agent → tunable, or learning_rate → value, such as 12 s.",
            required=True,
        ),
    ),
)


@dataclass(frozen=True, kw_only=True)
class Preset:
    """Preset with its values.

    Attributes:
        name: Its name.
        values: Agent and tunable, as in ``attentive_guide.patience`` → value as it is written.
        positions: Place of each of these names in the file.
    """

    name: str
    values: Mapping[str, str]
    positions: Mapping[str, Position]


def read_preset(
    file: Path | Source,
    agents: Collection[AgentSpec] = (),
    taken: Mapping[str, Path] = MappingProxyType({}),
) -> Preset:
    """Return the preset of a file, or raise a ``ReadError`` with all problems.

    Args:
        file: The file.
        agents: Values of their tunables must be possible, as the host refuses the others.
        taken: Names of other presets, with their files.
    """
    tunables = {(one.name, its.name): its for one in agents for its in one.tunables}
    with TypedReader.of(file) as reading:
        fields = reading.file(PRESET)
        name = fields.text("preset")
        if name and (problem := name_problem(name)):
            reading.error("bad-name", fields.nodes["preset"], problem)
        elif name in taken:
            message = f"{taken[name]} holds the preset {quote(name)} already"
            reading.error("duplicate-preset", fields.nodes["preset"], message)
        values: dict[str, str] = {}
        positions: dict[str, Position] = {}
        for of_agent in fields.entries("values"):
            agent = reading.name(of_agent.key, "the name of an agent")
            what = f"the values of '{of_agent.key.text[:40]}'"
            entries = reading.entries(of_agent.value, what, "tunables and values")
            if isinstance(of_agent.value, MappingNode) and not entries:
                reading.error("missing-value", of_agent.value, f"{what}: there is no value")
            for entry in entries:
                tunable = reading.name(entry.key, "the name of a tunable")
                empty = isinstance(entry.value, Scalar) and not entry.value.plain
                text = reading.text(entry.value, f"'{entry.key.text[:40]}'", empty=empty)
                if agent is not None and tunable is not None and text is not None:
                    values[f"{agent}.{tunable}"] = text
                    positions[f"{agent}.{tunable}"] = entry.key.position
                    _check_value(reading, entry, tunables.get((agent, tunable)))
        reading.problems.raise_if_any()
        return Preset(name=name, values=values, positions=positions)


def _check_value(reading: TypedReader, entry: MappingEntry, tunable: Tunable | None) -> None:
    assert isinstance(entry.value, Scalar)
    what = f"'{entry.key.text[:40]}'"
    if tunable is not None:
        value = read_setting(reading, entry.value, what, tunable.type)
        check_setting(reading, entry.value, what, value, tunable)
    elif entry.key.text == LEARNING_RATE:
        reading.number(entry.value, what, 0.0, 1.0)


def name_problem(name: str) -> str:
    """Return why a preset cannot have this name; empty if it can."""
    sound = 0 < len(name) <= LONGEST_NAME and name.isprintable() and name == name.strip()
    if sound and _stem(name):
        return ""
    return (
        f"a preset cannot be called {quote(name)}; expected 1 to {LONGEST_NAME} visible "
        "characters in one line, with a letter or a digit"
    )


def preset_file(name: str) -> str:
    """Return the name of the file for a preset: ``care_home.yaml`` for ``Care home``."""
    return f"{_stem(name)}.yaml"


def _stem(name: str) -> str:
    # Neither '/' nor '.' is left, so the file cannot lie outside of its folder.
    return re.sub(r"[\W_]+", "_", name.casefold())[:LONGEST_NAME].strip("_")


def preset_text(name: str, values: Mapping[str, str]) -> str:
    """Return the text of a file with values by agent and tunable; :func:`read_preset` reads it."""
    lines = [f"format: {FORMAT}", f"preset: {as_scalar(name)}", "values:"]
    last = ""
    for key, value in sorted(values.items(), key=lambda item: item[0].partition(".")[0]):
        agent, _, tunable = key.partition(".")
        if agent != last:
            lines.append(f"  {agent}:")
        lines.append(f"    {tunable}: {as_scalar(value)}")
        last = agent
    return "\n".join(lines) + "\n"


def unknown_values(preset: Preset, agents: Collection[AgentSpec]) -> Iterator[Diagnostic]:
    """Yield a warning for each value of an agent or tunable that does not exist."""
    known = {one.name: [LEARNING_RATE, *(o.name for o in one.tunables)] for one in agents}
    for name, position in preset.positions.items():
        agent, _, tunable = name.partition(".")
        if agent not in known:
            message, hint = f"there is no agent '{agent}'", did_you_mean(agent, known)
        elif tunable not in known[agent]:
            message = f"agent '{agent}' has no tunable '{tunable}'"
            hint = did_you_mean(tunable, known[agent])
        else:
            continue
        passes = f"{message}; the preset passes over this value"
        yield warning("unknown-in-preset", position, len(tunable), passes, hint)
