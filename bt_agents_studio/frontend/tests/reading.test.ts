// SPDX-License-Identifier: Apache-2.0
import { describe, expect, test } from "vitest";
import { readAddress, writeAddress, type Address } from "../src/address";
import { scaleOf } from "../src/fields";
import { exactNumber, formatNumber, formatSeconds } from "../src/formatting";

describe("formatting", () => {
  test.each([0.1 + 0.2, 1 / 3, 1e21, -0.0001])("%d keeps all digits in a field", (value) => {
    expect(Number(exactNumber(value))).toBe(value);
  });

  test.each([
    [0.12345, "0.123"],
    [3, "3"],
    [-1.0005, "-1"],
  ])("%d is looked at as %s", (value, text) => {
    expect(formatNumber(value)).toBe(text);
  });

  test.each([
    [0.04, "0 s"],
    [12.34, "12.3 s"],
    [89.9, "89.9 s"],
    [119.7, "2 min 0 s"],
    [3_725, "62 min 5 s"],
  ])("%d seconds are %s", (seconds, text) => {
    expect(formatSeconds(seconds)).toBe(text);
  });
});

describe("address", () => {
  const NOTHING: Address = { page: "live", agent: "", node: "", round: "", search: "", source: "", atS: null };
  const again = (address: Address): Address => {
    const [path = "", query = ""] = writeAddress(address).split("?");
    return readAddress(path, query);
  };

  test.each([
    { agent: "guide & friends", node: "tree/0@retry" },
    { page: "market" as const, round: "7" },
    { page: "tune" as const, search: "100 % ü" },
    { source: "day.mcap", atS: 1_764_000_000.123 },
    { atS: 1_764_000_000 },
  ])("%o is read back as it was written", (shown) => {
    expect(again({ ...NOTHING, ...shown })).toEqual({ ...NOTHING, ...shown });
  });

  test("a recording without a moment is shown at its end", () => {
    const shown = readAddress("/live", "from=day.mcap");
    expect(shown.atS).toBeGreaterThan(Date.now() / 1000);
    expect(writeAddress(shown)).toBe("/live?from=day.mcap");
  });

  test.each(["at=now", "at=-1", "at=1e9", `agent=${"a".repeat(1_001)}`, `from=${"a".repeat(256)}`])("%s is left out", (query) => {
    expect(readAddress("/live", query)).toEqual(NOTHING);
  });

  test("an unknown path shows no page", () => {
    expect(readAddress("/elsewhere", "").page).toBeNull();
  });
});

describe("scale of a slider", () => {
  test.each([
    [0, 1, 0.01],
    [1, 5, 0.05],
    [0, 250, 5],
    [-3, 3, 0.1],
  ])("from %d to %d it moves by %d", (minimum, maximum, step) => {
    expect(scaleOf(minimum, maximum).step).toBe(step);
  });

  test("both ends of the range can be reached", () => {
    for (const [minimum, maximum] of [[0.3, 7.77], [1e-6, 1e-3], [-1, 1e6]] as const) {
      const { low, high, step } = scaleOf(minimum, maximum);
      expect(low).toBeLessThanOrEqual(minimum);
      expect(high).toBeGreaterThanOrEqual(maximum);
      expect((high - low) / step).toBeLessThanOrEqual(102);
    }
  });

  test("whole numbers move by whole numbers", () => {
    expect(scaleOf(0, 10, 0, true).step).toBe(1);
  });

  test("a range of one value has a step", () => {
    expect(scaleOf(2, 2)).toMatchObject({ low: 2, high: 2, step: 1 });
  });
});
