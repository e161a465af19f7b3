# SPDX-License-Identifier: Apache-2.0
"""Node types: records of everything that the language knows about a kind of node."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Protocol

from bt_agents_core.diagnostic import Position
from bt_agents_core.field_types import BindingKind, FieldType, Plain
from bt_agents_core.scene import SceneSpace
from bt_agents_core.text import ellipsize
from bt_agents_language.expression.expressions import Expression
from bt_agents_language.fields.interfaces import Interfaces
from bt_agents_language.fields.scope import NameScope
from bt_agents_language.model.specs import Binding, FieldSpec, Literal, NodeSpec, SkillSpec, Value
from bt_agents_language.nodes.endings import Outcome, Outcomes, Unreached, as_its_child
from bt_agents_language.yaml.typed_reader import TypedReader
from bt_agents_language.yaml.yaml_reader import MappingEntry, Node, Scalar

FOREVER = "forever"
"""Word for an attempt or repetition without end."""

LABEL_LENGTH = 24
"""Maximum number of characters of a value in a node label."""

LAST = 1000
"""Default order of a node type."""

FieldValues = dict[str, Value | Expression]
"""The fields of a checked node by name."""


class Content(Enum):
    """Allowed content of a field of a node."""

    VALUE = "a value, which may hold ${…}"
    CONDITION = "a condition over names"
    CONSTANT = "a value without ${…}"
    ROS_NAME = "the name of a topic, service or action"
    ROS_TYPE = "the name of a ROS type"
    MAP = "fields and their values"
    OUTPUTS = "names and the fields whose values they get"
    TIMEOUTS = "how long the server may take"
    HEARTBEAT = "what the server publishes while it is alive"
    ERROR_CODE = "where the result says that it failed"
    COUNT = "all, one, a number of children, or a list of their names"
    NODE = "a node"


class Role(Enum):
    """Role of nodes of a type in a tree."""

    COMPOSITE = "has a list of children"
    LEAF = "does something itself"
    DECORATOR = "stands beside a node, and wraps it"
    BRANCH = "wraps a child of a composite, and is written as a part of that"


class Children(Enum):
    """Number of children that a node key takes."""

    NONE = "none"
    LIST = "list"
    ONE = "one"


class Waits(Enum):
    """Thing that a purely waiting leaf waits for."""

    TIME = "a time"
    EVENT = "an event, which may never come"


class Mark(Enum):
    """Observed behaviour of a node in a rehearsal."""

    TICKED = "ticked"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    LEFT_OUT = "left out"
    BROKEN_OFF = "broken off"


@dataclass(frozen=True, kw_only=True)
class NodeField:
    """One field of a node type.

    Attributes:
        default: Value if it is not written; None leaves the field out.
        words: Possible texts of a constant; for a value, additional possible texts; for timeouts,
            their keys.
        minimum: Smallest possible number.
        message: Name under which a condition sees a message, for example ``msg``.
        drawn: Text in pictures for any value but the default; empty shows the value.
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
    drawn: str = ""

    @cached_property
    def default_value(self) -> Literal | None:
        """Value of the field in a node that does not write it; None for no value."""
        return None if self.default is None else Literal(value=self.default)


def declared_field(one: FieldSpec) -> NodeField:
    """Return an input or output of a skill or subtree as a field of a node."""
    return NodeField(
        name=one.name,
        type=one.type,
        required=one.required,
        default=one.default,
        description=one.description,
    )


MEMORY = NodeField(
    name="memory",
    content=Content.CONSTANT,
    type=FieldType.BOOLEAN,
    required=False,
    default=True,
    description="true: each tick continues at the running child; false: each tick starts again at "
    "the first child",
    drawn="starts over at each tick",
)

PAUSE = NodeField(
    name="pause",
    type=FieldType.DURATION,
    required=False,
    description="how long to wait in between",
)


@dataclass(frozen=True, kw_only=True)
class SiblingKey:
    """Key next to a node that is neither a node key nor a decorator.

    Attributes:
        field: The key, its allowed values, and one sentence.
        where: The nodes that may have it, in words.
        hint: How to fix it next to another node; ``{node}`` is that node's key.
    """

    field: NodeField
    where: str
    hint: str = "remove it"
    example: str

    @property
    def key(self) -> str:
        """The word in a file."""
        return self.field.name


