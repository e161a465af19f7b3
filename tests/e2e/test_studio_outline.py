# SPDX-License-Identifier: Apache-2.0
"""Outline and map of a tree of 2,000 nodes in the studio: following, search, keys and zoom."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from studio_browser import box, enter, opened_page
from studio_entries import run
from studio_harness import BackgroundStudio, background_studio
from studio_records import large_tree, status

pytestmark = pytest.mark.e2e

AGENT = "large"
GROUPS, LEAVES = 100, 19
TIP = "tree/80.sequence/12.say"
NEXT = "tree/20.sequence/3.say"
LAST = f"tree/{GROUPS - 1}.sequence/{LEAVES - 1}.say"
ROW_PX = 24


@pytest.fixture(scope="module")
def studio() -> Iterator[BackgroundStudio]:
    with background_studio() as served:
        served.put("trees", AGENT, large_tree(AGENT, GROUPS, LEAVES))
        yield served


@pytest.fixture
def page(browser: Browser, studio: BackgroundStudio) -> Iterator[Page]:
    studio.put("runs", AGENT, run(AGENT, tip=TIP))
    with opened_page(browser, studio.address) as opened:
        expect(row(opened, TIP)).to_be_in_viewport(ratio=1)
        yield opened


def open_map(page: Page) -> None:
    page.get_by_role("button", name="Map", exact=True).click()
    expect(row(page, TIP)).to_be_in_viewport()


def row(page: Page, path: str) -> Locator:
    return page.locator(f'[role=treeitem][data-path="{path}"]')


def tree(page: Page) -> Locator:
    return page.get_by_role("tree")


def chip(page: Page) -> Locator:
    return page.get_by_role("button", name="Following")


def top(found: Locator) -> float:
    return box(found)["y"]


def chosen(page: Page) -> Locator:
    return page.locator('[role=treeitem][aria-selected="true"]')


def test_root_and_ancestors_stay_on_top(page: Page) -> None:
    group = row(page, "tree/80.sequence")
    expect(row(page, "tree")).to_be_in_viewport(ratio=1)
    expect(group).to_be_in_viewport(ratio=1)
    frame = top(tree(page))
    assert [top(row(page, "tree")), top(group)] == [frame, frame + ROW_PX]
    hit = "([x, y]) => document.elementFromPoint(x, y).closest('[role=treeitem]').dataset.path"
    x = box(tree(page))["x"] + 200
    seen = [page.evaluate(hit, [x, frame + 12 + ROW_PX * one]) for one in range(3)]
    assert seen[:2] == ["tree", "tree/80.sequence"]
    assert re.fullmatch(r"tree/80\.sequence/\d+\.say", seen[2])
    # Only the visible rows are in the document.
    assert 15 < page.locator("[role=treeitem]").count() < 60
    assert box(page.locator(".outline-rows"))["height"] == (1 + GROUPS * (LEAVES + 1)) * ROW_PX


def test_outline_follows_tip_until_scrolled(page: Page, studio: BackgroundStudio) -> None:
    expect(chip(page)).to_have_attribute("aria-pressed", "true")
    studio.put("runs", AGENT, run(AGENT, tip=NEXT))
    expect(row(page, NEXT)).to_be_in_viewport(ratio=1)
    before = tree(page).evaluate("(one) => one.scrollTop")
    tree(page).hover()
    page.mouse.wheel(0, 2000)
    moved = "(offset) => document.querySelector('.outline').scrollTop === offset"
    page.wait_for_function(moved, arg=before + 2000)
    expect(chip(page)).to_have_attribute("aria-pressed", "false")
    expect(row(page, NEXT)).not_to_be_in_viewport()
    offset = tree(page).evaluate("(one) => one.scrollTop")
    studio.put("runs", AGENT, run(AGENT, tip=TIP))
    page.get_by_role("searchbox").fill("group 1")
    expect(page.get_by_label("Tree", exact=True)).to_contain_text("11 found")
    assert tree(page).evaluate("(one) => one.scrollTop") == offset
    chip(page).click()
    expect(chip(page)).to_have_attribute("aria-pressed", "true")
    expect(row(page, TIP)).to_be_in_viewport(ratio=1)


def test_keyboard_walks_and_folds_rows(page: Page) -> None:
    tree(page).focus()
    page.keyboard.press("Home")
    expect(row(page, "tree")).to_have_attribute("aria-selected", "true")
    page.keyboard.press("ArrowRight")
    expect(chosen(page)).to_have_attribute("data-path", "tree/0.sequence")
    page.keyboard.press("ArrowLeft")
    expect(chosen(page)).to_have_attribute("aria-expanded", "false")
    expect(row(page, "tree/0.sequence/0.say")).to_have_count(0)
    page.keyboard.press("ArrowDown")
    expect(chosen(page)).to_have_attribute("data-path", "tree/1.sequence")
    assert top(row(page, "tree/1.sequence")) == top(row(page, "tree/0.sequence")) + ROW_PX
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    expect(chosen(page)).to_have_attribute("data-path", "tree/0.sequence/0.say")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("End")
    expect(chosen(page)).to_have_attribute("data-path", LAST)
    expect(row(page, LAST)).to_be_in_viewport(ratio=1)
    expect(tree(page)).to_be_focused()
    page.keyboard.press("t")
    expect(row(page, TIP)).to_be_in_viewport(ratio=1)
    page.keyboard.press("/")
    expect(page.get_by_role("searchbox")).to_be_focused()


def test_enter_shows_details_of_node(page: Page) -> None:
    tree(page).focus()
    page.keyboard.press("End")
    page.keyboard.press("Enter")
    details = page.get_by_label("Node", exact=True)
    expect(details).to_be_focused()
    expect(details).to_be_in_viewport()
    expect(details.get_by_role("heading")).to_be_in_viewport(ratio=1)
    expect(details).to_contain_text("sentence 99 18")


def test_rows_tell_their_place_in_tree(page: Page) -> None:
    tree(page).focus()
    page.keyboard.press("End")
    last = row(page, LAST)
    assert [
        last.get_attribute(f"aria-{name}")
        for name in ("level", "posinset", "setsize", "selected", "expanded")
    ] == ["3", "19", "19", "true", None]
    active = tree(page).get_attribute("aria-activedescendant")
    assert active == last.get_attribute("id")
    for one in page.locator("[role=treeitem]").all():
        title = one.locator(".outline-title").inner_text()
        expect(one).to_have_role("treeitem")
        expect(one).to_have_accessible_name(f"{title} , has not run")


@pytest.mark.parametrize(("drawing", "ratio"), [("Outline", 1.0), ("Map", 0.0)])
def test_search_unfolds_and_shows_row(page: Page, drawing: str, ratio: float) -> None:
    page.get_by_role("button", name=drawing, exact=True).click()
    group, leaf = row(page, "tree/50.sequence"), row(page, "tree/50.sequence/3.say")
    search = page.get_by_role("searchbox")
    enter(search, "group 50")
    expect(group).to_be_in_viewport(ratio=ratio)
    group.dblclick()
    expect(group).to_have_attribute("aria-expanded", "false")
    expect(leaf).to_have_count(0)
    enter(search, "sentence 50 3")
    expect(leaf).to_be_in_viewport(ratio=ratio)
    expect(leaf).to_have_attribute("data-found", "true")
    expect(group).to_have_attribute("aria-expanded", "true")


@pytest.mark.parametrize("drawing", ["Outline", "Map"])
def test_node_chosen_elsewhere_comes_into_view(page: Page, drawing: str) -> None:
    page.get_by_role("button", name=drawing, exact=True).click()
    for number in ("50 3", "40 3"):
        page.keyboard.press("Control+k")
        field = page.get_by_role("combobox", name="Go to …")
        field.fill(f"sentence {number}")
        field.press("Enter")
        group, leaf = number.split()
        expect(row(page, f"tree/{group}.sequence/{leaf}.say")).to_be_in_viewport()
    page.go_back()
    expect(row(page, "tree/50.sequence/3.say")).to_be_in_viewport()


def test_chosen_drawing_is_kept(page: Page) -> None:
    page.get_by_role("button", name="Map", exact=True).click()
    expect(page.locator("svg[role=tree]")).to_be_in_viewport()
    expect(row(page, TIP)).to_be_in_viewport()
    page.reload()
    expect(page.locator("svg[role=tree]")).to_be_in_viewport()
    page.get_by_role("button", name="Outline", exact=True).click()
    expect(row(page, TIP)).to_be_in_viewport(ratio=1)
    expect(page.locator(".outline")).to_be_in_viewport()


# --- the map ---------------------------------------------------------------------------------


def middle(found: Locator) -> tuple[float, float]:
    seen = box(found)
    return seen["x"] + seen["width"] / 2, seen["y"] + seen["height"] / 2


def test_only_nodes_near_viewport_are_drawn(page: Page) -> None:
    open_map(page)
    assert page.locator("[role=treeitem]").count() < 200
    tree(page).focus()
    page.keyboard.press("Home")
    expect(row(page, "tree")).to_be_in_viewport()
    expect(row(page, TIP)).to_have_count(0)
    page.get_by_role("button", name="Jump to the tip").click()
    expect(row(page, TIP)).to_be_in_viewport()
    expect(row(page, TIP)).to_have_attribute("data-tip", "true")
    assert page.locator("[role=treeitem]").count() < 200


def test_search_results_are_stepped_forwards_and_backwards(page: Page) -> None:
    open_map(page)
    search = page.get_by_role("searchbox")
    search.fill("sentence 42")
    expect(page.get_by_label("Tree")).to_contain_text("19 found")
    for path, number in (("0", 1), ("1", 2)):
        search.press("Enter")
        expect(row(page, f"tree/42.sequence/{path}.say")).to_be_in_viewport()
        expect(page.get_by_label("Tree")).to_contain_text(f"{number} of 19 found")
    for path in ("0", "18"):
        search.press("Shift+Enter")
        expect(row(page, f"tree/42.sequence/{path}.say")).to_be_in_viewport()


def test_search_stays_when_another_agent_runs(page: Page, studio: BackgroundStudio) -> None:
    search = page.get_by_role("searchbox")
    search.fill("sentence 42")
    studio.put("runs", "other", run("other"))
    expect(page.locator("option").first).to_have_text("newest run: other")
    expect(search).to_have_value("sentence 42")
    expect(search).to_be_focused()


def test_the_wheel_zooms_at_the_pointer(page: Page) -> None:
    open_map(page)
    for _ in range(3):
        page.get_by_role("button", name="larger").click()
    group = row(page, "tree/50.sequence")
    enter(page.get_by_role("searchbox"), "group 50")
    expect(group).to_be_in_viewport()
    before = middle(group)
    page.mouse.move(*before)
    page.mouse.wheel(0, 150)
    expect(tree(page)).to_have_attribute("data-zoom", "1.56")
    assert middle(group) == pytest.approx(before, abs=2)


def test_drag_moves_tree_without_selecting(page: Page) -> None:
    open_map(page)
    page.get_by_role("button", name="Jump to the tip").click()
    expect(row(page, TIP)).to_be_in_viewport()
    x, y = middle(row(page, TIP))
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 60, steps=4)
    page.mouse.up()
    assert middle(row(page, TIP)) == pytest.approx((x, y - 60), abs=2)
    expect(page.locator('[aria-selected="true"]')).to_have_count(0)
    row(page, TIP).click()
    expect(row(page, TIP)).to_have_attribute("aria-selected", "true")


def test_keyboard_zooms_fits_searches_and_finds_tip(page: Page) -> None:
    open_map(page)
    tree(page).focus()
    page.keyboard.press("End")
    last = row(page, LAST)
    expect(last).to_be_in_viewport()
    expect(last).to_be_focused()
    page.keyboard.press("t")
    expect(row(page, TIP)).to_be_in_viewport()
    page.keyboard.press("0")
    expect(page.locator(".tree-name")).to_have_count(0)
    for _ in range(8):
        page.keyboard.press("+")
    expect(page.locator(".tree-name").first).to_be_visible()
    page.keyboard.press("/")
    expect(page.get_by_role("searchbox")).to_be_focused()


def test_tooltip_shows_full_names_and_reasons(page: Page, studio: BackgroundStudio) -> None:
    open_map(page)
    path = "tree/80.sequence/10.say"
    reason = "the robot does not speak, as its server has not answered for ten seconds"
    studio.put("nodes", f"{AGENT}|{path}", status("FAILURE", reason))
    expect(row(page, path)).to_have_attribute("data-status", "FAILURE")
    said = row(page, path).locator("> title").text_content() or ""
    assert "sentence 80 10 to somebody" in said
    assert reason in said
    assert path in said


def test_click_on_map_scrolls_tree_there(page: Page) -> None:
    open_map(page)
    strip = page.locator(".tree_map-map")
    seen = box(strip)
    strip.click(position={"x": seen["width"] / 2, "y": seen["height"] - 2})
    expect(row(page, LAST)).to_be_visible()
    assert box(strip.locator("div"))["bottom"] == pytest.approx(seen["bottom"], abs=8)
