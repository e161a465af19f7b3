// SPDX-License-Identifier: Apache-2.0
// Controls of the recording: start, stop, and bookmark of the current moment.

import { useState } from "react";
import { author } from "./author";
import { Empty } from "./empty";
import { OperationButton, Outcome, useOperation, WhyNot } from "./operation";
import shared from "./shared.module.css";
import { useEntry } from "./store";
import { texts } from "./texts";

const words = texts.world;

/** Start, stop and bookmark; without a journal, a hint how to get one. */
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
    <section className={shared.panel} aria-label={words.recording}>
      <h2>{words.recording}</h2>
      {record === undefined && <Empty>{words.noJournal}</Empty>}
      {record?.recording === true && (
        <>
          <p>
            <b>{record.label || record.file}</b> {words.recorded} · {texts.time.bookmarks}: {record.bookmarks}
          </p>
          <form
            className={shared.bar}
            onSubmit={(event) => {
              event.preventDefault();
              void ask("BOOKMARK", { label: bookmark }).then((accepted) => accepted && setBookmark(""));
            }}
          >
            <label>
              {words.bookmark} <input value={bookmark} maxLength={200} onChange={(event) => setBookmark(event.target.value)} />
            </label>
            <OperationButton of={write}>{words.mark}</OperationButton>
            <OperationButton of={write} className={shared.stop} ask={() => ask("STOP", {})}>
              {words.stop}
            </OperationButton>
          </form>
        </>
      )}
      {record?.recording === false && (
        <>
          <p className={shared.faint}>{words.notRecorded}</p>
          <form
            className={shared.bar}
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
