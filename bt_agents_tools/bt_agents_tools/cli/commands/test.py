# SPDX-License-Identifier: Apache-2.0
"""Command `bt-agents test`: the test files of a trees folder, without a robot and without ROS."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from bt_agents_core.errors import BtAgentsError
from bt_agents_tools.cli.trees_choice import named_path, take_trees
from bt_agents_tools.rehearsal.suite import (
    CaseResult,
    FileResult,
    TreesFolders,
    coverages,
    failure,
    find_tests,
    junit,
    run_file,
)
from bt_agents_tools.rehearsal.transcript import ending, transcript


@click.command("test")
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path), metavar="[PATH]...")
@click.option("-k", "word", default="", metavar="WORD", help="Only cases with WORD in the name.")
@click.option(
    "--junit",
    "junit_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the results here as JUnit XML.",
)
@click.option(
    "--coverage", is_flag=True, help="List nodes and branches that no case goes through."
)
@click.option("--language", default="", help="Language of the texts: de for texts/de.yaml.")
@click.option("-v", "--verbose", is_flag=True, help="Show what happened in each case.")
def test(
    paths: tuple[Path, ...],
    word: str,
    junit_file: Path | None,
    coverage: bool,
    language: str,
    verbose: bool,
) -> None:
    """Rehearse the cases of test files and compare them with what they expect.

    PATH is a file *.test.yaml or a folder that is searched for them; without it, the trees folder.
    Exit code 1 when a case fails, a file cannot be read, or there is no case.
    """
    start = time.perf_counter()
    console = Console(highlight=False, soft_wrap=True)
    folders = TreesFolders(language)
    results = [
        run_file(path, folders, word)
        for path in find_tests(map(named_path, paths or (take_trees(),)))
    ]
    for result in results:
        _show(console, result, verbose)
    if coverage:
        _show_coverage(console, results)
    if junit_file is not None:
        try:
            junit_file.write_text(junit(results), encoding="utf-8")
        except OSError as error:
            raise BtAgentsError(f"{junit_file} cannot be written: {error.strerror}") from None
    sys.exit(_summary(console, results, word, time.perf_counter() - start))


def _show(console: Console, result: FileResult, verbose: bool) -> None:
    if not result.cases and result.error is None:
        return
    console.print(f"[bold]{escape(str(result.file))}[/]")
    if result.error is not None:
        report = escape(_indented(result.error.report))
        console.print(f"  [red]✘ the file has errors[/]\n{report}")
    for case in result.cases:
        _show_case(console, case, verbose)


def _show_case(console: Console, case: CaseResult, verbose: bool) -> None:
    name = escape(case.case.name)
    if not case.passed:
        console.print(f"  [red]✘[/] {name}\n{escape(_indented(failure(case)))}\n")
        return
    console.print(f"  [green]✔[/] {name}  [dim]{ending(case.rehearsed)}[/]")
    if verbose:
        console.print(f"{escape(_indented(transcript(case.rehearsed.events)))}\n")


def _show_coverage(console: Console, results: Iterable[FileResult]) -> None:
    console.print("\n[bold]coverage[/]")
    for one in coverages(results):
        style = "green" if one.missed == 0 else "yellow"
        counted = f"{one.total - one.missed} of {one.total} nodes and branches"
        console.print(f"  [{style}]{one.percent:>3} %[/] {escape(one.agent)}  [dim]{counted}[/]")
        for gap in one.gaps:
            console.print(f"        {escape(str(gap))}")


def _summary(console: Console, results: Sequence[FileResult], word: str, seconds: float) -> int:
    cases = [case for result in results for case in result.cases]
    failed = sum(not case.passed for case in cases)
    broken = sum(result.error is not None for result in results)
    if not results:
        raise BtAgentsError("there is no file *.test.yaml; docs/testing.md shows how to write one")
    if not cases and not broken:
        raise BtAgentsError(f"no case has '{word}' in its name")
    counts = [f"{len(cases) - failed} passed"]
    counts += [f"{failed} failed"] * bool(failed)
    counts += [f"{broken} file{'s' * (broken > 1)} with errors"] * bool(broken)
    style = "red" if failed or broken else "green"
    text = f"{len(cases)} case{'s' * (len(cases) != 1)}: {', '.join(counts)}"
    console.print(f"\n[bold {style}]{text}[/] in {seconds:.2f} s")
    return int(bool(failed or broken))


def _indented(text: str) -> str:
    return "\n".join(f"    {line}".rstrip() for line in text.splitlines())
