# SPDX-License-Identifier: Apache-2.0
"""Facts about a person: typed, bounded, and separate from other values."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from bt_agents_core.errors import Refused
from bt_agents_core.field_types import FieldType
from bt_agents_core.person_facts import (
    LONGEST_FACT,
    MOST_FACTS,
    Fact,
    fact,
    facts,
    from_message_fields,
    message_fields,
    values_of,
)
from tree_harness import scene


@pytest.mark.parametrize(
    ("value", "wanted", "expected"),
    [
        ("tea", FieldType.TEXT, "tea"),
        (2, FieldType.NUMBER, 2.0),
        (False, FieldType.BOOLEAN, False),
        (0.5, None, 0.5),
    ],
)
def test_text_number_and_boolean_are_valid_facts(
    value: object, wanted: FieldType | None, expected: Fact
) -> None:
    found = fact("favourite", value, wanted)
    assert found == expected
    assert type(found) is type(expected)
    assert from_message_fields(message_fields("favourite", found)) == ("favourite", expected)


@pytest.mark.parametrize(
    ("key", "value", "wanted", "code"),
    [
        ("Favourite", "tea", None, "BAD_KEY"),
        ("", "tea", None, "BAD_KEY"),
        ("a" * 65, "tea", None, "BAD_KEY"),
        ("a", True, FieldType.NUMBER, "BAD_VALUE"),
        ("a", 1.0, FieldType.BOOLEAN, "BAD_VALUE"),
        ("a", "1", FieldType.NUMBER, "BAD_VALUE"),
        ("a", math.nan, None, "BAD_VALUE"),
        ("a", 10**400, None, "BAD_VALUE"),
        ("a", "x" * (LONGEST_FACT + 1), None, "BAD_VALUE"),
        ("a", ["tea"], None, "BAD_VALUE"),
    ],
)
def test_other_fact_types_are_refused(
    key: str, value: object, wanted: FieldType | None, code: str
) -> None:
    with pytest.raises(Refused) as refused:
        fact(key, value, wanted)
    assert refused.value.code == code
    assert len(refused.value.reason) < 200


def test_facts_of_person_are_bounded_and_unique() -> None:
    many = [(f"k{number}", "x") for number in range(MOST_FACTS + 1)]
    assert len(facts(many[:-1])) == MOST_FACTS
    assert facts([("a", "x"), ("b", None)]) == {"a": "x"}
    for given, code in ((many, "TOO_MANY"), ([("a", 1), ("a", 2)], "DUPLICATE_KEY")):
        with pytest.raises(Refused, match=f"^{code}: "):
            facts(given)


def test_list_fact_is_refused_and_unset_fact_forgets() -> None:
    def message(kind: int) -> SimpleNamespace:
        return SimpleNamespace(key="a", value=SimpleNamespace(type=kind, integer_value=3))

    assert values_of([message(0), message(2)]) == [("a", None), ("a", 3)]
    for messages, code in (([message(9)], "BAD_VALUE"), ([message(0)] * 33, "TOO_MANY")):
        with pytest.raises(Refused, match=f"^{code}: "):
            values_of(messages)


def test_only_known_person_has_name_and_facts() -> None:
    anna = replace(scene(), person_id="anna", visits=2, remembered={"favourite": "tea"})
    assert [anna.of_person(one) for one in ("name", "visits", "favourite")] == ["anna", 2, "tea"]
    for nobody in (replace(anna, visits=0), replace(anna, person_id="")):
        for member in ("name", "visits", "favourite"):
            with pytest.raises(KeyError):
                nobody.of_person(member)
