// SPDX-License-Identifier: Apache-2.0
// Exports of the span in the timeline: events as CSV, a picture as PNG, messages as MCAP.

import type { BookmarkRecord, EventRecord } from "./protocol";
import { texts } from "./texts";
import type { Span } from "./timeline_lanes";

const COLUMNS = ["began", "ended", "lane", "kind", "agent", "text"];
/** Pixels of the picture per pixel of the page. */
const SHARPNESS = 2;
const MARGIN_PX = 8;
const FORGET_MS = 10_000;

/** Offer the events and bookmarks of a span as a table; an event in progress has no end. */
export function saveTable(
  events: readonly EventRecord[],
  bookmarks: readonly BookmarkRecord[],
  { fromS, toS }: Span,
  source: string,
): void {
  const marked = bookmarks.map(({ at_s, label }) => ({ lane: "BOOKMARK", kind: "", agent: "", text: label, began_s: at_s, ended_s: at_s }));
  const rows = [...events, ...marked]
    .sort((one, other) => one.began_s - other.began_s)
    .filter((one) => one.began_s <= toS && (one.ended_s ?? Infinity) >= fromS)
    .map((one) => [stamp(one.began_s), one.ended_s === null ? "" : stamp(one.ended_s), one.lane, one.kind, one.agent, one.text]);
  const text = [COLUMNS, ...rows].map((row) => `${row.map(cell).join(",")}\r\n`).join("");
  save(new Blob([text], { type: "text/csv" }), nameOf(fromS, source, "csv"));
}

/** Offer a picture of the drawing in the colours of the page. */
export function savePicture(drawing: SVGSVGElement, { fromS }: Span, source: string): void {
  const { width, height } = drawing.getBoundingClientRect();
  const canvas = document.createElement("canvas");
  canvas.width = (width + 2 * MARGIN_PX) * SHARPNESS;
  canvas.height = (height + 2 * MARGIN_PX) * SHARPNESS;
  const context = canvas.getContext("2d");
  if (context === null) return;
  context.scale(SHARPNESS, SHARPNESS);
  context.fillStyle = getComputedStyle(document.documentElement).backgroundColor;
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.translate(MARGIN_PX, MARGIN_PX);
  for (const shape of drawing.querySelectorAll<SVGGraphicsElement>("line, rect, polyline, text")) draw(context, shape);
  canvas.toBlob((blob) => blob && save(blob, nameOf(fromS, source, "png")));
}

/** Offer the messages of a span of a recording; return why that failed, or an empty text. */
export async function saveMessages({ fromS, toS }: Span, recording: string): Promise<string> {
  try {
    const answer = await fetch(`/api/journals/${encodeURIComponent(recording)}/messages?from=${fromS}&to=${toS}`);
    if (!answer.ok) return ((await answer.json()) as { message: string }).message;
    save(await answer.blob(), nameOf(fromS, recording, "mcap"));
    return "";
  } catch {
    return texts.time.noAnswer;
  }
}

/** Draw a shape as the page does; handles all shapes of the timeline. */
function draw(context: CanvasRenderingContext2D, shape: SVGGraphicsElement): void {
  const { fill, stroke, strokeWidth, strokeDasharray, font, textAnchor } = getComputedStyle(shape);
  const at = (name: string): number => Number(shape.getAttribute(name));
  const path = new Path2D();
  if (shape.tagName === "text") {
    context.fillStyle = fill;
    context.font = font;
    context.textAlign = textAnchor === "middle" ? "center" : "left";
    context.fillText(shape.textContent ?? "", at("x"), at("y"));
    return;
  }
  if (shape.tagName === "rect") path.roundRect(at("x"), at("y"), at("width"), at("height"), at("rx"));
  else if (shape.tagName === "line") {
    path.moveTo(at("x1"), at("y1"));
    path.lineTo(at("x2"), at("y2"));
  } else for (const { x, y } of (shape as SVGPolylineElement).points) path.lineTo(x, y);
  if (fill !== "none") {
    context.fillStyle = fill;
    context.fill(path);
  }
  if (stroke !== "none") {
    context.strokeStyle = stroke;
    context.lineWidth = parseFloat(strokeWidth);
    context.setLineDash(strokeDasharray === "none" ? [] : strokeDasharray.split(",").map(parseFloat));
    context.stroke(path);
  }
}

const stamp = (atS: number): string => new Date(atS * 1000).toISOString();

/** Format a cell; mark a text that a spreadsheet would evaluate as text. */
function cell(text: string): string {
  const safe = /^[=+\-@\t\r]/.test(text) ? `'${text}` : text;
  return /[",\r\n]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
}

function nameOf(fromS: number, source: string, suffix: string): string {
  return `${source.replace(/\.mcap$/, "") || "timeline"}-${stamp(fromS).slice(0, 19).replaceAll(":", "-")}.${suffix}`;
}

function save(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  window.setTimeout(() => URL.revokeObjectURL(link.href), FORGET_MS);
}
