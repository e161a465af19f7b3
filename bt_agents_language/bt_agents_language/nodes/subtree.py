# SPDX-License-Identifier: Apache-2.0
"""``subtree``: runs a tree from the section ``subtrees``."""

from __future__ import annotations

from bt_agents_core.field_types import FieldType
from bt_agents_language.nodes.node_type import Children, Content, NodeField, NodeType, SiblingKey

_EXAMPLE = """\
tree:
  subtree: greet
  with: {who: Ms. Miller}
subtrees:
  greet:
    inputs: {who: text}
    tree:
      say: Good morning, ${who}.
"""

WITH = SiblingKey(
    field=NodeField(
        name="with",
        content=Content.MAP,
        description="Values for the inputs of a subtree, by name.",
    ),
    where="a subtree",
    hint="write the fields after '{node}:' as {{ … }}",
    example=_EXAMPLE,
)

OUTPUTS = SiblingKey(
    field=NodeField(
        name="outputs",
        content=Content.OUTPUTS,
        description="Names for later nodes, each with the output that gives its value.",
    ),
    where="a subtree or a skill",
    example="""\
tree:
  sequence:
    - ask: Where to?
      outputs: {place: answer}
    - drive: ${place}
""",
)

SUBTREE = NodeType(
    key="subtree",
    order=150,
    main="name",
    fields=(
        NodeField(
            name="name",
            content=Content.CONSTANT,
            type=FieldType.TEXT,
            description="name under 'subtrees', in this file or an import",
        ),
    ),
    children=Children.ONE,
    description="Runs a tree from 'subtrees'; 'with' sets its inputs.",
    siblings=(WITH.key, OUTPUTS.key),
    read=lambda reader, raw, path, names: reader.subtree(raw, path, names),
    example=_EXAMPLE,
)
