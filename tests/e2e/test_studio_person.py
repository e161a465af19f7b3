# SPDX-License-Identifier: Apache-2.0
"""The document of the page Person: what a tablet loads of it, and for whom it is there."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect

from bt_agents_studio.access import SessionRole
from studio_browser import opened_page
from studio_harness import BackgroundStudio, background_studio

pytestmark = pytest.mark.e2e

MOST_KB = 90
LOADED = """
["navigation", "resource"]
  .flatMap((type) => performance.getEntriesByType(type))
  .map((one) => [new URL(one.name).pathname, one.encodedBodySize])
"""


@pytest.fixture(scope="module")
def studio() -> Iterator[BackgroundStudio]:
    with background_studio() as studio:
        yield studio


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
        expect(page.locator(".told")).to_have_text("done")
        links.get_by_role("link", name="Tune").click()
        expect(page.get_by_label("Keep in the files")).to_be_in_viewport()
        page.go_back()
        expect(page.get_by_label("The robot says")).to_be_in_viewport()
