# SPDX-License-Identifier: Apache-2.0
"""The timeline of the studio: places of live and recorded events, and ways to reach them."""

from __future__ import annotations

import base64
import csv
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect
from rclpy.serialization import serialize_message

from bt_agents_interfaces.msg import Run
from bt_agents_lab.recorder.file import JournalFile, RecordedMessage
from bt_agents_lab.recorder.reading import JournalEntry, JournalReader
from bt_agents_ros.messages import header_at, to_time
from bt_agents_studio.access import SessionRole
from bt_agents_studio.records import BookmarkRecord, LogRecord, MoodRecord, MoodRuleRecord
from journal_fixture import topic_of
from studio_browser import LIMIT_MS, box, opened_page, strip, style
from studio_entries import agent, event, filled, market, recording, run, scene
from studio_harness import BackgroundStudio, background_studio

pytestmark = pytest.mark.e2e

FILE = "journal-2026-03-01_001.mcap"
DAY_S, BEGAN_S, RUNS = 8 * 3600.0, 1_000_000.0, 120
SEEN = """() => {
  const lanes = document.querySelector(".timeline-lanes");
  const edge = lanes.querySelector("svg").getBoundingClientRect();
  const of = (name) => Number(lanes.getAttribute(`aria-value${name}`));
  return {
    first: of("min"), last: of("max"), now: of("now"), left: edge.left + 64, right: edge.right,
    cursor: lanes.querySelector(".timeline-cursor")?.getBoundingClientRect().left ?? null,
    marks: [...lanes.querySelectorAll(".timeline-marks rect")]
      .map((one) => one.getBoundingClientRect().left),
    blocks: [...lanes.querySelectorAll(".timeline-block")].map((one) => {
      const { left, right, top, bottom } = one.querySelector("rect").getBoundingClientRect();
      return { ...one.dataset, left, right, top, bottom };
    }),
  };
}"""
READ = """performance.getEntriesByType("resource")
  .filter((one) => one.name.endsWith("/events")).length"""
"""Counts how often a page has read the events of a recording."""


class Seen:
    """Content of the timeline at one instant."""

    def __init__(self, page: Page) -> None:
        found = page.evaluate(SEEN)
        self.first, self.last, self.now = found["first"], found["last"], found["now"]
        self.left, self.right, self.cursor = found["left"], found["right"], found["cursor"]
        self.marks: list[float] = found["marks"]
        self.blocks: list[dict[str, Any]] = found["blocks"]

    def place(self, at_s: float) -> float:
        """Return the place of a moment while the whole time is shown [px]."""
        share = (at_s - self.first) / (self.last - self.first)
        return float(self.left + share * (self.right - self.left))

    def block(self, lane: str, kind: str) -> dict[str, Any]:
        [found] = [one for one in self.blocks if (one["lane"], one["kind"]) == (lane, kind)]
        return found


@pytest.fixture
def began_s() -> float:
    """When the history of the studio begins: a good while ago."""
    return time.time() - 100.0


@pytest.fixture
def studio(began_s: float) -> Iterator[BackgroundStudio]:
    with background_studio() as served:
        line = LogRecord(at_s=began_s, kind="run", agent="guide", path="", text="long ago")
        served.put_past(began_s, "log", "0", line)
        served.put("log", "0", line)
        served.put("log", "1", replace(line, text="just now"))
        served.put("market", "", market())
        served.put("live", "", scene())
        served.put("agents", "guide", agent("guide", "The guide"))
        for number, one in enumerate(
            (
                event("AGENT", "FAILED", began_s + 10, began_s + 30, "no answer"),
                event("AGENT", "RUNNING", began_s + 60, None, "started"),
                event("ROBOT", "SAY", began_s + 12, began_s + 20, "Good morning"),
                event("MARKET", "AWARDED", began_s + 9, began_s + 9, "it is the nearest"),
                event("FEEDBACK", "NEGATIVE", began_s + 40, began_s + 40, "by button"),
                event("FAULT", "ERROR", began_s + 50, began_s + 50, "camera: no picture"),
            )
        ):
            served.put("events", str(number), one)
        yield served


@pytest.fixture
def page(browser: Browser, studio: BackgroundStudio) -> Iterator[Page]:
    with opened_page(browser, studio.address) as opened:
        expect(opened.locator(".timeline-block")).to_have_count(6)
        yield opened


