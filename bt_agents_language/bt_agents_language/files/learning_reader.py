# SPDX-License-Identifier: Apache-2.0
"""Reader of ``learning:`` or ``learning_rate:`` of an agent, and of ``weights:`` of its bid."""

from __future__ import annotations

from bt_agents_core.feedback import LearningRule, Share, Update
from bt_agents_core.profile_layers import PERSON, PLACE
from bt_agents_core.scene import MAX_WEIGHT, SceneParameter, SceneSpace
from bt_agents_language.fields.scene_values import read_parameter
from bt_agents_language.yaml.field_tables import (
    SHARE,
    Entries,
    FieldDecl,
    Items,
    Key,
    KeyTable,
    SceneNameList,
    SceneValues,
    WordChoice,
    integer,
    number,
)
from bt_agents_language.yaml.typed_reader import MappingReader, Shape, TypedReader
from bt_agents_language.yaml.yaml_reader import Scalar

DEFAULT_LEARNING_RATE = 0.2
"""The paper's Experiment 3."""

LAYERS = (PERSON, PLACE)
"""Layers that an agent can learn separately."""

MAX_WINDOW = 100
"""Maximum number of feedbacks for the median."""

MAX_ANNEAL = 100

_ALL = "all"


def _up_to_range(parameter: SceneParameter) -> tuple[float, float]:
    return 0, parameter.maximum - parameter.minimum


LEARNING = KeyTable(
    what="'learning'",
    fields=(
        FieldDecl("rate", SHARE, "How far one feedback moves the profile; as 'learning_rate'."),
        FieldDecl(
            "rates",
            SceneValues(of_profiles=True, limits=lambda _: (0, 1)),
            "How far one feedback moves single parameters.",
        ),
        FieldDecl(
            "freeze",
            SceneNameList(_ALL),
            f"Parameters that learning does not change, or '{_ALL}'.",
        ),
        FieldDecl(
            "update",
            WordChoice(tuple(one.value for one in Update)),
            "plain: every feedback counts fully; huber: far feedback counts as if it were nearer; "
            "median: the median of the last feedbacks counts.",
        ),
        FieldDecl(
            "width",
            SceneValues(of_profiles=True, limits=_up_to_range),
            "For huber: feedback from farther away counts as if it were this far away.",
        ),
        FieldDecl(
            "window", integer(1, MAX_WINDOW), "For median: how many of the last feedbacks count."
        ),
        FieldDecl(
            "anneal",
            number(0, MAX_ANNEAL),
            "After n feedbacks the rate is rate / (1 + anneal × n).",
        ),
        FieldDecl(
            "drift",
            SceneValues(of_profiles=True, limits=_up_to_range),
            "How far the profile may move from the values of this file.",
        ),
        FieldDecl(
            "retreat",
            SceneValues(of_profiles=True),
            "Where negative feedback moves a parameter whose value equals the scene's.",
        ),
        FieldDecl(
            "weights",
            Entries(number(0, MAX_WEIGHT), "sources of feedback and numbers", keys=Key.ANY),
            "Weights of the sources of feedback: button, mood rule, fleet, ….",
        ),
        FieldDecl(
            "layers",
            Items(WordChoice(LAYERS)),
            "What the agent learns separately for each person or place.",
        ),
        FieldDecl(
            "general",
            SHARE,
            "Share of what the agent learns for a person or place that the profile for everybody "
            "also learns.",
        ),
        FieldDecl(
            "share",
            WordChoice(tuple(one.value for one in Share)),
            "What the robots of a fleet learn together: everything (except what belongs to "
            "persons), place (only what is learned for places) or nothing.",
        ),
    ),
)

LEARNING_FIELDS = (
    FieldDecl(
        "learning_rate", SHARE, "How far one feedback moves the profile, 0 to 1; or 'learning'."
    ),
    FieldDecl("learning", LEARNING, "How feedback moves the profile."),
    FieldDecl(
        "weights",
        SceneValues(of_profiles=True, limits=lambda _: (0, MAX_WEIGHT)),
        "Weights of the parameters for this agent in weighted distances; usually 1.",
    ),
)
"""Keys of an agent for its learning."""


