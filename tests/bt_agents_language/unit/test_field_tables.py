# SPDX-License-Identifier: Apache-2.0
"""Field tables: one declaration for both the reader and the JSON Schema."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import yaml
from jsonschema import Draft7Validator

from bt_agents_language.files.file_kinds import FILE_KINDS
from bt_agents_language.tools.schema.generator import file_schema
from bt_agents_language.yaml.field_tables import (
    NAME,
    TEXT,
    Either,
    Entries,
    FieldDecl,
    FileKind,
    Items,
    KeyTable,
    Several,
    WordChoice,
    integer,
    number,
    one_of,
)
from bt_agents_language.yaml.source import Source
from bt_agents_language.yaml.typed_reader import TypedReader
from tree_harness import SPACE

CUP = KeyTable(
    what="a cup",
    fields=(
        FieldDecl("size", number(0.1, 2), "How much goes into it.", required=True),
        FieldDecl("sort", WordChoice(("tea", "coffee")), "What is in it."),
    ),
)
BAR = FileKind(
    name="bar",
    what="a bar",
    title="Bar",
    description="Cups.",
    fields=(
        FieldDecl("guests", integer(1), "How many.", required=True),
        FieldDecl("cups", Items(CUP, empty="there is no cup"), "All of them."),
        FieldDecl("names", Entries(TEXT, "names and texts"), "Who drinks."),
        FieldDecl("owner", NAME, "Whose it is."),
    ),
)


def read(text: str) -> list[str]:
    """Read a file with a reader that takes everything from the table."""
    reading = TypedReader(Source("bar.yaml", f"format: 1\n{text}"))
    fields = reading.file(BAR)
    fields.integer("guests")
    for node in fields.items("cups"):
        cup = reading.keys(node, CUP)
        if cup is not None:
            cup.number("size")
            cup.choice("sort")
    fields.entries("names")
    fields.name("owner")
    return [f"{one.code}: {one.message}" for one in reading.problems.sorted()]


SOUND = "guests: 2\ncups: [{size: 0.2, sort: tea}]\nnames: {anna: hello}\nowner: anna\n"


@pytest.mark.parametrize(
    ("written", "wrong", "problem"),
    [
        ("guests: 2", "guests: 0", "out-of-range: 'guests' is 0, expected 1 or more"),
        ("size: 0.2", "size: 3", "out-of-range: 'size' is 3, expected 0.1 to 2"),
        ("sort: tea", "sort: milk", "bad-choice: 'sort' is 'milk', expected tea or coffee"),
        ("size: 0.2, ", "", "missing-key: a cup needs the key 'size'"),
        ("size: 0.2", "size: 0.2, colour: red", "unknown-key: a cup has no key 'colour'"),
        ("[{size: 0.2, sort: tea}]", "[]", "missing-value: there is no cup"),
        ("{anna: hello}", "anna", "wrong-type: 'names': expected a mapping of names and texts, "
         "found 'anna'"),
        ("owner: anna", "owner: 4 friends", "bad-name: 'owner' is '4 friends', expected small "
         "letters a-z, digits and '_', a letter first, at most 64 characters"),
    ],
)  # fmt: skip
def test_reader_and_schema_reject_the_same_values(written, wrong, problem):
    validator = Draft7Validator(file_schema(BAR, SPACE))
    assert read(SOUND) == []
    assert validator.is_valid({"format": 1, **yaml.safe_load(SOUND)})
    broken = SOUND.replace(written, wrong)
    assert read(broken) == [problem]
    assert not validator.is_valid({"format": 1, **yaml.safe_load(broken)})


def test_table_can_require_one_of_several_keys():
    keys = ("each", "sequence")
    fields = tuple(FieldDecl(key, TEXT) for key in keys)
    for exclusive, both in ((False, True), (True, False)):
        table = KeyTable(fields=fields, needs=one_of(keys, "write one", exclusive=exclusive))
        kind = FileKind(
            name="bar",
            title="Bar",
            description="One.",
            fields=(FieldDecl("bar", table, required=True),),
        )
        validator = Draft7Validator(file_schema(kind, SPACE))
        assert not validator.is_valid({"format": 1, "bar": {}})
        assert validator.is_valid({"format": 1, "bar": {"each": "a"}})
        assert validator.is_valid({"format": 1, "bar": {"each": "a", "sequence": "b"}}) is both


def tables(value: object) -> Iterator[KeyTable]:
    match value:
        case KeyTable():
            yield value
            for field in value.fields:
                yield from tables(field.value)
        case Items(item=inner) | Entries(value=inner) | Several(one=inner):
            yield from tables(inner)
        case Either(options=options):
            for option in options:
                yield from tables(option)


@pytest.mark.parametrize("kind", FILE_KINDS.values(), ids=FILE_KINDS)
def test_table_lists_each_key_once(kind):
    for table in (*tables(kind), *kind.shared.values()):
        assert len(table.values) == len(table.fields)


def test_extended_table_keeps_order_of_replaced_fields():
    other = FieldDecl("size", TEXT, "Small or large.")
    table = CUP.extended(other, FieldDecl("colour", TEXT, "Of what colour."))
    assert [*table.values] == ["size", "sort", "colour"]
    assert table.values["size"] is TEXT
    assert table.required == ()
    assert [*table.only(("colour", "size")).values] == ["size", "colour"]
