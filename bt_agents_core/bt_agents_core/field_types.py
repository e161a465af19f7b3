# SPDX-License-Identifier: Apache-2.0
"""Types of the values that files, trees and messages share, and kinds of ROS interfaces."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

Plain = None | bool | int | float | str | tuple["Plain", ...] | Mapping[str, "Plain"]
"""A value that contains no names."""


class FieldType(Enum):
    """Types of fields, tunables, inputs and outputs; the value is the word in files."""

    TEXT = "text"
    NUMBER = "number"
    INTEGER = "integer"
    BOOLEAN = "boolean"
    DURATION = "duration"
    LENGTH = "length"
    ANGLE = "angle"
    ANY = "any"

    # Enum computes its hash each time, and these are keys wherever a file is read.
    __hash__ = object.__hash__


class BindingKind(Enum):
    """Kind of ROS interface that a skill or leaf uses; the value is the word in files."""

    ACTION = "action"
    SERVICE = "service"
    TOPIC = "topic"


INTERFACE_FOLDERS: Mapping[BindingKind, str] = {
    BindingKind.ACTION: "action",
    BindingKind.SERVICE: "srv",
    BindingKind.TOPIC: "msg",
}
"""The middle part of a type's name for each kind of interface."""
