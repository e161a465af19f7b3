// SPDX-License-Identifier: Apache-2.0
// Log of a run, sorted by time, which follows the newest line until the reader scrolls up.

import { memo, useEffect, useLayoutEffect, useMemo, useRef, useState } from "react";
import { useConnection } from "./connection";
import { formatTime } from "./formatting";
import css from "./log.module.css";
import type { LogRecord } from "./protocol";
import shared from "./shared.module.css";
import { useCollection } from "./store";
import { texts } from "./texts";

const PERIOD_MS = 250;
const MOST_LINES = 100;
const MOST_RESULTS = 20;
/** Distance below the frame that still counts as the end. */
const END_PX = 8;

type Lines = readonly [string, LogRecord][];

export function Log() {
  const lines = useCollection("log", PERIOD_MS);
  const { atS, source } = useConnection();
  const box = useRef<HTMLOListElement>(null);
  // Latched messages arrive late; place them at the time they were sent.
  const newest = useMemo(() => [...lines].sort(([, one], [, other]) => one.at_s - other.at_s).slice(-MOST_LINES), [lines]);
  /** Lines that stay in place while somebody reads further up. */
  const [held, setHeld] = useState<Lines | null>(null);
  const shown = held ?? newest;
  const missed = useMemo(() => {
    const keys = new Set(shown.map(([key]) => key));
    return newest.filter(([key]) => !keys.has(key)).length;
  }, [shown, newest]);
  useEffect(() => setHeld(null), [atS, source]);
  useLayoutEffect(() => {
    if (held === null) box.current?.scrollTo({ top: box.current.scrollHeight });
  }, [shown, held]);
  const onScroll = (): void => {
    const list = box.current;
    if (list === null) return;
    const isAtEnd = list.scrollHeight - list.scrollTop - list.clientHeight < END_PX;
    setHeld((before) => (isAtEnd ? null : (before ?? newest)));
  };
  return (
    <section className={`${shared.panel} ${css.log}`} aria-label={texts.live.log}>
      <div className={shared.bar}>
        <h2>{texts.live.log}</h2>
        {held !== null && (
          <button type="button" onClick={() => setHeld(null)}>
            {texts.live.newestLines} {missed > 0 && `(${missed})`}
          </button>
        )}
      </div>
      <ol ref={box} tabIndex={0} onScroll={onScroll}>
        {shown.map(([key, line]) => (
          <LogLine key={key} line={line} />
        ))}
      </ol>
    </section>
  );
}

/** The last results of a node, newest first. */
export function NodeResults({ agent, path }: { agent: string; path: string }) {
  const lines = useCollection("log", PERIOD_MS);
  const shown = useMemo(() => {
    const own = lines.filter(([, line]) => line.agent === agent && line.path === path);
    return own.slice(-MOST_RESULTS).reverse();
  }, [lines, agent, path]);
  if (shown.length === 0) return null;
  return (
    <>
      <h3>{texts.live.results}</h3>
      <ol className={shared.lines} tabIndex={0} aria-label={texts.live.results}>
        {shown.map(([key, { at_s, text }]) => (
          <li key={key}>
            <time>{formatTime(at_s)}</time> {text}
          </li>
        ))}
      </ol>
    </>
  );
}

const LogLine = memo(function LogLine({ line }: { line: LogRecord }) {
  return (
    <li>
      <time>{formatTime(line.at_s)}</time> <b>{line.kind}</b> {line.agent && <i>{line.agent}</i>} {line.text}
    </li>
  );
});
