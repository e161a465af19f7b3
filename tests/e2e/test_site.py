# SPDX-License-Identifier: Apache-2.0
"""The documentation site, as built by scripts/docs."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any

import pytest
import yaml

from programs import ROOT

pytestmark = pytest.mark.e2e

SITE = ROOT / "build" / "site"


def navigated(entry: Any) -> Iterator[str]:
    """Yield the pages of an entry of the navigation."""
    match entry:
        case str():
            yield entry
        case list():
            for one in entry:
                yield from navigated(one)
        case dict():
            for one in entry.values():
                yield from navigated(one)


def test_site_lists_pages_once_and_links_resolve_offline() -> None:
    built = subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "docs_site.py")], capture_output=True, text=True
    )
    assert built.returncode == 0, built.stdout + built.stderr
    pages = list(navigated(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]))
    assert sorted(pages) == sorted(
        str(page.relative_to(ROOT / "build" / "pages"))
        for page in (ROOT / "build" / "pages").rglob("*.md")
    )
    texts = {page: page.read_text() for page in SITE.rglob("*.html")}
    anchors = {page: set(re.findall(r'\bid="([^"]*)"', text)) for page, text in texts.items()}
    followed = 0
    for name in pages:
        page = SITE / Path(name).with_suffix(".html")
        for link in re.findall(r'\b(?:href|src)="([^"]*)"', texts[page]):
            path, _, anchor = unescape(link).partition("#")
            if re.match(r"[a-z]+:", path):
                assert f'src="{link}"' not in texts[page]
                continue
            target = (page.parent / path).resolve() if path else page
            assert target.exists(), f"{name}: {link}"
            assert not anchor or anchor in anchors[target] or anchor.startswith("__"), (name, link)
            followed += 1
    assert followed > 1000
    for name in ("commands", "files", "interfaces"):
        assert len(anchors[SITE / "reference" / f"{name}.html"]) > 10
    assert "bid_deadline" in texts[SITE / "ros_reference.html"]
