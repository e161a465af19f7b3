// SPDX-License-Identifier: Apache-2.0
// Keys that act on every page, except while somebody types.

import { useEffect } from "react";

const TWICE_MS = 1000;
const TYPED =
  'input:not([type="range"], [type="checkbox"], [type="radio"]), textarea, select, [contenteditable], dialog, [role="dialog"]';

/** Whether a key goes to a field or a dialog, which handles it itself. */
function isTyped(event: KeyboardEvent): boolean {
  return event.target instanceof Element && event.target.closest(TYPED) !== null;
}

const isPlain = (event: KeyboardEvent): boolean =>
  !event.repeat && !event.ctrlKey && !event.altKey && !event.metaKey && !event.isComposing;

/** Call back when a key is pressed. */
export function useKey(key: string, act: () => void): void {
  useEffect(() => {
    const pressed = (event: KeyboardEvent): void => {
      if (event.key === key && isPlain(event) && !isTyped(event)) act();
    };
    window.addEventListener("keydown", pressed);
    return () => window.removeEventListener("keydown", pressed);
  }, [key, act]);
}

/** Call back when Esc is pressed twice, the first time not while somebody types. */
export function useEscapeTwice(act: () => void, isOn: boolean): void {
  useEffect(() => {
    if (!isOn) return;
    let firstMs = -Infinity;
    const pressed = (event: KeyboardEvent): void => {
      if (event.repeat) return;
      const isEscape = event.key === "Escape" && isPlain(event);
      const isSecond = isEscape && event.timeStamp - firstMs <= TWICE_MS;
      firstMs = isEscape && !isSecond && !isTyped(event) ? event.timeStamp : -Infinity;
      if (isSecond) act();
    };
    window.addEventListener("keydown", pressed, true);
    return () => window.removeEventListener("keydown", pressed, true);
  }, [act, isOn]);
}
