# SPDX-License-Identifier: Apache-2.0
"""Pictures of the pages of a running studio, for docs/studio: its address is the argument."""

from __future__ import annotations

import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

FOLDER = Path(__file__).parents[1] / "docs" / "studio"
PAGES = ("live", "person", "market", "tune", "world", "system")
SETTLE_MS = 1000


def main(address: str) -> None:
    """Take a picture of each page, light and dark."""
    FOLDER.mkdir(exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            args=["--no-sandbox"], executable_path="/usr/bin/chromium"
        )
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        page.wait_for_timeout(SETTLE_MS)
        page.locator(".node.running").last.click()
        for name in PAGES:
            page.locator(f"nav a[href^='/{name}']").click()
            for scheme in ("light", "dark"):
                page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
                page.wait_for_timeout(SETTLE_MS)
                page.screenshot(path=FOLDER / f"{name}_{scheme}.png")
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1])
