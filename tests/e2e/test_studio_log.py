# SPDX-License-Identifier: Apache-2.0
"""The log on the page Live of the studio: sorted, readable, and still while somebody reads."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from bt_agents_studio.records import LogRecord
from studio_browser import box, opened_page, style
from studio_harness import BackgroundStudio

pytestmark = pytest.mark.e2e


@pytest.fixture
def page(browser: Browser, studio: BackgroundStudio) -> Iterator[Page]:
    with opened_page(browser, studio.address) as opened:
        yield opened


def line(number: int, at_s: float, kind: str = "tree") -> LogRecord:
    return LogRecord(at_s=at_s, kind=kind, agent="guide", path="", text=f"line {number:02d}")


KINDS = ("tree", "feedback", "run", "market", "bar", "time", "node", "outline")


def test_log_is_sorted_readable_and_selectable(page: Page, studio: BackgroundStudio) -> None:
    for number in range(60):
        # Every second one arrives late.
        at_s = 1000.0 + (number if number % 2 else 59 - number)
        studio.put("log", f"{number}", line(number, at_s, KINDS[number % len(KINDS)]))
    lines = page.get_by_label("What happened").locator("li")
    expect(lines.filter(has_text="line 59")).to_have_count(1)
    expect(lines.filter(has_text="line 00")).to_have_count(1)
    texts = lines.all_inner_texts()
    times = [one.split()[0] for one in texts]
    assert times == sorted(times)
    expect(lines.last).to_be_in_viewport()
    for one in lines.all():
        assert box(one)["height"] < 50
        assert style(one, "userSelect") in ("auto", "text")
        assert style(one, "cursor") == "auto"
    selected = page.evaluate(
        """() => {
            getSelection().selectAllChildren(document.querySelector(".log ol"));
            return getSelection().toString();
        }"""
    )
    assert [one in selected for one in ("line 00", "line 31", "line 59")] == [True] * 3


def test_log_stands_still_while_read(page: Page, studio: BackgroundStudio) -> None:
    for number in range(60):
        studio.put("log", f"{number}", line(number, 1000.0 + number))
    log = page.get_by_label("What happened")
    # Lines of the test before have other times until they are replaced.
    expect(log.locator("li").first).to_contain_text("line 00")
    expect(log.get_by_text("line 59")).to_be_in_viewport()
    log.locator("ol").evaluate("(one) => one.scrollTo({top: 0})")
    top = log.get_by_text("line 00")
    expect(top).to_be_in_viewport()
    newest = log.get_by_role("button", name="Newest lines")
    expect(newest).to_be_in_viewport(ratio=1)
    before = box(top)
    for number in range(60, 90):
        studio.put("log", f"{number}", line(number, 1000.0 + number))
    expect(newest).to_contain_text("(30)")
    assert box(top) == before
    newest.click()
    expect(log.get_by_text("line 89")).to_be_in_viewport()
    expect(newest).to_have_count(0)
    studio.put("log", "90", line(90, 1090.0))
    expect(log.get_by_text("line 90")).to_be_in_viewport()