def timeline(page: Page) -> Locator:
    return page.get_by_label("Shown moment")


def test_events_are_drawn_where_they_happened(page: Page, began_s: float) -> None:
    expect(page.locator(".timeline-lanes svg")).to_be_in_viewport(ratio=1)
    seen = Seen(page)
    assert seen.first == pytest.approx(began_s, abs=0.01)
    said = seen.block("ROBOT", "SAY")
    failed, running = seen.block("AGENT", "FAILED"), seen.block("AGENT", "RUNNING")
    for one, from_s, to_s in ((failed, 10, 30), (said, 12, 20)):
        assert one["left"] == pytest.approx(seen.place(began_s + from_s), abs=2)
        assert one["right"] == pytest.approx(seen.place(began_s + to_s), abs=2)
    assert running["left"] == pytest.approx(seen.place(began_s + 60), abs=2)
    assert running["right"] == pytest.approx(seen.right, abs=2)
    moments = (("MARKET", "AWARDED", 9), ("FEEDBACK", "NEGATIVE", 40), ("FAULT", "ERROR", 50))
    for lane, kind, at_s in moments:
        one = seen.block(lane, kind)
        assert one["left"] == pytest.approx(seen.place(began_s + at_s), abs=2)
        assert one["right"] - one["left"] < 6
    # Each lane has its own line.
    tops = sorted((one["top"], one["bottom"]) for one in seen.blocks if one is not running)
    assert all(one[1] <= other[0] for one, other in pairwise(tops))


def test_click_shows_moment_it_points_at(page: Page, began_s: float) -> None:
    log = page.get_by_label("What happened")
    expect(log).to_contain_text("just now")
    page.mouse.click(Seen(page).place(began_s + 45), box(timeline(page))["y"] + 5)
    expect(page.get_by_role("button", name="Back to now")).to_be_in_viewport()
    seen = Seen(page)
    assert seen.now == pytest.approx(began_s + 45, abs=0.5)
    assert seen.cursor == pytest.approx(seen.place(seen.now), abs=2)
    expect(log).to_contain_text("long ago")
    expect(log).not_to_contain_text("just now")
    expect(page).to_have_url(re.compile(rf"at={int(seen.now)}"))
    # Later events are still there.
    assert len(seen.blocks) == 6


def test_wheel_zooms_at_the_pointer(page: Page, began_s: float) -> None:
    before = Seen(page)
    said = before.block("ROBOT", "SAY")
    page.mouse.move((said["left"] + said["right"]) / 2, said["top"] + 3)
    for _ in range(4):
        page.mouse.wheel(0, -100)
    page.wait_for_function(
        "wide => document.querySelector('.timeline-block[data-lane=ROBOT] rect')"
        ".getBoundingClientRect().width > 2 * wide",
        arg=said["right"] - said["left"],
    )
    after = Seen(page).block("ROBOT", "SAY")
    middles = [(one["left"] + one["right"]) / 2 for one in (said, after)]
    assert middles[1] == pytest.approx(middles[0], abs=15)
    assert page.evaluate("scrollY") == 0
    timeline(page).press("0")
    expect(page.locator(".timeline-block")).to_have_count(6)


def test_drag_pans_without_leaving_now(page: Page) -> None:
    bar = timeline(page)
    for _ in range(2):
        bar.press("+")
    expect(page.locator(".timeline-block[data-lane=FAULT]")).to_have_count(1)
    before = Seen(page).block("FAULT", "ERROR")
    seen = box(bar)
    page.mouse.move(seen["x"] + 300, seen["y"] + 20)
    page.mouse.down()
    page.mouse.move(seen["x"] + 500, seen["y"] + 20, steps=4)
    page.mouse.up()
    after = Seen(page).block("FAULT", "ERROR")
    assert after["left"] - before["left"] == pytest.approx(200, abs=30)
    assert "at=" not in page.url
    page.get_by_role("button", name="Back to now").click()
    expect(page.get_by_role("button", name="Back to now")).to_have_count(0)


