# SPDX-License-Identifier: Apache-2.0
"""Operations on the studio's pages: permissions, waiting, and results."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from bt_agents_studio.access import SessionRole
from bt_agents_studio.records import StrategyRecord
from studio_browser import box, look_back, open_page, opened_page, strip, wait_for
from studio_entries import HOST, agent, market, part, recording, tunable, tunings
from studio_harness import BackgroundStudio, background_studio

pytestmark = pytest.mark.e2e

CHANGING = {
    "market": ("Pin", "Veto", "Award", "Good", "Bad", "Draw the map"),
    "tune": ("As in the file", "Show what would be written"),
    "world": ("Announce the scene", "Change only the sensed values", "Show its address", "Start"),
    "person": ("Begin", "I am leaving", "Good", "worse"),
}
"""Page → its buttons that change something, or call the system."""

NEAREST = StrategyRecord(name="manhattan", description="the nearest", options=())


@pytest.fixture(scope="module")
def studio() -> Iterator[BackgroundStudio]:
    with background_studio() as served:
        served.put("parts", "marketplace", part())
        served.put("agents", "guide", agent("guide"))
        served.put("tunables", f"{HOST}|guide.patience", tunable("guide", "patience", 8.0))
        served.put("tunings", HOST, tunings())
        served.put("market", "", replace(market(), strategies=(NEAREST,)))
        served.put("recording", "", replace(recording(), recording=False))
        yield served


@pytest.fixture
def page(browser: Browser, studio: BackgroundStudio) -> Iterator[Page]:
    with opened_page(browser, studio.address) as opened:
        expect(opened.locator(".phase")).to_have_text("connected")
        yield opened


def test_only_announced_scene_names_its_person(page: Page, studio: BackgroundStudio) -> None:
    open_page(page, "World")
    panel = page.get_by_label("Play the world")
    panel.get_by_label("Known as").fill("Anna")
    for button, name in (("Change only the sensed values", None), ("Announce the scene", "Anna")):
        studio.caller.calls.clear()
        panel.get_by_role("button", name=button).click()
        expect(panel.locator("output")).to_have_text("done")
        expect(panel.get_by_role("button", name=button)).to_be_enabled()
        [(service, fields)] = studio.caller.calls
        assert service == "scene_layer/analyze"
        assert fields.get("name") == name


def test_operation_is_sent_once_while_it_waits(
    page: Page, studio: BackgroundStudio, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Future[Any]] = []

    def wait(*_: object) -> Future[Any]:
        asked.append(Future())
        return asked[-1]

    monkeypatch.setattr(studio.caller, "call", wait)
    open_page(page, "World")
    button = page.get_by_role("button", name="Announce the scene")
    button.click()
    expect(button).to_have_text("Announce the scene …")
    expect(button).to_be_disabled()
    expect(button).to_be_focused()
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Change only the sensed values").click(force=True)
    wait_for(page, lambda: asked)
    asked[0].set_result(SimpleNamespace(accepted=False, code="NO", message="not today"))
    shown = page.get_by_label("Play the world").locator("output")
    expect(shown).to_have_text("not today")
    expect(shown).to_have_class("operation-answer shared-failure")
    expect(shown).to_be_in_viewport()
    expect(button).to_have_text("Announce the scene")
    expect(button).to_be_enabled()
    assert len(asked) == 1


def test_visitor_gets_code_of_reachable_studio_only(page: Page, studio: BackgroundStudio) -> None:
    open_page(page, "World")
    panel = page.get_by_label("Phone or tablet for a visitor")
    panel.get_by_role("button", name="Show its address").click()
    expect(panel.get_by_text("Only this machine can open it")).to_be_visible()
    expect(panel.get_by_role("img")).to_have_count(0)

    address = f"https://192.168.1.20:8770/person#{'0123456789abcdef' * 4}"
    reachable = {"accepted": True, "code": "", "message": ""} | {
        "record": {"address": address, "is_local": False}
    }
    page.route("**/api/do/person_link", lambda route: route.fulfill(json=reachable))
    page.reload()
    panel.get_by_role("button", name="Show its address").click()
    code = panel.get_by_role("img", name="QR code of the page Person")
    code.scroll_into_view_if_needed()
    expect(code).to_be_in_viewport(ratio=1)
    assert box(code)["width"] >= 200
    expect(panel).to_contain_text(address)
    page.unroute("**/api/do/person_link")


def test_viewer_sees_why_controls_are_disabled(browser: Browser, studio: BackgroundStudio) -> None:
    with opened_page(browser, studio.address_for(SessionRole.VIEW)) as page:
        open_page(page, "Market")
        strategy = page.get_by_label("Strategy", exact=True)
        expect(strategy).to_contain_text("the nearest")
        expect(strategy.get_by_label("Ranks the bids")).to_be_disabled()
        for name, labels in CHANGING.items():
            open_page(page, name.capitalize())
            expect(page.get_by_text("This link is for viewing only").first).to_be_in_viewport()
            for label in labels:
                expect(page.get_by_role("button", name=label, exact=True).first).to_be_disabled()


def test_operator_is_told_that_files_stay(page: Page) -> None:
    open_page(page, "Tune")
    keep = page.get_by_label("Keep in the files")
    expect(keep).to_contain_text("This link is not for writing files")
    expect(keep.get_by_role("button")).to_be_disabled()


def test_tab_without_key_views_until_it_signs_in(page: Page, studio: BackgroundStudio) -> None:
    other = page.context.new_page()
    other.goto(studio.address.partition("#")[0])
    open_page(other, "World")
    panel = other.get_by_label("Play the world")
    button = panel.get_by_role("button", name="Announce the scene")
    expect(other.get_by_text("This tab is for viewing only").first).to_be_in_viewport()
    expect(button).to_be_disabled()
    other.goto(studio.address)
    open_page(other, "World")
    button.click()
    expect(panel.locator(".operation-answer")).not_to_be_empty()
    expect(panel).not_to_contain_text("This tab is for viewing only")


def test_earlier_moment_cannot_be_changed(page: Page, studio: BackgroundStudio) -> None:
    look_back(page)
    open_page(page, "World")
    button = page.get_by_role("button", name="Announce the scene")
    expect(page.get_by_text("This is an earlier moment").first).to_be_in_viewport()
    expect(button).to_be_disabled()
    page.get_by_role("button", name="Back to now").click()
    expect(button).to_be_enabled()


EMPTY = {
    "live": "No agent has run yet",
    "market": "There has been no round yet",
    "tune": "No host of agents is running",
    "system": "None.",
}
"""Page → its first sentence if a system is there, but nothing has happened."""


@pytest.mark.parametrize("name", EMPTY)
def test_empty_page_says_what_is_missing(browser: Browser, name: str) -> None:
    with background_studio() as fresh:
        with opened_page(browser, fresh.address.partition("#")[0] + name) as stranger:
            expect(stranger.get_by_role("main")).to_contain_text("Not signed in")
            expect(stranger.get_by_text(EMPTY[name])).to_have_count(0)
        with opened_page(browser, fresh.address_for(SessionRole.OPERATE, name)) as page:
            main = page.get_by_role("main")
            expect(main.get_by_text("No system is running here").first).to_be_in_viewport()
            expect(page.get_by_text(EMPTY[name], exact=name == "system")).to_have_count(0)
            fresh.put("parts", "marketplace", part(alive=False))
            expect(main.get_by_text("The system is silent").first).to_be_in_viewport()
            expect(strip(page)).to_contain_text("the marketplace is silent since")
            fresh.put("parts", "marketplace", part())
            told = main.get_by_text(EMPTY[name], exact=name == "system").first
            expect(told).to_be_in_viewport()
            expect(page.get_by_text("No system is running here")).to_have_count(0)
