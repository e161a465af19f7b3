# SPDX-License-Identifier: Apache-2.0
"""Refusal codes: from one enumeration, documented and used."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache

import pytest

from bt_agents_core import refusal_codes
from bt_agents_core.refusal_codes import RefusalCode
from product_modules import product_modules
from programs import ROOT

REFUSALS = {"FleetError", "LedgerError", "Refused"}


@cache
def sources() -> dict[str, ast.Module]:
    return {
        name: ast.parse(path.read_text(encoding="utf-8"))
        for name, path in product_modules().items()
        if name != refusal_codes.__name__
    }


def texts(node: ast.expr) -> Iterator[ast.expr]:
    """Yield the possible texts of a value, or of its items."""
    match node:
        case ast.JoinedStr() | ast.Constant(value=str()):
            yield node
        case ast.IfExp(body=body, orelse=other):
            yield from (*texts(body), *texts(other))
        case ast.BoolOp(values=parts) | ast.Tuple(elts=parts) | ast.List(elts=parts):
            for part in parts:
                yield from texts(part)
        case ast.Set(elts=parts):
            for part in parts:
                yield from texts(part)


def is_code(node: ast.expr) -> bool:
    return isinstance(node, ast.Attribute) and node.attr == "code"


def written_out(tree: ast.AST) -> Iterator[ast.expr]:
    """Yield codes written as texts where a refusal is made, set or compared."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=[code, *_]) if (
                name in REFUSALS
            ):
                yield from texts(code)
            case ast.Compare(left=left, comparators=others):
                if any(map(is_code, (left, *others))):
                    for side in (left, *others):
                        yield from texts(side)
            case ast.Assign(targets=[target], value=value):
                match target, value:
                    case ast.Tuple(elts=targets), ast.Tuple(elts=values):
                        pairs = list(zip(targets, values, strict=True))
                    case _:
                        pairs = [(target, value)]
                for one, given in pairs:
                    if is_code(one):
                        yield from (text for text in texts(given) if ast.unparse(text) != "''")


@pytest.mark.parametrize(
    "source",
    [
        "raise Refused('BUSY', reason)",
        "raise Refused(f'NOTHING_TO_{what}', reason)",
        "raise errors.Refused('BUSY' if busy else code, reason)",
        "raise LedgerError('LEDGER_CORRUPT', reason)",
        "refused.code == 'BUSY'",
        "'BUSY' != answer.code",
        "answer.code in ('BUSY', 'QUEUE_FULL')",
        "response.code = 'BUSY'",
        "response.code, response.message = 'BUSY', reason",
    ],
)
def test_code_as_text_is_found(source: str) -> None:
    assert list(written_out(ast.parse(source)))


def test_no_code_is_written_as_text() -> None:
    found = [
        f"{module}:{node.lineno}: {ast.unparse(node)}"
        for module, tree in sources().items()
        for node in written_out(tree)
    ]
    assert not found, "take a member of RefusalCode"


def test_every_code_is_used() -> None:
    used = {
        node.attr
        for tree in sources().values()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "RefusalCode"
    }
    assert not set(RefusalCode.__members__) - used


def test_every_code_has_one_line_documented() -> None:
    page = (ROOT / "docs" / "errors.md").read_text(encoding="utf-8")
    for name, code in RefusalCode.__members__.items():
        assert code == name
        assert code.sentence.endswith(".")
        assert f"\n| `{code}` | {code.sentence} |" in page
