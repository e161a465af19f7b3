# SPDX-License-Identifier: Apache-2.0
"""Measures the page of the studio in a headless browser, and the cost of its process.

``studio.py --minutes 60`` reports how page and process grow while the page stays open.
"""

from __future__ import annotations

import json
import math
import re
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

sys.path += [str(Path(__file__).parent), str(Path(__file__).parents[1] / "tests" / "harness")]

import click
from playwright.sync_api import Browser, CDPSession, Page

from browser import chromium
from measuring import Effort, Row
from processes import HERE, Graph, Running, graphs
from stalls import Stalls
from status_source import CHANGES, PROBE

AGENTS = 30
NODES = 200
MANY_NODES = 2000
RATE_HZ = 50
CLIENTS = 10

PAINTED_S = 0.025
SLOWEST_S = 0.050
FIRST_VIEW_S = 0.5
OTHERS_S = 0.100
"""Limit on the slowest message to a client while another one hangs [s]."""
FRAMES = 0.95
"""Smallest share of a bare page's frames."""

PAGE_MB = 200.0
FIRST_PAGE_KB = 130.0
PERSON_PAGE_KB = 90.0
TICK = 1.05
STUDIO_CPU = 20.0
"""CPU limit of the studio [% of a core]."""

_WINDOW_S = 6.0
_SHORT_S = 1.5
_SETTLE_S = 2.0
_LIMIT_MS = 30_000

_WATCH = """
window.painted = [];
window.firstMs = 0;
const afterTask = (done) => {
  const channel = new MessageChannel();
  channel.port1.onmessage = done;
  channel.port2.postMessage(0);
};
// The first task after the callbacks of a frame comes after its painting.
const nextFrame = window.requestAnimationFrame.bind(window);
let inFrame = false;
window.requestAnimationFrame = (draw) => nextFrame((time) => {
  inFrame = true;
  afterTask(() => { inFrame = false; });
  draw(time);
});
const afterFrame = (done) => inFrame ? afterTask(done) : nextFrame(() => afterTask(done));
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
    const now = (performance.timeOrigin + performance.now()) / 1e3;
    window.painted.push([Number(sent[0]), now - Number(sent[0])]);
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
"""Transferred sizes of the files of a page [bytes]."""


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Measurements of one window of a page.

    Attributes:
        first_s: Time until its first view, without a cache.
        painted: For each change of the probe, the time of its tick [s since 1970], and from then
            to the painted frame [s].
        frames: Frames a second while the tree moves.
        page_mb: Memory of the processes that draw the page.
        heap_mb: Memory of its scripts' objects.
        elements: Number of elements of the document.
        drawing: CPU of the processes that draw the page, as a share of a core.
        messages: Messages of the WebSocket a second.
        message_bytes: Average size of a message.
        cpu: CPU of the serving process, as a share of a core.
    """

    first_s: float
    painted: list[tuple[float, float]]
    frames: float
    page_mb: float
    heap_mb: float
    elements: float
    drawing: float
    messages: float
    message_bytes: float
    cpu: float