@dataclass(frozen=True, kw_only=True)
class Resources:
    """Resources outside the tree that a node of an agent uses.

    Attributes:
        binding: The ROS interface of a skill or leaf.
        topic: Name and ROS type of a topic that it receives.
        latched: Whether it wants the last earlier message of that topic.
        feedback: Whether it gives feedback.
    """

    binding: Binding | None = None
    topic: tuple[str, str] | None = None
    latched: bool = False
    feedback: bool = False


def bound(spec: NodeSpec) -> Resources:
    """Return the binding of a skill or of a leaf that names a ROS interface."""
    return Resources(binding=spec.skill.binding if spec.skill is not None else None)


@dataclass(slots=True, kw_only=True, eq=False)
class RawNode:
    """Node as written, before its values are read.

    Attributes:
        type: None for a skill.
        skill: Set for a skill.
        name: Name for people; empty when none is written.
        siblings: The entries of sibling keys such as ``with``.
        options: Fields of a composite.
        nodes: Nodes in decorators and in fields of a composite, by key.
    """

    key: Scalar
    value: Node
    type: NodeType | None
    skill: SkillSpec | None
    name: str = ""
    decorators: Mapping[str, MappingEntry] = field(default_factory=dict)
    siblings: Mapping[str, MappingEntry] = field(default_factory=dict)
    options: Mapping[str, MappingEntry] = field(default_factory=dict)
    children: tuple[RawNode, ...] = ()
    nodes: Mapping[str, RawNode] = field(default_factory=dict)

    @property
    def key_meant(self) -> str:
        """Key of the node type or skill; for a misspelled key, the intended one."""
        if self.type is not None:
            return self.type.key
        return self.skill.name if self.skill is not None else self.key.text

    def walk(self) -> Iterator[RawNode]:
        """Return this node and all nodes below it, including handlers."""
        waiting = [self]
        while waiting:
            raw = waiting.pop()
            yield raw
            if raw.nodes:
                waiting += reversed([*raw.nodes.values()])
            if raw.children:
                waiting += reversed(raw.children)


Wrap = Callable[[RawNode, NodeSpec | None, str], NodeSpec | None]
"""Function that returns the replacement of a child, given it as written and read, and its path."""


