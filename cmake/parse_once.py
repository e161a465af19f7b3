# SPDX-License-Identifier: Apache-2.0
"""Code generator of rosidl, with the syntax trees that another one has parsed before it.

    python parse_once.py GENERATOR ARGUMENT...

Each of six generators parses every interface, which is half of its time. The first one leaves the
syntax trees in the folder in which it runs, where the next ones read them.
"""

from __future__ import annotations

import hashlib
import json
import os
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lark import Token, Tree
from rosidl_parser import parser

FOLDER = Path("syntax_trees")


def keep_trees(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return ``parse`` for a text that it has not parsed yet in any process."""

    def parse_once(text: str) -> Any:
        kept = FOLDER / f"{hashlib.sha256(text.encode()).hexdigest()}.json"
        if kept.exists():
            return _decode(json.loads(kept.read_text(encoding="utf-8")))
        tree = parse(text)
        FOLDER.mkdir(exist_ok=True)
        # Two generators may run at the same time.
        complete = kept.with_suffix(f".{os.getpid()}")
        complete.write_text(json.dumps(_encode(tree)), encoding="utf-8")
        complete.replace(kept)
        return tree

    return parse_once


def _encode(node: Any) -> list[Any]:
    if isinstance(node, Token):
        return [node.type, str(node)]
    return [str(node.data), [_encode(child) for child in node.children]]


def _decode(node: list[Any]) -> Any:
    name, held = node
    return Token(name, held) if isinstance(held, str) else Tree(name, [*map(_decode, held)])


if __name__ == "__main__":
    parser.get_ast_from_idl_string = keep_trees(parser.get_ast_from_idl_string)
    del sys.argv[0]
    runpy.run_path(sys.argv[0], run_name="__main__")
