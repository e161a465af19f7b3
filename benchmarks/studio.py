# SPDX-License-Identifier: Apache-2.0
"""Measures the page of the studio in a headless browser.

``studio.py --minutes 60`` says how page and process grow while the page stays open.
"""

from __future__ import annotations

import re
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path += [str(Path(__file__).parent), str(Path(__file__).parents[1] / "tests" / "harness")]

import click
import numpy as np
from playwright.sync_api import Browser, CDPSession, Page

from browser import chromium
from measuring import Effort, Row
from processes import HERE, Graph, Running, graphs, proportional_bytes
from status_source import PROBE

AGENTS = 30
NODES = 200
MANY_NODES = 2000
RATE_HZ = 50

PAINTED_S = 0.040
SLOWEST_S = 0.100
FIRST_VIEW_S = 1.0
FRAME_S = 1 / 57
"""Time between two frames of a browser that paints 60 a second [s], a twentieth missed."""

PAGE_MB = 200.0
FIRST_PAGE_KB = 130.0
PERSON_PAGE_KB = 90.0
_WINDOW_S = 6.0
_SHORT_S = 1.5
_SETTLE_S = 2.0
_LIMIT_MS = 30_000

_WATCH = """
window.painted = [];
window.firstMs = 0;
const afterFrame = (done) => requestAnimationFrame(() => {
  const channel = new MessageChannel();
  channel.port1.onmessage = done;
  channel.port2.postMessage(0);
});
new MutationObserver((changes) => {
  const probe = document.querySelector('[data-path="PROBE"]');
  if (probe === null) return;
  if (window.firstMs === 0) {
    window.firstMs = -1;
    afterFrame(() => { window.firstMs = performance.now(); });
  }
  if (!changes.some((one) => one.target === probe && one.attributeName === "title")) return;
  const sent = /\\d+\\.\\d{6}/.exec(probe.getAttribute("title"));
  if (sent === null) return;
  afterFrame(() => {
    window.painted.push((performance.timeOrigin + performance.now()) / 1e3 - Number(sent[0]));
  });
}).observe(document, {subtree: true, childList: true, attributes: true});
""".replace("PROBE", PROBE)

_FRAMES = """
(seconds) => new Promise((resolve) => {
  const frame = document.querySelector(".outline, .tree") ?? document.scrollingElement;
  const began = performance.now();
  let frames = 0;
  let step = 12;
  const next = () => {
    frames += 1;
    frame.scrollTop += step;
    if (frame.scrollTop > 20000) step = -12;
    if (frame.scrollTop === 0) step = 12;
    const took = (performance.now() - began) / 1e3;
    if (took < seconds) requestAnimationFrame(next);
    else resolve(frames / took);
  };
  requestAnimationFrame(next);
})
"""