def test_live_timeline_follows_now(page: Page, studio: BackgroundStudio) -> None:
    bar = timeline(page)
    for _ in range(8):
        bar.press("+")
    studio.put("events", "new", event("FAULT", "STALE", time.time(), time.time(), "door"))
    fault = page.locator(".timeline-block[data-kind=STALE] rect")
    expect(fault).to_be_in_viewport(ratio=1)
    first = box(fault)["x"]
    assert first > Seen(page).right - 300
    page.wait_for_function(
        "from => document.querySelector('.timeline-block[data-kind=STALE] rect')"
        ".getBoundingClientRect().left < from - 40",
        arg=first,
        timeout=LIMIT_MS,
    )
    seen = Seen(page)
    assert seen.cursor == pytest.approx(seen.right, abs=4)
    expect(page.locator(".timeline-moment")).to_contain_text("Now")


def test_mood_lane_shows_where_rules_act(
    page: Page, studio: BackgroundStudio, began_s: float
) -> None:
    rules = tuple(
        MoodRuleRecord(when="", changes=(change,), hold_s=1.0, give=give, cancels=False)
        for change, give in ((0.5, "POSITIVE"), (-1.0, "NEGATIVE"), (9.0, "POSITIVE"))
    )
    studio.put("agents", "guide", replace(agent("guide"), rules=rules))
    studio.put("runs", "guide", run("guide", began_s + 60))
    studio.put("scene", "", scene())
    for number, mood in enumerate((3.0, 3.5, 2.0)):
        studio.put("moods", str(number), MoodRecord(at_s=began_s + 61 + 10 * number, mood=mood))
    positive, negative = (
        page.locator(f".timeline-threshold[data-give={one}]") for one in ("POSITIVE", "NEGATIVE")
    )
    for line in (positive, negative):
        expect(line).to_be_in_viewport()
    page.wait_for_function("() => document.querySelector('.timeline-mood').points.length === 3")
    assert style(positive, "stroke") != style(negative, "stroke")
    left, ups, levels = page.evaluate(
        """() => {
          const of = (name) => document.querySelector(name);
          const line = (give) => of(`.timeline-threshold[data-give=${give}]`);
          const lines = [line("POSITIVE"), line("NEGATIVE")];
          return [
            lines.map((one) => one.getBoundingClientRect().left),
            [...of(".timeline-mood").points].map((one) => one.y),
            lines.map((one) => one.y1.baseVal.value),
          ];
        }"""
    )
    # They begin with the run, and the mood line reaches them.
    assert left == [pytest.approx(Seen(page).place(began_s + 60), abs=12)] * 2
    assert levels == pytest.approx(ups[1:])


PLAYED = """async (ms) => {
  const bar = document.querySelector(".timeline-lanes");
  const look = () => [performance.now() / 1000, Number(bar.getAttribute("aria-valuenow"))];
  const [beganS, fromS] = look();
  await new Promise((done) => setTimeout(done, ms));
  const [endedS, toS] = look();
  return (toS - fromS) / (endedS - beganS);
}"""
"""Measures how much recorded time passes in a second of the page."""


def play(page: Page) -> Locator:
    return page.get_by_role("button", name="Play", exact=True)


def hold(page: Page) -> Locator:
    return page.get_by_role("button", name="Stop playing")


def test_play_shows_what_happened_next(page: Page, began_s: float) -> None:
    expect(play(page)).to_have_count(0)
    bar = timeline(page)
    for _ in range(6):
        bar.press("ArrowLeft")
    expect(bar).to_have_attribute("aria-valuetext", re.compile("Rounds: .*nearest"))
    from_px = Seen(page).cursor
    page.get_by_label("Speed").select_option("4×")
    play(page).click()
    expect(hold(page)).to_be_in_viewport(ratio=1)
    page.wait_for_timeout(500)
    assert page.evaluate(PLAYED, 3000) == pytest.approx(4, rel=0.3)
    bar.press("Space")
    expect(play(page)).to_be_in_viewport(ratio=1)
    seen = Seen(page)
    assert seen.now > began_s + 9 + 8
    assert seen.cursor > from_px + 10
    assert seen.cursor == pytest.approx(seen.place(seen.now), abs=2)
    assert page.evaluate(PLAYED, 500) == 0


def test_play_ends_where_now_is(page: Page) -> None:
    bar = timeline(page)
    seen = box(bar)
    page.mouse.click(seen["x"] + seen["width"] - 500, seen["y"] + 5)
    page.get_by_label("Speed").select_option("8×")
    bar.focus()
    page.keyboard.press("Space")
    expect(hold(page)).to_be_in_viewport(ratio=1)
    expect(page.locator(".timeline-moment")).to_contain_text("Now")
    expect(hold(page)).to_have_count(0)
    assert "at=" not in page.url


