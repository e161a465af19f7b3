// SPDX-License-Identifier: Apache-2.0
// The part of a tree in its frame: zoom and scrolling by wheel, pointer and buttons.

import { useCallback, useEffect, useLayoutEffect, useMemo, useRef, useState } from "react";
import { HEIGHT, WIDTH, type Layout, type Placed } from "./tree_layout";

export const SMALLEST = 0.1;
export const LARGEST = 2;
/** Below this zoom, texts are illegible and left out. */
export const READABLE = 0.4;
/** Zoom factor of one press of a key or a button. */
export const STEP = 1.25;
const CELL = 500;
const WHEEL = 0.0015;
/** A pointer that moves no farther counts as a click. */
export const DRAG_PX = 4;

export interface Part {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

export interface Viewport {
  frame: React.RefObject<HTMLDivElement | null>;
  zoom: number;
  /** Whether the frame is too small for the whole tree. */
  isPart: boolean;
  /** Nodes near the visible part, and nodes whose edges lead there. */
  near: readonly Placed[];
  onScroll: () => void;
  onPointerDown: (event: React.PointerEvent) => void;
  /** Visible part, in coordinates of the layout. */
  part: () => Part;
  /** Set the function to call when the visible part changes. */
  watch: (watcher: (() => void) | null) => void;
  zoomBy: (factor: number) => void;
  fit: () => void;
  /** Centre a node, or a place of the layout. */
  show: (path: string) => void;
  centre: (x: number, y: number) => void;
}

const bounded = (zoom: number): number => Math.min(LARGEST, Math.max(SMALLEST, zoom));

/** Nodes in a range of squares, and nodes whose parents are there. */
function nearest(layout: Layout, squares: string): Placed[] {
  const [left = 0, top = 0, right = 0, bottom = 0] = squares.split(",").map(Number);
  const within = (one: Placed): boolean => {
    const column = Math.floor(one.x / CELL);
    const row = Math.floor(one.y / CELL);
    return column >= left && column <= right && row >= top && row <= bottom;
  };
  return layout.placed.filter((one) => within(one) || (one.parent !== null && within(one.parent)));
}

export function useViewport(layout: Layout): Viewport {
  const frame = useRef<HTMLDivElement>(null);
  const watcher = useRef<(() => void) | null>(null);
  // Place of the layout that the next zoom holds, x and y, and its pixels from the frame's corner.
  const anchor = useRef<readonly [number, number, number, number] | null>(null);
  const [zoom, setZoom] = useState(1);
  const [squares, setSquares] = useState("0,0,3,3");
  const [isPart, setIsPart] = useState(false);
  const current = useRef(zoom);

  const part = useCallback((): Part => {
    const box = frame.current;
    const scale = current.current;
    if (box === null) return { left: 0, top: 0, right: 0, bottom: 0 };
    return {
      left: box.scrollLeft / scale,
      top: box.scrollTop / scale,
      right: (box.scrollLeft + box.clientWidth) / scale,
      bottom: (box.scrollTop + box.clientHeight) / scale,
    };
  }, []);

  const onScroll = useCallback((): void => {
    const shown = part();
    const first = (value: number): number => Math.floor(value / CELL) - 1;
    const last = (value: number): number => Math.floor(value / CELL) + 1;
    setSquares([first(shown.left), first(shown.top), last(shown.right), last(shown.bottom)].join(","));
    watcher.current?.();
  }, [part]);

  const zoomAt = useCallback((next: number, x: number, y: number): void => {
    const box = frame.current;
    if (box === null || bounded(next) === current.current) return;
    anchor.current = [(box.scrollLeft + x) / current.current, (box.scrollTop + y) / current.current, x, y];
    current.current = bounded(next);
    setZoom(current.current);
  }, []);

  useLayoutEffect(() => {
    const box = frame.current;
    if (box === null) return;
    if (anchor.current !== null) {
      const [x, y, pixelsX, pixelsY] = anchor.current;
      anchor.current = null;
      box.scrollTo({ left: x * zoom - pixelsX, top: y * zoom - pixelsY });
    }
    setIsPart(layout.width * zoom > box.clientWidth || layout.height * zoom > box.clientHeight);
    onScroll();
  }, [zoom, layout, onScroll]);

  useEffect(() => {
    const box = frame.current;
    if (box === null) return;
    const observer = new ResizeObserver(onScroll);
    observer.observe(box);
    // React's listener is passive, so the page would scroll as well.
    const onWheel = (event: WheelEvent): void => {
      if (event.shiftKey) return;
      event.preventDefault();
      const corner = box.getBoundingClientRect();
      const factor = Math.exp(-event.deltaY * WHEEL * (event.deltaMode === 1 ? 16 : 1));
      zoomAt(current.current * factor, event.clientX - corner.left, event.clientY - corner.top);
    };
    box.addEventListener("wheel", onWheel, { passive: false });
    return () => {
      observer.disconnect();
      box.removeEventListener("wheel", onWheel);
    };
  }, [onScroll, zoomAt]);

  const onPointerDown = useCallback((event: React.PointerEvent): void => {
    const box = frame.current;
    if (box === null || event.button !== 0 || event.pointerType !== "mouse") return;
    const from = { x: event.clientX, y: event.clientY, left: box.scrollLeft, top: box.scrollTop };
    let isDrag = false;
    const move = (moved: PointerEvent): void => {
      const x = moved.clientX - from.x;
      const y = moved.clientY - from.y;
      isDrag ||= Math.hypot(x, y) > DRAG_PX;
      if (isDrag) box.scrollTo({ left: from.left - x, top: from.top - y });
      box.toggleAttribute("data-dragged", isDrag);
    };
    const end = (): void => {
      removeEventListener("pointermove", move);
      removeEventListener("pointerup", end);
      removeEventListener("pointercancel", end);
      box.removeAttribute("data-dragged");
      // The end of a drag is not a click on the node below the pointer.
      const swallow = (click: Event): void => click.stopPropagation();
      if (isDrag) box.addEventListener("click", swallow, { capture: true, once: true });
      setTimeout(() => box.removeEventListener("click", swallow, { capture: true }));
    };
    addEventListener("pointermove", move);
    addEventListener("pointerup", end);
    addEventListener("pointercancel", end);
  }, []);

  const centre = useCallback((x: number, y: number): void => {
    const box = frame.current;
    const scale = current.current;
    box?.scrollTo({ left: x * scale - box.clientWidth / 2, top: y * scale - box.clientHeight / 2 });
  }, []);
  const show = useCallback(
    (path: string): void => {
      const item = layout.at.get(path);
      if (item !== undefined) centre(item.x + WIDTH / 2, item.y + HEIGHT / 2);
    },
    [layout, centre],
  );
  const zoomBy = useCallback(
    (factor: number): void => {
      const box = frame.current;
      if (box !== null) zoomAt(current.current * factor, box.clientWidth / 2, box.clientHeight / 2);
    },
    [zoomAt],
  );
  const fit = useCallback((): void => {
    const box = frame.current;
    if (box === null || layout.width === 0) return;
    zoomAt(Math.min(1, box.clientWidth / layout.width, box.clientHeight / layout.height), 0, 0);
  }, [layout, zoomAt]);
  const watch = useCallback((next: (() => void) | null): void => {
    watcher.current = next;
  }, []);
  const near = useMemo(() => nearest(layout, squares), [layout, squares]);
  return { frame, zoom, isPart, near, onScroll, onPointerDown, part, watch, zoomBy, fit, show, centre };
}