def read_learning(
    reading: TypedReader, agent: MappingReader, space: SceneSpace
) -> tuple[float, LearningRule]:
    """Return the learning rate of an agent and its rule; report problems."""
    node = agent.get("learning")
    short = agent.number("learning_rate")
    usual = DEFAULT_LEARNING_RATE if short is None else short
    fields = None if node is None else reading.keys(node, LEARNING)
    if fields is None:
        return usual, LearningRule()
    if short is not None and fields.get("rate") is not None:
        reading.error(
            "contradiction",
            fields.keys["rate"],
            "'learning_rate' says the learning rate, too",
            "keep one of both",
        )
    rate = fields.number("rate")
    return usual if rate is None else rate, _rule(reading, fields, space)


def _rule(reading: TypedReader, fields: MappingReader, space: SceneSpace) -> LearningRule:
    usual = LearningRule()
    rates = numbers_by_parameter(reading, fields, "rates", space)
    retreat = numbers_by_parameter(reading, fields, "retreat", space)
    frozen = _frozen(reading, fields, space)
    for given, contradiction in (
        (rates, "'rates' says how fast {} learns, 'freeze' that it does not"),
        (retreat, "'retreat' says where {} goes, 'freeze' that it does not learn"),
    ):
        both = ", ".join(name for name in frozen if name in given)
        if both:
            message = contradiction.format(both)
            reading.error("contradiction", fields.keys["freeze"], message, "keep one of both")
    word = fields.choice("update")
    share = fields.choice("share")
    update = usual.update if word is None else Update(word)
    if word is not None or fields.get("update") is None:
        for key, only in (("window", Update.MEDIAN), ("width", Update.HUBER)):
            if fields.get(key) is not None and update is not only:
                _report_idle(reading, fields, key, f"add 'update: {only}', or take it out")
    width = numbers_by_parameter(reading, fields, "width", space)
    stuck = ", ".join(name for name, value in width.items() if not value)
    if stuck:
        reading.error(
            "out-of-range",
            fields.keys["width"],
            f"'width' of {stuck} is 0, expected more",
            f"write 'freeze: [{stuck}]' for what is not to learn",
        )
    window = fields.integer("window")
    anneal = fields.number("anneal")
    general = fields.number("general")
    layers = (reading.choice(item, "a layer", LAYERS) for item in fields.items("layers"))
    if general is not None and fields.get("layers") is None:
        _report_idle(reading, fields, "general", "add 'layers: [person]'")
    return LearningRule(
        rates={**rates, **dict.fromkeys(frozen, 0.0)},
        update=update,
        width=width,
        window=usual.window if window is None else window,
        anneal=usual.anneal if anneal is None else anneal,
        drift=numbers_by_parameter(reading, fields, "drift", space),
        retreat=retreat,
        weights=_weights(reading, fields),
        layers=tuple(dict.fromkeys(layer for layer in layers if layer is not None)),
        general=usual.general if general is None else general,
        share=usual.share if share is None else Share(share),
    )


def _frozen(reading: TypedReader, fields: MappingReader, space: SceneSpace) -> tuple[str, ...]:
    node = fields.get("freeze")
    if node is None:
        return ()
    if isinstance(node, Scalar) and node.text == _ALL:
        return space.names
    if isinstance(node, Scalar) and not node.empty:
        reading.wrong_type(node, "'freeze'", f"a list of parameters, or '{_ALL}'", Shape.LIST)
        return ()
    found = (read_parameter(reading, item, space) for item in reading.items(node, "'freeze'"))
    return tuple(parameter.name for parameter in found if parameter is not None)


def _report_idle(reading: TypedReader, fields: MappingReader, key: str, hint: str) -> None:
    message = f"'{key}' has nothing to act on here"
    reading.error("misplaced-key", fields.keys[key], message, hint)


def _weights(reading: TypedReader, fields: MappingReader) -> dict[str, float]:
    weights: dict[str, float] = {}
    for entry in fields.entries("weights"):
        what = f"the weight of '{entry.key.text}'"
        weight = reading.number(entry.value, what, 0.0, MAX_WEIGHT)
        if weight is not None:
            weights[entry.key.text] = weight
    return weights


def numbers_by_parameter(
    reading: TypedReader, fields: MappingReader, key: str, space: SceneSpace
) -> dict[str, float]:
    """Return numbers for some scene parameters, each within the limits of the table."""
    found: dict[str, float] = {}
    for entry in fields.entries(key, f"numbers for {', '.join(space.names)}"):
        parameter = read_parameter(reading, entry.key, space)
        if parameter is None:
            continue
        what = f"'{key}' of {parameter.name}"
        value = reading.number(entry.value, what, *fields.limits_for(key, parameter))
        if value is not None:
            found[parameter.name] = value
    return found
