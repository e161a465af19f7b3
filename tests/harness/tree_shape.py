# SPDX-License-Identifier: Apache-2.0
"""The shape of a tree, to compare trees of different files."""

from __future__ import annotations

from bt_agents_language.model.specs import NodeSpec


def shape(spec: NodeSpec | None) -> object:
    """Return the content of a tree, without its places in the file."""
    if spec is None:
        return None
    children = [shape(one) for one in spec.children]
    return spec.kind, spec.name, dict(spec.fields), dict(spec.outputs), children
