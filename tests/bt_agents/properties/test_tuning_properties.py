# SPDX-License-Identifier: Apache-2.0
"""Laws of tuning: undo and redo, its files, and values kept in an agent's file."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bt_agents.host.tuning.change_log import ChangeLog, read_history
from bt_agents.host.tuning.history import TuningAction, TuningRevision
from bt_agents.host.tuning.tunable import (
    Setting,
    TunableKind,
    TunableParameter,
    format_value,
    parameters_of,
    profile_values,
)
from bt_agents_core.errors import BtAgentsError, Refused
from bt_agents_core.field_types import FieldType
from bt_agents_language.files.preset_reader import name_problem, preset_text, read_preset
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.yaml.precheck import BAD_CHARACTER
from bt_agents_language.yaml.source import Source
from bt_agents_tools.client.write_back import ParameterState, write_defaults
from faulty_disk import Disk
from file_texts import read_agent_text
from tree_harness import SPACE, SYMBOLS, TREES
from tuning_desk import Desk

NAMES = ("a.x", "a.y", "b.x", "c.x", "rate")
START: Mapping[str, Setting] = dict.fromkeys(NAMES, 0)
SETS = st.dictionaries(st.sampled_from(NAMES), st.integers(0, 9), min_size=1)
TEXTS = st.text(st.characters(exclude_categories=["Cs", "Cc", "Cn", "Co"]), max_size=40).filter(
    lambda text: not BAD_CHARACTER.search(text)
)


def step(desk: Desk, action: TuningAction, *agents: str) -> bool:
    """Undo or redo; return whether there was something."""
    try:
        desk.undo(*agents) if action is TuningAction.UNDO else desk.redo(*agents)
    except Refused:
        return False
    return True


@given(st.lists(SETS, max_size=30))
def test_undos_and_redos_pass_through_all_states(changes):
    desk = Desk(START)
    states = [dict(desk.values)]
    for change in changes:
        desk.set(change)
        if desk.values != states[-1]:
            states.append(dict(desk.values))
    for state in reversed(states[:-1]):
        assert step(desk, TuningAction.UNDO)
        assert desk.values == state
    assert not step(desk, TuningAction.UNDO)
    for state in states[1:]:
        assert step(desk, TuningAction.REDO)
        assert desk.values == state
    assert not step(desk, TuningAction.REDO)


STEPS = st.lists(
    st.one_of(
        SETS,
        st.tuples(
            st.sampled_from([TuningAction.UNDO, TuningAction.REDO]),
            st.sampled_from([(), ("a",), ("b",), ("a", "c")]),
        ),
    ),
    max_size=40,
)


def names(revision: TuningRevision) -> set[str]:
    return {change.name for change in revision.changes}


def done(steps: list[Any]) -> Desk:
    desk = Desk(START)
    for one in steps:
        if isinstance(one, dict):
            desk.set(one)
        else:
            action, agents = one
            step(desk, action, *agents)
    return desk


@given(STEPS)
def test_undoing_everything_restores_the_start_values(steps):
    desk = done(steps)
    while step(desk, TuningAction.UNDO):
        pass
    assert desk.values == START


@given(STEPS, st.sampled_from(["a", "b", "c"]))
def test_agent_undo_reverts_its_whole_last_change(steps, agent):
    desk = done(steps)
    before = dict(desk.values)
    stack = desk.history.undoable
    if not step(desk, TuningAction.UNDO, agent):
        return
    [taken] = [one for one in stack if one not in desk.history.undoable]
    assert any(name.startswith(f"{agent}.") for name in names(taken))
    assert desk.values == before | {change.name: change.before for change in taken.changes}
    later = stack[stack.index(taken) + 1 :]
    assert all(not names(taken) & names(one) for one in later)
    assert step(desk, TuningAction.REDO, agent)
    assert desk.values == before


@settings(deadline=None, max_examples=60)
@given(STEPS)
def test_history_survives_its_file(tmp_path_factory, steps):
    desk = done(steps)
    path = tmp_path_factory.mktemp("log") / "tunings.json"
    log = ChangeLog(path, Disk())
    log.write(desk.history)
    log.close()
    read = read_history(path)
    assert (read.undoable, read.redoable) == (desk.history.undoable, desk.history.redoable)
    assert (read.shown, read.overrides) == (desk.history.shown, desk.history.overrides)
    assert {n: k.value for n, k in read.overrides.items()} == {
        name: value for name, value in desk.values.items() if value != 0
    }


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | TEXTS,
    lambda inner: st.lists(inner, max_size=7) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=8,
)


@settings(deadline=None, max_examples=100)
@given(JSON, st.sampled_from(["revisions", "undoable", "shown", "overrides", "format", ""]))
def test_any_bad_content_is_reported_as_damage(tmp_path_factory, content, key):
    path = tmp_path_factory.mktemp("log") / "tunings.json"
    sound = {"format": 1, "revisions": [], "undoable": [], "redoable": [], "shown": []}
    whole = sound | {"overrides": {}, key: content} if key else content
    path.write_text(json.dumps(whole))
    try:
        log = ChangeLog(path, Disk())
    except BtAgentsError:
        assert key in ("format", "")
        return
    log.close()
    for kept in log.history.overrides.values():
        assert isinstance(kept.value, bool | int | float | str)


@given(
    st.text(st.characters(exclude_categories=["Z", "C"]), min_size=1, max_size=60),
    st.dictionaries(
        st.sampled_from(["a.x", "b.patience", "b.place"]),
        TEXTS | st.sampled_from(["null", "~", "12 s", "-0.5", "010", "1:30", "yes", "x "]),
        min_size=1,
    ),
)
def test_preset_survives_its_file(name, values):
    assume(not name_problem(name))
    read = read_preset(Source("presets/x.yaml", preset_text(name, values)))
    assert (read.name, read.values) == (name, values)


@given(
    st.floats(0, 1e7) | st.sampled_from([8.0, 120.0, 0.25]),
    st.sampled_from([FieldType.DURATION, FieldType.LENGTH, FieldType.ANGLE, FieldType.NUMBER]),
)
def test_formatted_value_parses_to_same_value(value, field_type):
    parameter = TunableParameter(
        name="a.x", agent="a", key="x", kind=TunableKind.TUNABLE, type=field_type, default=0.0
    )
    assert parameter.parse(format_value(value, field_type)) == value


FILES = [
    path.read_text()
    for path in sorted((TREES / "agents").glob("*.yaml"))
    if not path.name.endswith(".test.yaml")
]
STYLES = [
    "{name}: {{default: {default}, min: {low}, max: {high}, description: 'a: b'}}  # {default}",
    "{name}:\n    default: {default}   # now\n    min: {low}\n    max: {high}",
]
VALUES = [
    ("8 s", "1 s", "2 h"), ("8s", "1 s", "2 h"), ("2 min", "1 s", "2 h"), ("90 s", "0 s", "3 h"),
    ("250 ms", "0 ms", "1 h"), ("8", "1 s", "2 h"), ("0.90", "0.5", "400.5"), ("1", "0", "400.5"),
    ("2.0", "1", "400"), ("2", "1", "400"), ("1.5 m", "0 m", "3 km"), ("90 deg", "0 deg", "7 rad"),
]  # fmt: skip
PROFILES = [
    "profile: {age: 3, familiarity: 3.0, mood: 3}  # bid\n",
    "profile:\n  age: 3\n  familiarity: 3.0  # well\n  mood: 3  # fine\n# next\n",
    "profile: {age: 3,\n  familiarity: 3.0, mood: 3\n  }\n",
]
FREE = ["true", "false", "station 4", "'it''s'", '"8 s"', "''"]


@st.composite
def agent_files(draw: st.DrawFn) -> str:
    """An agent file whose tunables are written in many ways."""
    tunables = []
    for number in range(draw(st.integers(1, 5))):
        if draw(st.booleans()):
            default, low, high = draw(st.sampled_from(VALUES))
            style = draw(st.sampled_from(STYLES))
            text = style.format(name=f"t{number}", default=default, low=low, high=high)
        else:
            text = f"t{number}: {{default: {draw(st.sampled_from(FREE))}}}"
        tunables.append(f"  {text}\n")
    rate = draw(st.sampled_from(["", "learning_rate: 0.20  # slow\n", "learning_rate: 1\n"]))
    profile = draw(st.sampled_from(PROFILES))
    end = draw(st.sampled_from(["\n", "\r\n"]))
    text = (
        "# kept\nformat: 1\nagent: a  # name\n" + profile + rate
        + "tunables:\n" + "".join(tunables) + "tree:\n  wait: 0 s\n"
    )  # fmt: skip
    return text.replace("\n", end)


def read_file(text: str) -> AgentSpec:
    return read_agent_text(text, "a.yaml", SYMBOLS)


def values_of(spec: AgentSpec) -> dict[str, TunableParameter]:
    profile = profile_values(spec.name, SPACE.names, spec.profile)
    ranged = [
        replace(value, minimum=one.minimum, maximum=one.maximum)
        for value, one in zip(profile, SPACE.parameters, strict=True)
    ]
    return {parameter.name: parameter for parameter in (*parameters_of(spec), *ranged)}


def another(draw: st.DrawFn, parameter: TunableParameter) -> Setting:
    if parameter.type is FieldType.BOOLEAN:
        return not parameter.default
    if parameter.type is FieldType.TEXT:
        return draw(st.sampled_from(["5", "8 s", "true", "a: b #", "", "yes", "5 sec", "Hi!"]))
    assert parameter.minimum is not None
    assert parameter.maximum is not None
    if parameter.type is FieldType.INTEGER:
        return draw(st.integers(int(parameter.minimum), int(parameter.maximum)))
    steps = draw(st.integers(0, 1000))
    value = parameter.minimum + (parameter.maximum - parameter.minimum) * steps / 1000
    return draw(st.sampled_from([value, float(f"{value:.3g}"), 60.0, 100.0, 3.0]))


@settings(deadline=None, max_examples=200)
@given(st.one_of(agent_files(), st.sampled_from(FILES)), st.data())
def test_keeping_tunings_changes_only_their_values_in_file(text, data):
    spec = read_file(text)
    parameters = values_of(spec)
    chosen = data.draw(st.sets(st.sampled_from(sorted(parameters)), max_size=4))
    wanted: dict[str, Setting] = {}
    for name in sorted(chosen):
        value = another(data.draw, parameters[name])
        try:
            wanted[name] = parameters[name].check(value)
        except Refused:
            continue
    tuned = [
        ParameterState(parameter=parameters[n], value=v)
        for n, v in wanted.items()
        if v != parameters[n].default
    ]
    kept = write_defaults(Source("a.yaml", text), tuned, SPACE, read_file)
    after = values_of(read_file(kept))
    for name, parameter in after.items():
        expected = wanted.get(name, parameters[name].default)
        if isinstance(expected, float) and ".profile." in name:
            assert math.isclose(float(parameter.default), expected, rel_tol=1e-5)
        else:
            assert (parameter.default, type(parameter.default)) == (expected, type(expected))
        for bound in ("type", "minimum", "maximum", "step"):
            assert getattr(parameter, bound) == getattr(parameters[name], bound)
    rate_is_new = any(one.parameter.key == "learning_rate" for one in tuned) and (
        re.search(r"\blearning_rate:|\blearning: \{rate:", text) is None
    )
    old, new = text.splitlines(keepends=True), kept.splitlines(keepends=True)
    assert len(new) == len(old) + rate_is_new
    gone = [line for line in difflib.ndiff(old, new) if line.startswith("- ")]
    assert len(gone) <= len(tuned) - rate_is_new
    comments = [line.partition("#")[2] for line in old if "# " in line]
    assert comments == [line.partition("#")[2] for line in new if "# " in line]


def keep(text: str, key: str, value: Setting) -> str:
    """Return an agent's file with one tuned value."""
    [parameter] = (one for one in parameters_of(read_file(text)) if one.key == key)
    tuned = ParameterState(parameter=parameter, value=value)
    return write_defaults(Source("a.yaml", text), [tuned], SPACE, read_file)


