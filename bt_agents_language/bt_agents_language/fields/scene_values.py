# SPDX-License-Identifier: Apache-2.0
"""Values of scene parameters in any file: profiles, scenes and feedback, each in its range."""

from __future__ import annotations

from bt_agents_core.errors import Refused
from bt_agents_core.scene import SceneParameter, SceneSpace, Vector, check_value
from bt_agents_core.text import join_quoted, quote
from bt_agents_language.diagnostics.collection import did_you_mean
from bt_agents_language.yaml.typed_reader import TypedReader, adding
from bt_agents_language.yaml.yaml_reader import Node, Scalar


def read_values(
    reading: TypedReader, node: Node, what: str, space: SceneSpace
) -> dict[str, float]:
    """Return values of some scene parameters; report and omit wrong ones."""
    found: dict[str, float] = {}
    for entry in reading.entries(node, what, f"values of {', '.join(space.names)}"):
        parameter = read_parameter(reading, entry.key, space)
        if parameter is None or _is_label(reading, entry.value, parameter):
            continue
        value = reading.number(entry.value, entry.key.text)
        if value is None:
            continue
        try:
            found[parameter.name] = check_value(parameter, value)
        except Refused as refused:
            reading.error("out-of-range", entry.value, refused.reason)
    return found


def _is_label(reading: TypedReader, node: Node, parameter: SceneParameter) -> bool:
    """Report a label in place of the value itself."""
    word = node.text if isinstance(node, Scalar) else ""
    value = next((one for one, label in parameter.labels.items() if label == word), None)
    if value is None:
        return False
    message = f"{parameter.name}: expected a number, found the word {quote(word)}"
    reading.error("bad-number", node, message, f"write {value:g}, which scene.yaml calls so")
    return True


def read_vector(reading: TypedReader, node: Node, what: str, space: SceneSpace) -> Vector | None:
    """Return the values of all scene parameters; None if one is wrong or missing."""
    before = len(reading.problems)
    values = read_values(reading, node, what, space)
    if len(reading.problems) > before:
        return None
    missing = [name for name in space.names if name not in values]
    if missing:
        reading.error(
            "missing-key", node, f"{what} has no value for {join_quoted(missing)}", adding(missing)
        )
        return None
    return tuple(values[name] for name in space.names)


def read_parameter(reading: TypedReader, node: Node, space: SceneSpace) -> SceneParameter | None:
    """Return the named scene parameter, or report that there is none and return None."""
    name = reading.text(node, "a scene parameter")
    if name is None:
        return None
    try:
        return space.parameter(name)
    except Refused:
        if name in space.left_out:
            reading.error(
                "wrong-value",
                node,
                f"no profile has {quote(name)}: scene.yaml says 'profile: false' of it",
                f"leave {quote(name)} out here, or write 'profile: true' in scene.yaml",
            )
            return None
        reading.error(
            "unknown-name",
            node,
            f"there is no scene parameter {quote(name)}",
            did_you_mean(name.removeprefix("scene."), space.names),
        )
        return None
