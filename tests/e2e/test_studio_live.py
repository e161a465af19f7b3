# SPDX-License-Identifier: Apache-2.0
"""Page Live of the studio: the drawings of a tree."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from bt_agents_studio.records import CountdownRecord, LogRecord, TreeRecord
from studio_browser import box, found_by_axe, opened_page, style
from studio_entries import HOST, filled, run
from studio_harness import BackgroundStudio, background_studio
from studio_records import node, status

pytestmark = pytest.mark.e2e

AGENT = "guide"
DRIVE = "tree/1.drive"
HANDLER = f"{DRIVE}@on_failure/0.say"

TREE = TreeRecord(
    agent=AGENT,
    host=HOST,
    nodes=(
        node("tree", -1, "sequence", "sequence"),
        node("tree/0.ask@retry", 0, "retry", "retry 3"),
        node("tree/0.ask@timeout", 1, "timeout", "timeout 90 s"),
        node("tree/0.ask", 2, "ask", "ask Shall we go?"),
        node(f"{DRIVE}@on_failure", 0, "on_failure", "on_failure"),
        node(f"{DRIVE}@timeout", 4, "timeout", "timeout 5 min"),
        node(DRIVE, 5, "drive", "drive check-in desk"),
        node(f"{HANDLER}@when", 4, "when", "when live.person"),
        node(HANDLER, 7, "say", "say I could not get through."),
        node("tree/2.wait", 0, "wait", "wait 8 s"),
        node("on_cancel", -1, "say", "say All right. I stop here."),
    ),
)


@pytest.fixture(scope="module")
def studio() -> Iterator[BackgroundStudio]:
    with background_studio() as served:
        served.put("trees", AGENT, TREE)
        served.put("runs", AGENT, run(AGENT, tip=DRIVE))
        yield served


@pytest.fixture
def page(browser: Browser, studio: BackgroundStudio) -> Iterator[Page]:
    for one in TREE.nodes:
        studio.put("nodes", f"{AGENT}|{one.path}", status("INVALID"))
    with opened_page(browser, studio.address) as opened:
        expect(shown(opened, DRIVE)).to_be_in_viewport()
        yield opened


def shown(page: Page, path: str) -> Locator:
    return page.locator(f'[role=treeitem][data-path="{path}"]')


def badge(page: Page, path: str) -> Locator:
    return page.locator(f'[data-badge="{path}"]')


def open_map(page: Page) -> None:
    page.get_by_role("button", name="Map", exact=True).click()
    expect(page.locator("svg[role=tree]")).to_be_in_viewport()


def test_outline_shows_handlers_as_labelled_branches(page: Page) -> None:
    expect(shown(page, HANDLER)).to_be_in_viewport()
    expect(shown(page, HANDLER).locator(".outline-title")).to_have_text(
        "if it fails: say I could not get through."
    )
    expect(shown(page, "on_cancel").locator(".outline-title")).to_have_text(
        "when stopped: say All right. I stop here."
    )
    levels = {
        path: shown(page, path).get_attribute("aria-level")
        for path in ("tree", DRIVE, HANDLER, "tree/2.wait", "on_cancel")
    }
    assert list(levels.values()) == ["1", "2", "3", "2", "1"]
    assert box(shown(page, HANDLER))["y"] == box(shown(page, DRIVE))["bottom"]
    indents = [
        box(shown(page, path).locator(".outline-mark"))["x"]
        for path in (DRIVE, HANDLER, "tree/2.wait")
    ]
    assert indents[0] == indents[2] < indents[1]


def test_handler_carries_only_its_own_badges(page: Page) -> None:
    expect(shown(page, DRIVE).locator("[data-badge]")).to_have_text([re.compile("5 min")])
    expect(shown(page, HANDLER).locator("[data-badge]")).to_have_text(["when live.person"])


def test_map_draws_handler_as_dashed_branch(page: Page) -> None:
    open_map(page)
    expect(shown(page, HANDLER)).to_be_in_viewport()
    expect(shown(page, HANDLER).locator(".tree-kind").first).to_have_text("if it fails: say")
    expect(shown(page, "on_cancel").locator(".tree-kind").first).to_have_text("when stopped: say")
    columns = [box(shown(page, path).locator("> rect"))["x"] for path in (DRIVE, HANDLER)]
    assert columns[0] < columns[1]
    dashed = page.locator(".tree-edge[data-handler]")
    expect(dashed).to_have_count(1)
    expect(dashed).to_be_in_viewport()
    assert style(dashed, "strokeDasharray") != "none"
    assert style(page.locator(".tree-edge:not([data-handler])").first, "strokeDasharray") == "none"


def put(studio: BackgroundStudio, **statuses: str) -> None:
    paths = {"tree": "tree", "ask": "tree/0.ask", "drive": DRIVE, "wait": "tree/2.wait"}
    for name, one in statuses.items():
        studio.put("nodes", f"{AGENT}|{paths[name]}", status(one))


def test_stopped_node_differs_from_ended_nodes(page: Page, studio: BackgroundStudio) -> None:
    put(studio, tree="STOPPED", ask="SUCCESS", drive="STOPPED", wait="FAILURE")
    expect(shown(page, DRIVE)).to_contain_text("was stopped here")
    assert "repeating-linear-gradient" in style(
        shown(page, DRIVE).locator(".outline-mark"), "backgroundImage"
    )
    for path in ("tree/0.ask", "tree/2.wait"):
        assert style(shown(page, path).locator(".outline-mark"), "backgroundImage") == "none"
    open_map(page)
    expect(shown(page, DRIVE)).to_be_in_viewport()
    assert "#hatched" in style(shown(page, DRIVE).locator("> rect"), "fill")
    assert "#hatched" not in style(shown(page, "tree/0.ask").locator("> rect"), "fill")


def test_node_of_lost_run_is_dotted(page: Page, studio: BackgroundStudio) -> None:
    put(studio, drive="UNKNOWN")
    expect(shown(page, DRIVE)).to_contain_text("not known")
    assert style(shown(page, DRIVE).locator(".outline-mark"), "borderTopStyle") == "dotted"


def test_failed_node_keeps_its_name(page: Page, studio: BackgroundStudio) -> None:
    reason = "the way is blocked"
    studio.put("nodes", f"{AGENT}|{DRIVE}", status("FAILURE", reason))
    row = shown(page, DRIVE)
    expect(row.locator(".outline-title")).to_have_text("drive check-in desk")
    expect(row.get_by_text(reason)).to_be_in_viewport()
    open_map(page)
    expect(row.locator(".tree-name")).to_have_text("drive check-in desk")
    expect(row.locator(".tree-reason")).to_have_text(reason)
    expect(row.locator(".tree-reason")).to_be_in_viewport()


def left(seconds: float | None, remaining: int | None = None, **fields: float) -> CountdownRecord:
    return filled(CountdownRecord, kind="x", remaining_s=seconds, remaining=remaining, **fields)


def test_badges_show_value_and_attempt(page: Page, studio: BackgroundStudio) -> None:
    for is_map in (False, True):
        if is_map:
            open_map(page)
        expect(badge(page, "tree/0.ask@timeout")).to_contain_text("90 s")
        studio.put("countdowns", f"{AGENT}|tree/0.ask@retry", left(None, 1))
        expect(badge(page, "tree/0.ask@retry")).to_contain_text("↻ 2 of 3")
        expect(badge(page, "tree/0.ask@retry")).to_be_in_viewport()
        studio.put("countdowns", f"{AGENT}|tree/0.ask@retry", left(None, 0))
        expect(badge(page, "tree/0.ask@retry")).to_contain_text("↻ 3 of 3")


def test_row_counts_down_with_bar(page: Page, studio: BackgroundStudio) -> None:
    studio.put("countdowns", f"{AGENT}|tree/2.wait", left(40.0, whole_s=80.0))
    counting = page.locator('[data-left="tree/2.wait"]')
    expect(counting).to_be_in_viewport()
    expect(counting).to_have_text(re.compile(r"^3\d s left$"))
    whole, rest = (
        box(counting.locator(name)) for name in (".control-whole", ".control-whole > span")
    )
    assert 0.2 < rest["width"] / whole["width"] < 0.51


def test_running_time_includes_present_stretch(page: Page, studio: BackgroundStudio) -> None:
    studio.put("nodes", f"{AGENT}|{DRIVE}", status("RUNNING", since_s=time.time() - 3600))
    shown(page, DRIVE).click()
    expect(page.get_by_label("Node", exact=True)).to_contain_text("60 min")
    expect(shown(page, DRIVE).locator(".outline-busy")).to_contain_text("60 min")


RULES = """{
    runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'],
    rules: {'label-content-name-mismatch': {enabled: true}},
}"""


def test_outline_is_accessible_in_every_status(page: Page, studio: BackgroundStudio) -> None:
    put(studio, tree="RUNNING", ask="SUCCESS", drive="FAILURE", wait="STOPPED")
    studio.put("nodes", f"{AGENT}|{HANDLER}", status("RUNNING", "it speaks"))
    studio.put("nodes", f"{AGENT}|on_cancel", status("UNKNOWN"))
    studio.put("countdowns", f"{AGENT}|{DRIVE}@timeout", left(60.0, whole_s=80.0))
    expect(shown(page, "on_cancel")).to_contain_text("not known")
    shown(page, DRIVE).click()
    assert found_by_axe(page, "'section[aria-label=Tree]'", RULES) == []


def test_chosen_node_lists_its_last_results(page: Page, studio: BackgroundStudio) -> None:
    for number in range(30):
        path = DRIVE if number % 2 else "tree/2.wait"
        text = f"result {number:02d}"
        line = LogRecord(at_s=1000.0 + number, kind="tree", agent=AGENT, path=path, text=text)
        studio.put("log", str(number), line)
    shown(page, DRIVE).click()
    results = page.get_by_label("Last results").get_by_role("listitem")
    expect(results.first).to_contain_text("result 29")
    expect(results).to_have_count(15)
    expect(results.last).to_contain_text("result 01")
