# SPDX-License-Identifier: Apache-2.0
"""Reads an experiment: which scenes are put on the market, and what feedback follows."""

from __future__ import annotations

import math
from pathlib import Path

from bt_agents_core.scene import SceneSpace, Vector
from bt_agents_language.model.experiment import ExperimentSpec
from bt_agents_language.model.scene_values import read_values, read_vector
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Node, Sequence
from feedback_node.simulated_feedback import Errors, SimulatedFeedback

MAX_ROUNDS = 1_000_000


def read_experiment(file: Path | Source, space: SceneSpace) -> ExperimentSpec:
    """Return the experiment of a file.

    Args:
        file: The file, or its text.
        space: The scene parameters.

    Raises:
        ReadError: There is a problem; it lists all of them.
    """
    reading = TypedReader.of(file)
    keys = ("title", "rounds", "seed", "scenes", "feedback")
    fields = reading.document("an experiment", keys, ("rounds", "seed", "scenes", "feedback"))
    title = fields.text("title")
    rounds = fields.integer("rounds", 1, MAX_ROUNDS)
    seed = fields.integer("seed", 0)
    nodes = fields.items("scenes")
    if not nodes and isinstance(fields.get("scenes"), Sequence):
        reading.error("missing-value", fields.nodes["scenes"], "there is no scene", "add one")
    scenes = [read_vector(reading, node, "a scene", space) for node in nodes]
    feedback_node = fields.get("feedback")
    feedback = (
        _feedback(reading, feedback_node, space, seed or 0) if feedback_node is not None else None
    )
    reading.problems.raise_if_any()
    assert rounds is not None
    assert seed is not None
    assert feedback is not None
    return ExperimentSpec(
        title=title,
        rounds=rounds,
        seed=seed,
        scenes=tuple(scene for scene in scenes if scene is not None),
        feedback=feedback,
    )


def read_simulated_feedback(path: Path, space: SceneSpace) -> SimulatedFeedback:
    """Return the feedback of an experiment alone; as :func:`read_experiment`."""
    return read_experiment(path, space).feedback


def _feedback(
    reading: TypedReader, node: Node, space: SceneSpace, seed: int
) -> SimulatedFeedback | None:
    fields = reading.fields(node, "'feedback'", ("each", "sequence", "repeat", "errors"))
    if fields is None:
        return None
    if fields.get("each") is None and fields.get("sequence") is None:
        reading.error(
            "missing-key",
            node,
            "'feedback' needs 'each' or 'sequence'",
            "add 'each: {agent: {…}}'",
        )
    each: dict[str, Vector] = {}
    for entry in fields.entries("each", "agents and their feedback"):
        agent = reading.name(entry.key, "the name of an agent")
        vector = _opinion(reading, entry.value, space)
        if agent is not None and vector is not None:
            each[agent] = vector
    sequence = [_opinion(reading, item, space) for item in fields.items("sequence")]
    repeat = fields.boolean("repeat")
    errors_node = fields.get("errors")
    return SimulatedFeedback(
        each=each,
        sequence=tuple(vector for vector in sequence if vector is not None),
        repeat=bool(repeat),
        errors=None if errors_node is None else _errors(reading, errors_node, space, seed),
    )


def _errors(reading: TypedReader, node: Node, space: SceneSpace, seed: int) -> Errors | None:
    fields = reading.fields(node, "'errors'", ("every", "share", "value"))
    if fields is None:
        return None
    given = [key for key in ("every", "share") if fields.get(key) is not None]
    if len(given) != 1:
        reading.error(
            "missing-key" if not given else "misplaced-key",
            node,
            f"'errors' has {'both' if given else 'neither'} 'every' {'and' if given else 'nor'} "
            "'share'",
            "write 'every: 3' for each third, or 'share: 0.05' for five of a hundred by chance",
        )
        return None
    every = fields.integer("every", 1, MAX_ROUNDS)
    share = fields.number("share", 0, 1)
    value_node = fields.get("value")
    return Errors(
        space=space,
        seed=seed,
        every=every or 0,
        share=share or 0.0,
        value=None if value_node is None else read_vector(reading, value_node, "a value", space),
    )


def _opinion(reading: TypedReader, node: Node, space: SceneSpace) -> Vector | None:
    """Return a feedback vector; a parameter that is left out is NaN, which means no opinion."""
    before = len(reading.problems)
    values = read_values(reading, node, "feedback", space)
    if not values and len(reading.problems) == before:
        reading.error(
            "missing-value", node, "the feedback has no value", "add one, such as 'age: 3'"
        )
    if len(reading.problems) > before:
        return None
    return tuple(values.get(name, math.nan) for name in space.names)
