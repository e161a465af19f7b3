// SPDX-License-Identifier: Apache-2.0
// Playback from an earlier moment, in real time or faster.

import { useEffect, useRef, useState } from "react";
import { isAwaited, seek, useConnection } from "./connection";
import type { EventRecord } from "./protocol";
import { texts } from "./texts";
import { neighbour, type Span } from "./timeline_lanes";

const words = texts.time;
const SPEEDS = [1, 2, 4, 8];
const PERIOD_MS = 250;
const CALM = matchMedia("(prefers-reduced-motion: reduce)");

export interface Player {
  isPlaying: boolean;
  speed: number;
  setSpeed: (speed: number) => void;
  toggle: () => void;
}

/** Playback of the time on show; with reduced motion, it jumps from event to event. */
export function usePlayer(events: readonly EventRecord[], whole: Span, toEnd: () => void): Player {
  const { atS, source, phase } = useConnection();
  const [isOn, setOn] = useState(false);
  const [speed, setSpeed] = useState(1);
  const isPlaying = isOn && atS !== null;
  /** The moment last shown, and the moment that playback has since reached. */
  const played = useRef({ shownS: 0, toS: 0 });
  const play = useRef<(passedS: number) => void>(() => undefined);
  play.current = (passedS) => {
    if (atS === null) return;
    // The user has jumped to another moment.
    if (played.current.shownS !== atS) played.current = { shownS: atS, toS: atS };
    const toS = (played.current.toS += speed * passedS);
    if (toS >= whole.toS) {
      setOn(false);
      toEnd();
      return;
    }
    const shownS = CALM.matches ? (neighbour(events, whole, toS, -1) ?? atS) : toS;
    if (shownS <= atS || isAwaited()) return;
    played.current.shownS = shownS;
    seek(source, shownS);
  };
  const isRunning = isPlaying && phase === "open";
  useEffect(() => {
    if (!isRunning) return;
    let before = performance.now();
    const timer = window.setInterval(() => {
      const now = performance.now();
      play.current((now - before) / 1000);
      before = now;
    }, PERIOD_MS);
    return () => window.clearInterval(timer);
  }, [isRunning]);
  useEffect(() => setOn(false), [atS === null, source]);
  const toggle = (): void => {
    if (atS === null) return;
    if (!isOn && atS >= whole.toS) seek(source, whole.fromS);
    setOn(!isOn);
  };
  return { isPlaying, speed, setSpeed, toggle };
}

export function PlayerButtons({ of }: { of: Player }) {
  const label = of.isPlaying ? words.hold : words.play;
  return (
    <>
      <button type="button" aria-label={label} title={`${label} (${words.playKey})`} onClick={of.toggle}>
        {of.isPlaying ? "❚❚" : "▶\uFE0E"}
      </button>
      <select aria-label={words.speed} value={of.speed} onChange={(event) => of.setSpeed(Number(event.target.value))}>
        {SPEEDS.map((one) => (
          <option key={one} value={one}>
            {one}×
          </option>
        ))}
      </select>
    </>
  );
}
