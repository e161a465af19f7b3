// SPDX-License-Identifier: Apache-2.0
// Map of a whole tree as a strip beside it, with one dot per node, and the visible part.

import { memo, useEffect, useRef } from "react";
import { watchColours } from "./appearance";
import { readEntry, watchCollection } from "./store";
import type { Layout } from "./tree_layout";
import { HEIGHT, WIDTH } from "./tree_layout";
import css from "./tree_map.module.css";
import type { Part, Viewport } from "./tree_view";

const REDRAW_MS = 250;
const SMALLEST_DOT_PX = 2;
/** Statuses in drawing order: running nodes on top. */
const COLOURS = [
  ["INVALID", "--line"],
  ["UNKNOWN", "--faint"],
  ["STOPPED", "--faint"],
  ["SUCCESS", "--success"],
  ["FAILURE", "--failure"],
  ["RUNNING", "--running"],
] as const;

interface TreeMapProps extends Pick<Viewport, "part" | "watch" | "centre"> {
  agent: string;
  layout: Layout;
}

export const TreeMap = memo(function TreeMap({ agent, layout, part, watch, centre }: TreeMapProps) {
  const dots = useRef<HTMLCanvasElement>(null);
  const shown = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const canvas = dots.current;
    if (canvas === null) return;
    let timer = 0;
    const draw = (): void => {
      timer = 0;
      drawNodes(canvas, agent, layout);
    };
    const later = (): void => {
      if (timer === 0) timer = window.setTimeout(draw, REDRAW_MS);
    };
    const observer = new ResizeObserver(draw);
    observer.observe(canvas);
    const unwatch = watchColours(draw);
    const stop = watchCollection("nodes", later);
    return () => {
      window.clearTimeout(timer);
      observer.disconnect();
      unwatch();
      stop();
    };
  }, [agent, layout]);
  useEffect(() => {
    const mark = (): void => {
      if (shown.current !== null) place(shown.current, part(), layout);
    };
    mark();
    watch(mark);
    return () => watch(null);
  }, [part, watch, layout]);
  const jump = (event: React.PointerEvent): void => {
    if (event.buttons !== 1) return;
    const box = event.currentTarget.getBoundingClientRect();
    centre(
      ((event.clientX - box.left) / box.width) * layout.width,
      ((event.clientY - box.top) / box.height) * layout.height,
    );
  };
  return (
    <div className={css.map} aria-hidden="true" onPointerDown={jump} onPointerMove={jump}>
      <canvas ref={dots} />
      <div ref={shown} />
    </div>
  );
});

function place(mark: HTMLDivElement, part: Part, layout: Layout): void {
  const percent = (value: number, whole: number): string => `${Math.min(100, (100 * value) / whole)}%`;
  mark.style.left = percent(part.left, layout.width);
  mark.style.top = percent(part.top, layout.height);
  mark.style.width = percent(part.right - part.left, layout.width);
  mark.style.height = percent(part.bottom - part.top, layout.height);
}

function drawNodes(canvas: HTMLCanvasElement, agent: string, layout: Layout): void {
  const context = canvas.getContext("2d");
  if (context === null) return;
  canvas.width = canvas.clientWidth;
  canvas.height = canvas.clientHeight;
  const acrossPx = canvas.width / layout.width;
  const downPx = canvas.height / layout.height;
  const width = Math.max(WIDTH * acrossPx, SMALLEST_DOT_PX);
  const height = Math.max(HEIGHT * downPx, SMALLEST_DOT_PX);
  const dots = new Map<string, [number, number][]>(COLOURS.map(([status]) => [status, []]));
  for (const { shown, x, y } of layout.placed) {
    const status = readEntry("nodes", `${agent}|${shown.node.path}`)?.status ?? "INVALID";
    dots.get(status)?.push([x * acrossPx, y * downPx]);
  }
  for (const [status, name] of COLOURS) {
    canvas.style.color = `var(${name})`;
    context.fillStyle = getComputedStyle(canvas).color;
    for (const [x, y] of dots.get(status) ?? []) context.fillRect(x, y, width, height);
  }
}
