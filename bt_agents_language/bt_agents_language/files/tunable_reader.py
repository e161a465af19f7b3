# SPDX-License-Identifier: Apache-2.0
"""Reader of tunables: values with a range that may change while a tree runs."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType, Plain
from bt_agents_core.scene import MAX_VALUE
from bt_agents_core.text import ellipsize, join_quoted, join_words, quote
from bt_agents_language.expression import quantities
from bt_agents_language.expression.quantities import format_quantity
from bt_agents_language.expression.units import DIMENSIONS, UNITS
from bt_agents_language.model.specs import Tunable
from bt_agents_language.yaml.field_tables import AMOUNT, TEXT, FieldDecl, KeyTable
from bt_agents_language.yaml.scalars import boolean
from bt_agents_language.yaml.typed_reader import MappingReader, TypedReader, adding, found
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar, entries_of, several

TUNABLE = KeyTable(
    fields=(
        FieldDecl(
            "default",
            TEXT,
            "Value at the start, which sets the type: 2, 2.0, 8 s, true, a text.",
            required=True,
        ),
        FieldDecl("min", AMOUNT, "Smallest value."),
        FieldDecl("max", AMOUNT, "Largest value."),
        FieldDecl("step", AMOUNT, "Step between allowed values, starting at 'min'."),
        FieldDecl("description", TEXT, "What it changes, in words."),
    )
)

_RANGE = ("min", "max", "step")
_SPANS = ("range", "limits", "between")
_STEP_TOLERANCE = 1e-6
_DIGITS = 6


def read_tunable(reading: TypedReader, entry: MappingEntry, name: str) -> Tunable | None:
    """Return a tunable, or report that it is wrong and return None.

    The default determines the type: ``2`` is an integer, ``2.0`` a number, ``8 s`` a duration,
    ``1.5 m`` a length, ``90 deg`` an angle, ``true`` a boolean, anything else a text. An integer
    with a fractional range is a number.
    """
    what = f"tunable '{name}'"
    if isinstance(entry.value, Scalar) and not entry.value.empty:
        reading.error(
            "wrong-type",
            entry.value,
            f"{what} needs a default and a range, found {found(entry.value)}",
            f"write {{default: {entry.value.text[:20]}, min: …, max: …, description: …}}",
        )
        return None
    span = next((one for one in entries_of(entry.value) if one.key.text in _SPANS), None)
    if span is not None:
        written = " to ".join(one.text for one in several(span.value) if isinstance(one, Scalar))
        low, high = map(ellipsize, quantities.ends_of(written) or ("…", "…"))
        message = f"{what} has no key '{span.key.text}'"
        reading.error("unknown-key", span.key, message, f"write min: {low}, max: {high}")
        return None
    fields = reading.keys(entry.value, TUNABLE, what)
    default = fields.get("default") if fields is not None else None
    if fields is None or default is None:
        return None
    if not isinstance(default, Scalar) or default.empty:
        reading.wrong_type(default, f"the default of {what}", "a number, time, length or text")
        return None
    before = len(reading.problems)
    description = fields.text("description")
    field_type = _type(default, [fields.get(key) for key in _RANGE])
    value = read_setting(reading, default, f"the default of {what}", field_type)
    minimum, maximum, step = None, None, 0.0
    if value is None:
        return None
    if isinstance(value, str | bool):
        _refuse_range(reading, fields, what, field_type)
        _warn_of_quantity(reading, default, what)
    else:
        limits = _range(reading, fields, entry, what, field_type)
        if limits is None:
            return None
        minimum, maximum, step = limits
    tunable = Tunable(
        name=name,
        type=field_type,
        default=value,
        minimum=minimum,
        maximum=maximum,
        step=step,
        description=description,
        position=entry.key.position,
    )
    check_setting(reading, default, f"the default of {what}", value, tunable)
    return tunable if len(reading.problems) == before else None


def _type(default: Scalar, limits: list[Node | None]) -> FieldType:
    texts = [node.text for node in limits if isinstance(node, Scalar)]
    text = default.text
    if not default.plain:
        return FieldType.TEXT
    if boolean(text) is not None:
        return FieldType.BOOLEAN
    types = [quantities.quantity_type(one, strict=False) for one in (text, *texts)]
    meant = [one for one in types if one is not None]
    if meant[:1] == [FieldType.LENGTH] and {*meant[1:]} == {FieldType.DURATION}:
        # Metres together with limits in seconds are misspelled minutes.
        return FieldType.DURATION
    if meant:
        return meant[0]
    # Without a range 1:30 can be a text.
    if texts and any(map(quantities.is_clock, (text, *texts))):
        return FieldType.DURATION
    if not _is_numeric(text):
        return FieldType.NUMBER if any(map(_is_numeric, texts)) else FieldType.TEXT
    numbers = (text, *filter(_is_numeric, texts))
    whole = all(one.strip().lstrip("+-").isdigit() for one in numbers)
    return FieldType.INTEGER if whole else FieldType.NUMBER


def _is_numeric(text: str) -> bool:
    try:
        quantities.number(text)
    except quantities.QuantityError:
        return text[:1].isdigit() and text.replace(".", "").isdigit()
    return True


def _refuse_range(
    reading: TypedReader, fields: MappingReader, what: str, field_type: FieldType
) -> None:
    keys = [key for key in _RANGE if fields.get(key) is not None]
    if keys:
        default = fields.nodes["default"]
        quoted = isinstance(default, Scalar) and not default.plain
        reading.error(
            "unknown-key",
            fields.keys[keys[0]],
            f"{what} is a {field_type.value}, which has no {join_quoted(keys)}",
            "write the default without quotes" if quoted else f"remove {join_quoted(keys)}",
        )


def _warn_of_quantity(reading: TypedReader, default: Scalar, what: str) -> None:
    unit = quantities.word_after_number(default.text)
    if not unit:
        return
    hint = f"{quote(unit)} is not a unit; the units are {join_words([*UNITS], 'and')}"
    meant = quantities.quantity_type(default.text, strict=False)
    if meant is not None:
        try:
            quantities.quantity(default.text, meant)
        except quantities.QuantityError as error:
            hint = f"{error.message}; {error.hint}" if error.hint else error.message
        else:
            hint = f"write it without quotes: {default.text}"
    reading.warning(
        "quantity-as-text",
        default,
        f"the default of {what} looks like a quantity, but is read as a text",
        hint,
    )


def read_setting(
    reading: TypedReader, node: Scalar, what: str, field_type: FieldType
) -> bool | int | float | str | None:
    """Return a value of a tunable of this type, or report that it is wrong and return None."""
    if field_type is FieldType.BOOLEAN:
        return reading.boolean(node, what)
    if field_type is FieldType.TEXT:
        return reading.text(node, what, empty=not node.plain)
    return reading.amount(node, what, field_type)


def _range(
    reading: TypedReader,
    fields: MappingReader,
    entry: MappingEntry,
    what: str,
    field_type: FieldType,
) -> tuple[float | None, float | None, float] | None:
    """Return minimum, maximum and step, 0 for none; report wrong ones and return None."""
    lowest = fields.get("min")
    if isinstance(lowest, Scalar) and (ends := quantities.ends_of(lowest.text)):
        reading.error(
            "bad-number",
            lowest,
            f"'min' of {what}: expected a number, found {found(lowest)}",
            f"write min: {ends[0]}, max: {ends[1]}",
        )
        return None
    before = len(reading.problems)
    needed = [key for key in ("min", "max") if fields.get(key) is None]
    limits = {
        key: reading.amount(node, f"'{key}' of {what}", field_type)
        for key in _RANGE
        if (node := fields.get(key)) is not None
    }
    for key, value in limits.items():
        if value is not None:
            reading.in_range(
                fields.nodes[key], f"'{key}' of {what}", value, -MAX_VALUE, MAX_VALUE, field_type
            )
    # Only a quantity can do without a range; but half a range is useless.
    if needed and (field_type not in DIMENSIONS or len(needed) == 1):
        reading.error(
            "missing-key",
            entry.key,
            f"{what} needs {' and '.join(needed)}, so that it can be a slider",
            adding(needed),
        )
    if len(reading.problems) > before:
        return None
    minimum, maximum, step = (limits.get(key) for key in _RANGE)
    if not fields.check_range(what, minimum, maximum, field_type):
        return None
    if step is not None and (step <= 0 or minimum is None):
        reading.error(
            "out-of-range",
            fields.nodes["step"],
            f"'step' of {what} needs a number above 0, and a 'min' that it counts from",
            "remove 'step' to allow every value",
        )
        return None
    width = 0.0 if minimum is None or maximum is None else maximum - minimum
    if step and width / step > MAX_VALUE:
        reading.error(
            "out-of-range",
            fields.nodes["step"],
            f"'step' of {what} is too small for a range of that size",
            "remove 'step' to allow every value",
        )
        return None
    return minimum, maximum, step or 0.0


def check_setting(
    reading: TypedReader, node: Node, what: str, value: Plain, tunable: Tunable
) -> bool:
    """Return whether a value of a tunable is in its range and on a step; report it if not."""
    low, high, step = tunable.minimum, tunable.maximum, tunable.step
    if not isinstance(value, int | float):
        return True
    if not reading.in_range(node, what, value, low, high, tunable.type):
        return False
    if not step or low is None or value == high:
        return True
    steps = (value - low) / step
    if abs(steps - round(steps)) <= _STEP_TOLERANCE:
        return True
    shown, shown_step, near = (
        format_quantity(one, tunable.type, _DIGITS)
        for one in (value, step, low + round(steps) * step)
    )
    reading.error(
        "off-step",
        node,
        f"{what} is {shown}, which is not 'min' plus a number of steps of {shown_step}",
        f"write {near}",
    )
    return False