HEAD = "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\n"


@pytest.mark.parametrize(
    ("old", "value", "new"),
    [
        ("8 s", 12.0, "12 s"),
        ("8s", 12.0, "12s"),
        ("8", 12.0, "12"),
        ("8 s", 90.0, "90 s"),
        ("2 min", 180.0, "3 min"),
        ("2 min", 90.0, "1.5 min"),
        ("2 min", 100.0, "100 s"),
        ("250 ms", 0.4, "400 ms"),
    ],
)
def test_duration_keeps_author_unit_while_it_fits(old, value, new):
    tunable = f"t: {{default: {old}, min: 0 s, max: 10 min}}  # t"
    text = f"{HEAD}tunables:\n  {tunable}\ntree: {{wait: 0 s}}\n"
    assert keep(text, "t", value) == text.replace(f"default: {old},", f"default: {new},")


@pytest.mark.parametrize(
    ("learning", "kept_as"),
    [
        ("learning: {rate: 0.2, update: median}  # slow\n", "{rate: 0.5, update: median}  # slow"),
        ("learning:\n  rate: 0.2  # slow\n", "rate: 0.5  # slow"),
        ("learning: {update: median}\n", "learning_rate: 0.5"),
    ],
)
def test_learning_rate_is_kept_at_its_original_place(learning, kept_as):
    kept = keep(f"{HEAD}{learning}tree: {{wait: 0 s}}\n", "learning_rate", 0.5)
    assert kept_as in kept
    assert read_file(kept).learning_rate == 0.5
