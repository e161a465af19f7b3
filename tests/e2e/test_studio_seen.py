# SPDX-License-Identifier: Apache-2.0
"""Look of every page of the studio: in a narrow window, with long words, and under axe."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from playwright.sync_api import Browser, Page, expect

from bt_agents_studio.records import FileRecord, HealthRecord, HostRecord, PresetRecord
from studio_browser import found_by_axe, opened_page
from studio_entries import (
    HOST,
    agent,
    auction,
    awaited,
    event,
    filled,
    market,
    part,
    profile_step,
    question,
    recording,
    run,
    scene,
    tunable,
    tunings,
)
from studio_harness import BackgroundStudio, background_studio

pytestmark = pytest.mark.e2e

PAGES = ("live", "market", "tune", "world", "system", "person")
LONG = "Donaudampfschifffahrtselektrizitätenhauptbetriebswerkbauunterbeamtengesellschaft" * 2
PHONE, WINDOW = (390, 844), (1280, 800)
RULES = """{
    runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"],
    rules: {"label-content-name-mismatch": {enabled: true}},
}"""


@pytest.fixture(scope="module")
def studio() -> Iterator[BackgroundStudio]:
    """A studio with content in every panel, and long words in it."""
    with background_studio() as served:
        fill(served)
        yield served


def fill(studio: BackgroundStudio) -> None:
    preset = PresetRecord(
        name=LONG, values={"guide.patience": "20 s"}, settings={"guide.patience": 20.0}
    )
    trees = f"/home/somebody/{LONG}"
    host = filled(HostRecord, host=HOST, instance="x", trees=trees, agents=("guide", LONG))
    health = HealthRecord(level="OK", message=LONG, values={"files": LONG}, since_s=0.0)
    for name in ("marketplace", "robot", HOST):
        studio.put("parts", name, part())
    studio.put("hosts", HOST, host)
    studio.put("health", "agents: files", health)
    studio.put("files", f"{HOST}|agents/guide.yaml", FileRecord(text="format: 1\n"))
    studio.put("market", "", market())
    studio.put("scene", "", scene(LONG))
    studio.put("live", "", scene())
    studio.put("agents", "guide", agent("guide", LONG))
    studio.put("agents", LONG, agent(LONG))
    studio.put("runs", "guide", replace(run("guide"), message=LONG))
    studio.put("rounds", "x/1", auction("guide", LONG))
    for number in range(40):
        studio.put("feedback", f"guide||{number}", profile_step("guide", number))
    studio.put("tunables", f"{HOST}|guide.patience", tunable("guide", "patience", 8.0))
    rate = tunable("guide", "learning_rate", 0.5, kind="LEARNING_RATE", maximum=1.0)
    studio.put("tunables", f"{HOST}|guide.learning_rate", rate)
    words = tunable("guide", "words", LONG, type="TEXT", unit="", minimum=None, maximum=None)
    studio.put("tunables", f"{HOST}|guide.words", words)
    studio.put("tunings", HOST, tunings(40, preset, changes=40))
    studio.put("questions", "", question(LONG, "yes", LONG))
    studio.put("listening", f"door/{LONG.lower()}", awaited())
    studio.put("recording", "", recording())
    now = time.time()
    for lane in ("AGENT", "ROBOT", "MARKET", "FEEDBACK", "FAULT", "RECORDING"):
        studio.put("events", lane, event(lane, LONG.upper(), now, None, LONG))


@contextmanager
def opened_at(
    browser: Browser, studio: BackgroundStudio, name: str, *, has_touch: bool = False
) -> Iterator[Page]:
    address = studio.address.replace("/#", f"/{name}#")
    with opened_page(browser, address, has_touch=has_touch) as page:
        expect(page.locator(".phase")).to_have_text("connected")
        expect(page.locator("main section").first).to_be_visible()
        yield page


def unfold(page: Page) -> None:
    folded = page.locator("main details:not([open]) > summary")
    while folded.count() > 0:
        folded.first.click()


@pytest.mark.parametrize("name", PAGES)
def test_page_fits_its_window(browser: Browser, studio: BackgroundStudio, name: str) -> None:
    with opened_at(browser, studio, name) as page:
        for width, height in (PHONE, WINDOW):
            page.set_viewport_size({"width": width, "height": height})
            # The timeline is redrawn when its width changes.
            page.wait_for_function(
                "() => [...document.querySelectorAll('.timeline-lanes svg')]"
                ".every((one) => one.getBoundingClientRect().right <= innerWidth)"
            )
            unfold(page)
            wide = page.evaluate("""() => [...document.querySelectorAll("header *, main *")]
                .filter((one) => one.getBoundingClientRect().right > innerWidth + 1)
                .filter((one) => !one.closest("pre, .market-rounds, .tree, .shared-hidden"))
                .map((one) => one.outerHTML.slice(0, 120))""")
            assert wide == [], width
            assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("name", PAGES)
def test_fingers_find_large_targets(browser: Browser, studio: BackgroundStudio, name: str) -> None:
    with opened_at(browser, studio, name, has_touch=True) as page:
        unfold(page)
        small = page.evaluate("""() => [...document.querySelectorAll("button, input, select, a")]
            .filter((one) => one.type !== "checkbox" && one.checkVisibility())
            .filter((one) => one.getBoundingClientRect().height < 44)
            .map((one) => one.outerHTML.slice(0, 120))""")
        assert small == []


@pytest.mark.parametrize("name", PAGES)
def test_filled_page_is_accessible(browser: Browser, studio: BackgroundStudio, name: str) -> None:
    with opened_at(browser, studio, name) as page:
        unfold(page)
        assert found_by_axe(page, "document", RULES) == []
