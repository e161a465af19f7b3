# SPDX-License-Identifier: Apache-2.0
"""Tunable parameters: type, range and check of a value, and its written form."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from bt_agents_core.errors import Refused
from bt_agents_core.field_types import FieldType
from bt_agents_core.refusal_codes import RefusalCode
from bt_agents_core.text import printable, quote
from bt_agents_language.expression import quantities
from bt_agents_language.expression.quantities import MAX_DURATION_S, QuantityError, format_quantity
from bt_agents_language.model.specs import AgentSpec
from bt_agents_language.yaml.precheck import BAD_CHARACTER
from bt_agents_language.yaml.scalars import boolean

Setting = bool | int | float | str
"""Value of a tunable parameter; times, lengths and angles in SI units."""

LONGEST_TEXT = 1000
"""Most characters of a tuned text."""

_STEP_TOLERANCE = 1e-6
_DIGITS = 6
_UNITS = {FieldType.DURATION: "s", FieldType.LENGTH: "m", FieldType.ANGLE: "rad"}
_TYPES: Mapping[FieldType, type] = {
    FieldType.BOOLEAN: bool,
    FieldType.INTEGER: int,
    FieldType.TEXT: str,
}

_TYPE_WORDS: Mapping[type, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number with a decimal point",
    str: "a text",
}


class TunableKind(Enum):
    """Kind of a value; a profile is not a ROS parameter, but files hold it in the same way."""

    TUNABLE = "tunable"
    LEARNING_RATE = "learning rate"
    PROFILE = "profile"
    TICK_RATE = "tick rate"


@dataclass(frozen=True, kw_only=True, slots=True)
class TunableParameter:
    """Description of a tunable value: a ROS parameter of the host.

    Attributes:
        name: Name of the parameter: ``attentive_guide.patience``.
        agent: Agent of the parameter; empty for a parameter of the whole host.
        key: Name without the agent: ``patience``, ``age`` of a profile.
        kind: What it belongs to.
        type: Type of its value.
        default: Value in the file, in SI units.
        minimum: Smallest value; None for texts, booleans and quantities without a range.
        maximum: Largest value.
        step: Distance between allowed values, starting at ``minimum``; 0 allows all.
        description: Meaning of the value.
    """

    name: str
    agent: str
    key: str
    kind: TunableKind
    type: FieldType
    default: Setting
    minimum: float | None = None
    maximum: float | None = None
    step: float = 0.0
    description: str = ""

    @property
    def unit(self) -> str:
        """SI unit of the value; empty for none."""
        return _UNITS.get(self.type, "")

    def read(self, text: str) -> Setting:
        """Return the value of a text: ``12``, ``12 s``, ``2 min``.

        Raises:
            Refused: ``NOT_A_VALUE``, or as in :meth:`check`.
        """
        try:
            return self.check(self.parse(text))
        except QuantityError as error:
            hint = f"; {error.hint}" if error.hint else ""
            raise Refused(RefusalCode.NOT_A_VALUE, f"{self.name}: {error.message}{hint}") from None

    def parse(self, text: str) -> Setting:
        """Return the value of a text, whether it is possible or not.

        Raises:
            QuantityError: The text is not a value.
        """
        if self.type in _UNITS:
            return quantities.quantity(text, self.type)
        if self.type is FieldType.INTEGER:
            return quantities.integer(text)
        if self.type is FieldType.BOOLEAN:
            value = boolean(text.strip())
            if value is None:
                raise QuantityError(f"expected true or false, found {quote(text)}")
            return value
        return text if self.type is FieldType.TEXT else quantities.number(text)

    def check(self, value: Setting) -> Setting:
        """Check a value of this parameter and return it.

        Raises:
            Refused: ``WRONG_TYPE``, ``NOT_FINITE``, ``OUT_OF_RANGE``, ``OFF_STEP`` or
                ``NOT_A_VALUE`` for a text that no file can hold.
        """
        wanted = _TYPES.get(self.type, float)
        if type(value) is not wanted:
            raise Refused(
                RefusalCode.WRONG_TYPE,
                f"{self.name} is {quote(str(value))}, a {type(value).__name__}; expected "
                f"{_TYPE_WORDS[wanted]}",
            )
        if isinstance(value, str):
            self._check_text(value)
        elif not isinstance(value, bool):
            self._check_number(value)
        return value

    def _check_text(self, value: str) -> None:
        if len(value) > LONGEST_TEXT:
            raise Refused(
                RefusalCode.NOT_A_VALUE,
                f"{self.name} has {len(value)} characters, expected at most {LONGEST_TEXT}",
            )
        if BAD_CHARACTER.search(value):
            raise Refused(
                RefusalCode.NOT_A_VALUE,
                f"{self.name} has a control character, which no file can hold",
            )

    def _check_number(self, value: float) -> None:
        if not math.isfinite(value):
            raise Refused(
                RefusalCode.NOT_FINITE,
                f"{self.name} is {value}, expected a number{self._limits()}",
            )
        low, high = self.minimum, self.maximum
        if low is None and self.type is FieldType.DURATION:
            low, high = 0.0, MAX_DURATION_S
        if low is not None and high is not None and not low <= value <= high:
            raise Refused(
                RefusalCode.OUT_OF_RANGE,
                f"{self.name} is {format_quantity(value, self.type, _DIGITS)}, expected "
                f"{self.format(low)} to {self.format(high)}",
            )
        if not self.step or low is None or value == high:
            return
        steps = (value - low) / self.step
        if abs(steps - round(steps)) > _STEP_TOLERANCE:
            raise Refused(
                RefusalCode.OFF_STEP,
                f"{self.name} is {format_quantity(value, self.type, _DIGITS)}, expected "
                f"{self.format(low)} and then steps of {self.format(self.step)}; the nearest is "
                f"{format_quantity(low + round(steps) * self.step, self.type, _DIGITS)}",
            )

    def _limits(self) -> str:
        if self.minimum is None or self.maximum is None:
            return ""
        return f" from {self.format(self.minimum)} to {self.format(self.maximum)}"

    def format(self, value: Setting) -> str:
        """Return a value as an author writes it: ``12 s``; :meth:`read` reverses this."""
        return format_value(value, self.type)


def format_value(value: Setting, field_type: FieldType) -> str:
    """Return a value as an author writes it, with as many digits as it needs."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value
    if field_type not in _UNITS:
        short = format_quantity(value, field_type)
        return short if float(short) == value else repr(value)
    for digits in (6, 9, 12, 15, 16, 17):
        text = format_quantity(value, field_type, digits)
        if not math.isfinite(value) or quantities.quantity(text, field_type) == value:
            return text
    return f"{value!r} {_UNITS[field_type]}"