def test_play_without_motion_jumps_to_events(page: Page, began_s: float) -> None:
    page.emulate_media(reduced_motion="reduce")
    page.evaluate(
        """() => {
          const bar = document.querySelector(".timeline-lanes");
          window.shown = [];
          new MutationObserver(() => window.shown.push(Number(bar.getAttribute("aria-valuenow"))))
            .observe(bar, {attributeFilter: ["aria-valuenow"]});
        }"""
    )
    bar = timeline(page)
    bar.press("Home")
    page.get_by_label("Speed").select_option("8×")
    play(page).click()
    page.wait_for_function(
        "at => window.shown.some((one) => one > at && one < at + 1)", arg=began_s + 60
    )
    # Nothing follows for some seconds.
    seen = Seen(page)
    assert seen.cursor == pytest.approx(seen.place(began_s + 60), abs=3)
    shown = {round(one - began_s) for one in page.evaluate("window.shown")}
    assert {one for one in shown if one < 65} <= {0, 9, 10, 12, 40, 50, 60}


def test_events_of_window_are_saved_as_table(
    page: Page, studio: BackgroundStudio, began_s: float, tmp_path: Path
) -> None:
    formula = event("FAULT", "ERROR", began_s + 45, began_s + 45, '=1+1, "quoted"')
    studio.put("events", "formula", formula)
    studio.put("bookmarks", "1", bookmark(began_s + 47, "odd"))
    expect(page.locator(".timeline-block")).to_have_count(7)
    expect(page.locator(".timeline-marks rect")).to_have_count(1)
    expect(menu(page, "Export")).to_be_in_viewport(ratio=1)
    rows = saved_table(page, tmp_path)
    assert rows[0] == ["began", "ended", "lane", "kind", "agent", "text"]
    assert [row[2] for row in rows[1:]] == [
        *("MARKET", "AGENT", "ROBOT", "FEEDBACK", "FAULT", "BOOKMARK", "FAULT", "AGENT")
    ]
    began, ended, *told = rows[3]
    assert told == ["ROBOT", "SAY", "guide", "Good morning"]
    seconds = [datetime.fromisoformat(one).timestamp() - began_s for one in (began, ended)]
    assert seconds == [pytest.approx(12, abs=0.002), pytest.approx(20, abs=0.002)]
    assert rows[5][-1] == '\'=1+1, "quoted"'
    assert rows[-1][1] == ""
    # Only events in the window.
    for _ in range(12):
        timeline(page).press("+")
    expect(page.locator(".timeline-block")).to_have_count(1)
    assert [row[2] for row in saved_table(page, tmp_path)[1:]] == ["AGENT"]


def test_table_is_saved_without_studio(page: Page, tmp_path: Path) -> None:
    page.context.set_offline(True)
    assert len(saved_table(page, tmp_path)) > 1


def menu(page: Page, name: str) -> Locator:
    return page.locator(".timeline_menu-menu").filter(has=page.get_by_text(name, exact=True))


def export(page: Page, form: str) -> None:
    """Save a file, using only the keyboard."""
    opened = menu(page, "Export")
    opened.locator("summary").focus()
    if opened.get_attribute("open") is None:
        page.keyboard.press("Enter")
    button = page.get_by_role("button", name=form)
    expect(button).to_be_in_viewport(ratio=1)
    for _ in range(3):
        if button.evaluate("one => one === document.activeElement"):
            break
        page.keyboard.press("Tab")
    page.keyboard.press("Enter")


def saved_messages(page: Page, folder: Path) -> list[JournalEntry]:
    """Return the messages in the file that the timeline saves of its window."""
    with page.expect_download() as download:
        export(page, "Messages (MCAP)")
    assert download.value.suggested_filename.endswith(".mcap")
    download.value.save_as(folder / "saved.mcap")
    expect(page.get_by_role("button", name="Messages (MCAP)")).not_to_be_visible()
    reader = JournalReader([folder / "saved.mcap"])
    found = reader.entries()
    assert reader.problems == []
    return found


