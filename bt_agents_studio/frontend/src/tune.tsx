// SPDX-License-Identifier: Apache-2.0
// Page "Tune": every tunable value of every agent, in the running system.

import { useEffect, useState } from "react";
import { operate, useConnection } from "./connection";
import { formatNumber, formatTime } from "./formatting";
import { PanelBoundary } from "./panel_boundary";
import type { TunableRecord, TuningsRecord } from "./protocol";
import { useCollection } from "./store";
import { texts } from "./texts";

const words = texts.tune;

export function Tune() {
  const tunables = useCollection("tunables");
  const tunings = useCollection("tunings");
  const [answer, setAnswer] = useState("");
  const groups = new Map<string, TunableRecord[]>();
  for (const [, one] of tunables) {
    const group = one.agent || one.host;
    groups.set(group, [...(groups.get(group) ?? []), one]);
  }
  return (
    <div className="columns">
      <div className="main">
        <output className="answer">{answer}</output>
        {groups.size === 0 && <p className="empty">{words.none}</p>}
        {[...groups].sort(([a], [b]) => a.localeCompare(b)).map(([group, values]) => (
          <PanelBoundary key={group} label={group}>
            <Group name={group} values={values} report={setAnswer} />
          </PanelBoundary>
        ))}
      </div>
      <div className="side">
        {tunings.map(([host, one]) => (
          <PanelBoundary key={host} label={words.history}>
            <History host={host} record={one} report={setAnswer} />
          </PanelBoundary>
        ))}
      </div>
    </div>
  );
}

interface GroupProps {
  name: string;
  values: TunableRecord[];
  report: (text: string) => void;
}

function Group({ name, values, report }: GroupProps) {
  return (
    <section className="panel" aria-label={name}>
      <h2>{name}</h2>
      {values.map((one) => (
        <Control key={one.name} tunable={one} report={report} />
      ))}
    </section>
  );
}

const written = (tunable: TunableRecord, value: string): string =>
  tunable.unit && value.trim() !== "" && !Number.isNaN(Number(value)) ? `${value} ${tunable.unit}` : value;

const shown = (value: TunableRecord["value"]): string =>
  typeof value === "number" ? formatNumber(value) : String(value ?? "");

function Control({ tunable, report }: { tunable: TunableRecord; report: (text: string) => void }) {
  const { atS } = useConnection();
  const current = shown(tunable.value);
  const [draft, setDraft] = useState<string | null>(null);
  useEffect(() => setDraft(null), [current]);
  const text = draft ?? current;
  const set = async (value: string): Promise<void> => {
    const done = await operate("tune", {
      host: tunable.host,
      action: "SET",
      author: words.author,
      names: [tunable.name],
      values: [written(tunable, value)],
    });
    report(done.message);
    if (!done.accepted) setDraft(null);
  };
  const id = `tunable-${tunable.name.replaceAll(".", "-")}`;
  const hasRange = tunable.minimum !== null && tunable.maximum !== null;
  const disabled = atS !== null;
  return (
    <div className="control">
      <label htmlFor={id}>
        {tunable.key} <small>{tunable.description}</small>
      </label>
      {tunable.type === "BOOLEAN" ? (
        <input
          id={id}
          type="checkbox"
          checked={tunable.value === true}
          disabled={disabled}
          onChange={(event) => void set(String(event.target.checked))}
        />
      ) : (
        <>
          {hasRange && (
            <input
              type="range"
              aria-label={`${tunable.name} slider`}
              min={tunable.minimum ?? 0}
              max={tunable.maximum ?? 1}
              step={tunable.step > 0 ? tunable.step : tunable.type === "INTEGER" ? 1 : "any"}
              value={Number.isNaN(Number(text)) ? current : text}
              disabled={disabled}
              onChange={(event) => setDraft(event.target.value)}
              onPointerUp={() => draft !== null && void set(draft)}
              onKeyUp={() => draft !== null && void set(draft)}
            />
          )}
          <input
            id={id}
            type="text"
            inputMode={hasRange ? "decimal" : "text"}
            value={text}
            disabled={disabled}
            onChange={(event) => setDraft(event.target.value)}
            onBlur={() => draft !== null && draft !== current && void set(draft)}
            onKeyDown={(event) => event.key === "Enter" && draft !== null && void set(draft)}
          />
          <span className="unit">{tunable.unit}</span>
        </>
      )}
      <small className="range">
        {hasRange && `${words.range} ${formatNumber(tunable.minimum ?? 0)} – ${formatNumber(tunable.maximum ?? 0)} · `}
        {words.default} {shown(tunable.default)}
      </small>
      <button
        type="button"
        disabled={disabled || tunable.value === tunable.default}
        onClick={() => void set(shown(tunable.default))}
      >
        {words.reset}
      </button>
    </div>
  );
}

interface HistoryProps {
  host: string;
  record: TuningsRecord;
  report: (text: string) => void;
}

function History({ host, record, report }: HistoryProps) {
  const { atS } = useConnection();
  const [name, setName] = useState("");
  const disabled = atS !== null;
  const ask = async (action: "UNDO" | "REDO" | "APPLY" | "SAVE", preset = ""): Promise<void> => {
    report((await operate("tune", { host, action, preset, author: words.author })).message);
  };
  return (
    <section className="panel" aria-label={words.history}>
      <h2>
        {words.history} <span>{host}</span>
      </h2>
      <div className="bar">
        <button type="button" disabled={disabled || record.undo === ""} title={record.undo} onClick={() => void ask("UNDO")}>
          {words.undo}
        </button>
        <button type="button" disabled={disabled || record.redo === ""} title={record.redo} onClick={() => void ask("REDO")}>
          {words.redo}
        </button>
      </div>
      <h3>{words.presets}</h3>
      {record.presets.length === 0 && <p className="empty">{words.noPresets}</p>}
      {record.presets.map((one) => (
        <div className="bar" key={one.name}>
          <span title={Object.entries(one.values).map(([key, value]) => `${key}=${value}`).join("\n")}>{one.name}</span>
          <button type="button" disabled={disabled} onClick={() => void ask("APPLY", one.name)}>
            {words.apply}
          </button>
        </div>
      ))}
      <form
        className="bar"
        onSubmit={(event) => {
          event.preventDefault();
          void ask("SAVE", name);
        }}
      >
        <input aria-label={words.save} value={name} onChange={(event) => setName(event.target.value)} />
        <button type="submit" disabled={disabled || name === ""}>
          {words.save}
        </button>
      </form>
      <ol className="feedback">
        {[...record.tunings].reverse().map((one) => (
          <li key={`${one.revision} ${one.name}`}>
            <time>{formatTime(one.at_s)}</time> <b>{one.name}</b> {one.before} → {one.after} · {one.author}
            {one.reason && `: ${one.reason}`}
          </li>
        ))}
      </ol>
    </section>
  );
}