_LOADED = """
() => ["navigation", "resource"]
  .flatMap((type) => performance.getEntriesByType(type))
  .filter((one) => !new URL(one.name).pathname.startsWith("/api/"))
  .map((one) => one.encodedBodySize)
"""
"""Sizes of the files of a page, as they were sent [bytes]."""


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What one window of a page has shown.

    Attributes:
        painted_s: From the tick to the painted frame, of each change of the probe.
        frames: A second, while the tree is moved.
        page_mb: Memory of the processes that draw the page.
    """

    painted_s: Sequence[float]
    frames: float
    page_mb: float


class Shown:
    """A page that a process serves, in a browser.

    Args:
        browser: Its own context is opened, so that nothing is cached.
        address: Of the page.
    """

    def __init__(self, browser: Browser, address: str) -> None:
        self._browser = browser
        self._context = browser.new_context(viewport={"width": 1280, "height": 800})
        self.page: Page = self._context.new_page()
        self.page.set_default_timeout(_LIMIT_MS)
        self.page.add_init_script(_WATCH)
        self.page.goto(address)
        self.page.wait_for_function("() => window.firstMs > 0")
        self.first_s = float(self.page.evaluate("window.firstMs")) / 1e3
        self._session: CDPSession = self._context.new_cdp_session(self.page)
        self._session.send("Performance.enable")

    def figures(self, window_s: float) -> Figures:
        """Return what is seen in so long [s], half of it while the tree is moved."""
        self.page.evaluate("window.painted = []")
        self.page.wait_for_timeout(window_s * 1e3)
        painted = [float(one) for one in self.page.evaluate("window.painted")]
        return Figures(
            painted_s=painted,
            frames=float(self.page.evaluate(_FRAMES, window_s)),
            page_mb=self._memory_mb(),
        )

    def heap_mb(self) -> float:
        """Return the memory of the objects that are in use [MB]."""
        self._session.send("HeapProfiler.collectGarbage")
        found = self._session.send("Performance.getMetrics")["metrics"]
        return next(float(one["value"]) for one in found if one["name"] == "JSHeapUsedSize") / 1e6

    def close(self) -> None:
        """Close the page."""
        self._context.close()

    def _memory_mb(self) -> float:
        """Return the memory of the drawing processes, each shared page by its part [MB]."""
        session = self._browser.new_browser_cdp_session()
        found = session.send("SystemInfo.getProcessInfo")["processInfo"]
        session.detach()
        drawing = (one["id"] for one in found if one["type"] == "renderer")
        return sum(map(proportional_bytes, drawing)) / 1e6


def measure(effort: Effort) -> Iterator[Row]:
    """Yield what each costs."""
    window_s = _SHORT_S if effort.is_short else _WINDOW_S
    repetitions = 1 if effort.is_short else 3
    with chromium() as browser:
        yield from _loaded(browser)
        for nodes in (MANY_NODES,) if effort.is_short else (NODES, MANY_NODES):
            agents = AGENTS if nodes == NODES else 1
            yield from _page(browser, agents, nodes, window_s, repetitions)


def _loaded(browser: Browser) -> Iterator[Row]:
    """Yield what a browser without a cache loads until a page is connected."""
    with graphs() as make:
        graph = make("loaded")
        studio = graph.command("bt-agents", "studio", HERE.parent / "trees", "--port", 0)
        addresses = {
            "first page": (_address(graph, studio), FIRST_PAGE_KB),
            "page Person": (_address(graph, studio, "to be the person"), PERSON_PAGE_KB),
        }
        for case, (address, limit_kb) in addresses.items():
            context = browser.new_context()
            page = context.new_page()
            page.set_default_timeout(_LIMIT_MS)
            page.goto(address)
            page.wait_for_selector(".phase.open")
            sizes = page.evaluate(_LOADED)
            context.close()
            yield Row.within(
                limit_kb,
                case=case,
                side=f"gzip, {len(sizes)} files",
                values=[sum(sizes) / 1e3],
                unit="kB",
            )


def _address(graph: Graph, server: Running, name: str = "studio") -> str:
    graph.until(lambda: f"{name}: " in server.said, "its address")
    return re.findall(rf"{name}: (\S+)", server.said)[0]


def _page(
    browser: Browser, agents: int, nodes: int, window_s: float, repetitions: int
) -> Iterator[Row]:
    """Yield what a page shows of a tree in which some nodes change in each tick."""
    found: list[Figures] = []
    first: list[float] = []
    with graphs() as make:
        graph = make("studio")
        graph.bare("status_source.py", agents, nodes, RATE_HZ)
        studio = graph.command("bt-agents", "studio", HERE.parent / "trees", "--port", 0)
        address = _address(graph, studio)
        graph.rest(_SETTLE_S)
        for _ in range(repetitions):
            shown = Shown(browser, address)
            first.append(shown.first_s)
            found.append(shown.figures(window_s))
            shown.close()
    median = [float(np.median(one.painted_s)) for one in found]
    slowest = [float(np.quantile(one.painted_s, 0.99)) for one in found]
    for side, limit, unit, values in (
        ("status → painted, median", PAINTED_S, "s", median),
        ("status → painted, p99", SLOWEST_S, "s", slowest),
        ("first view, cold", FIRST_VIEW_S, "s", first),
        ("between frames while moved", FRAME_S, "s", [1 / one.frames for one in found]),
        ("memory of the page", PAGE_MB, "MB", [one.page_mb for one in found]),
    ):
        yield Row.within(
            limit,
            case=f"{agents} x {nodes} nodes, {RATE_HZ} ticks/s",
            side=side,
            values=values,
            unit=unit,
        )


@click.command()
@click.option("--minutes", default=60.0, show_default=True, help="How long it stays open.")
@click.option("--every", default=1.0, show_default=True, help="Minutes between two looks.")
def main(minutes: float, every: float) -> None:
    """Leave a page open, and say how it and the studio grow."""
    seen: list[tuple[float, float, float]] = []
    with graphs() as make, chromium() as browser:
        graph = make("open")
        graph.bare("status_source.py", AGENTS, NODES, RATE_HZ)
        server = graph.command("bt-agents", "studio", HERE.parent / "trees")
        shown = Shown(browser, _address(graph, server))
        began = time.monotonic()
        while (at_min := (time.monotonic() - began) / 60) < minutes:
            shown.page.wait_for_timeout(min(every, minutes - at_min) * 60e3)
            seen.append(((time.monotonic() - began) / 60, shown.heap_mb(), server.resident_mb))
            click.echo("after {:.1f} min: page {:.1f} MB, process {:.1f} MB".format(*seen[-1]))
    late = seen[len(seen) // 2 :]
    for name, column in (("page", 1), ("process", 2)):
        if len(late) > 1:
            slope = statistics.linear_regression(
                [one[0] for one in late], [one[column] for one in late]
            ).slope
            click.echo(f"{name}: {60 * slope:+.1f} MB/h in the second half")


if __name__ == "__main__":
    main()