def mark(page: Page, note: str, kept: str) -> None:
    """Set a bookmark at the moment on show; the page names its place."""
    opened = menu(page, "Bookmark")
    opened.locator("summary").click()
    told = opened.locator("p")
    expect(told).to_be_in_viewport(ratio=1)
    expect(told).to_contain_text(kept)
    opened.get_by_label("Note on this moment").fill(note)
    opened.get_by_role("button", name="Set it").click()
    expect(told).not_to_be_visible()


def bookmark(at_s: float, label: str) -> BookmarkRecord:
    return filled(BookmarkRecord, at_s=at_s, label=label)


def test_bookmark_goes_into_the_recording(
    page: Page, studio: BackgroundStudio, began_s: float
) -> None:
    studio.put("recording", "", recording())
    expect(menu(page, "Bookmark")).to_be_in_viewport(ratio=1)
    mark(page, "they laughed", "goes into the recording")
    page.mouse.click(Seen(page).place(began_s + 45), box(timeline(page))["y"] + 5)
    expect(page.get_by_role("button", name="Back to now")).to_be_visible()
    mark(page, "it went wrong", "goes into the recording")
    seen = Seen(page)
    now, past = [fields for service, fields in studio.caller.calls if "record" in service]
    assert (now["action"], now["label"]) == (2, "they laughed")
    assert now["age_s"] == pytest.approx(0, abs=5)
    assert past["label"] == "it went wrong"
    assert past["age_s"] == pytest.approx(seen.last - seen.now, abs=5)
    # It is shown at once, even on pages at an earlier moment.
    studio.put("bookmarks", "1", bookmark(began_s + 45, "it went wrong"))
    expect(page.locator(".timeline-marks rect")).to_be_in_viewport(ratio=1)
    seen = Seen(page)
    assert seen.marks == [pytest.approx(seen.place(began_s + 45), abs=2)]
    page.mouse.move(seen.marks[0] + 1, box(timeline(page))["y"] + 40)
    expect(page.locator(".timeline-hover")).to_have_text(re.compile("Bookmark: it went wrong$"))


def test_recording_is_started_and_stopped_from_timeline(
    page: Page, studio: BackgroundStudio
) -> None:
    panel = page.get_by_label("Recording", exact=True)
    studio.put("recording", "", replace(recording(), recording=False))
    menu(page, "Record").locator("summary").click()
    start = panel.get_by_role("button", name="Start")
    expect(start).to_be_in_viewport(ratio=1)
    start.click()
    expect(panel.locator("output")).to_have_text("done")
    studio.put("recording", "", recording())
    expect(panel.get_by_role("button", name="Stop")).to_be_in_viewport(ratio=1)
    [asked] = [fields for service, fields in studio.caller.calls if service == "journal/record"]
    assert asked["action"] == 0
    menu(page, "Record").locator("summary").click()
    expect(panel).not_to_be_visible()


def test_bookmark_without_journal_survives_a_reload(page: Page, began_s: float) -> None:
    page.mouse.click(Seen(page).place(began_s + 45), box(timeline(page))["y"] + 5)
    expect(page.get_by_role("button", name="Back to now")).to_be_visible()
    mark(page, "here", "is kept in this browser only")
    shown = Seen(page).now
    page.get_by_role("button", name="Back to now").click()
    page.reload()
    line = page.locator(".timeline-marks rect")
    expect(line).to_be_in_viewport(ratio=1)
    seen = Seen(page)
    assert seen.marks == [pytest.approx(seen.place(shown), abs=2)]
    page.get_by_label("Bookmarks").select_option(index=1)
    expect(page.get_by_role("button", name="Back to now")).to_be_visible()
    assert Seen(page).now == pytest.approx(shown)
    menu(page, "Bookmark").locator("summary").click()
    page.get_by_role("button", name="Remove it").click()
    expect(line).to_have_count(0)