def shown_value(parameter: TunableParameter, value: Setting) -> str:
    """Return a value for people in one line: an empty text as ``''``, a learned one rounded."""
    if parameter.kind is TunableKind.PROFILE:
        return f"{value:g}"
    return printable(parameter.format(value)) or "''"


def same(one: Setting, other: Setting) -> bool:
    """Return whether two values are equal and of the same type."""
    return type(one) is type(other) and one == other


TICK_RATE = TunableParameter(
    name="tick_rate",
    agent="",
    key="tick_rate",
    kind=TunableKind.TICK_RATE,
    type=FieldType.NUMBER,
    default=20.0,
    minimum=1.0,
    maximum=200.0,
    description="ticks of the running tree [1/s]",
)


def parameters_of(spec: AgentSpec) -> tuple[TunableParameter, ...]:
    """Return the parameters of an agent: its tunables and its learning rate."""
    rate = TunableParameter(
        name=f"{spec.name}.learning_rate",
        agent=spec.name,
        key="learning_rate",
        kind=TunableKind.LEARNING_RATE,
        type=FieldType.NUMBER,
        default=float(spec.learning_rate),
        minimum=0.0,
        maximum=1.0,
        description="step of a profile towards feedback",
    )
    tunables = (
        TunableParameter(
            name=f"{spec.name}.{one.name}",
            agent=spec.name,
            key=one.name,
            kind=TunableKind.TUNABLE,
            type=one.type,
            default=one.default if one.type in _TYPES else float(one.default),
            minimum=one.minimum,
            maximum=one.maximum,
            step=one.step,
            description=one.description,
        )
        for one in spec.tunables
    )
    return (*tunables, rate)


def profile_values(
    agent: str, names: Sequence[str], profile: Sequence[float]
) -> tuple[TunableParameter, ...]:
    """Return the values of a profile in a file, as parameters."""
    return tuple(
        TunableParameter(
            name=f"{agent}.profile.{name}",
            agent=agent,
            key=name,
            kind=TunableKind.PROFILE,
            type=FieldType.NUMBER,
            default=float(value),
            description="its bid",
        )
        for name, value in zip(names, profile, strict=True)
    )
