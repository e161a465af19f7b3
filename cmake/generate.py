# SPDX-License-Identifier: Apache-2.0
"""Code generator of rosidl, on all cores, with the syntax trees that another one has parsed.

    python generate.py GENERATOR ARGUMENT...

Each of six generators parses every interface, which takes half of its time, and uses one core. The
first one leaves the syntax trees next to its arguments, where the next ones read them.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import runpy
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rosidl_pycommon
from lark import Token, Tree
from rosidl_parser import parser


def in_processes(work: Callable[[Sequence[str]], object], items: Sequence[str]) -> None:
    """Call ``work`` with a part of ``items`` in a process for each core; exit if one fails."""
    cores = len(os.sched_getaffinity(0))
    context = multiprocessing.get_context("fork")  # what "work" refers to needs no pickle
    processes = [context.Process(target=work, args=(items[i::cores],)) for i in range(cores)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        sys.exit(1)


def keep_trees(parse: Callable[[str], Any], folder: Path) -> Callable[[str], Any]:
    """Return ``parse`` for a text that no process has parsed yet."""

    def parse_once(text: str) -> Any:
        kept = folder / f"{hashlib.sha256(text.encode()).hexdigest()}.json"
        if kept.exists():
            return _decode(json.loads(kept.read_text(encoding="utf-8")))
        tree = parse(text)
        folder.mkdir(exist_ok=True)
        # Two generators may run at the same time.
        complete = kept.with_suffix(f".{os.getpid()}")
        complete.write_text(json.dumps(_encode(tree)), encoding="utf-8")
        complete.replace(kept)
        return tree

    return parse_once


def split(generate: Callable[..., Any]) -> Callable[..., list[str]]:
    """Return ``rosidl_pycommon.generate_files`` with the interfaces divided among processes."""

    def generate_files(arguments: str, *rest: Any, **options: Any) -> list[str]:
        everything = json.loads(Path(arguments).read_text(encoding="utf-8"))

        def generate_part(interfaces: Sequence[str]) -> None:
            part = Path(f"{arguments}.{os.getpid()}")
            part.write_text(json.dumps(everything | {"idl_tuples": interfaces}), encoding="utf-8")
            generate(str(part), *rest, **options)
            part.unlink()

        in_processes(generate_part, everything["idl_tuples"])
        return []  # no generator uses the names

    return generate_files


def _encode(node: Any) -> list[Any]:
    if isinstance(node, Token):
        return [node.type, str(node)]
    return [str(node.data), [_encode(child) for child in node.children]]


def _decode(node: list[Any]) -> Any:
    name, held = node
    return Token(name, held) if isinstance(held, str) else Tree(name, [*map(_decode, held)])


def _parse(interfaces: Sequence[str]) -> None:
    for interface in interfaces:
        folder, path = interface.rsplit(":", 1)
        parser.get_ast_from_idl_string(Path(folder, path).read_text(encoding="utf-8"))


if __name__ == "__main__":
    del sys.argv[0]
    arguments = Path(next(each for each in sys.argv if each.endswith("__arguments.json")))
    trees = arguments.parent / "syntax_trees"
    parser.get_ast_from_idl_string = keep_trees(parser.get_ast_from_idl_string, trees)
    rosidl_pycommon.generate_files = split(rosidl_pycommon.generate_files)
    if not trees.exists():
        in_processes(_parse, json.loads(arguments.read_text(encoding="utf-8"))["idl_tuples"])
    runpy.run_path(sys.argv[0], run_name="__main__")
