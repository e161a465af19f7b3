# SPDX-License-Identifier: Apache-2.0
"""Reader of experiments: scenes for the market, and the feedback that follows."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from bt_agents_core.scene import SceneSpace, Vector
from bt_agents_core.text import quote
from bt_agents_language.fields.scene_values import read_values, read_vector
from bt_agents_language.model.experiment import ExperimentSpec, FeedbackErrors, PreparedFeedback
from bt_agents_language.yaml.field_tables import (
    BOOLEAN,
    SHARE,
    TEXT,
    Entries,
    FieldDecl,
    FileKind,
    Items,
    KeyTable,
    SceneValues,
    integer,
    one_of,
)
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Node, Sequence

MAX_ROUNDS = 1_000_000

_GIVEN = ("each", "sequences", "sequence")
_OPINION = SceneValues(of_profiles=True, filled=True)
_ERRORS = KeyTable(
    what="'errors'",
    fields=(
        FieldDecl("every", integer(1, MAX_ROUNDS), "Every n-th feedback is wrong."),
        FieldDecl("share", SHARE, "Probability that feedback is wrong."),
        FieldDecl(
            "value",
            SceneValues(every=True, of_profiles=True),
            "Value of the wrong feedback; any value if left out.",
        ),
    ),
    needs=one_of(("every", "share"), "write either 'every' or 'share'", exclusive=True),
)
_FEEDBACK = KeyTable(
    what="'feedback'",
    fields=(
        FieldDecl(
            "each",
            Entries(_OPINION, "agents and their feedback"),
            "Agent → the feedback that it always gets.",
        ),
        FieldDecl(
            "sequences",
            Entries(Items(_OPINION, filled=True), "agents and their lists of feedback"),
            "Agent → its own feedback, run by run.",
        ),
        FieldDecl(
            "sequence",
            Items(_OPINION),
            "Feedback by round, for agents without feedback of their own.",
        ),
        FieldDecl("repeat", BOOLEAN, "Whether each sequence starts again at its end."),
        FieldDecl("errors", _ERRORS, "Which feedback is wrong."),
    ),
    needs=one_of(_GIVEN, "write 'each', 'sequences' or 'sequence'"),
)
EXPERIMENT = FileKind(
    name="experiment",
    what="an experiment",
    title="Experiment",
    description="The scenes that the market gets, and the feedback that follows.",
    fields=(
        FieldDecl("title", TEXT, "Name for people."),
        FieldDecl("rounds", integer(1, MAX_ROUNDS), "Number of rounds.", required=True),
        FieldDecl(
            "seed", integer(0), "Makes the random numbers the same in every run.", required=True
        ),
        FieldDecl(
            "scenes",
            Items(SceneValues(every=True), empty="there is no scene"),
            "The scenes that the market gets.",
            required=True,
        ),
        FieldDecl("feedback", _FEEDBACK, "What the simulated person wants.", required=True),
    ),
)


def read_experiment(file: Path | Source, space: SceneSpace) -> ExperimentSpec:
    """Return the experiment of a file, or raise a ``ReadError`` with all problems."""
    with TypedReader.of(file) as reading:
        fields = reading.file(EXPERIMENT)
        title = fields.text("title")
        rounds = fields.integer("rounds")
        seed = fields.integer("seed")
        scenes = readable(
            read_vector(reading, node, "a scene", space) for node in fields.items("scenes")
        )
        feedback = None
        if (node := fields.get("feedback")) is not None:
            feedback = _feedback(reading, node, space.profiles, seed or 0)
        reading.problems.raise_if_any()
        assert rounds is not None
        assert seed is not None
        assert feedback is not None
        return ExperimentSpec(
            title=title, rounds=rounds, seed=seed, scenes=scenes, feedback=feedback
        )


def _feedback(
    reading: TypedReader, node: Node, space: SceneSpace, seed: int
) -> PreparedFeedback | None:
    fields = reading.keys(node, _FEEDBACK)
    if fields is None:
        return None
    if not any(fields.get(key) is not None for key in _GIVEN):
        reading.error(
            "missing-key",
            node,
            "'feedback' needs 'each', 'sequences' or 'sequence'",
            "add 'each: {agent: {…}}'",
        )
    each: dict[str, Vector] = {}
    for entry in fields.entries("each"):
        agent = reading.name(entry.key, "the name of an agent")
        vector = _opinion(reading, entry.value, space)
        if agent is not None and vector is not None:
            each[agent] = vector
    return PreparedFeedback(
        each=each,
        sequences=_sequences(reading, fields, space, each),
        sequence=readable(_opinion(reading, item, space) for item in fields.items("sequence")),
        repeat=bool(fields.boolean("repeat")),
        errors=fields.read("errors", lambda node, _: _errors(reading, node, space, seed)),
    )


def _sequences(
    reading: TypedReader, fields: MappingReader, space: SceneSpace, each: Collection[str]
) -> dict[str, tuple[Vector, ...]]:
    sequences: dict[str, tuple[Vector, ...]] = {}
    for entry in fields.entries("sequences"):
        agent = reading.name(entry.key, "the name of an agent")
        items = reading.items(entry.value, "the list of an agent")
        if isinstance(entry.value, Sequence) and not items:
            reading.error(
                "missing-value",
                entry.value,
                "the list of an agent is empty",
                "add one feedback, such as '- {age: 3}'",
            )
        if agent is not None and agent in each:
            reading.error(
                "misplaced-key",
                entry.key,
                f"{quote(agent)} stands under 'each', too",
                "leave it there if it always gets the same feedback, else here",
            )
        opinions = readable(_opinion(reading, item, space) for item in items)
        if agent is not None:
            sequences[agent] = opinions
    return sequences


def _errors(
    reading: TypedReader, node: Node, space: SceneSpace, seed: int
) -> FeedbackErrors | None:
    fields = reading.keys(node, _ERRORS)
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
    return FeedbackErrors(
        space=space,
        seed=seed,
        every=fields.integer("every") or 0,
        share=fields.number("share") or 0.0,
        value=fields.read("value", lambda node, _: read_vector(reading, node, "a value", space)),
    )


def _opinion(reading: TypedReader, node: Node, space: SceneSpace) -> Vector | None:
    """Return a feedback vector; a missing parameter is NaN, which means no opinion."""
    before = len(reading.problems)
    values = read_values(reading, node, "feedback", space)
    if not values and len(reading.problems) == before:
        reading.error(
            "missing-value", node, "the feedback has no value", "add one, such as 'age: 3'"
        )
    if len(reading.problems) > before:
        return None
    return space.ordered(values)
