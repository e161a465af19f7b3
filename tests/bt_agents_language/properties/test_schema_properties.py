# SPDX-License-Identifier: Apache-2.0
"""The schema for editors accepts what a reader accepts, in every notation."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from jsonschema import Draft7Validator

from bt_agents_core.errors import ReadError
from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.tools.schema.folder import schema_of
from core_schema import loaded
from file_texts import read_agent_text
from tree_harness import SYMBOLS

HEAD = "format: 1\nagent: a\nprofile: {age: 3, familiarity: 3, mood: 3}\n"
SCHEMA = Draft7Validator(schema_of(AGENT, SYMBOLS))
WORDS = st.sampled_from(
    ["true", "False", "null", "forever", "all", "one", "live.person", "${live.age}", "$${", "3 s"]
)
SCALARS = st.one_of(
    WORDS,
    st.text("0123456789.+-eE smhinTrueF", min_size=1, max_size=8),
    st.integers(-9, 9).map(str),
    st.floats(allow_nan=False).map(repr),
)
WRITTEN = st.one_of(SCALARS, SCALARS.map(lambda text: f"'{text}'"))
PLACES = [
    "wait: {}",
    "check: {}",
    "say: {}",
    "set: {{x: {}}}",
    "log: {{message: x, level: {}}}",
    "say: {{text: x, rate: {}}}",
    "light: {{colour: red, blink: {}}}",
    "ask: {{text: x, choices: {}}}",
    "sequence: {{memory: {}, children: [{{wait: 1 s}}]}}",
    "parallel: {{succeed_on: {}, children: [{{wait: 1 s}}]}}",
    "random: {{seed: {}, children: [{{wait: 1 s}}]}}",
    "random: [{{wait: 1 s, weight: {}}}]",
    "give_feedback: {}",
    "give_feedback: {{kind: direct, values: {{age: {}}}}}",
    "wait: 1 s\n  retry: {}",
    "wait: 1 s\n  repeat: {{times: 3, pause: {}}}",
    "wait: 1 s\n  timeout: {}",
    "wait: 1 s\n  timeout: {{limit: {}}}",
    "wait: 1 s\n  while: {}",
    "wait: 1 s\n  invert: {}",
    "wait: 1 s\n  name: {}",
]


@pytest.mark.parametrize("place", PLACES)
@given(written=WRITTEN)
@example(written="' 5 '")
@example(written="'${1 + 1}'")
def test_schema_accepts_trees_the_reader_accepts(place, written):
    text = f"{HEAD}tree:\n  {place.format(written)}\n"
    try:
        read_agent_text(text, "a.yaml", SYMBOLS)
    except ReadError:
        return
    assert [error.message for error in SCHEMA.iter_errors(loaded(text))] == []


@given(
    written=WRITTEN,
    key=st.sampled_from(["default: 3, min: {}", "default: {}", "default: 1 s, min: 0, max: {}"]),
)
def test_schema_accepts_tunables_the_reader_accepts(written, key):
    tunable = key.format(written)
    text = f"{HEAD}tunables: {{t: {{{tunable}}}}}\ntree: {{say: '${{t}}'}}\n"
    try:
        read_agent_text(text, "a.yaml", SYMBOLS)
    except ReadError:
        return
    assert [error.message for error in SCHEMA.iter_errors(loaded(text))] == []