class Shown:
    """A served page in a browser.

    Args:
        browser: Gets a new context for the page, so nothing is cached.
        server: Process that serves the page.
        address: Address of the page.
    """

    def __init__(self, browser: Browser, server: Running, address: str) -> None:
        self._browser = browser
        self._server = server
        self._context = browser.new_context(viewport={"width": 1280, "height": 800})
        self.page: Page = self._context.new_page()
        self._lengths: list[int] = []
        self.page.on(
            "websocket",
            lambda socket: socket.on(
                "framereceived", lambda text: self._lengths.append(len(text))
            ),
        )
        self.page.set_default_timeout(_LIMIT_MS)
        self.page.add_init_script(_WATCH)
        self.page.goto(address)
        self.page.wait_for_function("() => window.firstMs > 0")
        self.first_s = float(self.page.evaluate("window.firstMs")) / 1e3
        self._session: CDPSession = self._context.new_cdp_session(self.page)
        self._session.send("Performance.enable")

    def figures(self, window_s: float) -> Figures:
        """Measure for a time [s]; the tree moves during half of it."""
        self.page.evaluate("window.painted = []")
        self._lengths.clear()
        drawn_s, cpu_s = self._drawn_s(), self._server.cpu_s
        began = time.monotonic()
        self.page.wait_for_timeout(window_s * 1e3)
        painted = [(sent, took) for sent, took in self.page.evaluate("window.painted")]
        took_s = time.monotonic() - began
        drawing = (self._drawn_s() - drawn_s) / took_s
        cpu = (self._server.cpu_s - cpu_s) / took_s
        lengths = list(self._lengths)
        after = self._metrics()
        frames = float(self.page.evaluate(_FRAMES, window_s))
        return Figures(
            first_s=self.first_s,
            painted=painted,
            frames=frames,
            page_mb=self._memory_mb(),
            heap_mb=after["JSHeapUsedSize"] / 1e6,
            elements=float(self.page.evaluate("document.querySelectorAll('*').length")),
            drawing=drawing,
            messages=len(lengths) / took_s,
            message_bytes=statistics.mean(lengths) if lengths else 0.0,
            cpu=cpu,
        )

    def heap_mb(self) -> float:
        """Return the memory of the objects in use [MB]."""
        self._session.send("HeapProfiler.collectGarbage")
        return self._metrics()["JSHeapUsedSize"] / 1e6

    def close(self) -> None:
        """Close the page."""
        self._context.close()

    def _metrics(self) -> dict[str, float]:
        found = self._session.send("Performance.getMetrics")["metrics"]
        return {one["name"]: float(one["value"]) for one in found}

    def _drawn_s(self) -> float:
        """Return the CPU time of the drawing processes [s]."""
        return sum(float(one["cpuTime"]) for one in self._processes())

    def _memory_mb(self) -> float:
        """Return the memory of the drawing processes, with their share of shared pages [MB]."""
        return sum(_proportional_mb(one["id"]) for one in self._processes())

    def _processes(self) -> list[dict[str, Any]]:
        session = self._browser.new_browser_cdp_session()
        found = session.send("SystemInfo.getProcessInfo")["processInfo"]
        session.detach()
        return [one for one in found if one["type"] == "renderer"]


def _proportional_mb(pid: int) -> float:
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    except OSError:
        return 0.0
    found = re.search(r"^Pss:\s+(\d+) kB", text, re.MULTILINE)
    return int(found[1]) * 1024 / 1e6 if found else 0.0


def measure(effort: Effort) -> Iterator[Row]:
    """Yield each cost."""
    window_s = _SHORT_S if effort.is_short else _WINDOW_S
    repetitions = 1 if effort.is_short else 3
    with chromium() as browser:
        yield from _loaded(browser)
        for nodes in (MANY_NODES,) if effort.is_short else (NODES, MANY_NODES):
            agents = AGENTS if nodes == NODES else 1
            yield from _page(browser, agents, nodes, window_s, repetitions)
    yield from _clients(effort, window_s, repetitions)


def _loaded(browser: Browser) -> Iterator[Row]:
    """Yield the size that a browser without a cache loads until a page is connected."""
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
            page.wait_for_selector(".phase[data-phase=open]")
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
    found: dict[str, list[Figures]] = {"studio": [], "bare": []}
    with graphs() as make:
        graph = make("studio")
        graph.bare("status_source.py", agents, nodes, RATE_HZ)
        stalls = Stalls(graph.bare("stalls.py"))
        servers = {
            "studio": graph.command("bt-agents", "studio", HERE.parent / "trees", "--port", 0),
            "bare": graph.bare("bare_page.py"),
        }
        addresses = {name: _address(graph, server) for name, server in servers.items()}
        graph.rest(_SETTLE_S)
        for _ in range(repetitions):
            for name, server in servers.items():
                shown = Shown(browser, server, addresses[name])
                # What a page loads after its first view does not count as a change.
                graph.rest(_SETTLE_S)
                found[name].append(shown.figures(window_s))
                shown.close()
        yield from _page_rows(f"{agents} x {nodes} nodes, {RATE_HZ} ticks/s", found, stalls)


