# SPDX-License-Identifier: Apache-2.0
"""Numbers on the studio's pages: typing, dragging, display, and the values sent."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from bt_agents_studio.records import PresetRecord
from studio_browser import box, enter, look_back, open_page, opened_page
from studio_entries import HOST, agent, part, run, tunable, tunings
from studio_harness import BackgroundStudio, background_studio

pytestmark = pytest.mark.e2e

PATIENCE = tunable("guide", "patience", 8.0, default=15.0, maximum=30.0)
FINE = tunable("guide", "fine", 0.00123456789, default=0.0004, minimum=None, maximum=None)
AGE = 1.23456789
VOLUME = tunable("carrier", "volume", 0.5, description="how loud it speaks", maximum=1.0)


class Host:
    """A host that accepts every value, and records when each arrived."""

    def __init__(self, studio: BackgroundStudio) -> None:
        self._studio = studio
        self._revision = 0
        self.tunables = {one.name: one for one in (PATIENCE, FINE, VOLUME)}
        self.sent: list[tuple[float, str, str]] = []
        self.authors: list[str] = []
        self.is_slow = False
        self._late: list[Callable[[], None]] = []
        self.age = AGE
        self.other: list[Mapping[str, Any]] = []
        studio.caller.call = self.call  # type: ignore[method-assign]
        for one in self.tunables.values():
            studio.put("tunables", f"{HOST}|{one.name}", one)
        preset = PresetRecord(
            name="evening",
            values={"guide.patience": "20 s", "carrier.volume": "0.5"},
            settings={"guide.patience": 20.0, "carrier.volume": 0.5},
        )
        self._presets = (preset,)
        studio.put("tunings", HOST, tunings(0, preset))

    def call(self, service: str, fields: Mapping[str, Any], limit_s: float) -> Future[Any]:
        del limit_s
        done: Future[Any] = Future()
        accepted, message = True, "done"
        if service.endswith("/tune") and fields["action"] == 0:
            accepted = fields["seen"] == self._revision
            self.authors.append(fields["author"])
            if accepted:
                self.set(fields["names"][0], fields["values"][0])
        else:
            self.other.append({"service": service, **fields})
            if "expected" in fields and fields["expected"][0] != self.age:
                accepted, message = False, f"age of guide is {self.age} now"
            elif service == "feedback/give":
                self.age = fields["values"][0]
        code = "" if accepted else "CHANGED_MEANWHILE"
        answer = SimpleNamespace(
            accepted=accepted, code=code, message=message, revision=self._revision
        )
        if self.is_slow:
            self._late.append(lambda: done.set_result(answer))
        else:
            done.set_result(answer)
        return done

    def answer_late(self) -> None:
        """Answer pending requests of a slow host; later requests are answered at once."""
        self.is_slow = False
        for answer in self._late:
            answer()

    def set(self, name: str, text: str) -> None:
        """Change a value, from the page or from elsewhere."""
        self._revision += 1
        self.sent.append((time.monotonic(), name, text))
        value = float(text.removesuffix(" s"))
        self.tunables[name] = replace(self.tunables[name], value=value)
        # A page that shows the value has received its revision, too.
        self._studio.put("tunings", HOST, tunings(self._revision, *self._presets))
        self._studio.put("tunables", f"{HOST}|{name}", self.tunables[name])

    @property
    def values(self) -> list[str]:
        return [text for _, _, text in self.sent]


@pytest.fixture(scope="module")
def studio() -> Iterator[BackgroundStudio]:
    with background_studio() as served:
        served.put("parts", "marketplace", part())
        served.put("agents", "guide", agent("guide", "A guide"))
        served.put("agents", "carrier", agent("carrier"))
        served.put("runs", "guide", run("guide"))
        yield served


@pytest.fixture
def host(studio: BackgroundStudio) -> Host:
    return Host(studio)


@pytest.fixture
def page(browser: Browser, studio: BackgroundStudio, host: Host) -> Iterator[Page]:
    del host
    with opened_page(browser, studio.address) as opened:
        open_page(opened, "Tune")
        expect(field(opened)).to_be_in_viewport()
        yield opened


def field(page: Page, key: str = "patience") -> Locator:
    return page.locator(f"#tunable-guide-{key}")


def undo(page: Page) -> Locator:
    """The offer to undo the newest change."""
    return page.locator(".undo")


def take_back(page: Page, answer: str = "done") -> None:
    """Undo the newest change."""
    undo(page).get_by_role("button").click()
    expect(undo(page)).to_have_text(answer)


def test_change_is_taken_back_from_another_page(page: Page, host: Host) -> None:
    enter(field(page), "12")
    open_page(page, "Market")
    expect(undo(page)).to_have_text("guide.patience: 8 s → 12 s Undo")
    expect(undo(page)).to_be_in_viewport()
    take_back(page)
    assert host.values == ["12 s", "8 s"]


def test_no_change_is_undone_while_looking_back(page: Page) -> None:
    enter(field(page), "12")
    button = undo(page).get_by_role("button")
    expect(button).to_have_count(1)
    look_back(page)
    expect(undo(page)).to_contain_text("8 s → 12 s")
    expect(button).to_have_count(0)


def test_slider_moves_are_taken_back_together(page: Page, host: Host) -> None:
    for end in (0.5, 0.7, 0.9):
        before = undo(page).text_content() or ""
        press(page, slider(page), end)
        expect(undo(page)).not_to_have_text(before)
        expect(undo(page)).to_contain_text("guide.patience: 8 s → ")
    assert len(host.values) == 3
    take_back(page)
    assert host.values[-1] == "8 s"


def test_overtaken_change_is_not_taken_back(page: Page, host: Host) -> None:
    enter(field(page), "12")
    expect(undo(page)).to_contain_text("8 s → 12 s")
    host.set("guide.patience", "3 s")
    take_back(page)
    assert host.values == ["12 s", "3 s"]


def test_undo_restores_what_others_have_set(page: Page, host: Host) -> None:
    enter(field(page), "12")
    expect(undo(page)).to_contain_text("8 s → 12 s")
    host.set("guide.patience", "20 s")
    expect(field(page)).to_have_value("20")
    enter(field(page), "15")
    expect(undo(page)).to_contain_text("20 s → 15 s")
    take_back(page)
    assert host.values[-1] == "20 s"


def test_late_answer_leaves_the_next_change_on_offer(page: Page, host: Host) -> None:
    enter(field(page), "12")
    expect(undo(page)).to_contain_text("8 s → 12 s")
    host.is_slow = True
    take_back(page, "undoing …")
    expect(field(page)).to_have_value("8")
    host.is_slow = False
    enter(field(page, "fine"), "2")
    expect(undo(page)).to_have_text("guide.fine: 0.00123456789 s → 2 s Undo")
    host.answer_late()
    page.wait_for_timeout(300)
    expect(undo(page)).to_have_text("guide.fine: 0.00123456789 s → 2 s Undo")


def test_applied_preset_is_taken_back(page: Page, host: Host) -> None:
    preset = page.locator(".tune-preset", has_text="evening")
    preset.locator("summary").click()
    preset.get_by_role("button", name="Apply").click()
    expect(undo(page)).to_have_text("done Undo")
    take_back(page)
    assert [one["preset"] for one in host.other] == ["evening"]
    assert host.values == ["8 s"]


def slider(page: Page) -> Locator:
    return page.get_by_label("guide.patience slider")


def place(found: Locator, part: float) -> tuple[float, float]:
    """Return a place on a slider, from 0 at its left end to 1 at its right."""
    seen = box(found)
    return seen["x"] + 8 + part * (seen["width"] - 16), seen["y"] + seen["height"] / 2


def press(page: Page, found: Locator, part: float) -> None:
    page.mouse.click(*place(found, part))


def test_value_is_shown_and_written_unrounded(page: Page, host: Host) -> None:
    expect(field(page, "fine")).to_have_value("0.00123456789")
    row = page.locator(".fields-row", has=field(page, "fine"))
    expect(row).to_contain_text("in the file 0.0004")
    row.get_by_role("button", name="As in the file").click()
    expect(field(page, "fine")).to_have_value("0.0004")
    expect(undo(page)).to_contain_text("→ 0.0004 s")
    assert host.values == ["0.0004 s"]


def test_unrounded_profile_value_is_taken_back_unless_changed(page: Page, host: Host) -> None:
    page.get_by_text("Profile", exact=True).click()
    shown = page.locator("#profile-guide-age-value")
    expect(shown).to_have_value("1.23456789")
    enter(shown, "1.87654321")
    expect(undo(page)).to_contain_text(f"guide: age {AGE} → 1.87654321")
    assert host.age == 1.87654321
    take_back(page)
    assert host.age == AGE
    enter(shown, "2.5")
    expect(undo(page)).to_contain_text("→ 2.5")
    host.age = 4.5
    take_back(page, "age of guide is 4.5 now")
    assert host.age == 4.5


def test_reset_profile_is_taken_back_unless_changed(page: Page, host: Host) -> None:
    page.get_by_text("Profile", exact=True).click()
    in_file = agent("guide", "A guide").profile["age"]
    for host.age, answer in ((in_file, "done"), (4.5, "age of guide is 4.5 now")):
        profile = page.locator("details details")
        profile.get_by_role("button", name="As in the file").click()
        take_back(page, answer)


def test_reset_profile_forgets_waiting_values(page: Page, host: Host) -> None:
    page.get_by_text("Profile", exact=True).click()
    profile = page.locator("details details")
    host.is_slow = True
    press(page, page.locator("#profile-guide-age"), 0.25)
    press(page, page.locator("#profile-guide-age"), 0.75)
    with page.expect_response("**/api/do/profiles"):
        profile.get_by_role("button", name="As in the file").click()
        host.answer_late()
    expect(profile.locator("output")).to_have_text("done")
    page.wait_for_timeout(300)  # no more requests
    assert [one["service"] for one in host.other] == ["feedback/give", "feedback/manage"]


def test_half_typed_value_is_not_sent(page: Page, host: Host) -> None:
    field(page).fill("1")
    press(page, slider(page), 0.5)
    expect(field(page)).to_have_value("15")
    expect(undo(page)).to_contain_text("8 s → 15 s")
    field(page).fill("2")
    field(page).press("Tab")
    page.keyboard.press("Tab")
    expect(field(page)).to_have_value("2")
    field(page).press("Escape")
    expect(field(page)).to_have_value("15")
    assert host.values == ["15 s"]


def test_dragged_slider_sends_its_last_place_last(page: Page, host: Host) -> None:
    page.mouse.move(*place(slider(page), 0.2))
    page.mouse.down()
    for step in range(40):
        page.mouse.move(*place(slider(page), 0.2 + step * 0.015))
    page.mouse.move(*place(slider(page), 0.8))
    expect(field(page)).to_have_value("24")
    page.mouse.up()
    expect(slider(page)).to_have_value("24")
    expect(undo(page)).to_contain_text("8 s → 24 s")
    page.wait_for_timeout(300)  # no more requests
    expect(field(page)).to_have_value("24")
    assert host.values[-1] == "24 s"
    # Each is sent after the answer to the last one, at least 100 ms later.
    seconds = host.sent[-1][0] - host.sent[0][0]
    assert 1 < len(host.sent) <= seconds * 10 + 2
    assert all(len(text) <= len("24.5 s") for text in host.values)


def test_typed_scene_value_is_announced_and_unticked(page: Page, host: Host) -> None:
    open_page(page, "World")
    panel = page.get_by_label("Play the world")
    typed = panel.locator("#world-age-value")
    typed.fill("2.123456789")
    ticked = panel.locator(".fields-give").get_by_role("checkbox").first
    panel.get_by_role("button", name="Announce the scene").click()
    expect(ticked).not_to_be_checked()
    expect(typed).to_have_value("3")
    assert [(one["names"], one["values"]) for one in host.other] == [(["age"], [2.123456789])]


def test_pressed_scene_slider_drops_half_typed_value(page: Page, host: Host) -> None:
    open_page(page, "World")
    panel = page.get_by_label("Play the world")
    panel.locator("#world-age-value").fill("4")
    press(page, panel.locator("#world-age"), 0.25)
    expect(panel.locator("#world-age-value")).to_have_value("2")
    panel.get_by_role("button", name="Change only the sensed values").click()
    expect(panel.locator("output")).to_have_text("done")
    expect(panel.locator(".fields-give").get_by_role("checkbox").first).to_be_checked()
    assert [one["values"] for one in host.other] == [[2.0]]


def test_current_values_are_given_by_checkbox_or_keyboard(page: Page, host: Host) -> None:
    open_page(page, "World")
    panel = page.get_by_label("Play the world")
    given = panel.locator(".fields-give").get_by_role("checkbox")
    every = panel.get_by_label("Give all values")
    expect(given).to_have_count(2)
    every.focus()
    page.keyboard.press("Space")
    for one in given.all():
        expect(one).to_be_checked()
    given.first.uncheck()
    assert every.evaluate("box => box.indeterminate")
    every.check()
    every.uncheck()
    for one in given.all():
        expect(one).not_to_be_checked()
    panel.locator("#world-age").press("Enter")
    expect(given.first).to_be_checked()
    panel.get_by_role("button", name="Change only the sensed values").click()
    expect(panel.locator("output")).to_have_text("done")
    assert [(one["names"], one["values"]) for one in host.other] == [(["age"], [3.0])]


def test_typed_value_survives_an_absent_studio(page: Page, host: Host) -> None:
    page.route("**/api/do/*", lambda route: route.abort())
    enter(field(page), "11.125")
    row = page.locator(".fields-row", has=field(page))
    expect(row.locator("output")).to_have_text("the studio does not answer")
    expect(row.locator("output")).to_be_in_viewport()
    expect(field(page)).to_have_value("11.125")
    page.unroute("**/api/do/*")
    row.get_by_role("button", name="Set", exact=True).click()
    expect(row.get_by_role("button", name="Set", exact=True)).to_have_count(0)
    expect(undo(page)).to_contain_text("8 s → 11.125 s")
    expect(field(page)).to_have_value("11.125")
    assert host.values == ["11.125 s"]


def test_profile_field_is_sent_by_enter_only(page: Page, host: Host) -> None:
    page.get_by_text("Profile", exact=True).click()
    typed = page.locator("#profile-guide-age-value")
    typed.fill("2.5")
    typed.press("Tab")
    page.route("**/api/do/*", lambda route: route.abort())
    typed.press("Enter")
    expect(page.locator("details details output")).to_have_text("the studio does not answer")
    expect(typed).to_have_value("2.5")
    page.unroute("**/api/do/*")
    assert host.age == AGE
    typed.press("Enter")
    expect(undo(page)).to_contain_text("→ 2.5")
    assert host.age == 2.5


def test_text_that_is_no_number_stays(page: Page, host: Host) -> None:
    open_page(page, "World")
    typed = page.locator("#world-age-value")
    typed.fill("2,5")
    typed.press("Tab")
    expect(typed).to_have_value("2,5")
    expect(page.get_by_text("This is not a number")).to_be_visible()
    assert host.other == []


def test_file_value_is_marked_on_track(page: Page) -> None:
    row = page.locator(".fields-row", has=field(page))
    mark = box(row.locator(".fields-fileMark rect"))
    assert abs(mark["x"] + mark["width"] / 2 - place(slider(page), 0.5)[0]) < 2


def test_running_agent_is_first_and_open(page: Page) -> None:
    groups = page.locator(".shared-main section")
    expect(groups.nth(0)).to_have_attribute("aria-label", "guide")
    expect(groups.nth(0)).to_contain_text("runs, or ran last")
    folded = groups.nth(1)
    expect(folded).to_have_attribute("aria-label", "carrier")
    expect(page.locator("#tunable-carrier-volume")).to_have_count(0)
    folded.locator("summary").click()
    expect(page.locator("#tunable-carrier-volume")).to_be_visible()


def test_typed_text_stays_when_another_agent_runs(page: Page, studio: BackgroundStudio) -> None:
    field(page).fill("12.5")
    studio.put("runs", "carrier", run("carrier", time.time() + 1))
    expect(page.locator(".shared-main section").first).to_have_attribute("aria-label", "carrier")
    expect(field(page)).to_have_value("12.5")
    expect(field(page)).to_be_focused()
    studio.put("runs", "guide", run("guide", time.time() + 2))
    expect(page.locator(".shared-main section").first).to_have_attribute("aria-label", "guide")


def test_typed_value_stays_among_differences(page: Page, studio: BackgroundStudio) -> None:
    page.get_by_label("Only differences from the file").check()
    expect(page.locator("#tunable-carrier-volume")).to_have_count(0)
    field(page).fill("12.5")
    studio.put("tunables", f"{HOST}|{PATIENCE.name}", replace(PATIENCE, value=PATIENCE.default))
    expect(page.get_by_role("alert").filter(has_text="8 → 15")).to_be_visible()
    expect(field(page)).to_have_value("12.5")


def test_values_are_found_by_name_and_description(page: Page) -> None:
    for text in ("volume", "LOUD it"):
        page.get_by_role("searchbox").fill(text)
        expect(page.locator("#tunable-carrier-volume")).to_be_in_viewport()
        expect(field(page)).to_have_count(0)
        page.get_by_role("searchbox").fill("")


def test_preset_shows_its_changes_and_is_deleted(page: Page, host: Host) -> None:
    preset = page.locator(".tune-preset", has_text="evening")
    expect(preset).to_contain_text("would change 1")
    preset.locator("summary").click()
    rows = preset.get_by_role("row")
    expect(rows).to_have_count(1)
    expect(rows).to_contain_text("8 s → 20 s")
    preset.get_by_role("button", name="Delete").click()
    expect(page.get_by_label("Changes").locator("output")).to_have_text("done")
    [asked] = host.other
    assert (asked["action"], asked["preset"]) == (5, "evening")


def test_preset_is_replaced_by_its_own_button(page: Page, host: Host) -> None:
    panel = page.get_by_label("Changes")
    name = panel.get_by_label("Save as")
    enter(name, " evening")
    expect(panel.get_by_role("button", name="Save as")).to_be_disabled()
    assert host.other == []
    panel.get_by_role("button", name="Replace it").click()
    expect(name).to_have_value("")
    assert [(one["action"], one["preset"]) for one in host.other] == [(4, " evening")]


def test_changes_carry_the_name_of_their_author(page: Page, host: Host) -> None:
    page.get_by_label("Your name").fill("Anna")
    for text in ("12", "13"):
        enter(field(page), text)
        expect(field(page)).to_have_value(text)
        expect(page.locator("input[data-draft]")).to_have_count(0)
        page.reload()
    page.get_by_label("Your name").fill("")
    page.locator(".fields-row", has=field(page)).get_by_role(
        "button", name="As in the file"
    ).click()
    expect(field(page)).to_have_value("15")
    assert host.authors == ["Anna", "Anna", "studio"]
