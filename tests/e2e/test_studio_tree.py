# SPDX-License-Identifier: Apache-2.0
"""The map of a tree of 2,000 nodes in the studio: search, keys, scrolling and zoom."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from studio_browser import opened_page
from studio_harness import BackgroundStudio, background_studio
from studio_records import large_tree, run, status

pytestmark = pytest.mark.e2e

AGENT = "large"
GROUPS, LEAVES = 100, 19
TIP = "tree/80.sequence/7.say"


@pytest.fixture(scope="module")
def studio() -> Iterator[BackgroundStudio]:
    with background_studio() as served:
        served.put("trees", AGENT, large_tree(AGENT, GROUPS, LEAVES))
        served.put("runs", AGENT, run(AGENT, TIP))
        yield served


@pytest.fixture
def page(browser: Browser, studio: BackgroundStudio) -> Iterator[Page]:
    with opened_page(browser, studio.address) as opened:
        opened.get_by_role("button", name="Map", exact=True).click()
        expect(shown(opened, TIP)).to_be_in_viewport()
        yield opened


def shown(page: Page, path: str) -> Locator:
    return page.locator(f'[role=treeitem][data-path="{path}"]')


def middle(found: Locator) -> tuple[float, float]:
    box = found.bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_only_nodes_near_viewport_are_drawn(page: Page) -> None:
    assert page.locator("[role=treeitem]").count() < 200
    page.get_by_role("tree").focus()
    page.keyboard.press("Home")
    expect(shown(page, "tree")).to_be_in_viewport()
    expect(shown(page, TIP)).to_have_count(0)
    page.get_by_role("button", name="Jump to the tip").click()
    expect(shown(page, TIP)).to_be_in_viewport()
    expect(shown(page, TIP)).to_have_attribute("data-tip", "true")
    assert page.locator("[role=treeitem]").count() < 200


def test_search_results_are_stepped_forwards_and_backwards(page: Page) -> None:
    search = page.get_by_role("searchbox")
    search.fill("sentence 42")
    expect(page.get_by_label("Tree")).to_contain_text("19 found")
    for path, number in (("0", 1), ("1", 2)):
        search.press("Enter")
        expect(shown(page, f"tree/42.sequence/{path}.say")).to_be_in_viewport()
        expect(page.get_by_label("Tree")).to_contain_text(f"{number} of 19 found")
    for path in ("0", "18"):
        search.press("Shift+Enter")
        expect(shown(page, f"tree/42.sequence/{path}.say")).to_be_in_viewport()


def test_search_result_below_folded_node_is_unfolded(page: Page) -> None:
    group = shown(page, "tree/50.sequence")
    search = page.get_by_role("searchbox")
    search.fill("group 50")
    search.press("Enter")
    expect(group).to_be_in_viewport()
    group.dblclick()
    expect(group).to_have_attribute("aria-expanded", "false")
    expect(shown(page, "tree/50.sequence/3.say")).to_have_count(0)
    search.fill("sentence 50 3")
    search.press("Enter")
    expect(shown(page, "tree/50.sequence/3.say")).to_be_in_viewport()
    expect(group).to_have_attribute("aria-expanded", "true")


def test_the_wheel_zooms_at_the_pointer(page: Page) -> None:
    for _ in range(3):
        page.get_by_role("button", name="larger").click()
    group = shown(page, "tree/50.sequence")
    page.get_by_role("searchbox").fill("group 50")
    page.get_by_role("searchbox").press("Enter")
    expect(group).to_be_in_viewport()
    before = middle(group)
    page.mouse.move(*before)
    page.mouse.wheel(0, 150)
    expect(page.get_by_role("tree")).to_have_attribute("data-zoom", "1.56")
    assert middle(group) == pytest.approx(before, abs=2)


def test_drag_moves_tree_without_selecting(page: Page) -> None:
    page.get_by_role("button", name="Jump to the tip").click()
    expect(shown(page, TIP)).to_be_in_viewport()
    x, y = middle(shown(page, TIP))
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 60, steps=4)
    page.mouse.up()
    assert middle(shown(page, TIP)) == pytest.approx((x, y - 60), abs=2)
    expect(page.locator('[aria-selected="true"]')).to_have_count(0)
    shown(page, TIP).click()
    expect(shown(page, TIP)).to_have_attribute("aria-selected", "true")


def test_keyboard_zooms_fits_searches_and_finds_tip(page: Page) -> None:
    tree = page.get_by_role("tree")
    tree.focus()
    page.keyboard.press("End")
    last = shown(page, f"tree/{GROUPS - 1}.sequence/{LEAVES - 1}.say")
    expect(last).to_be_in_viewport()
    expect(last).to_be_focused()
    page.keyboard.press("t")
    expect(shown(page, TIP)).to_be_in_viewport()
    page.keyboard.press("0")
    expect(page.locator(".tree-name")).to_have_count(0)
    for _ in range(8):
        page.keyboard.press("+")
    expect(page.locator(".tree-name").first).to_be_visible()
    page.keyboard.press("/")
    expect(page.get_by_role("searchbox")).to_be_focused()


def test_tooltip_shows_full_names_and_reasons(page: Page, studio: BackgroundStudio) -> None:
    path = "tree/80.sequence/3.say"
    reason = "the robot does not speak, as its server has not answered for ten seconds"
    studio.put("nodes", f"{AGENT}|{path}", status("FAILURE", reason))
    expect(shown(page, path)).to_have_attribute("data-status", "FAILURE")
    said = shown(page, path).locator("> title").text_content() or ""
    assert "sentence 80 3 to somebody" in said
    assert reason in said
    assert path in said


def test_click_on_map_scrolls_tree_there(page: Page) -> None:
    strip = page.locator(".tree_map-map")
    box = strip.bounding_box()
    assert box is not None
    strip.click(position={"x": box["width"] / 2, "y": box["height"] - 2})
    expect(shown(page, f"tree/{GROUPS - 1}.sequence/{LEAVES - 1}.say")).to_be_visible()
    mark = strip.locator("div").bounding_box()
    assert mark is not None
    assert mark["y"] + mark["height"] == pytest.approx(box["y"] + box["height"], abs=8)
