# SPDX-License-Identifier: Apache-2.0
"""Page Market of the studio as a race: a dragged scene, its bids, and the strategy."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from bt_agents_interfaces.msg import Auction, RankedBid, Scene, SceneValue
from bt_agents_studio.access import SessionRole
from bt_agents_studio.records import StrategyRecord
from studio_browser import box, open_page, opened_page, wait_for
from studio_entries import auction, market, part
from studio_harness import BackgroundStudio, background_studio

pytestmark = pytest.mark.e2e

AGES = {"young": 1.0, "old": 5.0}
"""Agent → the age of its profile."""


class PreviewingMarket:
    """A market with an agent for the young and one for the old; it records each scene."""

    def __init__(self, studio: BackgroundStudio) -> None:
        self.asked: list[tuple[float, Mapping[str, float]]] = []
        self.held: list[Future[Any]] | None = None
        self.refuses = False
        studio.caller.preview = self.preview  # type: ignore[method-assign]

    def preview(self, values: Mapping[str, float], limit_s: float) -> Future[Any]:
        del limit_s
        self.asked.append((time.monotonic(), dict(values)))
        done: Future[Any] = Future()
        if self.held is not None:
            self.held.append(done)
        elif self.refuses:
            done.set_result(refusal())
        else:
            done.set_result(decision(values))
        return done

    @property
    def ages(self) -> list[float]:
        return [values["age"] for _, values in self.asked]


def refusal() -> Any:
    return SimpleNamespace(accepted=False, code="BUSY", message="too many previews")


def decision(values: Mapping[str, float]) -> Any:
    age = values["age"]
    ranking = [
        RankedBid(
            agent=name,
            vector=[own, 3.0],
            contributions=[abs(age - own), abs(values["mood"] - 3.0)],
            score=abs(age - own) + abs(values["mood"] - 3.0),
        )
        for name, own in sorted(AGES.items(), key=lambda one: abs(age - one[1]))
    ]
    auction = Auction(
        strategy="manhattan",
        tie_break="name",
        scene=Scene(values=[SceneValue(name=name, value=one) for name, one in values.items()]),
        ranking=ranking,
        winner=ranking[0].agent,
        change_names=["age"],
        change_values=[3.05 if age < 3.0 else 2.95],
    )
    return SimpleNamespace(accepted=True, code="", message="", auction=auction)


@pytest.fixture(scope="module")
def studio() -> Iterator[BackgroundStudio]:
    with background_studio() as served:
        served.put("parts", "marketplace", part())
        infos = (StrategyRecord(name="manhattan", description="the nearest", options=()),)
        refused = ("/b: HOST_EXISTS: it is there",)
        served.put("market", "", replace(market(), strategies=infos, refused_hosts=refused))
        yield served


@pytest.fixture
def previews(studio: BackgroundStudio) -> PreviewingMarket:
    return PreviewingMarket(studio)


@pytest.fixture
def page(browser: Browser, studio: BackgroundStudio, previews: PreviewingMarket) -> Iterator[Page]:
    del previews
    with opened_page(browser, studio.address_for(SessionRole.OPERATE, "market")) as opened:
        expect(opened.locator(".phase")).to_have_text("connected")
        panel(opened).scroll_into_view_if_needed()
        yield opened


def panel(page: Page) -> Locator:
    return page.get_by_label("Who would win?")


def slider(page: Page, name: str = "age") -> Locator:
    return page.locator(f"#dry-run-{name}")


def drag(page: Page, *parts: float) -> None:
    """Move the pointer over the slider of the age: 0 is its left end, 1 its right."""
    measured = box(slider(page))
    for part_ in parts:
        x = measured["x"] + 8 + part_ * (measured["width"] - 16)
        page.mouse.move(x, measured["y"] + measured["height"] / 2)


def row(page: Page, agent: str) -> Locator:
    return panel(page).get_by_role("row").filter(has_text=agent)


def test_refused_host_is_a_problem(page: Page) -> None:
    open_page(page, "System")
    problems = page.get_by_label("Problems", exact=True)
    expect(problems).to_contain_text("the market refuses /b: HOST_EXISTS: it is there")


def test_bids_reorder_while_scene_is_dragged(page: Page) -> None:
    drag(page, 0.5)
    page.mouse.down()
    for part_, first, last in ((0.1, "young", "old"), (0.9, "old", "young")):
        drag(page, part_)
        expect(panel(page)).to_contain_text(f"{first} would win")
        expect(row(page, first).locator(".shared-number")).to_have_text("0.4")
        expect(row(page, last).locator(".shared-number")).to_have_text("3.6")
        for agent in AGES:
            expect(row(page, agent)).to_be_in_viewport()
        assert box(row(page, first))["y"] < box(row(page, last))["y"]
        expect(slider(page)).to_be_enabled()
    page.mouse.up()
    expect(slider(page)).to_have_value("4.6")


def test_race_sends_last_scene_within_rate(page: Page, previews: PreviewingMarket) -> None:
    sent: list[str] = []
    page.on(
        "request", lambda one: "/api/do/dry_run" in one.url and sent.append(one.post_data or "")
    )
    drag(page, 0.1)
    page.mouse.down()
    drag(page, *(0.1 + step * 0.02 for step in range(40)), 0.9)
    page.mouse.up()
    expect(slider(page)).to_have_value("4.6")
    expect(row(page, "old").locator(".shared-number")).to_have_text("0.4")
    page.wait_for_timeout(300)  # no more requests
    assert previews.ages[-1] == 4.6
    assert len(set(previews.ages)) == len(previews.ages)
    seconds = previews.asked[-1][0] - previews.asked[0][0]
    assert 1 < len(previews.asked) <= seconds * 10 + 2
    assert {*map(tuple, map(json.loads, sent))} == {("names", "values")}


def test_waiting_scene_is_asked_after_refusal(page: Page, previews: PreviewingMarket) -> None:
    previews.held = []
    drag(page, 0.1)
    page.mouse.down()
    wait_for(page, lambda: previews.held)
    drag(page, 0.9)
    expect(slider(page)).to_be_enabled()
    expect(slider(page)).to_have_value("4.6")
    [first], previews.held = previews.held, None
    first.set_result(refusal())
    expect(panel(page)).to_contain_text("old would win")
    page.mouse.up()
    assert previews.ages == [1.4, 4.6]


def test_refusal_replaces_bids_of_other_scene(page: Page, previews: PreviewingMarket) -> None:
    slider(page).fill("2")
    expect(row(page, "young")).to_be_in_viewport()
    previews.refuses = True
    slider(page).fill("4")
    told = panel(page).locator("output")
    expect(told).to_have_text("too many previews")
    expect(told).to_be_in_viewport()
    expect(row(page, "young")).to_have_count(0)
    expect(slider(page)).to_be_enabled()


def test_button_moves_scene_to_tipping_point(page: Page, previews: PreviewingMarket) -> None:
    slider(page).fill("2")
    expect(panel(page)).to_contain_text("young would win")
    panel(page).get_by_role("button", name="Move the scene there").click()
    expect(panel(page)).to_contain_text("old would win")
    expect(page.locator("#dry-run-age-value")).to_have_value("3.05")
    assert previews.ages == [2.0, 3.05]


def test_map_of_other_scene_says_so(page: Page) -> None:
    panel(page).get_by_label("up").select_option("age")
    panel(page).get_by_role("button", name="Draw the map").click()
    expect(panel(page).locator(".dry_run-map")).to_be_visible()
    slider(page).fill("2")
    expect(row(page, "young")).to_be_visible()
    note = panel(page).get_by_text("Draw the map again")
    expect(note).to_have_count(0)
    slider(page, "mood").fill("4")
    expect(note).to_be_visible()


def test_rounds_stay_in_place_when_one_begins(page: Page, studio: BackgroundStudio) -> None:
    for number in range(30):
        studio.put("rounds", f"x/{number}", replace(auction("a guide"), round=number))
    rounds = page.get_by_label("Rounds", exact=True).get_by_role("button")
    expect(rounds).to_have_count(30)
    rounds.last.scroll_into_view_if_needed()
    page.wait_for_function("document.querySelector('.market-rounds').scrollLeft > 0")
    before = box(rounds.last)["x"]
    studio.put("rounds", "x/30", replace(auction("a guide"), round=30))
    expect(rounds).to_have_count(31)
    assert box(rounds.last)["x"] == pytest.approx(before, abs=1)
