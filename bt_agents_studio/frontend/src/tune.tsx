// SPDX-License-Identifier: Apache-2.0
// Page "Tune": every tunable value of every agent, in the running system.

import { useRef, useState } from "react";
import { operate, useConnection } from "./connection";
import { formatNumber, formatTime } from "./formatting";
import { PanelBoundary } from "./panel_boundary";
import type { AgentRecord, KeepRecord, TunableRecord, TuningRecord, TuningsRecord } from "./protocol";
import { useCollection, useEntry } from "./store";
import { texts } from "./texts";

const words = texts.tune;

export function Tune() {
  const tunables = useCollection("tunables");
  const tunings = useCollection("tunings");
  const [answer, setAnswer] = useState("");
  const [onlyDifferent, setOnlyDifferent] = useState(false);
  const isDifferent = (one: TunableRecord): boolean => one.value !== one.default;
  const different = tunables.filter(([, one]) => isDifferent(one)).length;
  const latest = new Map<string, TuningRecord>();
  const revisions = new Map<string, number>();
  for (const [host, one] of tunings) {
    revisions.set(host, one.revision);
    for (const tuning of one.tunings) latest.set(tuning.name, tuning);
  }
  const groups = new Map<string, TunableRecord[]>();
  for (const [, one] of tunables) {
    if (onlyDifferent && !isDifferent(one)) continue;
    const group = one.agent || one.host;
    groups.set(group, [...(groups.get(group) ?? []), one]);
  }
  return (
    <div className="columns">
      <div className="main">
        <div className="bar">
          <label>
            <input type="checkbox" checked={onlyDifferent} onChange={(event) => setOnlyDifferent(event.target.checked)} />{" "}
            {words.differs}
          </label>
          <span className="place">
            {different} {words.differences}
          </span>
        </div>
        <output className="answer">{answer}</output>
        {tunables.length === 0 && <p className="empty">{words.none}</p>}
        {[...groups].sort(([a], [b]) => a.localeCompare(b)).map(([group, values]) => (
          <PanelBoundary key={group} label={group}>
            <Group name={group} values={values} latest={latest} revisions={revisions} report={setAnswer} />
          </PanelBoundary>
        ))}
      </div>
      <div className="side">
        <PanelBoundary label={words.keep}>
          <Keep />
        </PanelBoundary>
        {tunings.map(([host, one]) => (
          <PanelBoundary key={host} label={words.history}>
            <History host={host} record={one} report={setAnswer} />
          </PanelBoundary>
        ))}
      </div>
    </div>
  );
}

const written = (tunable: TunableRecord, value: string): string =>
  tunable.unit && value.trim() !== "" && !Number.isNaN(Number(value)) ? `${value} ${tunable.unit}` : value;

const shown = (value: TunableRecord["value"]): string =>
  typeof value === "number" ? formatNumber(value) : String(value ?? "");

interface GroupProps {
  name: string;
  values: TunableRecord[];
  latest: ReadonlyMap<string, TuningRecord>;
  revisions: ReadonlyMap<string, number>;
  report: (text: string) => void;
}

function Group({ name, values, latest, revisions, report }: GroupProps) {
  const agent = useEntry("agents", name);
  return (
    <section className="panel" aria-label={name}>
      <h2>{name}</h2>
      {values.map((one) => (
        <Control
          key={one.name}
          tunable={one}
          latest={latest.get(one.name)}
          revision={revisions.get(one.host) ?? 0}
          report={report}
        />
      ))}
      {agent && <Profile agent={agent} report={report} />}
    </section>
  );
}

interface ControlProps {
  tunable: TunableRecord;
  latest: TuningRecord | undefined;
  /** Of the last change of the host that this page has seen. */
  revision: number;
  report: (text: string) => void;
}

