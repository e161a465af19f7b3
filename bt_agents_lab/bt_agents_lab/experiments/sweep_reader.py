# SPDX-License-Identifier: Apache-2.0
"""Reader of sweep files: strategies, learning rules, wrong feedback and the world."""

from __future__ import annotations

import math
from pathlib import Path

from bt_agents_core.errors import BtAgentsError
from bt_agents_core.feedback import LearningRule, Update
from bt_agents_core.scene import SceneSpace
from bt_agents_lab.experiments.random_streams import WrongFeedback
from bt_agents_lab.experiments.replicas import world_of
from bt_agents_lab.experiments.simulated_world import NOT_SIMULATED, Person, SimulatedWorld
from bt_agents_lab.experiments.sweep import Learning, Selection, SweepSpec
from bt_agents_language.files.experiment_reader import read_experiment
from bt_agents_language.files.folder_reader import read_trees
from bt_agents_language.model.scene_values import read_vector
from bt_agents_language.yaml.source import read_source
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import Mapping, Node
from marketplace_node.strategies import STRATEGIES, TIE_BREAKS

MAX_RUNS = 1_000_000
MAX_ROUNDS = 100_000
TIES = (*TIE_BREAKS, "random")


def read_sweep(path: Path) -> SweepSpec:
    """Return the sweep of a file.

    Raises:
        ReadError: There is a problem; it lists all of them.
        BtAgentsError: The experiment that it is about cannot be read.
    """
    reading = TypedReader.of(read_source(path))
    required = ("experiment", "runs", "rounds", "seed", "strategies", "updates")
    known = ("title", *required, "wrong", "person")
    fields = reading.document("a sweep", known, required)
    title = fields.text("title") or path.stem
    runs = fields.integer("runs", 1, MAX_RUNS)
    rounds = fields.integer("rounds", 1, MAX_ROUNDS)
    seed = fields.integer("seed", 0)
    folder = fields.text("experiment")
    if not folder:
        # Without the experiment nobody knows what the rest may name.
        reading.problems.raise_if_any()
    world = _world(path.parent / folder)
    space = world.space
    selections = [_selection(reading, node) for node in fields.items("strategies")]
    learnings = [_learning(reading, node, space) for node in fields.items("updates")]
    for key, found in (("strategies", selections), ("updates", learnings)):
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
                f"the scene of '{folder}' has no mood that a person could have",
                "name it in its scene.yaml: mood: …",
            )
        person = _person(reading, node)
    reading.problems.raise_if_any()
    assert runs is not None
    assert rounds is not None
    assert seed is not None
    return SweepSpec(
        title=title,
        world=SimulatedWorld(
            space=space,
            agents=world.agents,
            starts=world.starts,
            best=world.best,
            scenes=world.scenes,
            rates=world.rates,
            person=person,
        ),
        runs=runs,
        rounds=rounds,
        seed=seed,
        shares=shares,
        wrong=wrong or "any",
        selections=tuple(one for one in selections if one is not None),
        learnings=tuple(one for one in learnings if one is not None),
    )


def _world(folder: Path) -> SimulatedWorld:
    if not (folder / "experiment.yaml").is_file():
        raise BtAgentsError(
            f"'{folder}' is no experiment: it has no experiment.yaml; 'experiment:' of a sweep is "
            "a folder, seen from the file's own"
        )
    trees = read_trees(folder)
    if trees.broken:
        raise BtAgentsError(trees.broken[0].error.report)
    return world_of(trees, read_experiment(folder / "experiment.yaml", trees.scene.space))


def _selection(reading: TypedReader, node: Node) -> Selection | None:
    names = [name for name in STRATEGIES if name not in NOT_SIMULATED]
    if not isinstance(node, Mapping):
        name = reading.choice(node, "a strategy", names)
        return None if name is None else Selection(strategy=name)
    options = {o.name for name in names for o in STRATEGIES[name].options}
    fields = reading.fields(node, "a strategy", ("name", "tie_break", *sorted(options)), ("name",))
    if fields is None:
        return None
    name = fields.choice("name", names)
    tie_break = TIES[0]
    if fields.get("tie_break") is not None:
        tie_break = fields.choice("tie_break", TIES) or TIES[0]
    if name is None:
        return None
    given = {}
    own = {option.name: option for option in STRATEGIES[name].options}
    for key in sorted(options & set(fields.nodes)):
        if key not in own:
            hint = f"it has {', '.join(own)}" if own else "it has no options"
            reading.error("unknown-key", fields.keys[key], f"{name} has no option '{key}'", hint)
            continue
        value = fields.number(key, own[key].minimum, own[key].maximum)
        if value is not None:
            given[key] = value
    return Selection(strategy=name, options=given, tie_break=tie_break)


def _learning(reading: TypedReader, node: Node, space: SceneSpace) -> Learning | None:
    if not isinstance(node, Mapping):
        name = reading.choice(node, "an update", [str(update) for update in Update])
        return None if name is None else Learning(rule=LearningRule(update=Update(name)))
    keys = ("name", "width", "window", "anneal")
    fields = reading.fields(node, "an update", keys, ("name",))
    if fields is None:
        return None
    name = fields.choice("name", [str(update) for update in Update])
    width = fields.number("width", 0)
    window = fields.integer("window", 1, 1000)
    anneal = fields.number("anneal", 0)
    if name is None:
        return None
    widths = {} if width is None else dict.fromkeys(space.names, width)
    default = LearningRule()
    return Learning(
        rule=LearningRule(
            update=Update(name),
            width=widths,
            window=default.window if window is None else window,
            anneal=default.anneal if anneal is None else anneal,
        )
    )


def _wrong(
    reading: TypedReader, node: Node, space: SceneSpace
) -> tuple[tuple[float, ...], WrongFeedback | None]:
    fields = reading.fields(node, "'wrong'", ("shares", "says"), ("shares",))
    if fields is None:
        return (0.0,), None
    shares = [reading.number(item, "a share", 0, 1) for item in fields.items("shares")]
    says = fields.get("says")
    wrong: WrongFeedback | None = "any"
    if isinstance(says, Mapping):
        wrong = read_vector(reading, says, "what wrong feedback says", space)
    elif says is not None:
        word = reading.choice(says, "'says'", ("any", "another"))
        wrong = None if word is None else "another" if word == "another" else "any"
    return tuple(share for share in shares if share is not None), wrong


def _person(reading: TypedReader, node: Node) -> Person | None:
    keys = ("seconds", "drift", "noise", "tolerance", "better", "worse", "hold")
    fields = reading.fields(node, "'person'", keys)
    if fields is None:
        return None
    default = Person()
    seconds = fields.integer("seconds", 1, 1000)
    numbers = {key: fields.number(key, 0) for key in ("drift", "noise", "better", "worse")}
    tolerance = fields.number("tolerance", 0.001)
    hold = fields.duration("hold")
    if hold is not None and hold != math.floor(hold):
        reading.error(
            "out-of-range", fields.nodes["hold"], f"'hold' is {hold:g} s, expected whole seconds"
        )
    return Person(
        seconds=default.seconds if seconds is None else seconds,
        tolerance=default.tolerance if tolerance is None else tolerance,
        hold_s=default.hold_s if hold is None else int(hold),
        **{
            key: getattr(default, key) if value is None else value
            for key, value in numbers.items()
        },
    )
