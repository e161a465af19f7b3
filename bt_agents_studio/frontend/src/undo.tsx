// SPDX-License-Identifier: Apache-2.0
// The newest change of this tab, at the foot of every page for a while, with an undo button.

import { useEffect, useState, useSyncExternalStore } from "react";
import { useConnection, type Answer } from "./connection";
import { texts } from "./texts";
import css from "./undo.module.css";

const words = texts.undo;
const SHOWN_MS = 10_000;

interface Change {
  /** Changed value; later changes of it, as by a moving slider, join the first change. */
  topic: string;
  /** Its value before. */
  from: string;
  /** Its value now, if later changes may join. */
  to?: string;
  /** The change in words. */
  text: (from: string) => string;
  /** Restore the previous value. */
  takeBack: (from: string) => Promise<Answer>;
}

let newest: Change | null = null;
/** Its values by changes of this tab, and the one before; another value is somebody else's. */
let own = new Set<string>();
const listeners = new Set<() => void>();

function show(change: Change | null): void {
  newest = change;
  for (const listener of listeners) listener();
}

/** Offer to undo a change that the system has accepted. */
export function offerUndo(change: Change): void {
  const before = newest?.topic === change.topic && own.has(change.from) ? newest : null;
  own = new Set([...(before ? own : [change.from]), change.to ?? change.from]);
  show({ ...change, from: before?.from ?? change.from });
}

export function Undo() {
  const { atS } = useConnection();
  const change = useSyncExternalStore(
    (listener) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    () => newest,
  );
  const [isHeld, setHeld] = useState(false);
  const [told, setTold] = useState<string | null>(null);
  useEffect(() => setTold(null), [change]);
  useEffect(() => {
    if (change === null || isHeld) return;
    const timer = window.setTimeout(() => show(null), SHOWN_MS);
    return () => window.clearTimeout(timer);
  }, [change, isHeld, told]);
  const undo = async (taken: Change): Promise<void> => {
    setTold(words.pending);
    setHeld(false); // the button is gone, and loses no focus
    const { message } = await taken.takeBack(taken.from);
    if (newest === taken) setTold(message);
  };
  return (
    <div
      className={css.undo}
      role="status"
      onPointerEnter={() => setHeld(true)}
      onPointerLeave={() => setHeld(false)}
      onFocus={() => setHeld(true)}
      onBlur={() => setHeld(false)}
    >
      {change && (
        <p>
          {told ?? change.text(change.from)}{" "}
          {told === null && atS === null && (
            <button type="button" onClick={() => void undo(change)}>
              {words.undo}
            </button>
          )}
        </p>
      )}
    </div>
  );
}
