# SPDX-License-Identifier: Apache-2.0
"""Laws of values: reading returns what was written, and quantities are finite."""

from __future__ import annotations

from contextlib import suppress
from fractions import Fraction
from functools import partial

from hypothesis import given, settings
from hypothesis import strategies as st

from bt_agents_core.field_types import FieldType
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.expression.quantities import QuantityError, integer, number, quantity
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.yaml_reader import Mapping, Node, Scalar, Sequence, read_yaml

scalars = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), max_size=8)
plain = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(scalars.filter(bool), inner, max_size=4)
    ),
    max_leaves=12,
)


def written(value: object) -> str:
    """Return a value in flow style, every text in double quotes."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{written(k)}: {written(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(written, value)) + "]"
    return '"' + str(value).replace("\\", "\\\\").replace('"', '\\"') + '"'


def content(node: Node) -> object:
    match node:
        case Scalar():
            return node.text
        case Sequence():
            return [content(item) for item in node.items]
        case Mapping():
            return {entry.key.text: content(entry.value) for entry in node.entries}


@settings(deadline=None)
@given(plain)
def test_written_values_are_read_back_with_span(value):
    text = f"k: {written(value)}\n"
    problems = Diagnostics(None)
    root = read_yaml(Source("a.yaml", text), problems)
    assert not len(problems)
    assert isinstance(root, Mapping)
    assert content(root) == {"k": value}
    (entry,) = root.entries
    assert text[slice(*entry.value.span)] == written(value)


@given(st.text(max_size=30))
def test_quantities_are_finite_or_rejected(text):
    duration = partial(quantity, field_type=FieldType.DURATION)
    for read, low in ((number, -1e308), (integer, -(2**63)), (duration, 0.0)):
        with suppress(QuantityError):
            assert low <= read(text) <= 1e308


@given(
    st.integers(0, 500_000), st.sampled_from([("ms", Fraction(1, 1000)), ("s", 1), ("min", 60)])
)
def test_time_is_number_times_unit(amount, unit):
    name, seconds = unit
    assert quantity(f"{amount} {name}", FieldType.DURATION) == float(amount * seconds)