def saved_table(page: Page, folder: Path) -> list[list[str]]:
    with page.expect_download() as download:
        export(page, "Events (CSV)")
    expect(page.get_by_role("button", name="Events (CSV)")).not_to_be_visible()
    assert download.value.suggested_filename.endswith(".csv")
    download.value.save_as(folder / "saved.csv")
    with (folder / "saved.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def test_timeline_is_saved_as_picture(page: Page, tmp_path: Path) -> None:
    with page.expect_download() as download:
        export(page, "Picture (PNG)")
    expect(page.get_by_role("button", name="Picture (PNG)")).not_to_be_visible()
    assert download.value.suggested_filename.endswith(".png")
    download.value.save_as(tmp_path / "saved.png")
    failed = Seen(page).block("AGENT", "FAILED")
    colour, seen = page.evaluate(
        """async ([png, x, y]) => {
          const image = new Image();
          image.src = `data:image/png;base64,${png}`;
          await image.decode();
          const canvas = new OffscreenCanvas(image.width, image.height);
          const context = canvas.getContext("2d");
          context.drawImage(image, 0, 0);
          const svg = document.querySelector(".timeline-lanes svg").getBoundingClientRect();
          const at = (value, edge) => Math.round((value - edge + 8) * 2);
          const rect = document.querySelector(".timeline-block[data-failed] rect");
          const [r, g, b] = context.getImageData(at(x, svg.x), at(y, svg.y), 1, 1).data;
          return [getComputedStyle(rect).fill, `rgb(${r}, ${g}, ${b})`];
        }""",
        [
            base64.b64encode((tmp_path / "saved.png").read_bytes()).decode(),
            failed["right"] - 3,
            (failed["top"] + failed["bottom"]) / 2,
        ],
    )
    assert seen == colour


def test_hover_says_what_and_when(page: Page) -> None:
    failed = Seen(page).block("AGENT", "FAILED")
    page.mouse.move((failed["left"] + failed["right"]) / 2, failed["top"] + 3)
    hover = page.locator(".timeline-hover")
    expect(hover).to_have_text(
        re.compile(r"^\d\d:\d\d:\d\d, 20 s · Agent: The guide · failed · no answer$")
    )
    expect(hover).to_be_in_viewport(ratio=0.99)
    page.mouse.move(5, 5)
    expect(hover).to_have_count(0)


@pytest.mark.parametrize(
    ("width", "height", "lanes"), [(1024, 600, 7), (390, 844, 2)], ids=["small laptop", "phone"]
)
def test_timeline_leaves_room_for_the_page(
    page: Page, width: int, height: int, lanes: int
) -> None:
    page.set_viewport_size({"width": width, "height": height})
    expect(page.locator(".timeline-lane text")).to_have_count(lanes)
    expect(page.locator(".timeline-lane text").first).to_have_text("Agent")
    expect(page.locator(".timeline-lanes svg")).to_be_in_viewport(ratio=1)
    expect(strip(page)).to_be_in_viewport(ratio=1)
    assert box(page.locator("header"))["height"] < 0.4 * height
    seen = Seen(page)
    assert seen.right <= width
    assert {one["lane"] for one in seen.blocks} >= {"AGENT", "MARKET"}


def run_message(at_s: float, **fields: Any) -> RecordedMessage:
    return RecordedMessage(
        topic=topic_of(Run, "/bt_agents/runs"),
        data=serialize_message(Run(header=header_at(to_time(at_s)), **fields)),
        sent_ns=int(at_s * 1e9),
        received_ns=int(at_s * 1e9),
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BackgroundStudio]:
    """A studio with the journal of a day, in which every tenth run failed."""
    folder = tmp_path_factory.mktemp("day")
    file = JournalFile(folder / FILE)
    for number in range(RUNS):
        began_s = BEGAN_S + number * DAY_S / RUNS
        outcome = Run.FAILED if number % 10 == 9 else Run.SUCCEEDED
        told = {"epoch": "e", "round": number + 1, "agent": "guide"}
        for at_s, fields in (
            (began_s, {"event": Run.STARTED}),
            (began_s + 120, {"event": Run.ENDED, "outcome": outcome, "duration_s": 120.0}),
        ):
            file.add(run_message(at_s, **told, **fields), number)
    file.close()
    with background_studio(folder) as served:
        served.put("market", "", market())
        yield served


def test_whole_recording_is_drawn_and_walked(browser: Browser, recorded: BackgroundStudio) -> None:
    address = recorded.address.replace("/#", f"/live?from={FILE}#")
    with opened_page(browser, address) as page:
        expect(page.locator(".timeline-block")).to_have_count(RUNS)
        expect(page.locator(".timeline-block[data-failed]")).to_have_count(RUNS // 10)
        assert page.evaluate(READ) == 1
        seen = Seen(page)
        assert (seen.first, seen.now) == (pytest.approx(BEGAN_S), pytest.approx(seen.last))
        for number, one in enumerate(seen.blocks):
            at_s = BEGAN_S + number * DAY_S / RUNS
            assert one["left"] == pytest.approx(seen.place(at_s), abs=2)
        failed = seen.blocks[59]
        page.mouse.click((failed["left"] + failed["right"]) / 2, failed["top"] + 3)
        bar = timeline(page)
        expect(bar).to_have_attribute("aria-valuetext", re.compile("guide · failed"))
        expect(page.locator(".live-run")).to_contain_text("round 60")
        bar.press("ArrowRight")
        expect(bar).to_have_attribute("aria-valuetext", re.compile("guide · succeeded"))
        assert Seen(page).now == pytest.approx(BEGAN_S + 60 * DAY_S / RUNS, abs=0.2)
        expect(page.locator(".timeline-moment")).to_contain_text(FILE)


def test_messages_of_window_are_saved_as_recording(
    browser: Browser, recorded: BackgroundStudio, tmp_path: Path
) -> None:
    address = recorded.address_for(SessionRole.VIEW, f"live?from={FILE}")
    with opened_page(browser, address) as page:
        expect(page.locator(".timeline-block")).to_have_count(RUNS)
        assert len(saved_messages(page, tmp_path)) == 2 * RUNS
        timeline(page).press("Home")
        expect(page.get_by_label("Speed")).to_be_visible()
        for _ in range(6):
            timeline(page).press("+")
        expect(page.locator(".timeline-block")).not_to_have_count(RUNS)
        seen = Seen(page)
        began = [one.decode() for one in saved_messages(page, tmp_path)]
        began = [one.round for one in began if one.event == Run.STARTED]
        # The visible ones, the last perhaps only partly.
        assert began == list(range(1, len(began) + 1))
        assert 2 <= len(began) < RUNS
        assert len(seen.blocks) - len(began) in (0, 1)


def test_running_system_is_saved_from_its_journal(
    browser: Browser, began_s: float, tmp_path: Path
) -> None:
    file = JournalFile(tmp_path / "2026.mcap")
    for number, at_s in enumerate((began_s - 50, began_s + 50, began_s + 51), 1):
        file.add(run_message(at_s, round=number), number)
    file.flush()
    with background_studio(tmp_path) as served:
        served.put_past(began_s, "market", "", market())
        served.put("market", "", market())
        for record, why in (
            (None, "'bt-agents up --journal' starts the system with one"),
            (replace(recording(), recording=False), "Nothing is recorded now"),
            (replace(recording(), file="gone.mcap"), "there is no journal 'gone.mcap'"),
            (recording(), ""),
        ):
            if record is not None:
                served.put("recording", "", record)
            with opened_page(browser, served.address) as page:
                expect(strip(page)).to_have_attribute("data-state", "IDLE")
                if not why:
                    found = saved_messages(page, tmp_path)
                    continue
                export(page, "Messages (MCAP)")
                failure = menu(page, "Export").locator(".shared-failure")
                expect(failure).to_contain_text(why)
                expect(failure).to_be_in_viewport(ratio=1)
    assert [one.decode().round for one in found] == [2, 3]
    file.close()


def test_recording_plays_to_its_end(browser: Browser, recorded: BackgroundStudio) -> None:
    address = recorded.address.replace("/#", f"/live?from={FILE}&at={BEGAN_S + DAY_S - 180}#")
    with opened_page(browser, address) as page:
        expect(page.locator(".timeline-block")).to_have_count(RUNS)
        page.get_by_label("Speed").select_option("8×")
        play(page).click()
        expect(hold(page)).to_be_in_viewport(ratio=1)
        expect(play(page)).to_be_in_viewport(ratio=1)
        seen = Seen(page)
        assert seen.now == pytest.approx(seen.last)
        assert seen.cursor == pytest.approx(seen.right, abs=4)
        expect(page.locator(".timeline-moment")).to_contain_text(FILE)
        # After the end, playback starts from the beginning.
        play(page).click()
        expect(hold(page)).to_be_in_viewport(ratio=1)
        page.wait_for_function(
            "end => Number(document.querySelector('.timeline-lanes').ariaValueNow) < end",
            arg=BEGAN_S + DAY_S / 2,
        )
        page.wait_for_function(
            "end => document.querySelector('.timeline-cursor').getBoundingClientRect().left < end",
            arg=seen.left + 20,
        )
