// SPDX-License-Identifier: Apache-2.0
// Layout of the timeline: the time span in its window, and the places of events in it.

import type { EventRecord } from "./protocol";

export const LANES = ["AGENT", "ROBOT", "MOOD", "MARKET", "FEEDBACK", "FAULT", "RECORDING"] as const;
export type Lane = (typeof LANES)[number];
const NARROW_LANES: readonly Lane[] = ["AGENT", "MARKET"];

export const LANE_PX = 11;
export const TICKS_PX = 14;
/** Room for the names of the lanes. */
export const NAMES_PX = 64;
/** Width of a moment; moments closer than this are drawn as one. */
export const MARK_PX = 4;

/** Wide enough for all lanes [px]. */
const WIDE_PX = 520;
/** Room for the label of a tick, and between two ticks. */
const TICK_PX = 60;
const BETWEEN_PX = 90;
const STEPS_S = [1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 21_600, 86_400];
const SHORTEST_S = 1;
/** An event's effect is known shortly after the event. */
const AFTER_S = 0.1;

export interface Span {
  fromS: number;
  toS: number;
}

/** A part of the whole time; without an end it follows the newest moment. */
export interface View {
  lengthS: number;
  endS: number | null;
}

export interface Block {
  lane: Lane;
  x: number;
  width: number;
  /** The first event of the block, or one of its failures. */
  event: EventRecord;
  count: number;
}

const clamp = (value: number, low: number, high: number): number => Math.min(Math.max(value, low), high);
const lengthOf = (span: Span): number => span.toS - span.fromS;

export function lanesIn(widthPx: number): readonly Lane[] {
  return widthPx < WIDE_PX ? NARROW_LANES : LANES;
}

/** Time span in the window; the whole time for null. */
export function windowOf(view: View | null, whole: Span): Span {
  if (view === null) return whole;
  const lengthS = Math.min(view.lengthS, lengthOf(whole));
  const toS = clamp(view.endS ?? whole.toS, whole.fromS + lengthS, whole.toS);
  return { fromS: toS - lengthS, toS };
}

/** Zoomed view, in which one moment keeps its place. */
export function zoomed(shown: Span, whole: Span, atS: number, factor: number): View | null {
  const lengthS = Math.max(lengthOf(shown) * factor, SHORTEST_S);
  if (lengthS >= lengthOf(whole)) return null;
  const share = (shown.toS - atS) / Math.max(lengthOf(shown), 1e-9);
  return viewTo(atS + share * lengthS, lengthS, whole);
}

/** View moved by some seconds to later moments. */
export function panned(shown: Span, whole: Span, byS: number): View | null {
  return lengthOf(shown) >= lengthOf(whole) ? null : viewTo(shown.toS + byS, lengthOf(shown), whole);
}

/** The same view if it contains a moment, else the nearest view that does. */
export function viewWith(atS: number, view: View | null, whole: Span): View | null {
  const shown = windowOf(view, whole);
  if (view === null || (atS >= shown.fromS && atS <= shown.toS)) return view;
  return viewTo(atS + lengthOf(shown) / 2, lengthOf(shown), whole);
}

function viewTo(endS: number, lengthS: number, whole: Span): View {
  return { lengthS, endS: endS >= whole.toS ? null : endS };
}

export function placeOf(atS: number, shown: Span, widthPx: number): number {
  return NAMES_PX + ((atS - shown.fromS) / Math.max(lengthOf(shown), 1e-9)) * (widthPx - NAMES_PX);
}

export function momentAt(x: number, shown: Span, widthPx: number): number {
  const share = (x - NAMES_PX) / Math.max(widthPx - NAMES_PX, 1);
  return shown.fromS + clamp(share, 0, 1) * lengthOf(shown);
}

/** Events in order of time; a run without an end ends at the latest when the next run begins. */
export function ordered(events: readonly EventRecord[]): EventRecord[] {
  const sorted = [...events].sort((one, other) => one.began_s - other.began_s);
  let nextS: number | null = null;
  for (let place = sorted.length - 1; place >= 0; place -= 1) {
    const event = sorted[place];
    if (event?.lane !== "AGENT") continue;
    if (event.ended_s === null && nextS !== null) sorted[place] = { ...event, kind: "LOST", ended_s: nextS };
    nextS = event.began_s;
  }
  return sorted;
}

export function isFailure(event: EventRecord): boolean {
  return event.lane === "FAULT" || (event.lane === "AGENT" && ["FAILED", "LOST", "REFUSED"].includes(event.kind));
}

/** Blocks in the window; moments too close to each other form one block. */
export function blocksOf(events: readonly EventRecord[], shown: Span, widthPx: number): Block[] {
  const blocks: Block[] = [];
  const last = new Map<string, Block>();
  for (const event of events) {
    const endS = event.ended_s ?? shown.toS;
    if (endS < shown.fromS || event.began_s > shown.toS) continue;
    const x = placeOf(Math.max(event.began_s, shown.fromS), shown, widthPx);
    const width = Math.max(placeOf(Math.min(endS, shown.toS), shown, widthPx) - x, MARK_PX);
    const before = last.get(event.lane);
    if (before !== undefined && width <= MARK_PX && before.width <= MARK_PX && x - before.x < MARK_PX) {
      before.count += 1;
      if (isFailure(event)) before.event = event;
      continue;
    }
    const block = { lane: event.lane as Lane, x: Math.min(x, widthPx - MARK_PX), width, event, count: 1 };
    blocks.push(block);
    last.set(event.lane, block);
  }
  return blocks;
}

/** The block of a lane under a pointer, or next to it. */
export function blockAt(blocks: readonly Block[], lane: Lane | undefined, x: number): Block | undefined {
  return blocks.findLast((one) => one.lane === lane && x >= one.x - MARK_PX && x <= one.x + one.width + MARK_PX);
}

export function ticksOf(shown: Span, widthPx: number): number[] {
  const least = (lengthOf(shown) / Math.max(widthPx - NAMES_PX, 1)) * BETWEEN_PX;
  const step = STEPS_S.find((one) => one >= least);
  if (step === undefined) return [];
  const ticks = [];
  for (let atS = Math.ceil(shown.fromS / step) * step; atS <= shown.toS; atS += step) ticks.push(atS);
  return ticks.filter((one) => placeOf(one, shown, widthPx) + TICK_PX / 2 <= widthPx);
}

/** Moment at which the next or previous event is known; null if there is none. */
export function neighbour(events: readonly EventRecord[], whole: Span, atS: number, direction: 1 | -1): number | null {
  const moments = events
    .map((one) => clamp(one.began_s + AFTER_S, whole.fromS, whole.toS))
    .filter((one) => (one - atS) * direction > 1e-3);
  if (moments.length === 0) return null;
  return direction === 1 ? Math.min(...moments) : Math.max(...moments);
}

/** The event of a moment: the newest one that began before it, unless that has ended. */
export function eventAt(events: readonly EventRecord[], atS: number): EventRecord | undefined {
  return events.findLast((one) => one.began_s <= atS && (one.ended_s ?? Infinity) >= atS - 2 * AFTER_S);
}