function Control({ tunable, latest, revision, report }: ControlProps) {
  const { atS } = useConnection();
  const current = shown(tunable.value);
  // What is being written here, and what was in force when that began.
  const [draft, setDraft] = useState<{ text: string; over: string; seen: number } | null>(null);
  const [isSent, setSent] = useState(false);
  const latestSeen = useRef(revision);
  latestSeen.current = revision;
  const text = draft?.text ?? current;
  const isOvertaken = draft !== null && !isSent && draft.over !== current;
  const write = (next: string): void => setDraft({ text: next, over: draft?.over ?? current, seen: draft?.seen ?? revision });
  const set = async (value: string, seen = revision): Promise<void> => {
    setSent(true);
    const done = await operate("tune", {
      host: tunable.host,
      action: "SET",
      author: words.author,
      names: [tunable.name],
      values: [written(tunable, value)],
      compare: true,
      seen,
    });
    report(done.message);
    // Whoever reads who changed it meanwhile may set it all the same.
    setDraft(done.code === "CHANGED_MEANWHILE" && draft ? { ...draft, seen: latestSeen.current } : null);
    setSent(false);
  };
  const finish = (): void => {
    if (draft !== null && !isOvertaken && !isSent && draft.text !== current) void set(draft.text, draft.seen);
  };
  const id = `tunable-${tunable.name.replaceAll(".", "-")}`;
  const hasRange = tunable.minimum !== null && tunable.maximum !== null;
  const disabled = atS !== null;
  const isRate = tunable.kind === "LEARNING_RATE";
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
              onChange={(event) => write(event.target.value)}
              onPointerUp={finish}
              onKeyUp={finish}
            />
          )}
          <input
            id={id}
            type="text"
            inputMode={hasRange ? "decimal" : "text"}
            value={text}
            disabled={disabled}
            onChange={(event) => write(event.target.value)}
            onBlur={finish}
            onKeyDown={(event) => event.key === "Enter" && finish()}
          />
          <span className="unit">{tunable.unit}</span>
        </>
      )}
      <small className="range">
        {hasRange && `${words.range} ${formatNumber(tunable.minimum ?? 0)} – ${formatNumber(tunable.maximum ?? 0)} · `}
        {words.default} {shown(tunable.default)}
        {isRate && tunable.value === 0 && ` · ${words.frozen}`}
      </small>
      <span className="buttons">
        <button
          type="button"
          disabled={disabled || tunable.value === tunable.default}
          onClick={() => void set(shown(tunable.default))}
        >
          {words.reset}
        </button>
        {isRate && (
          <button type="button" disabled={disabled || tunable.value === 0} onClick={() => void set("0")}>
            {words.freeze}
          </button>
        )}
      </span>
      {isOvertaken && (
        <p className="overtaken" role="alert">
          {words.meanwhile}: {draft.over} → {current}
          {latest && ` ${words.by} ${latest.author}, ${formatTime(latest.at_s)}`}{" "}
          <button type="button" onClick={() => void set(draft.text)}>
            {words.setMine} ({draft.text})
          </button>{" "}
          <button type="button" onClick={() => setDraft(null)}>
            {words.takeTheirs}
          </button>
        </p>
      )}
    </div>
  );
}

function Profile({ agent, report }: { agent: AgentRecord; report: (text: string) => void }) {
  const { hello, atS } = useConnection();
  const order = useEntry("profiles", `${agent.name}|`);
  const [drafts, setDrafts] = useState<Record<string, number>>({});
  const disabled = atS !== null;
  const set = async (name: string): Promise<void> => {
    const value = drafts[name];
    if (value === undefined) return;
    const done = await operate("feedback", {
      feedback_id: `tuning/${crypto.randomUUID()}`,
      agent: agent.name,
      kind: "SET",
      values: Object.keys(order?.values ?? agent.current).map((one) => (one === name ? value : null)),
      source: "tuning",
      reason: words.tunedBy,
    });
    report(done.message);
    const { [name]: _sent, ...others } = drafts;
    setDrafts(others);
  };
  const reset = async (): Promise<void> => {
    report((await operate("profiles", { action: "RESET", agent: agent.name, author: words.author })).message);
  };
  return (
    <details>
      <summary>{words.profile}</summary>
      {Object.entries(agent.current).map(([name, value]) => {
        const range = hello?.parameters.find((one) => one.name === name);
        const id = `profile-${agent.name}-${name}`;
        const text = drafts[name] ?? value ?? 0;
        return (
          <div className="control" key={name}>
            <label htmlFor={id}>{name}</label>
            <input
              id={id}
              type="range"
              min={range?.minimum ?? 0}
              max={range?.maximum ?? 1}
              step="any"
              value={text}
              disabled={disabled}
              onChange={(event) => setDrafts({ ...drafts, [name]: Number(event.target.value) })}
              onPointerUp={() => void set(name)}
              onKeyUp={() => void set(name)}
              onBlur={() => void set(name)}
            />
            <span>{formatNumber(text)}</span>
            <small className="range">
              {words.default} {shown(agent.profile[name] ?? null)}
            </small>
          </div>
        );
      })}
      <button type="button" disabled={disabled} onClick={() => void reset()}>
        {words.reset}
      </button>
    </details>
  );
}

function Keep() {
  const { atS } = useConnection();
  const [profile, setProfile] = useState(false);
  const [found, setFound] = useState<KeepRecord | null>(null);
  const [answer, setAnswer] = useState("");
  const look = async (): Promise<void> => {
    const done = await operate("keep", { profile });
    setFound(done.accepted ? (done.record as KeepRecord) : null);
    setAnswer(done.accepted ? "" : done.message);
  };
  const write = async (digest: string): Promise<void> => {
    const done = await operate("keep", { profile, digest });
    setAnswer(done.message);
    setFound(null);
  };
  return (
    <section className="panel" aria-label={words.keep}>
      <h2>{words.keep}</h2>
      <div className="bar">
        <label>
          <input
            type="checkbox"
            checked={profile}
            onChange={(event) => {
              setProfile(event.target.checked);
              setFound(null);
            }}
          />{" "}
          {words.keepProfiles}
        </label>
        <button type="button" disabled={atS !== null} onClick={() => void look()}>
          {words.showChange}
        </button>
      </div>
      <output>{answer}</output>
      {found && found.diff === "" && <p className="empty">{words.nothingToKeep}</p>}
      {found && found.diff !== "" && (
        <>
          <pre tabIndex={0}>{found.diff}</pre>
          {found.tests.map((line) => (
            <p key={line} className={found.breaks ? "failure" : "place"}>
              {line}
            </p>
          ))}
          <button type="button" disabled={atS !== null} onClick={() => void write(found.digest)}>
            {found.breaks ? words.writeAnyway : words.write}
          </button>
        </>
      )}
    </section>
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
