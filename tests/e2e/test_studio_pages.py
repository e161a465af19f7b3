# SPDX-License-Identifier: Apache-2.0
"""Changes made by the studio's pages: recordings, answers, messages, dry runs, kept values."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from bt_agents_lab.recorder.reading import JournalReader
from checkout import ROOT
from studio_browser import (
    System,
    announce,
    box,
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

ASKER = """\
format: 1
agent: asker
title: Asker
description: Asks.
profile: {age: 1, familiarity: 3, mood: 3}
learning_rate: 0.5
tunables:
  patience: {default: 60 s, min: 1 s, max: 90 s, description: how long to wait} # a comment
tree:
  sequence:
    - ask: {text: "Shall we go?", choices: ["yes", "no"], wait: "${patience}"}
    - say: "You said ${answer}."
    - wait: 60 s
"""
LISTENER = """\
format: 1
agent: listener
title: Listener
description: Listens.
profile: {age: 5, familiarity: 3, mood: 3}
tree:
  sequence:
    - wait_for: {topic: buttons/go, type: std_msgs/msg/Bool, until: msg.data}
    - say: pressed
    - wait_for: {topic: door/state, type: std_msgs/msg/String, until: msg.data == "open"}
    - say: opened
    - wait: 60 s
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trees folder with an agent that asks and one that waits for a message."""
    trees = tmp_path_factory.mktemp("of_pages") / "trees"
    (trees / "agents").mkdir(parents=True)
    shutil.copy(ROOT / "trees" / "scene.yaml", trees)
    shutil.copytree(ROOT / "trees" / "skills", trees / "skills")
    (trees / "agents" / "asker.yaml").write_text(ASKER)
    (trees / "agents" / "listener.yaml").write_text(LISTENER)
    return trees


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory, folder: Path) -> Iterator[System]:
    state = tmp_path_factory.mktemp("state")
    with running_system(state, str(folder), "--journal") as running:
        yield running


def test_recording_is_started_marked_listed_and_downloaded(page: Page, tmp_path: Path) -> None:
    open_page(page, "World")
    panel = page.get_by_label("Recording", exact=True)
    expect(panel).to_contain_text("is being recorded")
    panel.get_by_role("button", name="Stop").click()
    expect(panel).to_contain_text("Nothing is recorded now")
    panel.get_by_label("Label of the recording").fill("a class")
    panel.get_by_label("Notes").fill("twelve children")
    panel.get_by_role("button", name="Start").click()
    expect(panel).to_contain_text("a class is being recorded")
    panel.get_by_label("Bookmark").fill("they laughed")
    panel.get_by_role("button", name="Mark this moment").click()
    expect(panel).to_contain_text("Bookmarks: 1")
    expect(page.locator(".timeline-marks rect")).to_have_count(1)
    page.wait_for_timeout(3000)  # the journal writes once a second
    seen = box(page.get_by_label("Shown moment"))
    page.mouse.click(seen["x"] + seen["width"] - 60, seen["y"] + 5)
    page.locator(".timeline_menu-menu summary", has_text="Bookmark").click()
    page.get_by_label("Note on this moment").fill("they asked")
    page.get_by_role("button", name="Set it").click()
    expect(page.locator(".timeline-marks rect")).to_have_count(2)
    page.get_by_role("button", name="Back to now").click()
    expect(page.locator(".timeline-block[data-kind=RECORDED]")).to_have_count(1)
    expect(page.locator(".timeline-block[data-kind=RECORDING]")).to_have_count(1)

    open_page(page, "System")
    row = page.get_by_label("Recordings").locator("li", has_text="a class")
    with page.expect_download() as download:
        row.get_by_role("link", name="Download").click()
    saved = tmp_path / "saved.mcap"
    download.value.save_as(saved)
    entries = JournalReader([saved]).entries()
    assert any(b"twelve children" in one.data for one in entries)

    row.get_by_role("button", name="Open", exact=True).click()
    bookmarks = page.get_by_label("Bookmarks")
    expect(bookmarks.locator("option")).to_have_count(3)
    expect(bookmarks).to_contain_text("they asked")
    bookmarks.select_option(index=1)
    expect(page.locator(".timeline")).to_contain_text(".mcap")
    page.get_by_role("button", name="Back to now").click()


def test_command_line_and_page_share_one_recording(page: Page, system: System) -> None:
    open_page(page, "World")
    panel = page.get_by_label("Recording", exact=True)
    expect(panel).to_contain_text("is being recorded")
    again = system.start_program("record", "start", "another")
    again.until("RECORDING_ALREADY: .*stop it before another one begins")
    system.start_program("record", "stop").until("nothing is recorded now")
    expect(panel).to_contain_text("Nothing is recorded now")
    begun = ("record", "start", "school class", "--notes", "twelve children, rain")
    system.start_program(*begun).until("'school class' is being recorded")
    expect(panel).to_contain_text("school class is being recorded")
    system.start_program("record", "mark", "they laughed").until("marked in .*: they laughed")
    expect(panel).to_contain_text("Bookmarks: 1")


def test_question_is_answered_by_choice_and_by_text(page: Page) -> None:
    for reply in ("yes", "no"):
        announce(page, "somebody to ask", age=1, familiarity=3, mood=3)
        panel = page.get_by_label("Open questions")
        expect(panel).to_contain_text("Shall we go?")
        if reply == "yes":
            panel.get_by_label("Another answer").fill("perhaps")
            panel.get_by_role("button", name="Answer", exact=True).click()
            expect(panel.locator("output")).to_contain_text(
                "'perhaps' is not an answer; the robot is asking: "
            )
            panel.get_by_role("button", name="yes").click()
        else:
            panel.get_by_label("Another answer").fill("no")
            panel.get_by_role("button", name="Answer", exact=True).click()
        expect(panel.locator("output")).to_contain_text(f"answered '{reply}' to: Shall we go?")
        expect(panel).to_contain_text("The robot has no open question")
        open_page(page, "Live")
        expect(page.get_by_label("What happened")).to_contain_text(f"You said {reply}.")
        stop(page)


def test_awaited_buttons_and_messages_are_sent_from_page(page: Page) -> None:
    announce(page, "somebody with a door", age=5, familiarity=3, mood=3)
    panel = page.get_by_label("What trees wait for")
    expect(panel).to_contain_text("buttons/go")
    panel.get_by_role("button", name="Press").click()
    expect(panel.locator("output")).to_contain_text("published on buttons/go")
    expect(panel).to_contain_text("door/state")
    panel.get_by_label("data").fill("open")
    panel.get_by_role("button", name="Publish").click()
    expect(panel.locator("output")).to_contain_text("published on door/state")
    open_page(page, "Live")
    expect(page.get_by_label("What happened")).to_contain_text("opened")
    stop(page)


def test_person_switch_updates_immediately(page: Page) -> None:
    announce(page, "somebody who comes and leaves", age=5, familiarity=3, mood=3)
    open_page(page, "Live")
    expect(strip(page)).to_have_attribute("data-state", "RUNNING")
    open_page(page, "World")
    switch = page.get_by_role("switch", name="Somebody is there")
    for _ in range(2):
        switch.click()
        expect(switch).to_be_checked()
        switch.click()
        expect(switch).not_to_be_checked()
    stop(page)


def test_page_switches_strategy_as_command_does(page: Page, system: System) -> None:
    open_page(page, "Market")
    panel = page.get_by_label("Strategy", exact=True)
    panel.get_by_label("Ranks the bids").select_option("ucb")
    panel.locator("#strategy-c-value").fill("101")
    panel.get_by_role("button", name="Set from the next round on").click()
    expect(panel.locator("output")).to_have_text("ucb.c: 101, expected 0 to 100")
    panel.locator("#strategy-c-value").fill("0.5")
    panel.get_by_role("button", name="Set from the next round on").click()
    expect(panel.locator("output")).to_have_text("ucb ranks the bids from the next round on")
    shown = system.start_program("strategy")
    shown.until("^> ucb ")
    shown.until("c = 0.5 ")
    system.start_program("strategy", "bounded_ucb").until("> ranks: bounded_ucb")
    expect(panel.get_by_label("Ranks the bids")).to_have_value("bounded_ucb")
    expect(panel.locator("#strategy-margin-value")).to_have_value("0.3")


def test_profile_history_shows_causes_of_changes(page: Page) -> None:
    serve(page, "somebody who judges", age=2, familiarity=4, mood=4)
    stop(page)
    open_page(page, "Market")
    page.get_by_role("button", name="Bad").click()
    panel = page.get_by_label("Feedback", exact=True)
    newest = panel.locator(".shared-lines li").first
    expect(newest).to_contain_text("negative · button")
    expect(newest).to_contain_text("learning rate 0.5 · weight")
    panel.get_by_label("Profiles over time").select_option("asker|")
    expect(panel.locator(".course circle title").first).to_contain_text("negative, button")
    shares = page.get_by_label("Contributions over time", exact=True)
    expect(shares.locator("rect").first).to_be_attached()
    newest.get_by_role("button", name="Undo").click()
    expect(panel.locator("output")).not_to_be_empty()


def test_concurrent_edits_warn_page_and_lose_nothing(
    page: Page, browser: Browser, system: System
) -> None:
    name = "#tunable-asker-patience"
    with opened_page(browser, system.address) as other:
        for one in (page, other):
            open_values(one, "asker")
        page.locator(name).fill("30")
        enter(other.locator(name), "40")
        told = page.get_by_role("main").get_by_role("alert")
        expect(told).to_contain_text("It has changed meanwhile: 60 → 40 by studio")
        page.locator(name).press("Enter")
        expect(page.locator(name)).to_have_value("30")
        expect(other.locator(name)).to_have_value("40")
        told.get_by_role("button", name="Set mine (30)").click()
        expect(other.locator(name)).to_have_value("30")
        expect(page.get_by_label("Changes")).to_contain_text("40 s → 30 s")
        page.get_by_label("Changes").get_by_role("button", name="Undo").click()
        expect(other.locator(name)).to_have_value("40")
        page.get_by_label("asker", exact=True).get_by_role(
            "button", name="As in the file"
        ).first.click()
        expect(other.locator(name)).to_have_value("60")


def test_frozen_learning_rate_differs_from_the_file(page: Page) -> None:
    open_values(page, "asker")
    panel = page.get_by_label("asker", exact=True)
    panel.get_by_role("button", name="Freeze").click()
    expect(panel).to_contain_text("it does not learn")
    page.get_by_label("Only differences from the file").check()
    expect(page.locator("#tunable-asker-patience")).to_have_count(0)
    learning_rate = page.locator("#tunable-asker-learning_rate")
    expect(learning_rate).to_have_value("0")
    panel.get_by_role("button", name="As in the file").first.click()
    expect(learning_rate).to_have_count(0)


def test_kept_change_is_previewed_before_writing(page: Page, folder: Path) -> None:
    file = folder / "agents" / "asker.yaml"
    open_values(page, "asker")
    enter(page.locator("#tunable-asker-patience"), "50")
    expect(page.get_by_label("Changes")).to_contain_text("1 min → 50 s")
    keep = page.get_by_label("Keep in the files")
    keep.get_by_role("button", name="Show what would be written").click()
    expect(keep.locator("pre")).to_contain_text("+  patience: {default: 50 s,")
    assert file.read_text() == ASKER
    enter(page.locator("#tunable-asker-patience"), "45")
    expect(page.get_by_label("Changes")).to_contain_text("50 s → 45 s")
    keep.get_by_role("button", name="Write", exact=True).click()
    expect(keep.locator("output")).to_contain_text("have changed since the change was shown")
    assert file.read_text() == ASKER
    keep.get_by_role("button", name="Show what would be written").click()
    keep.get_by_role("button", name="Write", exact=True).click()
    expect(keep.locator("output")).to_contain_text("asker.patience: 60 s → 45 s")
    assert file.read_text() == ASKER.replace("default: 60 s", "default: 45 s")


def test_system_health_shows_worst_first_with_since_time(page: Page, folder: Path) -> None:
    open_page(page, "System")
    health = page.get_by_label("Health", exact=True)
    hosts = health.locator("li", has_text="marketplace: hosts")
    expect(hosts).to_contain_text(re.compile(r"OK since \d\d:\d\d:\d\d hosts: 1, agents: 2"))
    files = health.locator("li", has_text="agents: files")
    expect(files).to_contain_text("OK")
    hosts.locator("summary").click()
    expect(hosts.locator("dl")).to_contain_text("/agents")
    file = folder / "agents" / "asker.yaml"
    before = file.read_text()
    file.write_text(before.replace("format: 1", "format: one"))
    try:
        expect(files).to_contain_text("error since")
        expect(files).to_contain_text("asker.yaml")
        expect(health.locator("li").first).to_contain_text("agents: files")
    finally:
        file.write_text(before)
    expect(files).to_contain_text("OK")
