// SPDX-License-Identifier: Apache-2.0
import { beforeEach, expect, test, vi } from "vitest";
import type { Delta, Present, Snapshot } from "../src/protocol";
import * as store from "../src/store";

let frames: (() => void)[] = [];

beforeEach(() => {
  frames = [];
  vi.useFakeTimers();
  vi.stubGlobal("window", globalThis);
  vi.stubGlobal("requestAnimationFrame", (drawn: () => void) => frames.push(drawn));
  vi.stubGlobal("cancelAnimationFrame", () => undefined);
  store.replaceAll(snapshot({ agents: { gone: {} } }));
  store.replaceAll(snapshot({}));
});

const snapshot = (entries: Snapshot["entries"], at_s: number | null = null): Snapshot =>
  ({ type: "snapshot", at_s, entries }) as Snapshot;
const delta = (...changes: Delta["changes"]): Delta => ({ type: "delta", changes }) as Delta;
const present = (is_whole: boolean, ...changes: Present["changes"]): Present =>
  ({ type: "present", is_whole, changes }) as Present;
const drawFrame = (): void => frames.splice(0).forEach((one) => one());
const read = (key: string): unknown => store.readEntry("agents", key);

test("a snapshot replaces all entries", () => {
  store.replaceAll(snapshot({ agents: { one: { name: "one" }, two: { name: "two" } } }));
  store.replaceAll(snapshot({ agents: { two: { name: "again" } } }));
  expect(read("one")).toBeUndefined();
  expect(read("two")).toEqual({ name: "again" });
});

test("all changes until the next frame are drawn together", () => {
  const changed = vi.fn();
  const end = store.watchCollection("agents", changed);
  store.apply(delta(["agents", "one", { name: "first" }]));
  store.apply(delta(["agents", "one", { name: "second" }], ["agents", "two", {}]));
  expect(read("one")).toBeUndefined();
  drawFrame();
  expect(read("one")).toEqual({ name: "second" });
  expect(changed).toHaveBeenCalledTimes(1);
  end();
  store.apply(delta(["agents", "one", {}]));
  drawFrame();
  expect(changed).toHaveBeenCalledTimes(1);
});

test("an entry without a value is removed", () => {
  store.replaceAll(snapshot({ agents: { one: {} } }));
  store.apply(delta(["agents", "one", null]));
  drawFrame();
  expect(read("one")).toBeUndefined();
});

test("a hidden tab, which draws no frames, applies changes", () => {
  store.apply(delta(["agents", "one", {}]));
  vi.advanceTimersByTime(1_000);
  expect(read("one")).toEqual({});
});

test("changes before a snapshot do not overwrite it", () => {
  store.apply(delta(["agents", "one", { name: "old" }]));
  store.replaceAll(snapshot({ agents: { one: { name: "new" } } }));
  drawFrame();
  expect(read("one")).toEqual({ name: "new" });
});

test("live changes do not affect an earlier moment", () => {
  store.replaceAll(snapshot({ agents: { one: { name: "then" } } }, 1_000));
  store.setPresent(snapshot({ agents: { one: { name: "now" } } }));
  store.apply(present(false, ["agents", "one", { name: "later" }]));
  drawFrame();
  expect(read("one")).toEqual({ name: "then" });
});
