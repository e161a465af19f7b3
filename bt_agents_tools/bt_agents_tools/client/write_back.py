# SPDX-License-Identifier: Apache-2.0
"""Write-back of tuned values as defaults into an agent file, without other changes."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from bt_agents.host.tuning.tunable import (
    Setting,
    TunableKind,
    TunableParameter,
    parameters_of,
    profile_values,
    shown_value,
)
from bt_agents_core.errors import ReadError, Refused
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.scene import SceneSpace
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.expression.quantities import QuantityError
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.yaml.scalars import quoted
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.span_edit import replace_value
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, read_yaml

_TOLERANCE = 1e-5


@dataclass(frozen=True, kw_only=True)
class ParameterState:
    """Tunable parameter of a running host or entry of a profile, with its current value.

    The default of the parameter is the value that the robot read from the file.
    """

    parameter: TunableParameter
    value: Setting


def write_defaults(
    source: Source,
    tuned: Sequence[ParameterState],
    space: SceneSpace,
    read: Callable[[str], AgentSpec],
) -> str:
    """Return the text of an agent file with tuned values of its agent as its defaults.

    ``read`` reads the text of an agent file.

    Raises:
        ReadError: The file is broken.
        Refused: ``UNKNOWN_PARAMETER``: the file has no such value; ``CHANGED_MEANWHILE``:
            its default differs from the one that the robot read; ``CANNOT_WRITE``.
    """

    def parameters(text: str) -> dict[str, TunableParameter]:
        spec = read(text)
        profile = profile_values(spec.name, space.profiles.names, spec.profile)
        return {parameter.name: parameter for parameter in (*parameters_of(spec), *profile)}

    here = parameters(source.text)
    for one in tuned:
        _check_unchanged(source, one, here.get(one.parameter.name))
    for one in tuned:
        source = Source(source.file, _with_value(source, one, parameters))
    return source.text


def _check_unchanged(source: Source, tuned: ParameterState, here: TunableParameter | None) -> None:
    robot = tuned.parameter
    if here is None:
        raise Refused(
            RefusalCode.UNKNOWN_PARAMETER,
            f"{source.file} has no '{robot.key}' any more; nothing is written",
        )
    if here.default != robot.default:
        raise Refused(
            RefusalCode.CHANGED_MEANWHILE,
            f"{source.file} says {shown_value(here, here.default)} for {robot.name}, but the "
            f"robot has read {shown_value(robot, robot.default)} there: the file has changed "
            "meanwhile; "
            "'bt-agents reload' brings the robot up to date",
        )


def _with_value(
    source: Source, tuned: ParameterState, parameters: Callable[[str], dict[str, TunableParameter]]
) -> str:
    """Return a text with one changed default, in the spelling most similar to the old one."""
    others = parameters(source.text)
    parameter = others.pop(tuned.parameter.name)
    for text in _texts(source, tuned.value, parameter):
        try:
            after = parameters(text)
        except ReadError:
            continue
        changed = after.pop(parameter.name)
        same_type = changed.type is parameter.type
        if same_type and _has_default(changed, tuned.value) and after == others:
            return text
    raise Refused(
        RefusalCode.CANNOT_WRITE,
        f"{source.file}: {parameter.name} cannot be changed to {parameter.format(tuned.value)} "
        "without changing anything else; write it yourself",
    )


def _has_default(parameter: TunableParameter, value: Setting) -> bool:
    if parameter.kind is TunableKind.PROFILE and isinstance(value, float):
        assert isinstance(parameter.default, float)
        return math.isclose(parameter.default, value, rel_tol=_TOLERANCE, abs_tol=_TOLERANCE)
    return parameter.default == value


def _texts(source: Source, value: Setting, parameter: TunableParameter) -> Iterator[str]:
    root = read_yaml(source, Diagnostics(None))
    node = _default_node(root, parameter)
    if node is None:
        if parameter.kind is TunableKind.LEARNING_RATE and isinstance(root, Mapping):
            yield from _with_learning_rate(source, root, value, parameter)
        return
    for spelling in _spellings(node.text, value, parameter):
        try:
            yield replace_value(source, node, spelling)
        except ValueError:
            continue
    if isinstance(value, str):
        start, end = node.span
        yield f"{source.text[:start]}{quoted(value)}{source.text[end:]}"


def default_text(source: Source, parameter: TunableParameter) -> str | None:
    """Return the default of a parameter as a file spells it; None if it is left out."""
    node = _default_node(read_yaml(source, Diagnostics(None)), parameter)
    return node.text if node is not None else None


def _default_node(root: Node | None, parameter: TunableParameter) -> Scalar | None:
    """Return the scalar node of a file that holds a default."""
    paths: tuple[tuple[str, ...], ...] = {
        TunableKind.TUNABLE: (("tunables", parameter.key, "default"),),
        TunableKind.LEARNING_RATE: (("learning_rate",), ("learning", "rate")),
        TunableKind.PROFILE: (("profile", parameter.key),),
    }.get(parameter.kind, ())
    for path in paths:
        node = root
        for key in path:
            node = node.get(key) if isinstance(node, Mapping) else None
        if isinstance(node, Scalar):
            return node
    return None


def _spellings(old: str, value: Setting, parameter: TunableParameter) -> list[str]:
    """Return spellings of a value, the most similar to the old text first."""
    if isinstance(value, bool | str | int):
        return [parameter.format(value)]
    if parameter.kind is TunableKind.PROFILE:
        return [f"{value:.6g}"]
    if parameter.unit:
        return [*_in_unit_of(old, value, parameter), parameter.format(value)]
    spellings = [parameter.format(value), repr(value)]
    return spellings[::-1] if "." in old else spellings


def _in_unit_of(old: str, value: float, parameter: TunableParameter) -> Iterator[str]:
    """Return a quantity in the unit of another one, if that needs only a few digits."""
    match = re.fullmatch(r"[-+.\deE]*\d\.?(\s*)([^\W\d_]+|°)", old)
    space, unit = match.groups() if match else ("", "")
    try:
        one = parameter.parse(f"1{unit}")
    except QuantityError:
        return
    assert isinstance(one, float)
    text = f"{value / one:.6g}{space}{unit}"
    if parameter.parse(text) == value:
        yield text
    if unit and not space:
        yield parameter.format(value).replace(" ", "")


def _with_learning_rate(
    source: Source, root: Mapping, value: Setting, parameter: TunableParameter
) -> Iterator[str]:
    """Return the text with a line for the learning rate after the profile."""
    profile = root.get("profile")
    line_end = source.text.find("\n", _end(source, profile)) if profile is not None else -1
    first = root.entries[0].key.position.column
    if line_end < 0 or first != 1:
        return
    ending = "\r\n" if source.text[line_end - 1] == "\r" else "\n"
    line = f"{parameter.key}: {parameter.format(value)}{ending}"
    yield f"{source.text[: line_end + 1]}{line}{source.text[line_end + 1 :]}"


def _end(source: Source, node: Node) -> int:
    """Return the index after the last character of a value."""
    if isinstance(node, Mapping) and node.entries and source.text[node.span[0]] != "{":
        return _end(source, node.entries[-1].value)
    return node.span[1]
