# SPDX-License-Identifier: Apache-2.0
"""The studio in a real browser, beside a real system."""

from __future__ import annotations

import json
import os
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from browser import chromium
from checkout import ROOT
from npm_packages import NotFetched, installed_package
from programs import Program, children

pytestmark = pytest.mark.e2e

LIMIT_MS = 30_000
PAGES = ("live", "market", "tune", "world", "system")
AXE = ("axe-core", "4.14.1")
RULES = "{runOnly: ['wcag2a', 'wcag2aa', 'wcag21aa', 'wcag22aa']}"


class System:
    """A running system and its studio."""

    def __init__(self, state: Path) -> None:
        self._environment = {
            **os.environ,
            "XDG_STATE_HOME": str(state),
            "PYTHONUNBUFFERED": "1",
            "COLUMNS": "120",
        }
        self.programs: list[Program] = []

    def start(self) -> None:
        self.up = self._start("up", "trees", "--journal")
        self.up.until("ready after")
        studio = self._start("studio", "trees")
        self.address = studio.until("studio: ").split()[-1]
        self.to_look = studio.until("to look on only: ").split()[-1]

    def _start(self, *arguments: str) -> Program:
        self.programs.append(Program(arguments, self._environment))
        return self.programs[-1]

    def end(self) -> None:
        for program in self.programs:
            for pid in [*children(program.process.pid), program.process.pid]:
                try:
                    os.kill(pid, signal.SIGKILL)
                except ProcessLookupError:
                    continue
            program.process.wait()
            program.close()


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    running = System(tmp_path_factory.mktemp("state"))
    try:
        running.start()
        yield running
    finally:
        running.end()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        context = chromium()
        opened = context.__enter__()
    except NotFetched as reason:
        pytest.skip(str(reason))
    try:
        yield opened
    finally:
        context.__exit__(None, None, None)


