# SPDX-License-Identifier: Apache-2.0
"""The outline of a tree of 2,000 nodes in the studio: following, scrolling, search and keys."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from studio_browser import opened_page
from studio_harness import BackgroundStudio, background_studio
from studio_records import large_tree, run

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
    studio.put("runs", AGENT, run(AGENT, TIP))
    with opened_page(browser, studio.address) as opened:
        expect(row(opened, TIP)).to_be_in_viewport(ratio=1)
        yield opened


def row(page: Page, path: str) -> Locator:
    return page.locator(f'[role=treeitem][data-path="{path}"]')


def tree(page: Page) -> Locator:
    return page.get_by_role("tree")


def chip(page: Page) -> Locator:
    return page.get_by_role("button", name="Following")


def top(found: Locator) -> float:
    box = found.bounding_box()
    assert box is not None
    return box["y"]


def chosen(page: Page) -> Locator:
    return page.locator('[role=treeitem][aria-selected="true"]')


def test_root_and_ancestors_stay_on_top(page: Page) -> None:
    group = row(page, "tree/80.sequence")
    expect(row(page, "tree")).to_be_in_viewport(ratio=1)
    expect(group).to_be_in_viewport(ratio=1)
    frame = top(tree(page))
    assert [top(row(page, "tree")), top(group)] == [frame, frame + ROW_PX]
    hit = "([x, y]) => document.elementFromPoint(x, y).closest('[role=treeitem]').dataset.path"
    box = tree(page).bounding_box()
    assert box is not None
    seen = [page.evaluate(hit, [box["x"] + 200, frame + 12 + ROW_PX * one]) for one in range(3)]
    assert seen[:2] == ["tree", "tree/80.sequence"]
    assert re.fullmatch(r"tree/80\.sequence/\d+\.say", seen[2])


def test_only_visible_rows_are_in_document(page: Page) -> None:
    for path in (TIP, LAST, "tree"):
        if path != TIP:
            tree(page).focus()
            page.keyboard.press("End" if path == LAST else "Home")
        expect(row(page, path)).to_be_in_viewport(ratio=1)
        assert 15 < page.locator("[role=treeitem]").count() < 60
    rows = page.locator(".outline-rows").bounding_box()
    assert rows is not None
    assert rows["height"] == (1 + GROUPS * (LEAVES + 1)) * ROW_PX


def test_outline_follows_tip_until_scrolled(page: Page, studio: BackgroundStudio) -> None:
    expect(chip(page)).to_have_attribute("aria-pressed", "true")
    studio.put("runs", AGENT, run(AGENT, NEXT))
    expect(row(page, NEXT)).to_be_in_viewport(ratio=1)
    before = tree(page).evaluate("(one) => one.scrollTop")
    tree(page).hover()
    page.mouse.wheel(0, 2000)
    moved = "(offset) => document.querySelector('.outline').scrollTop === offset"
    page.wait_for_function(moved, arg=before + 2000)
    expect(chip(page)).to_have_attribute("aria-pressed", "false")
    expect(row(page, NEXT)).not_to_be_in_viewport()
    offset = tree(page).evaluate("(one) => one.scrollTop")
    studio.put("runs", AGENT, run(AGENT, TIP))
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


def test_search_unfolds_and_shows_row(page: Page) -> None:
    search = page.get_by_role("searchbox")
    search.fill("group 50")
    search.press("Enter")
    group = row(page, "tree/50.sequence")
    expect(group).to_be_in_viewport(ratio=1)
    group.dblclick()
    expect(group).to_have_attribute("aria-expanded", "false")
    search.fill("sentence 50 3")
    search.press("Enter")
    expect(row(page, "tree/50.sequence/3.say")).to_be_in_viewport(ratio=1)
    expect(row(page, "tree/50.sequence/3.say")).to_have_attribute("data-found", "true")


def test_chosen_drawing_is_kept(page: Page) -> None:
    page.get_by_role("button", name="Map", exact=True).click()
    expect(page.locator("svg[role=tree]")).to_be_in_viewport()
    expect(row(page, TIP)).to_be_in_viewport()
    page.reload()
    expect(page.locator("svg[role=tree]")).to_be_in_viewport()
    page.get_by_role("button", name="Outline", exact=True).click()
    expect(row(page, TIP)).to_be_in_viewport(ratio=1)
    expect(page.locator(".outline")).to_be_in_viewport()
