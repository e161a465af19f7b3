// SPDX-License-Identifier: Apache-2.0
// Divider between the columns of a page, moved by pointer or keys; each browser keeps its place.

import { useLayoutEffect, useState, type KeyboardEvent, type PointerEvent } from "react";
import css from "./divider.module.css";
import { texts } from "./texts";

const KEY = "width of the right column";
const USUAL_PX = 360;
const NARROWEST_PX = 240;
const WIDEST_PX = 1200;
const STEP_PX = 20;

const bounded = (width: number): number => Math.round(Math.min(Math.max(width, NARROWEST_PX), WIDEST_PX)) || USUAL_PX;

export function Divider() {
  const [width, setWidth] = useState(() => bounded(Number(localStorage.getItem(KEY) ?? USUAL_PX)));
  const set = (next: number): void => {
    setWidth(bounded(next));
    localStorage.setItem(KEY, String(bounded(next)));
  };
  useLayoutEffect(() => document.documentElement.style.setProperty("--side", `${width}px`), [width]);
  const drag = (event: PointerEvent<HTMLElement>): void => {
    const column = event.currentTarget.parentElement;
    if (column === null || !event.currentTarget.hasPointerCapture(event.pointerId)) return;
    set(column.getBoundingClientRect().right - event.clientX);
  };
  const press = (event: KeyboardEvent): void => {
    const change = { ArrowLeft: STEP_PX, ArrowRight: -STEP_PX }[event.key];
    if (change === undefined) return;
    event.preventDefault();
    set(width + change);
  };
  return (
    <div
      className={css.divider}
      role="separator"
      tabIndex={0}
      aria-orientation="vertical"
      aria-label={texts.divider.label}
      title={texts.divider.hint}
      aria-valuenow={width}
      aria-valuemin={NARROWEST_PX}
      aria-valuemax={WIDEST_PX}
      onPointerDown={(event) => event.currentTarget.setPointerCapture(event.pointerId)}
      onPointerMove={drag}
      onDoubleClick={() => set(USUAL_PX)}
      onKeyDown={press}
    />
  );
}
