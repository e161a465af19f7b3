// SPDX-License-Identifier: Apache-2.0
import { describe, expect, test } from "vitest";
import type { EventRecord } from "../src/protocol";
import * as lanes from "../src/timeline_lanes";

const WHOLE = { fromS: 1_000, toS: 4_600 };
const WIDTH_PX = 1_064;

function event(began_s: number, ended_s: number | null = began_s, change: Partial<EventRecord> = {}): EventRecord {
  return { lane: "MARKET", kind: "AWARDED", agent: "agent", text: "", began_s, ended_s, ...change };
}

const run = (began_s: number, ended_s: number | null, kind = "SUCCEEDED"): EventRecord => event(began_s, ended_s, { lane: "AGENT", kind });

describe("window", () => {
  test("a zoom keeps the moment under the pointer in place", () => {
    const shown = { fromS: 2_000, toS: 3_000 };
    const view = lanes.zoomed(shown, WHOLE, 2_300, 0.5);
    const after = lanes.windowOf(view, WHOLE);
    expect(after.toS - after.fromS).toBeCloseTo(500);
    expect(lanes.placeOf(2_300, after, WIDTH_PX)).toBeCloseTo(lanes.placeOf(2_300, shown, WIDTH_PX));
  });

  test("zooming out shows at most the whole time", () => {
    expect(lanes.zoomed(WHOLE, WHOLE, 2_000, 2)).toBeNull();
    expect(lanes.windowOf(null, WHOLE)).toEqual(WHOLE);
  });

  test("a window that reaches the newest moment follows it", () => {
    const view = lanes.panned({ fromS: 4_000, toS: 4_500 }, WHOLE, 200);
    expect(view).toEqual({ lengthS: 500, endS: null });
    expect(lanes.windowOf(view, { fromS: 1_000, toS: 5_000 })).toEqual({ fromS: 4_500, toS: 5_000 });
  });

  test("a window stays within the kept time", () => {
    expect(lanes.windowOf({ lengthS: 500, endS: 900 }, WHOLE)).toEqual({ fromS: 1_000, toS: 1_500 });
  });

  test("a view moves only for a moment outside it", () => {
    const view = { lengthS: 500, endS: 2_000 };
    expect(lanes.viewWith(1_800, view, WHOLE)).toBe(view);
    const { fromS, toS } = lanes.windowOf(lanes.viewWith(3_000, view, WHOLE), WHOLE);
    expect([fromS, toS]).toEqual([2_750, 3_250]);
  });

  test("a position converts back to its moment", () => {
    for (const atS of [1_000, 2_345.6, 4_600])
      expect(lanes.momentAt(lanes.placeOf(atS, WHOLE, WIDTH_PX), WHOLE, WIDTH_PX)).toBeCloseTo(atS);
  });

  test("ticks are apart from each other and within the window", () => {
    for (const lengthS of [1, 7, 60, 3_600, 86_400]) {
      const shown = { fromS: 1_000, toS: 1_000 + lengthS };
      const places = lanes.ticksOf(shown, WIDTH_PX).map((one) => lanes.placeOf(one, shown, WIDTH_PX));
      expect(places.every((one) => one >= lanes.NAMES_PX && one <= WIDTH_PX)).toBe(true);
      expect(places.every((one, index) => index === 0 || one - (places[index - 1] ?? 0) >= 89)).toBe(true);
    }
  });
});

describe("events", () => {
  test("a run that nobody has ended is lost when the next one begins", () => {
    const events = lanes.ordered([run(30, null), run(10, null), run(20, 25)]);
    expect(events.map((one) => [one.began_s, one.ended_s, one.kind])).toEqual([
      [10, 20, "LOST"],
      [20, 25, "SUCCEEDED"],
      [30, null, "SUCCEEDED"],
    ]);
  });

  test("moments that are too close share a block, which shows their failure", () => {
    const faults = [event(2_000), event(2_001, 2_001, { lane: "FAULT", text: "lost" }), event(2_002)];
    const blocks = lanes.blocksOf(faults, WHOLE, WIDTH_PX);
    expect(blocks.map((one) => [one.lane, one.count])).toEqual([["MARKET", 2], ["FAULT", 1]]);
    const runs = [run(2_000, 2_001), run(2_001, 2_002, "FAILED")];
    expect(lanes.blocksOf(runs, WHOLE, WIDTH_PX).map((one) => [one.count, one.event.kind])).toEqual([[2, "FAILED"]]);
  });

  test("events outside the window are left out, and others are cut at its edges", () => {
    const shown = { fromS: 2_000, toS: 3_000 };
    const [block, ...rest] = lanes.blocksOf([run(1_000, 1_999), run(1_500, null), run(3_001, null)], shown, WIDTH_PX);
    expect(rest).toEqual([]);
    expect([block?.x, block?.width]).toEqual([lanes.NAMES_PX, WIDTH_PX - lanes.NAMES_PX]);
  });

  test("ten thousand events draw no more blocks than there is room for", () => {
    const events = Array.from({ length: 10_000 }, (_, index) => event(1_000 + index * 0.36));
    expect(lanes.blocksOf(events, WHOLE, WIDTH_PX).length).toBeLessThanOrEqual(WIDTH_PX / lanes.MARK_PX);
  });

  test("arrows go to the moment at which the next event is known", () => {
    const events = [event(2_000), event(2_500), event(3_000)];
    expect(lanes.neighbour(events, WHOLE, 2_500.1, 1)).toBeCloseTo(3_000.1);
    expect(lanes.neighbour(events, WHOLE, 2_500.1, -1)).toBeCloseTo(2_000.1);
    expect(lanes.neighbour(events, WHOLE, 3_000.1, 1)).toBeNull();
  });

  test("the event of a moment is the newest that has begun and not ended", () => {
    const events = [run(2_000, 2_100), run(2_200, 2_300)];
    expect(lanes.eventAt(events, 2_050)?.began_s).toBe(2_000);
    expect(lanes.eventAt(events, 2_150)).toBeUndefined();
    expect(lanes.eventAt(events, 1_900)).toBeUndefined();
  });
});
