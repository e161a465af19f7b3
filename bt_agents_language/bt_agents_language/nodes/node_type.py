# SPDX-License-Identifier: Apache-2.0
"""Node types: the record of everything that the language knows of one kind of node."""

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
"""Characters of a value in the label of a node."""

LAST = 1000
"""Order of a node type that says nothing else."""

FieldValues = dict[str, Value | Expression]
"""The fields of a checked node by name."""


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
    ERROR_CODE = "where the result says that it failed"
    COUNT = "all, one, a number of children, or a list of their names"
    NODE = "a node"


class Role(Enum):
    """The part that nodes of a type have in a tree."""

    COMPOSITE = "has a list of children"
    LEAF = "does something itself"
    DECORATOR = "stands beside a node, and wraps it"
    BRANCH = "wraps a child of a composite, and is written as a part of that"


class Children(Enum):
    """How many children are written behind a node key."""

    NONE = "none"
    LIST = "list"
    ONE = "one"


class Waits(Enum):
    """What a leaf that does nothing else waits for."""

    TIME = "a time"
    EVENT = "an event, which may never come"


class Mark(Enum):
    """What a node has been seen to do in a rehearsal."""

    TICKED = "ticked"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    LEFT_OUT = "left out"
    BROKEN_OFF = "broken off"


@dataclass(frozen=True, kw_only=True)
class NodeField:
    """One field of a node type.

    Attributes:
        default: Taken when it is not written; None leaves the field out.
        words: The possible texts of a constant; of a value, texts that are possible besides; of
            timeouts, their keys.
        minimum: Smallest possible number.
        message: Name under which a condition sees a message, for example ``msg``.
        drawn: What a picture says of any value but the default; empty shows the value.
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
    description="whether it goes on at the running child instead of starting over at each tick",
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
    """A key beside a node that is neither a node key nor a decorator.

    Attributes:
        field: The key, what may stand behind it, and one sentence.
        where: The nodes beside which it may stand, in words.
        hint: What to do where it stands beside another node; ``{node}`` is that node's key.
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
class MessageSource:
    """The ROS message from which the ``outputs`` of a leaf take their values.

    Attributes:
        section: Section of the interface type: ``result``.
        prefix: Name of the message in the paths of outputs: ``msg``.
    """

    kind: BindingKind
    section: str
    prefix: str


@dataclass(frozen=True, kw_only=True)
class Resources:
    """What the node of an agent uses outside of its tree.

    Attributes:
        binding: The ROS interface of a skill or leaf.
        topic: Name and ROS type of a topic that it receives.
        latched: Whether it wants the last message of that topic from before.
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
    """One node as written, its values not read yet.

    Attributes:
        type: None for a skill.
        skill: Set for a skill.
        name: Name for people; empty when none is written.
        siblings: The entries of sibling keys such as ``with``.
        options: Fields of a composite.
        nodes: Nodes behind decorators and in fields of a composite, by key.
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
        """Key of the node type or skill; of a misspelt key the one that is meant."""
        if self.type is not None:
            return self.type.key
        return self.skill.name if self.skill is not None else self.key.text

    def walk(self) -> Iterator[RawNode]:
        """Return this node and all below it, handlers included."""
        waiting = [self]
        while waiting:
            raw = waiting.pop()
            yield raw
            if raw.nodes:
                waiting += reversed([*raw.nodes.values()])
            if raw.children:
                waiting += reversed(raw.children)


Wrap = Callable[[RawNode, NodeSpec | None, str], NodeSpec | None]
"""Returns the node to put in place of a child: the child as written and as read, and its path."""


