# SPDX-License-Identifier: Apache-2.0
"""Takes pictures of the pages of a running studio for docs/studio; its address is the argument."""

from __future__ import annotations

import sys
from pathlib import Path
from urllib.parse import urljoin

sys.path.append(str(Path(__file__).parents[1] / "tests" / "harness"))

from browser import chromium

FOLDER = Path(__file__).parents[1] / "docs" / "studio"
PAGES = ("live", "market", "tune", "world", "system", "person")
SETTLE_MS = 1000


def main(address: str) -> None:
    """Take a picture of each page, light and dark."""
    FOLDER.mkdir(exist_ok=True)
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        page.wait_for_timeout(SETTLE_MS)
        page.locator(".outline-node[data-status=RUNNING]").last.click()
        for name in PAGES:
            if name != "live":
                page.goto(urljoin(address, f"/{name}"))
            for scheme in ("light", "dark"):
                page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
                page.wait_for_timeout(SETTLE_MS)
                page.screenshot(path=FOLDER / f"{name}_{scheme}.png")


if __name__ == "__main__":
    main(sys.argv[1])
