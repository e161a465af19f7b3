# SPDX-License-Identifier: Apache-2.0
"""Reads how an agent learns: ``learning:`` or ``learning_rate:``, and ``weights:`` of its bid."""

from __future__ import annotations

from collections.abc import Callable

from bt_agents_core.feedback import LearningRule, Update
from bt_agents_core.profile_layers import PERSON, PLACE
from bt_agents_core.scene import MAX_WEIGHT, SceneParameter, SceneSpace
from bt_agents_language.model.scene_values import read_parameter
from bt_agents_language.yaml.mapping_reader import MappingReader
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Node, Scalar

DEFAULT_LEARNING_RATE = 0.2
"""The paper's Experiment 3."""

LAYERS = (PERSON, PLACE)
"""What an agent can learn apart."""

MAX_WINDOW = 100
"""Most feedbacks of which the median is taken."""

MAX_ANNEAL = 100.0
"""Largest annealing."""

KEYS = (
    "rate", "rates", "freeze", "update", "window", "width", "anneal", "drift", "weights",
    "layers", "general",
)  # fmt: skip

_ALL = "all"
_ONLY_WITH = {"window": Update.MEDIAN, "width": Update.HUBER}


def read_learning(
    reading: TypedReader, agent: MappingReader, space: SceneSpace
) -> tuple[float, LearningRule]:
    """Return the learning rate of an agent and its rule; problems are reported."""
    node = agent.get("learning")
    short = agent.number("learning_rate", 0.0, 1.0)
    usual = DEFAULT_LEARNING_RATE if short is None else short
    fields = None if node is None else reading.fields(node, "'learning'", KEYS)
    if fields is None:
        return usual, LearningRule()
    if short is not None and fields.get("rate") is not None:
        reading.error(
            "contradiction",
            fields.keys["rate"],
            "'learning_rate' says the learning rate, too",
            "keep one of both",
        )
    rate = fields.number("rate", 0.0, 1.0)
    return usual if rate is None else rate, _Learning(reading, fields, space).rule()


def read_weights(
    reading: TypedReader, agent: MappingReader, space: SceneSpace
) -> dict[str, float]:
    """Return how much parameters count for an agent; problems are reported."""
    node = agent.get("weights")
    if node is None:
        return {}
    return _by_parameter(reading, node, "'weights'", space, lambda _: (0.0, MAX_WEIGHT))


class _Learning:
    """The keys of ``learning:`` while they are read."""

    def __init__(self, reading: TypedReader, fields: MappingReader, space: SceneSpace) -> None:
        self._reading = reading
        self._fields = fields
        self._space = space

    def rule(self) -> LearningRule:
        """Return what they say."""
        fields = self._fields
        usual = LearningRule()
        rates = self._of_parameters("rates", lambda _: (0.0, 1.0))
        frozen = self._frozen()
        self._refuse_both(rates, frozen)
        word = fields.choice("update", [one.value for one in Update])
        update = usual.update if word is None else Update(word)
        if word is not None or fields.get("update") is None:
            self._refuse_idle(update)
        window = fields.integer("window", 1, MAX_WINDOW)
        anneal = fields.number("anneal", 0.0, MAX_ANNEAL)
        general = fields.number("general", 0.0, 1.0)
        layers = self._layers()
        if general is not None and fields.get("layers") is None:
            self._idle("general", "add 'layers: [person]'")
        return LearningRule(
            rates={**rates, **dict.fromkeys(frozen, 0.0)},
            update=update,
            width=self._width(),
            window=usual.window if window is None else window,
            anneal=usual.anneal if anneal is None else anneal,
            drift=self._of_parameters("drift", lambda p: (0.0, p.maximum - p.minimum)),
            weights=self._weights(),
            layers=layers,
            general=usual.general if general is None else general,
        )

    def _of_parameters(
        self, key: str, limits: Callable[[SceneParameter], tuple[float, float]]
    ) -> dict[str, float]:
        node = self._fields.get(key)
        if node is None:
            return {}
        return _by_parameter(self._reading, node, f"'{key}'", self._space, limits)

    def _width(self) -> dict[str, float]:
        width = self._of_parameters("width", lambda p: (0.0, p.maximum - p.minimum))
        stuck = [name for name, value in width.items() if not value]
        if stuck:
            self._reading.error(
                "out-of-range",
                self._fields.keys["width"],
                f"'width' of {', '.join(stuck)} is 0, expected more",
                f"write 'freeze: [{', '.join(stuck)}]' for what is not to learn",
            )
        return width

    def _frozen(self) -> tuple[str, ...]:
        """Return the parameters that do not learn."""
        node = self._fields.get("freeze")
        if node is None:
            return ()
        if isinstance(node, Scalar) and node.text == _ALL:
            return self._space.names
        if isinstance(node, Scalar) and not node.empty:
            self._reading.wrong_type(node, "'freeze'", f"a list of parameters, or '{_ALL}'")
            return ()
        found = (
            read_parameter(self._reading, item, self._space)
            for item in self._reading.items(node, "'freeze'")
        )
        return tuple(parameter.name for parameter in found if parameter is not None)

    def _refuse_both(self, rates: dict[str, float], frozen: tuple[str, ...]) -> None:
        both = [name for name in frozen if name in rates]
        if both:
            self._reading.error(
                "contradiction",
                self._fields.keys["freeze"],
                f"'rates' says how fast {', '.join(both)} learns, 'freeze' that it does not",
                "keep one of both",
            )

    def _refuse_idle(self, update: Update) -> None:
        for key, only in _ONLY_WITH.items():
            if self._fields.get(key) is not None and update is not only:
                self._idle(key, f"add 'update: {only}', or take it out")

    def _idle(self, key: str, hint: str) -> None:
        self._reading.error(
            "misplaced-key", self._fields.keys[key], f"'{key}' has nothing to act on here", hint
        )

    def _weights(self) -> dict[str, float]:
        weights: dict[str, float] = {}
        for entry in self._fields.entries("weights", "sources of feedback and numbers"):
            weight = self._reading.number(
                entry.value, f"the weight of '{entry.key.text}'", 0.0, MAX_WEIGHT
            )
            if weight is not None:
                weights[entry.key.text] = weight
        return weights

    def _layers(self) -> tuple[str, ...]:
        found = (
            self._reading.choice(item, "a layer", LAYERS) for item in self._fields.items("layers")
        )
        return tuple(dict.fromkeys(layer for layer in found if layer is not None))


def _by_parameter(
    reading: TypedReader,
    node: Node,
    what: str,
    space: SceneSpace,
    limits: Callable[[SceneParameter], tuple[float, float]],
) -> dict[str, float]:
    found: dict[str, float] = {}
    for entry in reading.entries(node, what, f"numbers for {', '.join(space.names)}"):
        parameter = read_parameter(reading, entry.key, space)
        if parameter is None:
            continue
        value = reading.number(entry.value, f"{what} of {parameter.name}", *limits(parameter))
        if value is not None:
            found[parameter.name] = value
    return found