class NodeReader(Protocol):
    """What a node type with a reader of its own builds on; ``names`` are those in sight."""

    @property
    def reading(self) -> TypedReader:
        """The file."""

    @property
    def interfaces(self) -> Interfaces | None:
        """The installed ROS types; None leaves types unchecked."""

    def written_fields(self, raw: RawNode) -> Mapping[str, Node] | None:
        """Return the written fields of a leaf by name; None when there are none to be read."""

    def values(
        self, node_type: NodeType, nodes: Mapping[str, Node], names: NameScope, what: str = ""
    ) -> FieldValues:
        """Return the values of the written fields of a type, with defaults for the others.

        Messages about the main field name the node by ``what``.
        """

    def leaf(
        self,
        raw: RawNode,
        path: str,
        names: NameScope,
        nodes: Mapping[str, Node] | None = None,
        label: Node | None = None,
    ) -> NodeSpec | None:
        """Return a leaf as its fields describe it.

        Its written fields are read unless they are given as ``nodes``; the value in its label is
        that of the main field unless it is given.
        """

    def composite(
        self, raw: RawNode, path: str, names: NameScope, wrap: Wrap | None = None
    ) -> NodeSpec:
        """Return a composite with its children, or with what wraps each of them."""

    def subtree(self, raw: RawNode, path: str, names: NameScope) -> NodeSpec | None:
        """Return a call of a subtree, whose body is not in place yet."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NodeType:
    """One type of node, or one decorator.

    Attributes:
        order: Position in the documentation; of a decorator, also that in which it wraps a node:
            the lowest is the outermost.
        main: Field that a scalar stands for; None when there is none.
        fields: In the order of the documentation; a decorator without any is written ``true``.
        children: How many children are written behind the key.
        open: True takes names of the author's choice as fields.
        assigns: True gives those names values, which later nodes can use.
        declared: Of an open one, the names that ``scene.yaml`` declares, with their types.
        handler: Of a decorator, whether a node is written behind it.
        example: Part of an agent file; empty makes one from the fields.
        plugin: Class of a node that a plug-in brings; None for nodes of the language itself.
        gives: Keys of the blackboard from which a node of a plug-in gives names values.
        siblings: The sibling keys that may stand beside it.
        child_siblings: The sibling keys that may stand beside its children.
        child_keys: What must stand beside each of its children, each key with a hint for where it
            is missing; a decorator among them is a part of the composite.
        contrary: Decorator that must not stand beside the same node.
        interface: Kind of the ROS interface that it names itself.
        message: Where its ``outputs`` take their values from.
        derived: Fields that come from where it stands, and are not written.
        read: Reader of its nodes; None reads them as their fields say.
        complete: Checks and completes the fields of a decorator: what is written behind it, its
            fields as written, and as read.
        outcomes: How a node can end: the node, and the outcomes of its children.
        unreached: Gives nodes that never run: the node, and the outcomes of all nodes by identity.
        continues_on: Outcome of a child after which a composite goes on to its next child.
        concurrent: Whether its children run at the same time.
        exclusive: Whether only one of its children runs.
        alternatives: The nodes of which one success is enough.
        stops_children: Whether a node may stop a running child.
        skips: Whether the decorator may skip its node.
        unaffected: Whether a decorator makes no difference to a node that is skipped.
        limits: Whether the decorator may stop its node, which has failed then.
        rounds: Field that says how often the decorator runs its node.
        single_round: Whether the decorator keeps a loop from running its node again.
        waits: What a leaf waits for; None for a leaf that does something.
        takes_time: Whether a leaf runs for longer than a tick, as far as its binding does not say.
        idle: Whether nothing but an event or a time changes a running leaf.
        read_only: Whether the leaf has no effect on anything.
        gives_up: Whether a rehearsal shows its failures.
        decides: Whether its failure says that a branch is not taken.
        to_cover: What tests should have seen it do, each with the text where they have not.
        resources: What a node uses outside of its tree.
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
    message: MessageSource | None = None
    derived: tuple[str, ...] = ()
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
        """Whether a node of this type may give names values."""
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
    """Return a node of a kind around another one; None when there is no other.

    Its path is that of both with a suffix, which is its kind unless another is given.
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
    """Return what is written somewhere as part of a label."""
    if not isinstance(node, Scalar):
        return "" if node is None else "…"
    return ellipsize(" ".join(node.text.split()), LABEL_LENGTH)
