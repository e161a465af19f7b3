# SPDX-License-Identifier: Apache-2.0
"""The page Person: what a tablet loads, who may open it, and a robot without it."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from playwright.sync_api import Browser, Page, expect

from bt_agents_studio.access import SessionRole
from bt_agents_studio.records import RobotActRecord, RobotRecord
from studio_browser import System, come, open_page, opened_page, running_system, strip
from studio_entries import filled
from studio_harness import BackgroundStudio

pytestmark = pytest.mark.e2e

MOST_KB = 90
LOADED = """
["navigation", "resource"]
  .flatMap((type) => performance.getEntriesByType(type))
  .map((one) => [new URL(one.name).pathname, one.encodedBodySize])
"""


def test_tablet_loads_no_tree_and_no_plots(browser: Browser, studio: BackgroundStudio) -> None:
    with opened_page(browser, studio.address_for(SessionRole.PERSON, "person")) as page:
        expect(page.locator(".phase")).to_have_text("connected")
        expect(page.get_by_role("button", name="Stop")).to_be_in_viewport()
        expect(page.get_by_role("navigation")).to_have_count(0)
        sizes = {
            path: size for path, size in page.evaluate(LOADED) if not path.startswith("/api/")
        }
    assert "/person.js" in sizes
    assert not sizes.keys() & {"/studio.js", "/application.js", "/application.css"}
    assert 0 < sum(sizes.values()) < MOST_KB * 1000, sizes


@pytest.mark.parametrize(
    ("locale", "language", "begin"),
    [
        ("de-AT", "de", "Beginnen"),
        ("es-MX", "es", "Empezar"),
        ("fr-FR", "fr", "Commencer"),
        ("ja-JP", "en", "Begin"),
    ],
)
def test_page_speaks_the_language_of_its_browser(
    browser: Browser, studio: BackgroundStudio, locale: str, language: str, begin: str
) -> None:
    address = studio.address_for(SessionRole.PERSON, "person")
    with opened_page(browser, address, locale) as page:
        expect(page.get_by_role("button", name=begin, exact=True)).to_be_enabled()
        assert page.locator("html").get_attribute("lang") == language


def test_visitor_reads_refusal_in_own_language(browser: Browser, studio: BackgroundStudio) -> None:
    with opened_page(browser, f"{studio.origin}/person", "de-AT") as page:
        expect(page.locator(".phase")).to_contain_text("Nicht angemeldet.")
        expect(page.get_by_text("Not signed in")).to_have_count(0)


def ask(studio: BackgroundStudio, number: int) -> None:
    act = filled(RobotActRecord, number=number, kind="ASK", text="Shall we go?", choices=("yes",))
    studio.put("robot", "", filled(RobotRecord, acts=(act,), light="green"))


@pytest.fixture
def tablet(browser: Browser, studio: BackgroundStudio) -> Iterator[Page]:
    """The page of a visitor whom the robot asks something."""
    answered = studio.caller.answered
    ask(studio, 1)
    with opened_page(browser, studio.address_for(SessionRole.PERSON, "person")) as page:
        expect(page.get_by_role("button", name="yes")).to_be_enabled()
        yield page
    studio.caller.answered = answered


def test_held_key_answers_only_one_question(tablet: Page, studio: BackgroundStudio) -> None:
    told = tablet.locator(".person-told")
    studio.caller.calls.clear()
    tablet.keyboard.down("1")
    expect(told).to_have_text("Your answer: yes")
    ask(studio, 2)
    tablet.wait_for_timeout(300)  # the next question
    tablet.keyboard.down("1")  # repeats
    tablet.keyboard.up("1")
    tablet.get_by_role("button", name="Good").click()
    expect(told).to_have_text("Thank you.")
    assert [name for name, _ in studio.caller.calls] == ["answer", "feedback/give"]


def test_visitor_sees_reply_for_a_while(tablet: Page) -> None:
    tablet.set_viewport_size({"width": 390, "height": 700})
    tablet.clock.install()
    tablet.get_by_role("button", name="Good").click()
    expect(tablet.get_by_text("Thank you.")).to_be_in_viewport(ratio=1)
    tablet.clock.fast_forward(16_000)
    expect(tablet.locator(".person-told")).to_have_text("")


def test_next_encounter_forgets_the_last_stop(tablet: Page) -> None:
    tablet.get_by_role("button", name="Stop").click()
    told = tablet.get_by_role("alert")
    expect(told).to_have_text("The robot has stopped.")
    come(tablet)
    expect(told).to_have_count(0)


def test_visitor_leaves_after_the_run(tablet: Page, studio: BackgroundStudio) -> None:
    studio.caller.answered = SimpleNamespace(
        accepted=False, code="NOT_RUNNING", message="no agent is running"
    )
    chosen = tablet.get_by_role("button", name="child", pressed=True)
    tablet.get_by_role("button", name="child").click()
    expect(chosen).to_have_count(1)
    tablet.get_by_role("button", name="I am leaving").click()
    expect(tablet.locator(".person-told")).to_have_text("The robot knows that you have left.")
    expect(chosen).to_have_count(0)


def test_session_of_person_is_led_to_its_page(browser: Browser, studio: BackgroundStudio) -> None:
    with opened_page(browser, studio.address_for(SessionRole.PERSON)) as page:
        page.wait_for_url("**/person")
        expect(page.get_by_label("The robot says")).to_be_in_viewport()
        expect(page.locator(".phase")).to_have_text("connected")


def test_operator_moves_between_person_and_other_pages(
    browser: Browser, studio: BackgroundStudio
) -> None:
    with opened_page(browser, studio.address) as page:
        links = page.get_by_role("navigation")
        links.get_by_role("link", name="Person").click()
        expect(page.get_by_label("The robot says")).to_be_in_viewport()
        page.get_by_role("region", name="How was the robot?").get_by_role(
            "button", name="Good"
        ).click()
        expect(page.locator(".person-told")).to_have_text("Thank you.")
        links.get_by_role("link", name="Tune").click()
        expect(page.get_by_label("Keep in the files")).to_be_in_viewport()
        page.go_back()
        expect(page.get_by_label("The robot says")).to_be_in_viewport()


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    state = tmp_path_factory.mktemp("state")
    with running_system(state, "trees", "--robot", "browser") as running:
        yield running


def test_closed_page_ends_run_and_reload_does_not(
    browser: Browser, system: System, page: Page
) -> None:
    with opened_page(browser, system.for_person) as tablet:
        come(tablet, "an older adult", "meets it for the first time", "neutral")
        answer = tablet.get_by_label("Your answer").get_by_role("button", name="yes")
        expect(answer).to_be_in_viewport()
        tablet.reload()
        expect(answer).to_be_in_viewport()
        expect(strip(page)).to_have_attribute("data-state", "RUNNING")
    expect(page.get_by_label("What happened")).to_contain_text("no page Person is open")
    expect(strip(page)).to_have_attribute("data-state", "IDLE")


def test_pages_explain_how_to_enable_missing_journal(page: Page) -> None:
    open_page(page, "World")
    panel = page.get_by_label("Recording", exact=True)
    expect(panel).to_contain_text("'bt-agents up --journal' starts")
