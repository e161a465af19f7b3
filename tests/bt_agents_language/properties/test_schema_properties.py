# SPDX-License-Identifier: Apache-2.0
"""The schema for editors accepts what a reader accepts, in every notation."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from jsonschema import Draft7Validator

from agent_texts import HEAD, agent_of, problems_of
from bt_agents_language.files.agent_reader import AGENT
from bt_agents_language.tools.schema.folder import schema_of
from core_schema import loaded
from tree_harness import SYMBOLS

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
    "say: '${{t}}'\ntunables: {{t: {{default: 3, min: {}}}}}",
    "say: '${{t}}'\ntunables: {{t: {{default: {}}}}}",
    "say: '${{t}}'\ntunables: {{t: {{default: 1 s, min: 0, max: {}}}}}",
]


@pytest.mark.parametrize("place", PLACES)
@given(written=WRITTEN)
@example(written="' 5 '")
@example(written="'${1 + 1}'")
def test_schema_accepts_agents_the_reader_accepts(place, written):
    keys = f"tree:\n  {place.format(written)}\n"
    if not problems_of(agent_of, keys):
        assert [error.message for error in SCHEMA.iter_errors(loaded(HEAD + keys))] == []
