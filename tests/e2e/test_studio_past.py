# SPDX-License-Identifier: Apache-2.0
"""Earlier moments on the studio's pages: of quick clicks, the last one counts."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Page, WebSocketRoute, expect

from studio_browser import box, opened_page, wait_for
from studio_harness import BackgroundStudio

pytestmark = pytest.mark.e2e

STEPS = 5


class Held:
    """WebSocket of a page that holds back answers about earlier moments."""

    def __init__(self) -> None:
        self.asked: list[float] = []
        self._answers: list[Callable[[], None]] = []

    def route(self, page: WebSocketRoute) -> None:
        server = page.connect_to_server()

        def ask(message: str | bytes) -> None:
            found = json.loads(message)
            if found["type"] == "seek":
                self.asked.append(found["at_s"])
            server.send(message)

        def answer(message: str | bytes) -> None:
            if json.loads(message).get("at_s") is None:
                page.send(message)
            else:
                self._answers.append(lambda: page.send(message))

        page.on_message(ask)
        server.on_message(answer)

    def until(self, page: Page, answers: int) -> None:
        """Wait until this many answers are held back."""
        wait_for(page, lambda: len(self._answers) == answers)

    def release(self) -> None:
        self._answers.pop()()


def click_along(page: Page) -> float:
    """Click along the timeline; return the last requested moment."""
    timeline = page.get_by_label("Shown moment")
    seen = box(timeline)
    for step in range(STEPS):
        page.mouse.click(seen["x"] + seen["width"] * (step + 3) / (STEPS + 4), seen["y"] + 8)
    return float(timeline.get_attribute("aria-valuenow") or "")


def test_quick_clicks_ask_for_one_moment_at_once(
    browser: Browser, studio: BackgroundStudio
) -> None:
    held = Held()
    with opened_page(browser, "about:blank") as page:
        page.route_web_socket("**/api/socket", held.route)
        page.goto(studio.address)
        page.wait_for_function(
            "() => { const lanes = document.querySelector('.timeline-lanes'); "
            "return Number(lanes?.ariaValueMax) - Number(lanes?.ariaValueMin) > 2; }"
        )
        first, last = (click_along(page) for _ in range(2))
        held.until(page, 1)
        assert len(held.asked) == 1
        held.release()
        held.until(page, 1)
        assert len(held.asked) == 2
        assert held.asked[1] == pytest.approx(last, abs=0.01)
        assert held.asked[0] < min(first, last)
        held.release()
        page.get_by_role("button", name="Back to now").click()
        expect(page.get_by_role("button", name="Back to now")).to_have_count(0)
