# SPDX-License-Identifier: Apache-2.0
"""What the table of the language says about a node, a modifier, and a field of one."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

from bt_agents_language.model.specs import FieldType, Literal, Plain


class Content(Enum):
    """What may stand in a field of a node."""

    VALUE = "a value, which may hold ${…}"
    CONDITION = "a condition over names"
    CONSTANT = "a value without ${…}"
    ROS_NAME = "the name of a topic, service or action"
    ROS_TYPE = "the name of a ROS type"
    MAP = "fields and their values"
    OUTPUTS = "names and the fields whose values they get"
    TIMEOUTS = "how long the server may take"
    HEARTBEAT = "what the server publishes while it is alive"
    COUNT = "all, one, a number of children, or a list of their names"
    NODE = "a node"


class Children(Enum):
    """How many children a kind of node has."""

    NONE = "none"
    LIST = "list"
    ONE = "one"


@dataclass(frozen=True, kw_only=True)
class NodeField:
    """One field of a kind of node.

    Attributes:
        content: What may stand there.
        type: Type of a value or constant.
        required: Whether it must be written.
        default: Taken when it is not written; None leaves the field out.
        words: The possible texts of a constant; of a value, texts that are possible besides; of
            timeouts, their keys.
        minimum: Smallest possible number.
        message: Name under which a condition sees a message, for example ``msg``.
    """

    name: str
    content: Content = Content.VALUE
    type: FieldType = FieldType.ANY
    required: bool = True
    default: Plain = None
    words: tuple[str, ...] = ()
    minimum: float | None = None
    message: str = ""
    description: str = ""

    @cached_property
    def default_value(self) -> Literal | None:
        """What a node has that does not write it; None when it has nothing then."""
        return None if self.default is None else Literal(value=self.default)


@dataclass(frozen=True, kw_only=True)
class NodeType:
    """One kind of node.

    Attributes:
        key: The word in a file.
        main: Field that a scalar stands for; None when there is none.
        fields: In the order of the documentation.
        children: How many children it has.
        open: True takes names of the author's choice as fields.
        description: One sentence.
        behaviour: Class of a node that a plug-in brings; None for nodes of the language itself.
    """

    key: str
    main: str | None = None
    fields: tuple[NodeField, ...] = ()
    children: Children = Children.NONE
    open: bool = False
    description: str = ""
    behaviour: type | None = None


@dataclass(frozen=True, kw_only=True)
class DecoratorType:
    """One modifier: a key beside a node that wraps the node.

    Attributes:
        key: The word in a file.
        main: Field that a scalar stands for.
        fields: What may be written behind it; none for a switch, which is ``true``.
        handler: True when a node is written behind it.
        description: One sentence.
    """

    key: str
    main: str = ""
    fields: tuple[NodeField, ...] = ()
    handler: bool = False
    description: str = ""


@dataclass(frozen=True, kw_only=True)
class SiblingKey:
    """A key beside a node that is neither node nor modifier.

    Attributes:
        key: The word in a file.
        where: The nodes beside which it may stand, in words.
        description: One sentence.
    """

    key: str
    where: str
    description: str
