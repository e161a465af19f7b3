// SPDX-License-Identifier: Apache-2.0
// Bookmarks of the journal, or of this browser if no journal is written.

import { useMemo, useRef, useState, type FormEvent } from "react";
import { author } from "./author";
import { seek, useConnection } from "./connection";
import { formatTime } from "./formatting";
import { OperationButton, Outcome, useOperation } from "./operation";
import type { BookmarkRecord } from "./protocol";
import shared from "./shared.module.css";
import { usePresent, usePresentCollection } from "./store";
import { texts } from "./texts";
import type { Span } from "./timeline_lanes";
import { close, Menu } from "./timeline_menu";

const words = texts.time;
const LONGEST = 200;
/** Most bookmarks that this browser keeps of a recording; the oldest are dropped. */
const MOST = 200;

export interface AllBookmarks {
  /** Bookmarks of the span, in order of time. */
  all: readonly BookmarkRecord[];
  own: readonly BookmarkRecord[];
  keep: (own: readonly BookmarkRecord[]) => void;
}

/** Bookmarks from the first moment that can be shown to the last. */
export function useBookmarks({ fromS, toS }: Span): AllBookmarks {
  const { source, bookmarks } = useConnection();
  const present = usePresentCollection("bookmarks");
  const [, setKept] = useState(0);
  const key = `bookmarks ${source}`;
  const text = localStorage.getItem(key) ?? "[]";
  const own = useMemo(() => parseKept(text), [text]);
  const keep = (kept: readonly BookmarkRecord[]): void => {
    localStorage.setItem(key, JSON.stringify(kept.slice(-MOST)));
    setKept((before) => before + 1);
  };
  const all = [...(source ? bookmarks : present.map(([, one]) => one)), ...own]
    .filter((one) => one.at_s >= fromS && one.at_s <= toS)
    .sort((one, other) => one.at_s - other.at_s);
  return { all, own, keep };
}

/** Return the bookmarks in a stored text; none if another version stored another format. */
function parseKept(text: string): readonly BookmarkRecord[] {
  try {
    const kept: unknown = JSON.parse(text);
    return Array.isArray(kept) ? (kept as BookmarkRecord[]).filter((one) => Number.isFinite(one?.at_s)) : [];
  } catch {
    return [];
  }
}

/** A list of bookmarks to jump to, and a form that sets one. */
export function Bookmarks({ of, moment }: { of: AllBookmarks; moment: number }) {
  const { source } = useConnection();
  return (
    <>
      {of.all.length > 0 && (
        <select
          aria-label={words.bookmarks}
          value=""
          onChange={(event) => event.target.value && seek(source, Number(event.target.value))}
        >
          <option value="">{words.bookmarks}</option>
          {of.all.map((one, place) => (
            <option key={place} value={one.at_s}>
              {formatTime(one.at_s)} {one.label}
            </option>
          ))}
        </select>
      )}
      <Mark of={of} moment={moment} />
    </>
  );
}

/** Form that sets a bookmark at the moment on show, or when it was opened on a live page. */
function Mark({ of: { own, keep }, moment }: { of: AllBookmarks; moment: number }) {
  const { atS, source, offsetS } = useConnection();
  const recording = usePresent("recording");
  const write = useOperation("record", true);
  const [openedS, setOpenedS] = useState(0);
  const [note, setNote] = useState("");
  const box = useRef<HTMLDetailsElement>(null);
  const markedS = atS === null ? openedS : moment;
  const isWritten = recording?.recording === true && ["", recording.file].includes(source) && write.whyNot === "";
  const mark = async (event: FormEvent): Promise<void> => {
    event.preventDefault();
    if (!isWritten) keep([...own, { at_s: markedS, label: note, notes: "", author: "" }]);
    else {
      const age_s = Math.max(Date.now() / 1000 + offsetS - markedS, 0);
      const done = await write.ask({ action: "BOOKMARK", label: note, author: author(), age_s });
      if (done?.accepted !== true) return;
    }
    setNote("");
    close(box);
  };
  const isOwn = own.some((one) => one.at_s === markedS);
  return (
    <Menu box={box} label={words.mark} onOpen={() => setOpenedS(Date.now() / 1000 + offsetS)}>
      <form onSubmit={(event) => void mark(event)}>
        <p>
          <b>{formatTime(markedS)}</b> {isWritten ? words.inJournal : words.inBrowser}
        </p>
        <div className={shared.bar}>
          <input
            aria-label={words.note}
            placeholder={words.note}
            maxLength={LONGEST}
            value={note}
            onChange={(event) => setNote(event.target.value)}
          />
          <OperationButton of={{ ...write, whyNot: "" }}>{words.setMark}</OperationButton>
          {isOwn && (
            <button type="button" onClick={() => keep(own.filter((one) => one.at_s !== markedS))}>
              {words.removeMark}
            </button>
          )}
        </div>
        <Outcome of={[write]} />
      </form>
    </Menu>
  );
}