@pytest.fixture
def page(browser: Browser, system: System) -> Iterator[Page]:
    """The page of an operator; an error that it reports fails the test."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    opened = context.new_page()
    opened.set_default_timeout(LIMIT_MS)
    expect.set_options(timeout=LIMIT_MS)
    errors: list[str] = []
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.goto(system.address)
    expect(opened.locator(".phase")).to_have_text("connected")
    yield opened
    context.close()
    assert errors == []


def open_page(page: Page, name: str) -> None:
    page.get_by_role("navigation").get_by_role("link", name=name, exact=True).click()


def announce(page: Page, label: str, **values: float) -> None:
    """Announce a scene as an operator does: by sliders and a button."""
    open_page(page, "World")
    for name, value in values.items():
        slider = page.locator(f"#world-{name}")
        slider.fill(str(value))
    page.get_by_label("Label").fill(label)
    page.get_by_role("button", name="Announce the scene").click()


def stop(page: Page) -> None:
    """Stop whatever runs, so that the next scene comes at once."""
    open_page(page, "Live")
    button = page.get_by_role("button", name="Stop")
    if button.is_enabled():
        button.click()
    expect(button).to_be_disabled()


def test_a_scene_is_played_and_its_tree_round_and_reasons_are_seen(page: Page) -> None:
    announce(page, "an evening guest", age=4.5, mood=2)
    open_page(page, "Live")
    expect(page.locator(".node.running").first).to_be_visible()
    expect(page.get_by_label("Scene", exact=True)).to_contain_text("an evening guest")
    expect(page.get_by_label("What happened")).to_contain_text("started")
    page.locator(".node").first.click()
    expect(page.get_by_label("Node", exact=True)).to_contain_text("trees/agents/")
    open_page(page, "Market")
    shown = page.get_by_label("Bids")
    expect(shown.locator("tr.winner")).to_have_count(1)
    expect(shown).to_contain_text("an evening guest")
    stop(page)


def test_a_stop_ends_the_run_and_says_who_wanted_it(page: Page) -> None:
    announce(page, "somebody to stop", age=4.5, mood=2)
    open_page(page, "Live")
    button = page.get_by_role("button", name="Stop")
    expect(button).to_be_enabled()
    button.click()
    expect(button).to_be_disabled()
    expect(page.get_by_label("What happened")).to_contain_text("stopped from the studio")


def test_a_value_is_tuned_undone_and_seen_by_other_pages(
    page: Page, browser: Browser, system: System
) -> None:
    other = browser.new_context().new_page()
    other.goto(system.to_look)
    expect(other.locator(".phase")).to_have_text("connected")
    open_page(page, "Tune")
    open_page(other, "Tune")
    name = "#tunable-attentive_guide-patience"
    page.locator(name).fill("12")
    page.locator(name).press("Enter")
    expect(other.locator(name)).to_have_value("12")
    expect(page.get_by_label("Changes")).to_contain_text("8 s → 12 s")
    page.get_by_role("button", name="Undo").click()
    expect(other.locator(name)).to_have_value("8")
    other.context.close()


def test_a_value_out_of_range_is_refused_in_the_words_of_the_command_line(page: Page) -> None:
    open_page(page, "Tune")
    page.locator("#tunable-attentive_guide-patience").fill("99")
    page.locator("#tunable-attentive_guide-patience").press("Enter")
    expect(page.locator("output.answer")).to_contain_text("99 s, expected 2 s to 30 s")
    expect(page.locator("#tunable-attentive_guide-patience")).to_have_value("8")


def test_who_may_only_look_changes_nothing(browser: Browser, system: System) -> None:
    page = browser.new_context().new_page()
    page.goto(system.to_look)
    open_page(page, "World")
    page.get_by_role("button", name="Announce the scene").click()
    expect(page.locator("output")).to_contain_text("this needs the role operate")
    page.context.close()


def test_without_the_printed_address_nothing_is_shown(browser: Browser, system: System) -> None:
    page = browser.new_context().new_page()
    page.goto(system.address.partition("#")[0])
    expect(page.locator(".phase")).to_contain_text("Not signed in", timeout=LIMIT_MS)
    assert page.locator(".node").count() == 0
    page.context.close()


@pytest.mark.parametrize("language", ["en-US@posix", "C", "", "xx-invalid", "de-DE", "ar-EG"])
def test_the_page_opens_in_any_language(browser: Browser, system: System, language: str) -> None:
    getter = f"{{get: () => {json.dumps(language)}}}"
    page = browser.new_context().new_page()
    page.add_init_script(f"Object.defineProperty(Navigator.prototype, 'language', {getter})")
    page.goto(system.address)
    expect(page.locator(".phase")).to_have_text("connected", timeout=LIMIT_MS)
    expect(page.get_by_label("Mood").locator("canvas")).to_be_in_viewport()
    page.context.close()


def test_a_panel_that_throws_says_so_and_leaves_the_others_alive(
    browser: Browser, system: System
) -> None:
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.set_default_timeout(LIMIT_MS)
    page.add_init_script("""
        const draw = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = () => { throw new Error("no canvas here"); };
        window.mend = () => { HTMLCanvasElement.prototype.getContext = draw; };
    """)
    page.goto(system.address)
    mood = page.get_by_role("alert", name="Mood")
    expect(mood).to_be_in_viewport()
    expect(mood).to_contain_text("This panel has failed. The rest of the page goes on.")
    expect(mood).to_contain_text("no canvas here")
    announce(page, "beside a broken panel", age=4.5, mood=2)
    open_page(page, "Live")
    expect(page.get_by_label("Scene", exact=True)).to_contain_text("beside a broken panel")
    expect(page.locator(".node.running").first).to_be_visible()
    page.evaluate("mend()")
    mood.get_by_role("button", name="Show it again").click()
    expect(page.get_by_label("Mood").locator("canvas")).to_be_in_viewport()
    expect(mood).to_have_count(0)
    stop(page)
    page.context.close()


def test_a_page_that_cannot_be_loaded_says_why(browser: Browser, system: System) -> None:
    page = browser.new_context().new_page()
    page.add_init_script(
        "Intl.NumberFormat = function () { throw new RangeError('no numbers here'); }"
    )
    page.goto(system.address)
    shown = page.get_by_role("alert")
    expect(shown).to_be_in_viewport(timeout=LIMIT_MS)
    expect(shown).to_contain_text("The studio cannot be shown in this browser.")
    expect(shown).to_contain_text("no numbers here")
    page.context.close()


def test_feedback_moves_a_profile_and_can_be_undone(page: Page) -> None:
    # Nobody fits exactly, else there would be nothing to move.
    announce(page, "somebody who judges", age=1.2, familiarity=4.8, mood=1.3)
    open_page(page, "Live")
    expect(page.get_by_role("button", name="Stop")).to_be_enabled()
    stop(page)
    open_page(page, "Market")
    page.get_by_role("button", name="Bad").click()
    newest = page.get_by_label("Feedback").locator("li").first
    expect(newest).to_contain_text("negative · button")
    newest.get_by_role("button", name="Undo").click()
    expect(page.get_by_label("Feedback").locator("output")).not_to_be_empty()


def test_the_time_bar_shows_an_earlier_moment_and_comes_back(page: Page) -> None:
    announce(page, "the last guest", age=4.5, mood=2)
    stop(page)
    scene = page.get_by_label("Scene", exact=True)
    expect(scene).to_contain_text("the last guest")
    bar = page.get_by_label("Moment that is shown")
    bar.fill(bar.get_attribute("min") or "")
    expect(scene).not_to_contain_text("the last guest")
    expect(page.get_by_role("button", name="Stop")).to_be_disabled()
    page.get_by_role("button", name="Back to now").click()
    expect(scene).to_contain_text("the last guest")


def test_a_recording_is_looked_into(page: Page) -> None:
    announce(page, "somebody recorded", age=4.5, mood=2)
    stop(page)
    page.wait_for_timeout(1500)  # the journal writes once a second
    open_page(page, "System")
    page.get_by_role("button", name="Look into it").first.click()
    expect(page.locator(".time")).to_contain_text(".mcap")
    open_page(page, "Market")
    expect(page.get_by_label("Rounds")).to_contain_text("somebody recorded")
    expect(page.get_by_role("button", name="Good")).to_be_disabled()
    page.get_by_role("button", name="Back to now").click()
    expect(page.get_by_role("button", name="Good")).to_be_enabled()


def test_a_killed_host_is_seen_to_go_and_to_come_back(page: Page, system: System) -> None:
    open_page(page, "System")
    part = page.get_by_label("Parts").locator("li", has_text="/agents")
    expect(part).to_contain_text("there")
    pids = children(system.up.process.pid)
    host = next(pid for pid in pids if "bt_agents.host.node" in _command(pid))
    os.kill(host, signal.SIGKILL)
    expect(part).to_contain_text("silent since")
    expect(part).to_contain_text("there")
    announce(page, "after the kill", age=4.5, mood=2)
    open_page(page, "Live")
    expect(page.locator(".node.running").first).to_be_visible()
    stop(page)


def _command(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()


def test_a_name_with_markup_is_text(page: Page) -> None:
    name = "<img src=x onerror=document.title='taken'>"
    announce(page, name, age=4.5, mood=2)
    open_page(page, "Live")
    expect(page.get_by_label("Scene", exact=True)).to_contain_text(name)
    assert page.locator("img").count() == 0
    assert page.title() == "bt-agents studio"
    stop(page)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_page_is_hard_to_reach_for_anybody(page: Page, scheme: str) -> None:
    axe = (installed_package(*AXE) / "node_modules/axe-core/axe.min.js").read_text("utf-8")
    page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
    for name in PAGES:
        page.goto(
            re.sub(r"/#.*", f"/{name}", page.url.partition("#")[0].rpartition("/")[0] + "/#")
        )
        expect(page.locator(".phase")).to_have_text("connected")
        page.evaluate(axe)
        found = page.evaluate(f"axe.run(document, {RULES})")
        assert [(one["id"], one["nodes"][0]["html"]) for one in found["violations"]] == []


def test_the_tree_is_walked_by_keys(page: Page) -> None:
    announce(page, "somebody for keys", age=4.5, mood=2)
    open_page(page, "Live")
    expect(page.locator(".node.running").first).to_be_visible()
    page.get_by_role("tree").focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowRight")
    chosen = page.locator('[role="treeitem"][aria-selected="true"]')
    expect(chosen).to_have_count(1)
    stop(page)


def test_the_committed_page_is_what_its_source_builds(
    tmp_path: Path, build_page: Callable[[Path], Path]
) -> None:
    committed = ROOT / "bt_agents_studio" / "bt_agents_studio" / "page"
    built = build_page(tmp_path)
    names = sorted(one.name for one in committed.iterdir())
    assert sorted(one.name for one in built.iterdir()) == names
    for name in names:
        assert (built / name).read_bytes() == (committed / name).read_bytes(), name


@pytest.fixture
def build_page() -> Callable[[Path], Path]:
    """Build the page from a copy of its source."""
    import shutil
    import subprocess

    from npm_packages import node_environment, npm, program

    def build(folder: Path) -> Path:
        source = folder / "bt_agents_studio" / "frontend"
        ignored = shutil.ignore_patterns("node_modules")
        shutil.copytree(ROOT / "bt_agents_studio" / "frontend", source, ignore=ignored)
        try:
            npm("ci", folder=source)
        except NotFetched as reason:
            pytest.skip(str(reason))
        for tool in (("typescript/bin/tsc", "--noEmit"), ("vite/bin/vite.js", "build")):
            command = [program("node"), str(source / "node_modules" / tool[0]), tool[1]]
            done = subprocess.run(
                command,
                cwd=source,
                env=node_environment(),
                capture_output=True,
                text=True,
                timeout=120,
                check=False,
            )
            assert done.returncode == 0, done.stdout + done.stderr
        return folder / "bt_agents_studio" / "bt_agents_studio" / "page"

    return build
