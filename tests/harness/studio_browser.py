# SPDX-License-Identifier: Apache-2.0
"""Studio of a running system in a browser, and the actions of an operator there."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from playwright.sync_api import Browser, Error, Locator, Page, expect

from npm_packages import installed_packages
from programs import Program, environment_of

LIMIT_MS = 30_000


class System:
    """A running system and its studio."""

    def __init__(self, state: Path, trees: str, *options: str) -> None:
        self._state = state
        self._environment = environment_of(state)
        self.programs: list[Program] = []
        self.up = self.start_program("up", trees, *options)

    def wait(self) -> None:
        """Wait until it is ready; read the addresses of its pages."""
        self.up.until("ready after")
        self.address = self.up.until("studio: ").split()[-1]
        [addresses] = self._state.glob("bt-agents/trees/*/studio.json")
        told = json.loads(addresses.read_text())
        self.to_look, self.for_person = told["view"], told["person"]

    def start_program(self, *arguments: str) -> Program:
        self.programs.append(Program(arguments, self._environment))
        return self.programs[-1]

    def end(self) -> None:
        for program in self.programs:
            program.kill()


@contextmanager
def running_system(state: Path, trees: str, *options: str) -> Iterator[System]:
    """Run a system until the end of the block."""
    system = System(state, trees, *options)
    try:
        system.wait()
        yield system
    finally:
        system.end()


@contextmanager
def opened_page(
    browser: Browser, address: str, locale: str = "en-US", *, has_touch: bool = False
) -> Iterator[Page]:
    """Open an address in a new context; an error that the page reports fails the test."""
    context = browser.new_context(
        viewport={"width": 1280, "height": 800}, locale=locale, has_touch=has_touch
    )
    page = context.new_page()
    page.set_default_timeout(LIMIT_MS)
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    yield page
    context.close()
    assert errors == []


def open_page(page: Page, name: str) -> None:
    page.get_by_role("navigation").get_by_role("link", name=name, exact=True).click()
    # The page may load it only now.
    expect(page.locator("main section").first).to_be_visible()


def open_values(page: Page, agent: str) -> None:
    """Unfold the values of an agent on the page Tune."""
    open_page(page, "Tune")
    group = page.get_by_label(agent, exact=True).locator("details").first
    if group.get_attribute("open") is None:
        group.locator("summary").first.click()


def enter(field: Locator, text: str) -> None:
    """Type a value into a field, and press Enter."""
    field.fill(text)
    field.press("Enter")


def announce(page: Page, label: str, **values: float) -> None:
    """Announce a scene as an operator does: with sliders and a button."""
    open_page(page, "World")
    for name, value in values.items():
        slider = page.locator(f"#world-{name}")
        slider.fill(str(value))
        page.locator(".fields-row", has=slider).get_by_role("checkbox").check()
    page.get_by_label("Label", exact=True).fill(label)
    page.get_by_role("button", name="Announce the scene").click()


def serve(page: Page, label: str, **values: float) -> None:
    """Announce a scene when nothing else runs, and wait until an agent runs for it."""
    stop(page)
    announce(page, label, **values)
    open_page(page, "Live")
    expect(page.get_by_label("Scene", exact=True)).to_contain_text(label)
    expect(strip(page)).to_have_attribute("data-state", "RUNNING")


def come(tablet: Page, *who: str) -> None:
    """Begin an encounter with a person."""
    for choice in who:
        tablet.get_by_role("button", name=choice, exact=True).click()
    tablet.get_by_role("button", name="Begin").click()


def strip(page: Page) -> Locator:
    """The status strip, which every page has."""
    return page.get_by_label("What runs now")


def stop(page: Page) -> None:
    """Stop the current run from any page, so that the next scene starts at once."""
    shown = strip(page)
    expect(shown).to_have_attribute("data-state", re.compile("[A-Z]"))
    button = shown.get_by_role("button", name="Stop", exact=True)
    if button.is_enabled():
        with suppress(Error):  # the run has ended meanwhile
            button.click(timeout=10_000)
    expect(shown).to_have_attribute("data-state", "IDLE")
    expect(button).to_be_disabled()


def wait_for(page: Page, is_so: Callable[[], object]) -> None:
    """Wait until a condition outside the page holds."""
    end = time.monotonic() + LIMIT_MS / 1000
    while not is_so():
        assert time.monotonic() < end
        page.wait_for_timeout(10)


def look_back(page: Page) -> None:
    """Show the oldest moment that the studio keeps."""
    timeline = page.get_by_label("Shown moment")
    expect(timeline).to_have_attribute("aria-disabled", "false")
    timeline.press("Home")
    expect(page.get_by_role("button", name="Back to now")).to_be_visible()


def box(found: Locator) -> dict[str, float]:
    """Return the position of an element: x, y, width, height and bottom [px]."""
    measured = found.bounding_box()
    assert measured is not None
    return {**measured, "bottom": measured["y"] + measured["height"]}


def style(found: Locator, name: str) -> str:
    """Return the computed value of a property of the style."""
    value = found.evaluate("(one, name) => getComputedStyle(one)[name]", name)
    assert isinstance(value, str)
    return value


def found_by_axe(page: Page, what: str, rules: str) -> list[tuple[str, str, str]]:
    """Return colour scheme, rule and element of each violation of accessibility."""
    page.evaluate((installed_packages() / "axe-core" / "axe.min.js").read_text("utf-8"))
    violations = []
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        found = page.evaluate(f"axe.run({what}, {rules})")["violations"]
        violations += [(scheme, one["id"], one["nodes"][0]["html"]) for one in found]
    return violations
