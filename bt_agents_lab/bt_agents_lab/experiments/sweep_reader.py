# SPDX-License-Identifier: Apache-2.0
"""Reader of sweep files: strategies, learning rules, wrong feedback and the world."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import LearningRule, Update
from bt_agents_core.scene import SceneSpace
from bt_agents_lab.experiments.random_streams import WrongFeedback
from bt_agents_lab.experiments.replicas import opened, world_of
from bt_agents_lab.experiments.simulated_world import (
    NOT_SIMULATED,
    ChangeOfMind,
    Person,
    Selection,
    SimulatedWorld,
)
from bt_agents_lab.experiments.sweep import SweepSpec
from bt_agents_language.fields.scene_values import read_vector
from bt_agents_language.files.learning_reader import numbers_by_parameter
from bt_agents_language.yaml.field_tables import (
    DURATION,
    NUMBER,
    SHARE,
    TEXT,
    Either,
    Entries,
    FieldDecl,
    FileKind,
    Items,
    Key,
    KeyTable,
    SceneValues,
    WordChoice,
    integer,
    number,
)
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader, readable
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar
from marketplace_node.strategies import STRATEGIES, TIE_BREAKS

MAX_RUNS = 1_000_000
MAX_ROUNDS = 100_000
TIES = (*TIE_BREAKS, "random")

_OPTIONS = {name: spec.options for name, spec in STRATEGIES.items() if name not in NOT_SIMULATED}
_UPDATES = tuple(str(update) for update in Update)
_STRATEGY = KeyTable(
    what="a strategy",
    fields=(
        FieldDecl("name", WordChoice(tuple(_OPTIONS)), "The strategy.", required=True),
        FieldDecl(
            "tie_break", WordChoice(TIES), "Which of equally good bids wins.", default=TIES[0]
        ),
        *(
            FieldDecl(name, NUMBER, "An option of the strategy.")
            for name in sorted({option.name for own in _OPTIONS.values() for option in own})
        ),
    ),
)
_UPDATE = KeyTable(
    what="an update",
    fields=(
        FieldDecl("name", WordChoice(_UPDATES), "The learning rule.", required=True),
        FieldDecl("width", number(0), "For huber: the width for every parameter."),
        FieldDecl("window", integer(1, 1000), "For median: how many of the last feedbacks count."),
        FieldDecl("anneal", number(0), "After n feedbacks the rate is rate / (1 + anneal × n)."),
        FieldDecl(
            "retreat",
            SceneValues(of_profiles=True),
            "Where negative feedback moves a parameter whose value equals the scene's.",
        ),
    ),
)
_WRONG = KeyTable(
    what="'wrong'",
    fields=(
        FieldDecl("shares", Items(SHARE), "Shares of wrong feedback.", required=True),
        FieldDecl(
            "says",
            Either((WordChoice(("any", "another")), SceneValues(every=True, of_profiles=True))),
            "What wrong feedback says.",
        ),
    ),
)
_PERSON = KeyTable(
    what="'person'",
    fields=(
        FieldDecl("seconds", integer(1, 1000), "Length of an interaction."),
        FieldDecl(
            "drift",
            number(0),
            "What an agent that suits the scene perfectly adds to the mood per second.",
        ),
        FieldDecl("noise", number(0), "Standard deviation of all other changes of the mood."),
        FieldDecl(
            "tolerance", number(0.001), "Distance at which an agent neither pleases nor annoys."
        ),
        FieldDecl("better", number(0), "Rise of the mood that gives positive feedback."),
        FieldDecl("worse", number(0), "Fall of the mood that gives negative feedback."),
        FieldDecl("hold", DURATION, "How long a rise or fall must hold."),
    ),
)
_CHANGE = KeyTable(
    what="'change'",
    fields=(
        FieldDecl(
            "round", integer(2), "The first round in which the change counts.", required=True
        ),
        FieldDecl(
            "each",
            Entries(SceneValues(every=True, of_profiles=True), "agents and scenes", keys=Key.ANY),
            "Agent → the scene that it suits from then on; other agents stay the same.",
            required=True,
        ),
    ),
)
SWEEP = FileKind(
    name="sweep",
    what="a sweep",
    title="Sweep",
    description="Runs of strategies and learning rules with increasing shares of wrong feedback.",
    fields=(
        FieldDecl("title", TEXT, "Name for people."),
        FieldDecl("experiment", TEXT, "Folder of the experiment.", required=True),
        FieldDecl("runs", integer(1, MAX_RUNS), "Number of runs.", required=True),
        FieldDecl("rounds", integer(1, MAX_ROUNDS), "Number of rounds per run.", required=True),
        FieldDecl("seed", integer(0), "Makes the random numbers the same.", required=True),
        FieldDecl(
            "strategies",
            Items(Either((WordChoice(tuple(_OPTIONS)), _STRATEGY))),
            "Each by name, or with options.",
            required=True,
        ),
        FieldDecl(
            "updates",
            Items(Either((WordChoice(_UPDATES), _UPDATE))),
            "Each by name, or with options.",
            required=True,
        ),
        FieldDecl("wrong", _WRONG, "Shares and contents of wrong feedback."),
        FieldDecl("person", _PERSON, "The person whose mood gives the feedback."),
        FieldDecl(
            "change", _CHANGE, "How the wishes of the person change, from a given round on."
        ),
        FieldDecl(
            "arrivals",
            Entries(integer(2), "agents and rounds", keys=Key.ANY),
            "Agent → the first round in which it takes part; other agents take part from the "
            "start.",
        ),
    ),
)


def read_sweep(path: Path) -> SweepSpec:
    """Return the sweep of a file.

    Raises:
        ReadError: There is a problem; it lists all of them.
        BtAgentsError: The experiment of the sweep cannot be read.
    """
    with TypedReader.of(path) as reading:
        fields = reading.file(SWEEP)
        title = fields.text("title") or path.stem
        runs = fields.integer("runs")
        rounds = fields.integer("rounds")
        seed = fields.integer("seed")
        folder = fields.text("experiment")
        if not folder:
            # Without the experiment, the valid names in the rest are unknown.
            reading.problems.raise_if_any()
        world = _world(path.parent / folder)
        space = world.space
        strategies, updates = fields.items("strategies"), fields.items("updates")
        selections = readable(_selection(reading, node) for node in strategies)
        learnings = readable(_learning(reading, node, space) for node in updates)
        for key, found in (("strategies", strategies), ("updates", updates)):
            if not found:
                reading.error("missing-value", fields.nodes[key], f"'{key}' is empty", "name one")
        shares: tuple[float, ...] = (0.0,)
        wrong: WrongFeedback | None = "any"
        if (node := fields.get("wrong")) is not None:
            shares, wrong = _wrong(reading, node, space)
        person = None
        if (node := fields.get("person")) is not None:
            if space.mood is None:
                reading.error(
                    "unknown-name",
                    node,
                    f"the scene of '{folder}' has no mood that is part of profiles",
                    "name it in its scene.yaml: mood: …, without 'profile: false'",
                )
            person = _person(reading, node)
        change = None
        if (node := fields.get("change")) is not None:
            change = _change(reading, node, world)
        absent = _absent(reading, fields, world)
        reading.problems.raise_if_any()
        assert runs is not None
        assert rounds is not None
        assert seed is not None
        return SweepSpec(
            title=title,
            world=replace(world, person=person, change=change, absent=absent),
            runs=runs,
            rounds=rounds,
            seed=seed,
            shares=shares,
            wrong=wrong or "any",
            selections=selections,
            learnings=learnings,
        )


def _world(folder: Path) -> SimulatedWorld:
    if not (folder / "experiment.yaml").is_file():
        raise BtAgentsError(
            f"'{folder}' is not an experiment: it has no experiment.yaml; 'experiment:' of a "
            "sweep is a folder, seen from the file's own"
        )
    return world_of(*opened(folder))


def _selection(reading: TypedReader, node: Node) -> Selection | None:
    if not isinstance(node, Mapping):
        name = reading.choice(node, "a strategy", tuple(_OPTIONS))
        return None if name is None else Selection(strategy=name)
    fields = reading.keys(node, _STRATEGY)
    if fields is None:
        return None
    name = fields.choice("name")
    tie_break = fields.choice("tie_break") or TIES[0]
    if name is None:
        return None
    given = {}
    own = {option.name: option for option in _OPTIONS[name]}
    for key in sorted(fields.nodes.keys() - {"name", "tie_break"}):
        if key not in own:
            hint = f"it has {', '.join(own)}" if own else "it has no options"
            reading.error("unknown-key", fields.keys[key], f"{name} has no option '{key}'", hint)
            continue
        value = fields.number(key, own[key].minimum, own[key].maximum)
        if value is not None:
            given[key] = value
    return Selection(strategy=name, options=given, tie_break=tie_break)


def _learning(reading: TypedReader, node: Node, space: SceneSpace) -> LearningRule | None:
    if not isinstance(node, Mapping):
        name = reading.choice(node, "an update", _UPDATES)
        return None if name is None else LearningRule(update=Update(name))
    fields = reading.keys(node, _UPDATE)
    if fields is None:
        return None
    name = fields.choice("name")
    width = fields.number("width")
    options = {"window": fields.integer("window"), "anneal": fields.number("anneal")}
    if name is None:
        return None
    widths = {} if width is None else dict.fromkeys(space.names, width)
    retreat = numbers_by_parameter(reading, fields, "retreat", space)
    return LearningRule(update=Update(name), width=widths, retreat=retreat, **_given(options))


def _wrong(
    reading: TypedReader, node: Node, space: SceneSpace
) -> tuple[tuple[float, ...], WrongFeedback | None]:
    fields = reading.keys(node, _WRONG)
    if fields is None:
        return (0.0,), None
    shares = readable(reading.number(item, "a share", 0, 1) for item in fields.items("shares"))
    says = fields.get("says")
    wrong: WrongFeedback | None = "any"
    if isinstance(says, Mapping):
        wrong = read_vector(reading, says, "what wrong feedback says", space)
    elif says is not None:
        word = reading.choice(says, "'says'", ("any", "another"))
        wrong = None if word is None else "another" if word == "another" else "any"
    return shares, wrong


def _person(reading: TypedReader, node: Node) -> Person | None:
    fields = reading.keys(node, _PERSON)
    if fields is None:
        return None
    numbers = {
        key: fields.number(key) for key in ("drift", "noise", "tolerance", "better", "worse")
    }
    hold = fields.duration("hold")
    if hold is not None and not hold.is_integer():
        reading.error(
            "out-of-range", fields.nodes["hold"], f"'hold' is {hold:g} s, expected whole seconds"
        )
    whole = {"seconds": fields.integer("seconds"), "hold_s": None if hold is None else int(hold)}
    return Person(**_given(whole), **_given(numbers))


def _change(reading: TypedReader, node: Node, world: SimulatedWorld) -> ChangeOfMind | None:
    fields = reading.keys(node, _CHANGE)
    if fields is None:
        return None
    first = fields.integer("round")
    best = world.best.copy()
    for entry in fields.entries("each"):
        agent = _agent(reading, entry.key, world)
        vector = read_vector(reading, entry.value, "what it is made for", world.space)
        if agent is not None and vector is not None:
            best[agent] = vector
    return None if first is None else ChangeOfMind(after=first - 1, best=best)


def _absent(reading: TypedReader, fields: MappingReader, world: SimulatedWorld) -> dict[str, int]:
    """Return for how many rounds agents are absent at the start."""
    absent: dict[str, int] = {}
    for entry in fields.entries("arrivals"):
        agent = _agent(reading, entry.key, world)
        first = reading.integer(entry.value, f"the first round of '{entry.key.text}'", 2)
        if agent is not None and first is not None:
            absent[world.agents[agent]] = first - 1
    if len(absent) == len(world.agents):
        reading.error(
            "contradiction",
            fields.keys["arrivals"],
            "in the first round nobody is there",
            "leave one of the agents out",
        )
    return absent


def _agent(reading: TypedReader, key: Scalar, world: SimulatedWorld) -> int | None:
    name = reading.choice(key, "an agent", world.agents)
    return None if name is None else world.agents.index(name)


def _given(values: dict[str, Any]) -> dict[str, Any]:
    """Return the values in a file; the others keep their defaults."""
    return {key: value for key, value in values.items() if value is not None}
