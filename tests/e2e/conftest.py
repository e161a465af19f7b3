# SPDX-License-Identifier: Apache-2.0
"""Fixtures for programs, which are killed by pid at the end of each test."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from browser import chromium
from command_server import CommandServer, command_server
from programs import ROOT, Ask, Program, Start, environment_of
from studio_browser import LIMIT_MS, System, opened_page
from studio_harness import BackgroundStudio, background_studio


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """An environment with its own state folder."""
    return environment_of(tmp_path / "state")


@pytest.fixture
def start(environment: dict[str, str]) -> Iterator[Start]:
    """Start ``bt-agents`` with arguments, in the checkout or another folder."""
    programs: list[Program] = []

    def start_one(*arguments: str, folder: Path = ROOT) -> Program:
        programs.append(Program(arguments, environment, folder))
        return programs[-1]

    try:
        yield start_one
    finally:
        for program in programs:
            program.kill()


@pytest.fixture
def start_up(start: Start) -> Iterator[Start]:
    """Start a system without voice and studio; wait until it is ready.

    It has to end properly after the test, or to have done so.
    """
    started: list[Program] = []

    def start_one(*arguments: str, **place: Path) -> Program:
        started.append(start("up", *arguments, "--no-voice", "--no-studio", **place))
        started[-1].until("ready after")
        return started[-1]

    yield start_one
    for up in started:
        assert up.process.poll() is not None or up.stop()[0] == 0, up.output
        assert "Traceback" not in up.output


@pytest.fixture(scope="session")
def commands() -> Iterator[CommandServer]:
    """All commands, loaded once."""
    with command_server(dict(os.environ)) as server:
        yield server


@pytest.fixture
def ask(commands: CommandServer, environment: dict[str, str]) -> Ask:
    """Run a short command to its end; return its output. ``None`` allows any exit code."""

    def ask_one(*arguments: str, code: int | None = 0) -> str:
        ended = commands.run(*arguments, folder=ROOT, environment=environment, together=True)
        assert code is None or ended.code == code, ended.out
        return ended.out

    return ask_one


@pytest.fixture
def trees(tmp_path: Path) -> Path:
    """A copy of the shipped trees that a test may change."""
    return Path(shutil.copytree(ROOT / "trees", tmp_path / "trees"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    expect.set_options(timeout=LIMIT_MS)
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def studio() -> Iterator[BackgroundStudio]:
    """An empty studio without a system."""
    with background_studio() as served:
        yield served


@pytest.fixture
def page(browser: Browser, system: System) -> Iterator[Page]:
    """The page of an operator."""
    with opened_page(browser, system.address) as opened:
        expect(opened.locator(".phase")).to_have_text("connected")
        yield opened