class NodeReader(Protocol):
    """Interface for node types with their own readers; ``names`` are the names in scope."""

    @property
    def reading(self) -> TypedReader:
        """The file."""

    @property
    def interfaces(self) -> Interfaces | None:
        """The installed ROS types; None leaves types unchecked."""

    def written_fields(self, raw: RawNode) -> Mapping[str, Node] | None:
        """Return the written fields of a leaf by name; None if they are unreadable."""

    def values(
        self, node_type: NodeType, nodes: Mapping[str, Node], names: NameScope, what: str = ""
    ) -> FieldValues:
        """Return the values of the written fields of a type, with defaults for the others.

        Messages about the main field call the node ``what``.
        """

    def leaf(
        self,
        raw: RawNode,
        path: str,
        names: NameScope,
        nodes: Mapping[str, Node] | None = None,
        label: Node | None = None,
    ) -> NodeSpec | None:
        """Return a leaf according to its fields.

        It reads the written fields unless they are given as ``nodes``; the value in the label is
        by default the type of the main field.
        """

    def composite(
        self, raw: RawNode, path: str, names: NameScope, wrap: Wrap | None = None
    ) -> NodeSpec:
        """Return a composite with its children, or with their wrappers."""

    def subtree(self, raw: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        """Return a call of a subtree, before its expansion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NodeType:
    """Type of a node or decorator.

    Attributes:
        order: Position in the documentation; for decorators also the order of wrapping: the
            lowest is the outermost.
        main: Field that a scalar sets; None if there is none.
        fields: Fields in the order of the documentation; a decorator without any is ``true``.
        children: Number of children that the key takes.
        open: True accepts names of the author's choice as fields.
        assigns: True assigns values to those names, which later nodes can use.
        declared: For an open type, the names that ``scene.yaml`` declares, with their types.
        handler: For a decorator, whether its value is a node.
        example: Part of an agent file; empty makes one from the fields.
        plugin: Class of a node from a plug-in; None for nodes of the language itself.
        gives: Blackboard keys whose values a plug-in's node assigns to names.
        siblings: Sibling keys that it may have.
        child_siblings: Sibling keys that its children may have.
        child_keys: Keys that each of its children must have, with hints for missing ones; a
            decorator among them is a part of the composite.
        contrary: Decorator that the same node must not have.
        interface: Kind of the ROS interface that it names itself.
        message: Kind of the ROS interface whose message provides its ``outputs``.
        read: Reader of its nodes; None reads them according to their fields.
        complete: Checks and completes the fields of a decorator: its value as written, and its
            fields as written and as read.
        outcomes: How a node can end: the node, and the outcomes of its children.
        unreached: Yields nodes that never run: the node, and all nodes' outcomes by identity.
        continues_on: Outcome of a child after which a composite continues with the next child.
        concurrent: Whether its children run at the same time.
        exclusive: Whether only one of its children runs.
        alternatives: Nodes; one success among them is enough.
        stops_children: Whether a node may stop a running child.
        skips: Whether the decorator may skip its node; its place decides its field ``otherwise``.
        unaffected: Whether a decorator makes no difference to a skipped node.
        limits: Whether the decorator may stop its node, which then fails.
        rounds: Field with the number of times that the decorator runs its node.
        single_round: Whether the decorator keeps a loop from running its node again.
        waits: What a leaf waits for; None for a leaf that does something.
        takes_time: Whether a leaf runs for longer than a tick, unless its binding decides that.
        idle: Whether only an event or a time changes a running leaf.
        read_only: Whether the leaf has no effect on anything.
        gives_up: Whether a rehearsal shows its failures.
        decides: Whether its failure means that a branch is not taken.
        to_cover: Behaviour that tests should cover, each with the text for a gap.
        resources: Resources that a node uses outside its tree.
        drawn_key: Word for a node in a picture.
    """

    key: str
    order: int = LAST
    role: Role = Role.LEAF
    main: str | None = None
    fields: tuple[NodeField, ...] = ()
    children: Children = Children.NONE
    open: bool = False
    assigns: bool = False
    declared: Callable[[SceneSpace], Mapping[str, FieldType]] = lambda space: {}
    handler: bool = False
    description: str = ""
    example: str = ""
    plugin: type | None = None
    gives: Mapping[str, NodeField] = field(default_factory=dict)
    siblings: tuple[str, ...] = ()
    child_siblings: tuple[str, ...] = ()
    child_keys: Mapping[str, str] = field(default_factory=dict)
    contrary: str = ""
    interface: BindingKind | None = None
    message: BindingKind | None = None
    read: Callable[[NodeReader, RawNode, str, NameScope], NodeSpec | None] | None = None
    complete: Callable[[TypedReader, Node, Mapping[str, Node], FieldValues], None] | None = None
    outcomes: Callable[[NodeSpec, Sequence[Outcomes]], Outcomes] = as_its_child
    unreached: Callable[[NodeSpec, Mapping[int, Outcomes]], Iterable[Unreached]] = (
        lambda spec, outcomes: ()
    )
    continues_on: Outcome = Outcome.SUCCESS
    concurrent: bool = False
    exclusive: bool = False
    alternatives: Callable[[NodeSpec], tuple[NodeSpec, ...]] = lambda spec: ()
    stops_children: Callable[[NodeSpec], bool] = lambda spec: False
    skips: bool = False
    unaffected: bool = False
    limits: bool = False
    rounds: str = ""
    single_round: bool = False
    waits: Waits | None = None
    takes_time: bool = False
    idle: bool = False
    read_only: bool = False
    gives_up: bool = False
    decides: bool = False
    to_cover: tuple[tuple[Mark, str], ...] = ()
    resources: Callable[[NodeSpec], Resources] = bound
    drawn_key: Callable[[NodeSpec], str] = lambda spec: spec.kind

    @cached_property
    def writes(self) -> bool:
        """Whether a node of this type may assign values to names."""
        written = self.assigns or self.message is not None or "outputs" in self.siblings
        return written or bool(self.gives)


def wrapped(
    spec: NodeSpec | None,
    kind: str,
    position: Position,
    path: str,
    fields: FieldValues,
    label: str,
    *,
    suffix: str = "",
) -> NodeSpec | None:
    """Return a node of a kind around another one; None if there is no other.

    Its path is the path of both with a suffix, by default its kind.
    """
    if spec is None:
        return None
    return NodeSpec(
        path=f"{path}@{suffix or kind}",
        position=position,
        kind=kind,
        name=label,
        fields=fields,
        children=(spec,),
    )


def short(node: Node | None) -> str:
    """Return a written value as part of a label."""
    if not isinstance(node, Scalar):
        return "" if node is None else "…"
    return ellipsize(" ".join(node.text.split()), LABEL_LENGTH)
