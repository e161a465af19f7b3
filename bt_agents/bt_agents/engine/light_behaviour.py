# SPDX-License-Identifier: Apache-2.0
"""Base class of every node: a py_trees behaviour that is fast to create and to stop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from types import MappingProxyType
from uuid import UUID, uuid4

from py_trees.behaviour import Behaviour
from py_trees.blackboard import Client
from py_trees.common import BlackBoxLevel, Status
from py_trees.logging import Logger

from bt_agents_core.field_types import Plain

# Access to a member of an Enum takes as long as three calls in Python 3.11.
SUCCESS, FAILURE, RUNNING, INVALID = (
    Status.SUCCESS,
    Status.FAILURE,
    Status.RUNNING,
    Status.INVALID,
)


class LightBehaviour(Behaviour):
    """A behaviour that creates its identifier and generator only when py_trees tools use them.

    It must precede the py_trees classes among the bases of a class, because their ``__init__`` is
    not called. Its children are compared by identity and never change.

    Attributes:
        changes_values: True if it may end without having another status than before, but with
            other values; each such end is reported.
        changed: Name → value of all that it has changed since it was last reported.
    """

    logger = Logger("bt_agents")
    changes_values = False
    changed: Mapping[str, Plain] = MappingProxyType({})

    def __init__(self, name: str, children: Iterable[Behaviour] = ()) -> None:
        self.name = name
        self.status = INVALID
        self.feedback_message = ""
        self.parent: Behaviour | None = None
        self.children: list[Behaviour] = list(children)
        self.blackboards: list[Client] = []
        self.blackbox_level = BlackBoxLevel.NOT_A_BLACKBOX
        for child in self.children:
            child.parent = self

    def stop(self, new_status: Status) -> None:
        self.terminate(new_status)
        self.status = new_status

    def note_change(self, name: str, value: Plain) -> None:
        """Note that it has changed the value of a name."""
        # Most nodes never change a value, so none has a mapping of its own before.
        self.changed = {**self.changed, name: value}

    @cached_property
    def id(self) -> UUID:
        """The unique identifier."""
        return uuid4()

    @cached_property
    def qualified_name(self) -> str:
        """The name with the name of the class."""
        return f"{type(self).__qualname__}/{self.name}"

    @cached_property
    def iterator(self) -> Iterator[Behaviour]:
        """The generator of one tick."""
        ticks: Iterator[Behaviour] = self.tick()
        return ticks