def _page_rows(case: str, found: dict[str, list[Figures]], stalls: Stalls) -> Iterator[Row]:
    def both(
        side: str,
        unit: str,
        value: Callable[[Figures], float],
        limit: float | None = None,
        windows: dict[str, list[Figures]] = found,
        **details: Any,
    ) -> Iterator[Row]:
        """Yield a figure beside the bare page's, and beside its limit, if any."""
        ours, bare = ([value(one) for one in windows[name]] for name in ("studio", "bare"))
        about = {"case": case, "side": side, "values": ours, "unit": unit}
        yield Row(**about, floor="bare page", floor_values=bare, **details)
        if limit is not None:
            yield Row.within(limit, **about)

    def median(one: Figures) -> float:
        return statistics.median(took for _, took in one.painted)

    def slowest(one: Figures) -> float:
        return _quantile(stalls.outside(one.painted), 0.99)

    # A window has fewer than a hundred changes of the probe: its own p99 would be its slowest.
    all_painted = {
        name: [replace(windows[0], painted=[change for one in windows for change in one.painted])]
        for name, windows in found.items()
    }
    note = f"{CHANGES} nodes change in each tick; the studio sends at most 60 messages a second"
    frames = {"goal": FRAMES, "at_least": True}
    yield from both("status → painted, median", "s", median, PAINTED_S, note=note)
    slow = "status → painted, p99 outside stalls of the machine"
    yield from both(slow, "s", slowest, SLOWEST_S, windows=all_painted)
    yield from both("first view, cold", "s", lambda one: one.first_s, FIRST_VIEW_S)
    yield from both("frames while moved", "/s", lambda one: one.frames, **frames)
    yield from both("memory of the page", "MB", lambda one: one.page_mb, PAGE_MB)
    yield from both("objects of its scripts", "MB", lambda one: one.heap_mb)
    yield from both("elements", "", lambda one: one.elements)
    yield from both("drawing processes", "% of a core", lambda one: 100 * one.drawing)
    yield from both("messages", "/s", lambda one: one.messages)
    yield from both("size of one", "bytes", lambda one: one.message_bytes)
    yield from both("serving process", "% of a core", lambda one: 100 * one.cpu)


def _quantile(values: Sequence[float], part: float) -> float:
    ordered = sorted(values)
    return ordered[math.ceil(part * len(ordered)) - 1]


def _ticks_s(source: Running, graph: Graph, window_s: float, stalls: Stalls) -> list[float]:
    """Return the time between ticks of the next seconds, outside stalls [s]."""
    before = len(source.said.splitlines())
    graph.rest(window_s)
    graph.until(lambda: len(source.said.splitlines()) > before + 1, "ticks")
    # The first line may contain earlier ticks.
    lines = source.said.splitlines()[before + 1 :]
    ends = [end for line in lines for end in json.loads(line)]
    return stalls.outside([(end, following - end) for end, following in pairwise(ends)])


def _clients(effort: Effort, window_s: float, repetitions: int) -> Iterator[Row]:
    with_s: list[float] = []
    without_s: list[float] = []
    received_s: list[float] = []
    cpu: list[float] = []
    resident_mb: list[float] = []
    with graphs() as make:
        graph = make("clients")
        source = graph.bare("status_source.py", AGENTS, NODES, RATE_HZ)
        graph.until_up()
        stalls = Stalls(graph.bare("stalls.py"))
        for _ in range(repetitions):
            with ExitStack() as stack:
                bare = graph.bare("bare_page.py")
                stack.callback(bare.end)
                _address(graph, bare)
                graph.rest(_SHORT_S if effort.is_short else _SETTLE_S)
                without_s.append(_quantile(_ticks_s(source, graph, window_s, stalls), 0.99))
            with ExitStack() as stack:
                studio = graph.command("bt-agents", "studio", HERE.parent / "trees")
                stack.callback(studio.end)
                address = _address(graph, studio)
                clients = graph.bare("studio_clients.py", address, CLIENTS - 1, 1)
                stack.callback(clients.kill)
                graph.until(lambda of=clients: "connected" in of.said, "all are connected")
                graph.rest(_SHORT_S if effort.is_short else _SETTLE_S)
                told = len(clients.said.splitlines())
                before_s, began = studio.cpu_s, time.monotonic()
                with_s.append(_quantile(_ticks_s(source, graph, window_s, stalls), 0.99))
                cpu.append(100 * (studio.cpu_s - before_s) / (time.monotonic() - began))
                resident_mb.append(studio.resident_mb)
                times_s = [float(one) for one in clients.said.splitlines()[told:]]
                received_s.append(_quantile(times_s, 0.99))
    case = f"{CLIENTS} clients, one of which hangs"
    yield Row(
        case=case,
        side="p99 between ticks outside stalls",
        values=with_s,
        floor="one bare reader",
        floor_values=without_s,
        goal=TICK,
    )
    side = "status → received by the others, p99"
    yield Row.within(OTHERS_S, case=case, side=side, values=received_s)
    yield Row.within(STUDIO_CPU, case=case, side="serving process", values=cpu, unit="% of a core")
    yield Row(case=case, side="memory of the serving process", values=resident_mb, unit="MB")


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
        shown = Shown(browser, server, _address(graph, server))
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
