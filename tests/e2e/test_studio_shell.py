# SPDX-License-Identifier: Apache-2.0
"""Shared parts of the studio's pages: status strip and Stop, connection, and address."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from urllib.parse import urljoin

import pytest
from playwright.sync_api import Browser, Page, WebSocketRoute, expect

import studio_entries
from bt_agents_studio.access import SessionRole
from bt_agents_studio.records import MarketRecord, RoundRecord, SceneRecord, TreeRecord
from studio_browser import box, look_back, open_page, opened_page, strip, wait_for
from studio_entries import HOST, agent, auction, run, scene, tunable
from studio_harness import BackgroundStudio, background_studio
from studio_records import node

pytestmark = pytest.mark.e2e

TIP = "tree/0.say"
STRIPPED = ("Live", "Market", "Tune", "World", "System")
ACCEPTED = SimpleNamespace(accepted=True, code="", message="stopping greeter")


def market(state: str, number: int = 7) -> MarketRecord:
    ran = "" if state == "IDLE" else "greeter"
    return replace(studio_entries.market(), state=state, round=number, agent=ran, host=HOST)


def tree(name: str) -> TreeRecord:
    nodes = (
        node("tree", -1, "sequence", f"all of {name}"),
        node(TIP, 0, "say", f'say "I am {name}."'),
    )
    return TreeRecord(agent=name, host=HOST, nodes=nodes)


def held_round(number: int) -> RoundRecord:
    of = scene(f"scene {number}")
    return replace(auction("greeter"), round=number, scene=of, explanation=f"because of {number}")


def live(mood: float) -> SceneRecord:
    unknown = scene("")
    return replace(unknown, values=(replace(unknown.values[1], value=mood, origin="MEASURED"),))


@pytest.fixture(scope="module")
def studio() -> Iterator[BackgroundStudio]:
    with background_studio() as served:
        served.put("market", "", market("IDLE", 6))
        for name, title in (("greeter", "The greeter"), ("carrier", "The carrier")):
            served.put("agents", name, agent(name, title))
            served.put("trees", name, tree(name))
        served.put("tunables", "carrier.pace", tunable("carrier", "pace", 0.4))
        yield served


@pytest.fixture
def running(studio: BackgroundStudio) -> BackgroundStudio:
    """The studio of a system in which the greeter runs."""
    studio.caller.calls.clear()
    studio.caller.answered = ACCEPTED
    studio.put("market", "", market("RUNNING"))
    studio.put("runs", "greeter", replace(run("greeter", tip=TIP), round=7))
    studio.put("live", "", live(2.0))
    return studio


@pytest.fixture
def page(browser: Browser, running: BackgroundStudio) -> Iterator[Page]:
    with opened_page(browser, running.address) as opened:
        expect(strip(opened)).to_have_attribute("data-state", "RUNNING")
        yield opened


def stops(studio: BackgroundStudio) -> list[str]:
    """Return the author of each stop request."""
    return [
        str(fields["by"])
        for service, fields in studio.caller.calls
        if service == "marketplace/cancel"
    ]


def until_stopped(page: Page, studio: BackgroundStudio) -> None:
    """Wait until the system is told to stop."""
    wait_for(page, lambda: stops(studio))


def stop_the_run(page: Page, studio: BackgroundStudio) -> None:
    strip(page).get_by_role("button", name="Stop").click()
    until_stopped(page, studio)


def run_again(page: Page, studio: BackgroundStudio) -> None:
    """Let the greeter run, whoever has stopped it."""
    studio.caller.calls.clear()
    for state in ("IDLE", "RUNNING"):
        studio.put("market", "", market(state))
        expect(strip(page)).to_have_attribute("data-state", state)


def test_every_page_tells_and_stops_the_run(page: Page, running: BackgroundStudio) -> None:
    button = strip(page).get_by_role("button", name="Stop", exact=True)
    page.get_by_label("Agent").select_option("carrier")
    for name in STRIPPED:
        run_again(page, running)
        open_page(page, name)
        expect(strip(page)).to_be_in_viewport()
        expect(strip(page)).to_contain_text('runningThe greetersay "I am greeter."since ')
        expect(strip(page)).to_contain_text("mood 2")
        expect(button).to_be_in_viewport()
        button.click()
        until_stopped(page, running)
        running.put("market", "", market("CANCELLING"))
        expect(strip(page).get_by_role("button", name="stopping …")).to_be_disabled()
        running.put("market", "", market("IDLE"))
        expect(button).to_be_disabled()


def test_viewer_sees_why_it_cannot_stop(browser: Browser, running: BackgroundStudio) -> None:
    with opened_page(browser, running.address_for(SessionRole.VIEW)) as viewer:
        button = strip(viewer).get_by_role("button", name="Stop", exact=True)
        expect(button).to_have_attribute("title", re.compile("for viewing only"))
        expect(button).to_be_disabled()
        viewer.keyboard.press("Escape")
        viewer.keyboard.press("Escape")
        expect(strip(viewer)).to_have_attribute("data-state", "RUNNING")
    assert not stops(running)


def test_strip_follows_and_stops_while_page_looks_back(
    page: Page, running: BackgroundStudio
) -> None:
    look_back(page)
    expect(strip(page)).to_contain_text("Now:runningThe greeter")
    running.put("live", "", live(4.0))
    expect(strip(page)).to_contain_text("mood 4")
    stop_the_run(page, running)
    running.put("market", "", market("CANCELLING"))
    expect(strip(page).get_by_role("button", name="stopping …")).to_be_disabled()
    page.get_by_role("button", name="Back to now").click()
    expect(strip(page).get_by_role("button", name="stopping …")).to_be_disabled()


def test_escape_twice_stops_from_any_page(page: Page, running: BackgroundStudio) -> None:
    for name in (*STRIPPED, "Person"):
        run_again(page, running)
        open_page(page, name)
        if name == "Person":  # a document of its own, which has to load
            expect(page).to_have_url(re.compile("/person"))
        expect(page.get_by_role("button", name="Stop", exact=True).first).to_be_enabled()
        page.keyboard.press("Escape")
        page.keyboard.press("Escape")
        until_stopped(page, running)


def test_single_or_typed_escape_stops_nothing(page: Page, running: BackgroundStudio) -> None:
    for key in ("Escape", "a", "Escape", "a"):
        page.keyboard.press(key)
    page.get_by_role("searchbox").focus()
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")
    stop_the_run(page, running)
    assert len(stops(running)) == 1


@pytest.mark.parametrize(
    ("typed", "keys", "named", "address"),
    [
        ("", ["ArrowDown"], "Market page", r"/market$"),
        ("carrier", [], "The carrier agent · carrier", r"/live\?agent=carrier$"),
        ("carrier say", [], 'say "I am carrier." node · The carrier · tree/0.say', r"0\.say$"),
        ("PACE", [], "pace tunable value · The carrier", r"/tune\?search=carrier\.pace$"),
    ],
)
def test_palette_goes_to_what_is_named(
    page: Page, typed: str, keys: list[str], named: str, address: str
) -> None:
    open_page(page, "World")
    page.keyboard.press("Control+k")
    field = page.get_by_role("combobox", name="Go to …")
    expect(field).to_be_focused()
    field.press_sequentially(typed)
    for key in keys:
        page.keyboard.press(key)
    shown = page.get_by_role("listbox", name="Go to …")
    expect(shown.get_by_role("option", selected=True)).to_have_text(named)
    page.keyboard.press("Enter")
    expect(field).to_be_hidden()
    expect(page).to_have_url(re.compile(address))


def test_column_keeps_the_width_that_somebody_gave_it(page: Page) -> None:
    edge = page.get_by_role("separator", name="Width of the right column")

    def width() -> float:
        return box(page.locator(".shared-side"))["width"]

    usual, place = width(), box(edge)
    page.mouse.move(place["x"] + 6, place["y"] + 40)
    page.mouse.down()
    page.mouse.move(place["x"] - 94, place["y"] + 40, steps=5)
    page.mouse.up()
    dragged = width()
    assert dragged == pytest.approx(usual + 100, abs=10)
    open_page(page, "Market")
    page.reload()
    expect(edge).to_be_visible()
    assert width() == dragged
    edge.press("ArrowRight")
    expect(edge).to_have_attribute("aria-valuenow", str(round(dragged - 20)))
    edge.dblclick()
    expect(edge).to_have_attribute("aria-valuenow", str(round(usual)))


def test_chosen_place_of_palette_is_in_view(page: Page) -> None:
    page.set_viewport_size({"width": 640, "height": 400})
    page.keyboard.press("Control+k")
    places = page.get_by_role("listbox", name="Go to …").get_by_role("option")
    expect(places).to_have_count(12)
    page.keyboard.press("ArrowUp")
    expect(places.last).to_have_attribute("aria-selected", "true")
    expect(places.last).to_be_in_viewport(ratio=1)
    expect(page.get_by_role("combobox", name="Go to …")).to_be_in_viewport(ratio=1)


def test_closed_palette_changes_nothing(page: Page, running: BackgroundStudio) -> None:
    open_page(page, "Market")
    page.keyboard.press("Control+k")
    page.get_by_role("combobox", name="Go to …").fill("nobody is called so")
    expect(page.get_by_text("Nothing has this name.")).to_be_in_viewport()
    page.keyboard.press("Enter")
    page.keyboard.press("Escape")
    expect(page.get_by_role("combobox", name="Go to …")).to_be_hidden()
    expect(page).to_have_url(re.compile(r"/market$"))
    assert stops(running) == []


def test_refused_stop_is_told_in_words(page: Page, running: BackgroundStudio) -> None:
    running.caller.answered = SimpleNamespace(accepted=False, code="", message="nothing runs")
    strip(page).get_by_role("button", name="Stop").click()
    told = strip(page).get_by_role("alert")
    expect(told).to_have_text("nothing runs")
    expect(told).to_be_in_viewport()
    page.context.set_offline(True)
    strip(page).get_by_role("button", name="Stop").click()
    expect(told).to_contain_text("Not stopped: the system does not answer.")
    page.context.set_offline(False)
    page.context.clear_cookies()
    strip(page).get_by_role("button", name="Stop").click()
    expect(told).to_contain_text("open the address")
    expect(told).to_contain_text("Not stopped")


STALE = re.compile(r"stale since \d\d:\d\d:\d\d, trying again …")
LOOK = """() => {
    window.looks = 0;
    setInterval(() => {
        window.looks += document.querySelector(".phase").textContent === "connected";
    }, 250);
}"""
"""Counts how often a page still says that it is connected; its own looks are as frequent."""
MOST_LOOKS = 16


class SwallowedSocket:
    """The connection of a page, whose messages can be swallowed."""

    def __init__(self, page: Page) -> None:
        self.is_swallowed = False
        page.route_web_socket("**/api/socket", self._pass)

    def _pass(self, socket: WebSocketRoute) -> None:
        server = socket.connect_to_server()
        server.on_message(lambda text: None if self.is_swallowed else socket.send(text))
        socket.on_message(lambda text: None if self.is_swallowed else server.send(text))


@pytest.fixture
def half_open(
    browser: Browser, running: BackgroundStudio
) -> Iterator[tuple[Page, SwallowedSocket]]:
    """A page with a connection that can swallow everything."""
    with opened_page(browser, "about:blank") as opened:
        socket = SwallowedSocket(opened)
        opened.goto(running.address)
        expect(strip(opened)).to_have_attribute("data-state", "RUNNING")
        yield opened, socket


def test_half_open_connection_is_shown_soon_and_replaced(
    half_open: tuple[Page, SwallowedSocket], running: BackgroundStudio
) -> None:
    page, socket = half_open
    phase, side = page.locator(".phase"), page.locator(".shared-side")
    expect(side).to_have_css("opacity", "1")
    socket.is_swallowed = True
    page.evaluate(LOOK)
    expect(phase).to_have_text(STALE)
    assert page.evaluate("looks") <= MOST_LOOKS
    expect(phase).to_be_in_viewport()
    expect(side).to_have_css("opacity", "0.5")
    running.put("live", "", live(5.0))
    # The next connection is silent, too, and no reason to show anything else.
    page.wait_for_timeout(4000)
    expect(phase).to_have_text(STALE, timeout=1)
    stop_the_run(page, running)
    socket.is_swallowed = False
    expect(phase).to_have_text("connected")
    expect(side).to_have_css("opacity", "1")
    expect(strip(page)).to_contain_text("mood 5")


@pytest.mark.parametrize(
    "event",
    [
        "window.dispatchEvent(new Event('online'))",
        "document.dispatchEvent(new Event('visibilitychange'))",
    ],
)
def test_lost_page_returns_with_network_or_user(
    half_open: tuple[Page, SwallowedSocket], event: str
) -> None:
    page, socket = half_open
    phase = page.locator(".phase")
    page.clock.install()
    page.reload()
    expect(strip(page)).to_have_attribute("data-state", "RUNNING")
    socket.is_swallowed = True
    page.clock.pause_at(time.time() + 60)
    page.clock.run_for(5000)
    expect(phase).to_have_text(STALE)
    # The clock of the page is stopped, so none of its timers retries.
    socket.is_swallowed = False
    with page.expect_request("**/api/journals") as asked:
        page.evaluate(event)
    asked.value.response()
    page.wait_for_timeout(1000)  # the page reads the answer
    page.clock.run_for(300)
    expect(phase).to_have_text("connected")


def test_quiet_connection_stays_connected(page: Page) -> None:
    shown = page.locator(".phase")
    page.evaluate(
        """() => {
            window.phases = new Set();
            const look = () => window.phases.add(document.querySelector(".phase").textContent);
            const all = {subtree: true, childList: true, characterData: true};
            new MutationObserver(look).observe(document.querySelector("header"), all);
            look();
        }"""
    )
    page.wait_for_timeout(4000)
    expect(shown).to_have_text("connected")
    assert page.evaluate("[...window.phases]") == ["connected"]


def test_pasted_address_signs_in_the_open_tab(browser: Browser, running: BackgroundStudio) -> None:
    bare, _, token = running.address.partition("#")
    with opened_page(browser, bare) as page:
        expect(page.locator(".phase")).to_contain_text("Not signed in")
        expect(page.locator("[role=treeitem]")).to_have_count(0)
        # After a paste into the address bar, only the part after # differs.
        page.goto(running.address)
        expect(page.locator(".phase")).to_have_text("connected")
        assert token not in page.url
        stop_the_run(page, running)


def test_refused_tab_follows_sign_in_of_another(
    browser: Browser, running: BackgroundStudio
) -> None:
    with opened_page(browser, running.address.partition("#")[0]) as refused:
        expect(refused.locator(".phase")).to_contain_text("Not signed in")
        refused.context.new_page().goto(running.address)
        expect(refused.locator(".phase")).to_have_text("connected")
        expect(strip(refused)).to_contain_text("The greeter")


def test_unanswered_probe_does_not_end_the_retries(
    half_open: tuple[Page, SwallowedSocket],
) -> None:
    page, socket = half_open
    page.route("**/api/journals", lambda _: None)
    socket.is_swallowed = True
    expect(page.locator(".phase")).to_have_text(STALE)
    socket.is_swallowed = False
    expect(page.locator(".phase")).to_have_text("connected")


def test_reload_shows_chosen_agent_and_node(page: Page) -> None:
    page.get_by_label("Agent").select_option("carrier")
    node = page.locator(f'[role=treeitem][data-path="{TIP}"]')
    node.click()
    expect(page).to_have_url(re.compile(r"/live\?agent=carrier&node=tree%2F0\.say$"))
    page.reload()
    expect(page.get_by_label("Agent")).to_have_value("carrier")
    expect(node).to_have_attribute("aria-selected", "true")
    expect(node).to_contain_text("I am carrier.")
    expect(page.get_by_label("Node", exact=True)).to_contain_text("a.yaml:1")
    assert page.title() == "Live · The carrier · bt-agents studio"


def test_back_returns_through_pages_and_choices(page: Page, running: BackgroundStudio) -> None:
    for number in (1, 2):
        running.put("rounds", f"x/{number}", held_round(number))
    page.get_by_label("Agent").select_option("carrier")
    open_page(page, "Market")
    bids = page.get_by_label("Bids", exact=True)
    expect(bids).to_contain_text("because of 2")
    page.get_by_label("Rounds").get_by_role("button", name="scene 1").click()
    expect(bids).to_contain_text("because of 1")
    expect(page).to_have_title("Market · The carrier · bt-agents studio")
    page.reload()
    expect(bids).to_contain_text("because of 1")
    page.go_back()
    expect(bids).to_contain_text("because of 2")
    page.go_back()
    expect(page.get_by_label("Agent")).to_have_value("carrier")
    page.go_back()
    expect(page.get_by_label("Agent")).to_have_value("")
    expect(page).to_have_title("Live · The greeter · bt-agents studio")
    page.go_forward()
    expect(page.get_by_label("Agent")).to_have_value("carrier")


def test_link_shows_the_same_moment(page: Page) -> None:
    look_back(page)
    open_page(page, "World")
    shown = page.locator("header time")
    at = shown.inner_text()
    expect(page).to_have_url(re.compile(r"/world\?at=\d+"))
    other = page.context.new_page()
    other.goto(page.url)
    expect(other.get_by_role("button", name="Back to now")).to_be_visible()
    expect(other.locator("header time")).to_have_text(at)
    expect(strip(other)).to_contain_text("Now:runningThe greeter")
    other.get_by_role("button", name="Back to now").click()
    expect(other).to_have_url(re.compile(r"/world$"))
    other.go_back()
    expect(other.locator("header time")).to_have_text(at)


def test_link_to_missing_recording_shows_the_present(page: Page) -> None:
    page.goto(page.url.partition("?")[0] + "live?from=missing.mcap")
    expect(page.locator(".timeline .shared-failure")).to_contain_text("missing.mcap")
    expect(page).to_have_url(re.compile(r"/live$"))
    expect(page.locator("[role=treeitem]").first).to_be_visible()


def test_missing_agent_and_round_are_named(page: Page, running: BackgroundStudio) -> None:
    running.put("parts", "marketplace", studio_entries.part())
    running.put("rounds", "market/1", held_round(1))
    page.goto(urljoin(page.url, "/live?agent=nobody"))
    expect(page.locator("main")).to_contain_text("There is no agent of this name.")
    page.goto(urljoin(page.url, "/market?round=999"))
    expect(page.locator("main")).to_contain_text("This round is no longer kept.")


def test_unknown_path_leads_to_live(page: Page) -> None:
    page.goto(page.url.partition("?")[0] + "lives")
    expect(page.get_by_role("main")).to_contain_text("There is no such page")
    expect(page).to_have_title("There is no such page · The greeter · bt-agents studio")
    expect(strip(page)).to_contain_text("The greeter")
    page.get_by_role("link", name="Go to Live").click()
    expect(page.locator("[role=treeitem]").first).to_be_visible()


def test_question_mark_lists_keys_and_stops_nothing(page: Page, running: BackgroundStudio) -> None:
    page.keyboard.press("?")
    shown = page.get_by_role("dialog", name="Keys, colours, density")
    expect(shown).to_be_in_viewport()
    expect(shown).to_contain_text("stop the running agent, from any page")
    page.keyboard.press("Escape")
    expect(shown).to_be_hidden()
    page.keyboard.press("Escape")
    page.get_by_role("searchbox").press("?")
    expect(shown).to_be_hidden()
    stop_the_run(page, running)
    assert len(stops(running)) == 1


def test_chosen_colours_are_kept_by_the_browser(page: Page) -> None:
    page.emulate_media(color_scheme="light")
    body, dark, light = page.locator("html"), "rgb(20, 23, 28)", "rgb(244, 245, 247)"
    expect(body).to_have_css("background-color", light)
    page.get_by_role("button", name="Keys, colours, density").click()
    page.get_by_role("button", name="Dark").click()
    expect(body).to_have_css("background-color", dark)
    page.reload()
    expect(body).to_have_css("background-color", dark)
    page.emulate_media(color_scheme="dark")
    page.get_by_role("button", name="Keys, colours, density").click()
    page.get_by_role("button", name="Light").click()
    expect(body).to_have_css("background-color", light)
    page.get_by_role("button", name="As the system").click()
    expect(body).to_have_css("background-color", dark)


def test_compact_pages_show_more(page: Page) -> None:
    def heights() -> list[float]:
        return [box(one)["height"] for one in (page.locator("header"), page.locator("main > *"))]

    usual = heights()
    page.get_by_role("button", name="Keys, colours, density").click()
    page.get_by_role("button", name="Compact").click()
    page.reload()
    expect(page.locator(".phase")).to_have_text("connected")
    expect(page.locator("html")).to_have_attribute("data-density", "compact")
    assert all(less < more for less, more in zip(heights(), usual, strict=True))
