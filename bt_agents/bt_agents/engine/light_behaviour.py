# SPDX-License-Identifier: Apache-2.0
"""Behaviours that are made quickly: what hardly anybody asks of a node is made when asked for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from uuid import UUID, uuid4

from py_trees import composites
from py_trees.behaviour import Behaviour
from py_trees.blackboard import Client
from py_trees.common import BlackBoxLevel
from py_trees.logging import Logger

from bt_agents.engine.halting import INVALID


class LightBehaviour(Behaviour):
    """A behaviour without a random number, a logger and a generator of its own.

    Among the bases of a class it has to stand behind those of py_trees.
    """

    logger = Logger("bt_agents")

    def __init__(self, name: str) -> None:
        self.name = name
        self.status = INVALID
        self.feedback_message = ""
        self.parent: Behaviour | None = None
        self.children: list[Behaviour] = []
        self.blackboards: list[Client] = []
        self.blackbox_level = BlackBoxLevel.NOT_A_BLACKBOX

    @cached_property
    def id(self) -> UUID:
        """The unique identifier."""
        return uuid4()

    @cached_property
    def qualified_name(self) -> str:
        """The name with that of the class."""
        return f"{type(self).__qualname__}/{self.name}"

    @cached_property
    def iterator(self) -> Iterator[Behaviour]:
        """A tick to come."""
        ticks: Iterator[Behaviour] = self.tick()
        return ticks


class LightSequence(composites.Sequence, LightBehaviour):
    """A sequence."""

    def __init__(self, name: str, memory: bool, children: Iterable[Behaviour]) -> None:
        composites.Sequence.__init__(self, name, memory)
        adopt(self, children)


class LightSelector(composites.Selector, LightBehaviour):
    """A selector."""

    def __init__(self, name: str, memory: bool, children: Iterable[Behaviour]) -> None:
        composites.Selector.__init__(self, name, memory)
        adopt(self, children)


def adopt(parent: Behaviour, children: Iterable[Behaviour]) -> None:
    """Put nodes below a new one, without a look at their identifiers."""
    parent.children = list(children)
    for child in parent.children:
        child.parent = parent
