# SPDX-License-Identifier: Apache-2.0
"""Chromium for tests: the machine's, or one from an npm package."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from npm_packages import installed_packages, make_once, node_environment, program

_UNPACK = """
import('@sparticuz/chromium').then(one => one.default.executablePath()).then(console.log)
"""
_UNPACK_S = 120


@contextmanager
def chromium() -> Iterator[Browser]:
    """Run a headless browser."""
    path, libraries = installed_browser()
    environment = {**os.environ, "LD_LIBRARY_PATH": str(libraries)}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=path, args=["--no-sandbox"], env=environment
        )
        try:
            yield browser
        finally:
            browser.close()


def installed_browser() -> tuple[str, Path]:
    """Return the path of a browser, and of the extra libraries that it needs."""
    folder = installed_packages().parent
    unpacked = folder / "unpacked"
    make_once(unpacked, partial(_unpack, folder))
    return str(unpacked / "chromium"), unpacked / "al2023" / "lib"


def _unpack(package: Path, folder: Path) -> None:
    # The package unpacks into the folder of temporary files; it unpacks its libraries only if it
    # detects a bare machine.
    bare = {"TMPDIR": str(folder), "AWS_EXECUTION_ENV": "AWS_Lambda_nodejs22.x"}
    subprocess.run(
        [program("node"), "-e", _UNPACK],
        cwd=package,
        env={**node_environment(), **bare},
        capture_output=True,
        timeout=_UNPACK_S,
        check=True,
    )
