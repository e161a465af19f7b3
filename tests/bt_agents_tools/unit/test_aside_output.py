# SPDX-License-Identifier: Apache-2.0
"""Output while nobody reads, and after the reader has gone."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import TextIO

from bt_agents_tools.cli.aside_output import MOST_BYTES, printing_aside

LINE = f"{'x' * 99}\n"
LINES = 3 * MOST_BYTES // len(LINE)


@contextmanager
def piped() -> Iterator[TextIO]:
    """Redirect standard output into a pipe within the block; yield the reading end."""
    reading, writing = os.pipe()
    with (
        open(reading, encoding="utf-8") as read,
        open(writing, "w", encoding="utf-8") as stream,
        redirect_stdout(stream),
    ):
        yield read


@contextmanager
def piped_errors() -> Iterator[TextIO]:
    """Redirect the descriptor of errors into a pipe within the block; yield the reading end."""
    before = os.dup(2)
    reading, writing = os.pipe()
    os.dup2(writing, 2)
    os.close(writing)
    try:
        with open(reading, encoding="utf-8") as read:
            yield read
    finally:
        os.dup2(before, 2)
        os.close(before)


def test_errors_are_written_in_order() -> None:
    with piped_errors() as read, piped():
        with printing_aside():
            for number in range(100):
                os.write(2, f"{number}\n".encode())
        os.write(2, b"after\n")
        expected = [*(f"{number}\n" for number in range(100)), "after\n"]
        assert [read.readline() for _ in expected] == expected


def test_errors_that_nobody_reads_do_not_block() -> None:
    with piped_errors(), piped(), printing_aside():
        for _ in range(LINES):
            # Those of C may be refused, those of Python never.
            with suppress(BlockingIOError):
                os.write(2, LINE.encode())
            print(LINE, end="", file=sys.stderr)


def test_output_is_written_in_order() -> None:
    with piped() as read:
        with printing_aside():
            for number in range(100):
                print(number)
        assert [read.readline() for _ in range(100)] == [f"{number}\n" for number in range(100)]


def test_full_pipe_does_not_block_and_reports_gap() -> None:
    found = [""]
    with piped() as read, printing_aside():
        for _ in range(LINES):
            print(LINE, end="")
        while not found[-1].startswith("…"):
            found.append(read.readline())
        print("and on")
        assert read.readline() == "and on\n"
    dropped = int(found[-1].split()[1])
    assert len(found) - 2 + dropped == LINES
    assert dropped > LINES // 2


def test_closed_reader_ends_only_the_printing() -> None:
    with piped() as read, printing_aside():
        read.close()
        for _ in range(100):
            print(LINE, end="")
