# SPDX-License-Identifier: Apache-2.0
"""Writes tuned values into an agent file as its new defaults, and leaves everything else."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from bt_agents.host.tuning.tunable import Setting, TunableKind, TunableParameter, tunables_of
from bt_agents_core.errors import ReadError, Refused
from bt_agents_core.scene import SceneSpace
from bt_agents_language.model.quantities import QuantityError
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.tools.formatting.scalar_style import quoted
from bt_agents_language.tools.formatting.span_edit import replace_value
from bt_agents_language.yaml.diagnostics import Diagnostics
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, read_yaml

_WITH_UNIT = re.compile(r"[-+.\deE]*\d\.?(\s*)([^\W\d_]+|°)")
_PROFILE_DIGITS = 6
_CLOSE = 1e-5


@dataclass(frozen=True, kw_only=True)
class TunedValue:
    """A value of a robot that differs from the file.

    Attributes:
        knob: With the default that the robot has from the file.
        value: In force on the robot.
    """

    knob: TunableParameter
    value: Setting


def write_defaults(
    source: Source,
    tuned: Sequence[TunedValue],
    space: SceneSpace,
    read: Callable[[str], AgentSpec],
) -> str:
    """Return the text of an agent file with tuned values as its defaults.

    Args:
        source: The file.
        tuned: What to write, all of this agent.
        space: The scene parameters.
        read: Reads the text of an agent file; may raise ``ReadError``.

    Raises:
        ReadError: The file is broken.
        Refused: ``UNKNOWN_PARAMETER``: the file has no such value; ``CHANGED``: its default is
            not what the robot has from it; ``CANNOT_WRITE``.
    """
    knobs = _knobs(read(source.text), space)
    for one in tuned:
        _check_same(source, one, knobs.get(one.knob.name))
    text = source.text
    for one in tuned:
        text = _with_value(Source(source.file, text), one, knobs[one.knob.name], space, read)
    return text


def _knobs(spec: AgentSpec, space: SceneSpace) -> dict[str, TunableParameter]:
    return {knob.name: knob for knob in tunables_of(spec, space)}


def _check_same(source: Source, tuned: TunedValue, here: TunableParameter | None) -> None:
    name = tuned.knob.name
    if here is None:
        raise Refused(
            "UNKNOWN_PARAMETER",
            f"{source.file} has no '{tuned.knob.key}' any more; nothing is written",
        )
    if here.default != tuned.knob.default:
        raise Refused(
            "CHANGED",
            f"{source.file} says {here.written(here.default)} for {name}, but the robot has read "
            f"{tuned.knob.written(tuned.knob.default)} there: the file has changed meanwhile; "
            "'bt-agents reload' brings the robot up to date",
        )


def _with_value(
    source: Source,
    tuned: TunedValue,
    knob: TunableParameter,
    space: SceneSpace,
    read: Callable[[str], AgentSpec],
) -> str:
    """Return a text with one default changed, the way that is most like the old one."""
    before = _knobs(read(source.text), space)
    for text in _texts(source, tuned.value, knob):
        try:
            after = _knobs(read(text), space)
        except ReadError:
            continue
        changed = after.pop(knob.name)
        others = {name: one for name, one in before.items() if name != knob.name}
        if changed.type is knob.type and _is(changed, tuned.value) and after == others:
            return text
    raise Refused(
        "CANNOT_WRITE",
        f"{source.file}: {knob.name} cannot be changed to {knob.written(tuned.value)} without "
        "changing anything else; write it yourself",
    )


def _is(knob: TunableParameter, value: Setting) -> bool:
    if knob.kind is TunableKind.PROFILE and isinstance(value, float):
        assert isinstance(knob.default, float)
        return math.isclose(knob.default, value, rel_tol=_CLOSE, abs_tol=_CLOSE)
    return knob.default == value


def _texts(source: Source, value: Setting, knob: TunableParameter) -> Iterator[str]:
    root = read_yaml(source, Diagnostics(None))
    node = _place(root, knob)
    if node is None:
        if knob.kind is TunableKind.LEARNING_RATE and isinstance(root, Mapping):
            yield from _with_learning_rate(source, root, value, knob)
        return
    for written in _writings(node.text, value, knob):
        try:
            yield replace_value(source, node, written)
        except ValueError:
            continue
    if isinstance(value, str):
        start, end = node.span
        yield f"{source.text[:start]}{quoted(value)}{source.text[end:]}"


def default_text(source: Source, knob: TunableParameter) -> str:
    """Return how a file writes the default of a knob; empty when it does not."""
    node = _place(read_yaml(source, Diagnostics(None)), knob)
    return node.text if node is not None else ""


def _place(root: Node | None, knob: TunableParameter) -> Scalar | None:
    """Return where the file says a default."""
    paths: tuple[tuple[str, ...], ...] = {
        TunableKind.TUNABLE: (("tunables", knob.key, "default"),),
        TunableKind.LEARNING_RATE: (("learning_rate",), ("learning", "rate")),
        TunableKind.PROFILE: (("profile", knob.key),),
    }.get(knob.kind, ())
    for path in paths:
        node = root
        for key in path:
            node = node.get(key) if isinstance(node, Mapping) else None
        if isinstance(node, Scalar):
            return node
    return None


def _writings(old: str, value: Setting, knob: TunableParameter) -> list[str]:
    """Return how a value may be written instead of another one, the most like it first."""
    if isinstance(value, bool | str | int):
        return [knob.written(value)]
    if knob.kind is TunableKind.PROFILE:
        return [f"{value:.{_PROFILE_DIGITS}g}"]
    if knob.unit:
        return [*_in_unit_of(old, value, knob), knob.written(value)]
    return [repr(value), knob.written(value)] if "." in old else [knob.written(value), repr(value)]


def _in_unit_of(old: str, value: float, knob: TunableParameter) -> Iterator[str]:
    """Return a quantity in the unit of another one, if that takes only a few digits."""
    match = _WITH_UNIT.fullmatch(old)
    space, unit = match.groups() if match else ("", "")
    try:
        one = knob.meant(f"1{unit}")
    except QuantityError:
        return
    assert isinstance(one, float)
    text = f"{value / one:.6g}{space}{unit}"
    if knob.meant(text) == value:
        yield text
    if unit and not space:
        yield knob.written(value).replace(" ", "")


def _with_learning_rate(
    source: Source, root: Mapping, value: Setting, knob: TunableParameter
) -> Iterator[str]:
    """Return the text with one line more, behind the profile."""
    profile = root.get("profile")
    line_end = source.text.find("\n", _end(source, profile)) if profile is not None else -1
    first = root.entries[0].key.position.column
    if line_end < 0 or first != 1:
        return
    ending = "\r\n" if source.text[line_end - 1] == "\r" else "\n"
    line = f"{knob.key}: {knob.written(value)}{ending}"
    yield f"{source.text[: line_end + 1]}{line}{source.text[line_end + 1 :]}"


def _end(source: Source, node: Node) -> int:
    """Return the index behind the last character of a value."""
    if isinstance(node, Mapping) and node.entries and source.text[node.span[0]] != "{":
        return _end(source, node.entries[-1].value)
    return node.span[1]
