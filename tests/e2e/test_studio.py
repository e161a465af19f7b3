# SPDX-License-Identifier: Apache-2.0
"""The studio in a real browser, beside a real system."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from checkout import ROOT
from npm_packages import node_environment, npm, program
from programs import node_of
from studio_browser import (
    LIMIT_MS,
    System,
    announce,
    come,
    enter,
    open_page,
    open_values,
    opened_page,
    running_system,
    serve,
    stop,
    strip,
)

pytestmark = pytest.mark.e2e


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    state = tmp_path_factory.mktemp("state")
    with running_system(state, "trees", "--journal", "--no-voice") as running:
        yield running


def test_played_scene_shows_reasons_until_it_is_stopped(page: Page) -> None:
    guest = "<img src=x onerror=document.title='taken'>"  # shown as text
    serve(page, guest, age=4.5, mood=2)
    expect(page.locator("[role=treeitem][data-status=RUNNING]").first).to_be_visible()
    log = page.get_by_label("What happened")
    expect(log).to_contain_text("started")
    page.locator("[role=treeitem]").first.click()
    expect(page.get_by_label("Node", exact=True)).to_contain_text("trees/agents/")
    open_page(page, "Market")
    shown = page.get_by_label("Bids", exact=True)
    expect(shown.locator("tr[data-winner]")).to_have_count(1)
    expect(shown).to_contain_text(guest)
    assert page.locator("img").count() == 0
    assert "taken" not in page.title()
    strip(page).get_by_role("button", name="Stop").click()
    expect(strip(page)).to_contain_text("idle")
    open_page(page, "Live")
    expect(log).to_contain_text("stopped from the studio")


def test_run_stops_at_breakpoint_steps_resumes_and_succeeds(page: Page) -> None:
    open_page(page, "Live")
    page.get_by_label("Agent").select_option("patient_carrier")
    node = page.locator('[role=treeitem][data-path="tree/1.wait"]')
    node.click()
    page.keyboard.press("b")
    expect(page.locator("[data-set]")).to_have_count(1)
    announce(page, "something in the way", age=3, familiarity=3, mood=3)
    open_page(page, "Live")
    banner = page.locator(".control-paused")
    expect(banner).to_contain_text("Paused before wait ${patience} (tree/1.wait)")
    expect(page.get_by_role("button", name="Pause")).to_be_disabled()
    node.locator(".outline-breakpoint").click()
    expect(page.locator("[data-set]")).to_have_count(0)
    page.get_by_role("button", name="Step").click()
    expect(page.get_by_text("patient_carrier was ticked once")).to_be_visible()
    left = page.locator('[data-left="tree/1.wait"]')
    expect(left).to_have_text("4.0 s left")
    node.click()
    details = page.get_by_label("Node", exact=True)
    expect(details.get_by_role("row", name="patience")).to_contain_text("4 s")
    page.get_by_role("button", name="Resume").click()
    expect(banner).to_have_count(0)
    expect(left).to_have_text(re.compile(r"^[0-3]\.\d s left$"))
    log = page.get_by_label("What happened")
    expect(log).to_contain_text("is paused before tree/1.wait")
    expect(log).to_contain_text("goes on")
    expect(log).to_contain_text("something in the way")
    expect(page.locator(".live-run")).to_contain_text("succeeded")


def test_refused_value_is_explained_and_put_back(
    page: Page, browser: Browser, system: System
) -> None:
    name = "#tunable-attentive_guide-patience"
    field = page.locator(name)
    open_values(page, "attentive_guide")
    enter(field, "99")
    told = page.locator(".fields-row", has=field).locator("output")
    expect(told).to_contain_text("99 s, expected 2 s to 30 s")
    expect(told).to_be_in_viewport()
    expect(field).to_have_value("8")
    with opened_page(browser, system.to_look) as viewer:
        open_values(viewer, "attentive_guide")
        expect(viewer.locator(name)).to_be_disabled()


@pytest.fixture
def tablet(browser: Browser, system: System, page: Page) -> Iterator[Page]:
    """The page Person, in a browser of its own; no agent runs before and after."""
    stop(page)
    with opened_page(browser, system.for_person) as opened:
        opened.set_viewport_size({"width": 1024, "height": 768})
        expect(opened.locator(".phase")).to_have_text("connected")
        yield opened
        stop(page)


def test_falling_visitor_mood_changes_market_winner(page: Page, tablet: Page) -> None:
    come(tablet, "an older adult", "meets it for the first time", "neutral")
    expect(tablet.get_by_label("The robot says")).to_contain_text("Hello. I carry your luggage")
    open_page(page, "Market")
    expect(page.get_by_label("Bids", exact=True)).to_contain_text("a visitor at the screen")
    expect(strip(page)).to_have_attribute("data-state", "RUNNING")
    rounds = page.get_by_label("Rounds").get_by_role("button")
    before = rounds.count()
    worse = tablet.get_by_role("button", name="worse")
    worse.click()
    worse.click()
    expect(tablet.get_by_role("region", name="How do you feel?")).to_contain_text("upset")
    newest = page.get_by_label("Feedback").locator("li").first
    expect(newest).to_contain_text("negative · mood rule")
    expect(rounds).to_have_count(before + 1)
    expect(page.get_by_label("Bids", exact=True).locator("tr[data-winner]")).not_to_contain_text(
        "attentive_guide"
    )


def test_visitor_answers_in_text_and_by_keyboard(page: Page, tablet: Page) -> None:
    told = tablet.locator(".person-told")
    come(tablet, "an adult", "works with it every day", "neutral")
    enter(tablet.get_by_role("textbox", name="Your answer"), "Gate 12")
    expect(told).to_have_text("Your answer: Gate 12")
    stop(page)
    come(tablet, "an older adult", "meets it for the first time", "neutral")
    expect(tablet.get_by_label("Your answer").get_by_role("button")).to_be_visible()
    tablet.keyboard.press("1")
    expect(told).to_have_text("Your answer: yes")


def test_single_switch_suffices_to_answer(tablet: Page) -> None:
    come(tablet, "an older adult", "meets it for the first time", "neutral")
    tablet.get_by_role("button", name="One button").click()
    choice = tablet.get_by_label("Your answer").get_by_role("button").first
    expect(choice).to_be_focused()
    # A touch anywhere presses the focused button.
    tablet.mouse.click(5, 400)
    expect(tablet.locator(".person-told")).to_contain_text("Your answer: ")


def test_browser_speaks_each_text_once_when_allowed(tablet: Page) -> None:
    tablet.evaluate(
        """() => {
            window.spoken = [];
            speechSynthesis.speak = (one) => window.spoken.push(one.text);
        }"""
    )
    tablet.get_by_role("button", name="Speak aloud").click()
    come(tablet, "an older adult", "meets it for the first time", "neutral")
    expect(tablet.get_by_label("The robot says")).to_contain_text("Shall we go?")
    spoken = tablet.evaluate("window.spoken")
    assert spoken[-3:] == [
        "Hello. I carry your luggage.",
        "Put your bag on the platform, please.",
        "Shall we go?",
    ]
    tablet.get_by_role("button", name="Stop").click()
    expect(tablet.get_by_role("alert")).not_to_be_empty()


def test_visitor_rates_by_face_or_by_parameter(page: Page, tablet: Page) -> None:
    come(tablet, "a child", "works with it every day", "upset")
    expect(tablet.get_by_label("The robot says")).not_to_contain_text("says nothing yet")
    judge = tablet.get_by_role("region", name="How was the robot?")
    judge.get_by_role("button", name="Bad").click()
    open_page(page, "Market")
    newest = page.get_by_label("Feedback").locator("li").first
    expect(newest).to_contain_text("negative · person")
    judge.get_by_role("button", name="Say more").click()
    judge.get_by_role("slider").fill("2")
    judge.get_by_role("button", name="Next").click()
    for _ in range(2):
        judge.get_by_role("button", name="No opinion").click()
    expect(newest).to_contain_text("direct · person")


def test_visitor_stop_works_or_reports_that_it_cannot(page: Page, tablet: Page) -> None:
    come(tablet, "an older adult", "meets it for the first time", "neutral")
    expect(tablet.get_by_label("The robot says")).to_contain_text("Hello")
    button = tablet.get_by_role("button", name="Stop")
    button.click()
    open_page(page, "Live")
    expect(page.get_by_label("What happened")).to_contain_text("stopped by the person")
    tablet.context.set_offline(True)
    button.click()
    expect(tablet.get_by_role("alert")).to_contain_text("The robot does not answer")


def test_open_page_recovers_after_studio_is_killed(
    page: Page, tablet: Page, system: System
) -> None:
    os.kill(node_of(system.up.process.pid, "bt_agents_studio.process"), signal.SIGKILL)
    expect(page.locator(".phase")).to_contain_text("trying again")
    for one in (page, tablet):
        expect(one.locator(".phase")).to_have_text("connected")
    come(tablet, "a child", "meets it for the first time", "content")
    expect(tablet.get_by_label("The robot says")).not_to_contain_text("says nothing yet")


@pytest.mark.parametrize("language", ["en-US@posix", "C", "", "xx-invalid", "de-DE", "ar-EG"])
def test_the_page_opens_in_any_language(browser: Browser, system: System, language: str) -> None:
    getter = f"{{get: () => {json.dumps(language)}}}"
    with opened_page(browser, "about:blank") as page:
        page.add_init_script(f"Object.defineProperty(Navigator.prototype, 'language', {getter})")
        page.goto(system.address)
        expect(page.locator(".phase")).to_have_text("connected")
        expect(page.get_by_label("Mood").locator("canvas")).to_be_in_viewport()


def test_failing_panel_reports_error_and_spares_others(browser: Browser, system: System) -> None:
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
    expect(mood).to_contain_text("This panel has failed. The rest of the page works.")
    expect(mood).to_contain_text("no canvas here")
    serve(page, "beside a broken panel", age=4.5, mood=2)
    expect(page.locator("[role=treeitem][data-status=RUNNING]").first).to_be_visible()
    page.evaluate("mend()")
    mood.get_by_role("button", name="Show it again").click()
    expect(page.get_by_label("Mood").locator("canvas")).to_be_in_viewport()
    expect(mood).to_have_count(0)
    stop(page)
    page.context.close()


def test_unloadable_page_says_why(browser: Browser, system: System) -> None:
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


PROCESSES = {
    "marketplace": "marketplace_node.node",
    "scene_layer": "scene_layer.node",
    "feedback": "feedback_node.node",
    "agents": "bt_agents.host.node",
    "robot": "bt_agents_robot.robot",
    "journal": "bt_agents_lab.node",
}
"""Name of each process → its module."""

WITH_HEARTBEAT = ("marketplace", "agents", "robot")


def test_open_page_continues_after_killed_process_restarts(page: Page, system: System) -> None:
    open_page(page, "System")
    for name, module in PROCESSES.items():
        part = page.get_by_label("Parts").locator("li", has_text=name)
        row = page.get_by_label("Processes").locator(
            "tr", has=page.locator("th", has_text=re.compile(f"^{name}\\s*$"))
        )
        expect(row).to_contain_text(re.compile(r"up\d\d:\d\d:\d\d.* MB"))
        if name in WITH_HEARTBEAT:
            expect(part).to_contain_text("alive")
        pid = node_of(system.up.process.pid, module)
        if name in WITH_HEARTBEAT:
            # It may be restarted before its loss is noticed.
            os.kill(pid, signal.SIGSTOP)
            expect(part).to_contain_text("silent since")
        os.kill(pid, signal.SIGKILL)
        system.up.until(f"{name} is back")
        expect(row).to_contain_text("killed by signal 9")
        expect(row.locator(".system-level")).to_have_text("up")
        expect(row.get_by_role("cell", name=str(pid), exact=True)).to_have_count(0)
        if name in WITH_HEARTBEAT:
            expect(part).to_contain_text("alive")
    serve(page, "after all of that", age=4.5, mood=2)
    expect(page.locator("[role=treeitem][data-status=RUNNING]").first).to_be_visible()
    stop(page)


def test_committed_page_matches_build_of_its_source(tmp_path: Path) -> None:
    committed = ROOT / "bt_agents_studio" / "bt_agents_studio" / "page"
    built = build_page(tmp_path)
    names = sorted(one.name for one in committed.iterdir())
    assert sorted(one.name for one in built.iterdir()) == names
    for name in names:
        assert (built / name).read_bytes() == (committed / name).read_bytes(), name


def build_page(folder: Path) -> Path:
    """Check, test and build the page from a copy of its source."""
    source = folder / "bt_agents_studio" / "frontend"
    ignored = shutil.ignore_patterns("node_modules")
    shutil.copytree(ROOT / "bt_agents_studio" / "frontend", source, ignore=ignored)
    npm("ci", folder=source)
    for tool, *arguments in (
        ("typescript/bin/tsc", "--noEmit"),
        ("vitest/vitest.mjs", "run"),
        ("vite/bin/vite.js", "build"),
    ):
        done = subprocess.run(
            [program("node"), str(source / "node_modules" / tool), *arguments],
            cwd=source,
            env=node_environment(),
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
    return folder / "bt_agents_studio" / "bt_agents_studio" / "page"
