# SPDX-License-Identifier: Apache-2.0
"""Name scope of one imported tree: names that it reads, writes, and gets from outside."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TypeVar

from bt_agents_core.field_types import FieldType
from bt_agents_groot.formulas import (
    ARITHMETIC,
    COMPARISONS,
    Binary,
    Conditional,
    Constant,
    Formula,
    Name,
    Unary,
    dotted_name,
)
from bt_agents_groot.naming import Renaming
from bt_agents_groot.ports import Mention
from bt_agents_language.expression.units import DIMENSIONS

T = TypeVar("T")

_USUAL: Mapping[FieldType, bool | int | float | str] = {
    FieldType.BOOLEAN: False,
    FieldType.NUMBER: 0.0,
    FieldType.INTEGER: 0,
    **dict.fromkeys(DIMENSIONS, 0),
}


def usual_value(field_type: FieldType) -> bool | int | float | str:
    """Return the usual default value of a type."""
    return _USUAL.get(field_type, "")


class TreeNames:
    """Names of one tree during its translation.

    Args:
        mentions: Blackboard entry → how often the tree mentions it.
        given: Entries that callers of the tree set.

    Attributes:
        shared: Entries shared by all trees (``@name``) that the tree mentions.
        written: Names that the tree writes.
    """

    def __init__(self, mentions: Mapping[str, int], given: Collection[str]) -> None:
        self.shared: set[str] = set()
        self.written: set[str] = set()
        self._mentions = mentions
        self._given = given
        self._rename = Renaming()
        self._originals: dict[str, str] = {}
        # Name → whether it is read where no earlier node may have written it.
        self._first: dict[str, bool] = {}
        # Names that an earlier node may have written.
        self._valued: set[str] = set()
        # Names for which an expression has an alternative if they have no value.
        self._tried: set[str] = set()
        self._types: dict[str, FieldType] = {}
        # Name → another name whose value it gets.
        self._same: dict[str, str] = {}
        self._fresh: Counter[str] = Counter()

    def rename(self, entry: str) -> str:
        """Return the name of a blackboard entry in our language."""
        grouped = dotted_name(entry)
        if grouped is not None:
            return grouped
        if entry.startswith("@"):
            self.shared.add(entry)
        name = self._rename(entry)
        self._originals[name] = entry
        return name

    def original(self, name: str) -> str:
        """Return the blackboard entry of a name."""
        return self._originals.get(name, name)

    def fresh(self, prefix: str) -> str:
        """Return a name that is unused in the tree, and record that it is written."""
        self._fresh[prefix] += 1
        name = self._rename(f"{prefix} {self._fresh[prefix]}")
        self.write(name)
        return name

    def is_new(self, entry: str) -> bool:
        """Return whether this is the first of several mentions of an entry."""
        name = self.rename(entry)
        known = name in self._first or name in self._tried or entry in self._given
        return not known and self._mentions.get(entry, 0) > 1

    def read(self, names: Iterable[str], field_type: FieldType = FieldType.ANY) -> None:
        """Record that names are read at a place with a type."""
        for name in names:
            if "." not in name:
                self._first[name] = self._first.get(name, False) or name not in self._valued
                self._add_type(name, field_type)

    def mention(self, mentions: Iterable[Mention], field_type: FieldType = FieldType.ANY) -> None:
        """Record that names occur in expressions of our language."""
        for name, needs_value in mentions:
            if needs_value:
                self.read([name], field_type)
            elif "." not in name:
                self._tried.add(name)

    def write(self, name: str) -> None:
        """Record that a name is written."""
        self._first.setdefault(name, False)
        self._valued.add(name)
        self.written.add(name)

    def exclusive(self, translations: Iterable[Callable[[], T]]) -> list[T]:
        """Return translated parts only one of which runs: none reads what another writes."""
        at_start, at_end = self._valued, set(self._valued)
        parts: list[T] = []
        for translate in translations:
            self._valued = set(at_start)
            parts.append(translate())
            at_end |= self._valued
        self._valued = at_end
        return parts

    def assign(self, name: str, value: Formula) -> None:
        """Record that a name gets the value of a formula."""
        self.read_formula(value)
        self.write(name)
        match value:
            case Name(other) if self._alike(name) != self._alike(other):
                known = self.type_of(name)
                self._same[self._alike(name)] = self._alike(other)
                self._add_type(other, known)
            case Constant(constant):
                self._add_type(name, _type_of(constant))
            case Binary("..", _, _):
                self._add_type(name, FieldType.TEXT)

    def read_formula(self, formula: Formula, field_type: FieldType = FieldType.ANY) -> None:
        """Record that the names of a formula are read, with the types of its operators."""
        match formula:
            case Name(name):
                self.read([name], field_type)
            case Unary(operator, operand):
                operand_type = FieldType.BOOLEAN if operator == "not" else FieldType.NUMBER
                self.read_formula(operand, operand_type)
            case Binary(operator, left, right):
                for one, other in ((left, right), (right, left)):
                    self.read_formula(one, _operand_type(operator, other))
            case Conditional(condition, yes, no):
                self.read_formula(condition, FieldType.BOOLEAN)
                self.read_formula(yes, field_type)
                self.read_formula(no, field_type)

    @property
    def needed(self) -> list[str]:
        """Names that the tree reads where it may not have written them."""
        needed = [name for name, reads in self._first.items() if reads]
        return needed + sorted(self._tried - self._first.keys())

    def default(self, name: str) -> bool | int | float | str:
        """Return a default value of the type that a name is used as."""
        return usual_value(self.type_of(name))

    def type_of(self, name: str) -> FieldType:
        """Return the type that a name is used as; any if unknown."""
        return self._types.get(self._alike(name), FieldType.ANY)

    def is_text(self, formula: Formula) -> bool:
        """Return whether the value of a formula is definitely a text."""
        match formula:
            case Name(name):
                return self.type_of(name) is FieldType.TEXT
            case Constant(value):
                return isinstance(value, str)
            case Binary("+" | "..", left, right):
                return self.is_text(left) or self.is_text(right)
        return False

    def _alike(self, name: str) -> str:
        """Return the representative of the names with the same value."""
        while name in self._same:
            following = self._same[name]
            self._same[name] = self._same.get(following, following)
            name = following
        return name

    def _add_type(self, name: str, field_type: FieldType) -> None:
        one = self._alike(name)
        if self._types.get(one, FieldType.ANY) is FieldType.ANY:
            self._types[one] = field_type


def _type_of(constant: bool | int | float | str) -> FieldType:
    if isinstance(constant, bool | str):
        return FieldType.BOOLEAN if isinstance(constant, bool) else FieldType.TEXT
    return FieldType.INTEGER if isinstance(constant, int) else FieldType.NUMBER


def _operand_type(operator: str, other: Formula) -> FieldType:
    if operator in ("and", "or"):
        return FieldType.BOOLEAN
    if operator in ARITHMETIC or operator in ("<", "<=", ">", ">="):
        return FieldType.NUMBER
    if operator in COMPARISONS:
        match other:
            case Constant(bool()):
                return FieldType.BOOLEAN
            case Constant(int() | float()):
                return FieldType.NUMBER
            case Constant(str()):
                return FieldType.TEXT
            case Binary(inner, _, _) if inner in ARITHMETIC:
                return FieldType.NUMBER
    return FieldType.ANY
