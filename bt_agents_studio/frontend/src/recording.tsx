// SPDX-License-Identifier: Apache-2.0
// The recording: its start, its end and its bookmarks.

import { useState } from "react";
import { seek, useConnection } from "./connection";
import { author } from "./author";
import { Empty } from "./empty";
import { formatTime } from "./formatting";
import { OperationButton, Outcome, useOperation, WhyNot } from "./operation";
import type { BookmarkRecord } from "./protocol";
import { useCollection, useEntry } from "./store";
import { texts } from "./texts";
import type { Span } from "./timeline_lanes";

const words = texts.world;

/** Start, stop and bookmark; without a journal, how to get one. */
export function Recording() {
  const record = useEntry("recording");
  const write = useOperation("record");
  const [label, setLabel] = useState("");
  const [notes, setNotes] = useState("");
  const [bookmark, setBookmark] = useState("");
  const ask = async (action: "START" | "STOP" | "BOOKMARK", told: { label?: string; notes?: string }): Promise<boolean> => {
    const done = await write.ask({ action, author: author(), ...told });
    return done?.accepted === true;
  };
  return (
    <section className="panel" aria-label={words.recording}>
      <h2>{words.recording}</h2>
      {record === undefined && <Empty>{words.noJournal}</Empty>}
      {record?.recording === true && (
        <>
          <p>
            <b>{record.label || record.file}</b> {words.recorded} · {texts.time.bookmarks}: {record.bookmarks}
          </p>
          <form
            className="bar"
            onSubmit={(event) => {
              event.preventDefault();
              void ask("BOOKMARK", { label: bookmark }).then((accepted) => accepted && setBookmark(""));
            }}
          >
            <label>
              {words.bookmark} <input value={bookmark} maxLength={200} onChange={(event) => setBookmark(event.target.value)} />
            </label>
            <OperationButton of={write}>{words.mark}</OperationButton>
            <OperationButton of={write} className="stop" ask={() => ask("STOP", {})}>
              {words.stop}
            </OperationButton>
          </form>
        </>
      )}
      {record?.recording === false && (
        <>
          <p className="empty">{words.notRecorded}</p>
          <form
            className="bar"
            onSubmit={(event) => {
              event.preventDefault();
              void ask("START", { label, notes });
            }}
          >
            <label>
              {words.recordingLabel} <input value={label} maxLength={200} onChange={(event) => setLabel(event.target.value)} />
            </label>
            <label>
              {words.notes} <input value={notes} maxLength={1000} onChange={(event) => setNotes(event.target.value)} />
            </label>
            <OperationButton of={write}>{words.start}</OperationButton>
          </form>
        </>
      )}
      {record !== undefined && <WhyNot of={write} />}
      <Outcome of={[write]} />
    </section>
  );
}

/** Marked moments of what is shown, from the first one that can be shown to the last. */
export function useBookmarks({ fromS, toS }: Span): BookmarkRecord[] {
  const { atS, bookmarks } = useConnection();
  const live = useCollection("bookmarks");
  const all = atS === null ? live.map(([, one]) => one) : bookmarks;
  return all.filter((one) => one.at_s >= fromS && one.at_s <= toS);
}

/** List to jump to a bookmark. */
export function Bookmarks({ bookmarks }: { bookmarks: readonly BookmarkRecord[] }) {
  const { source } = useConnection();
  if (bookmarks.length === 0) return null;
  return (
    <select
      aria-label={texts.time.bookmarks}
      value=""
      onChange={(event) => event.target.value && seek(source, Number(event.target.value))}
    >
      <option value="">{texts.time.bookmarks}</option>
      {bookmarks.map((one) => (
        <option key={one.at_s} value={one.at_s}>
          {formatTime(one.at_s)} {one.label}
        </option>
      ))}
    </select>
  );
}
