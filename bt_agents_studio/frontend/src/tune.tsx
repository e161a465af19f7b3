// SPDX-License-Identifier: Apache-2.0
// Page "Tune": every tunable value of every agent, in the running system.

import { useRef, useState } from "react";
import { author, AuthorField } from "./author";
import { operate, useConnection, type Answer } from "./connection";
import { Divider } from "./divider";
import { Empty } from "./empty";
import { NumberField, NumberPair, scaleOf, Slider, useDraft, useNewest, useSliding } from "./fields";
import fieldCss from "./fields.module.css";
import { exactNumber, formatNumber, formatTime } from "./formatting";
import { go, useAddress } from "./navigation";
import { isUnheard, OperationButton, Outcome, useOperation, WhyNot, type Operation } from "./operation";
import { PanelBoundary } from "./panel_boundary";
import type { AgentRecord, KeepRecord, PresetRecord, TunableRecord, TuningRecord, TuningsRecord } from "./protocol";
import shared from "./shared.module.css";
import { useCollection, useEntry } from "./store";
import { texts } from "./texts";
import css from "./tune.module.css";
import { offerUndo } from "./undo";

const words = texts.tune;
const RUNS_MS = 1000;

const isDifferent = (one: TunableRecord): boolean => one.value !== one.default;

export function Tune() {
  const tunables = useCollection("tunables");
  const tunings = useCollection("tunings");
  const agents = useCollection("agents");
  const running = useRunning();
  const may = useOperation("tune");
  const [onlyDifferent, setOnlyDifferent] = useState(false);
  /** Names of the values that somebody moves or types; they stay, even if they become those of the file. */
  const changed = useRef(new Set<string>());
  const { search } = useAddress();
  const latest = new Map<string, TuningRecord>();
  const revisions = new Map<string, number>();
  for (const [host, one] of tunings) {
    revisions.set(host, one.revision);
    for (const tuning of one.tunings) latest.set(tuning.name, tuning);
  }
  const titles = new Map(agents.map(([name, one]) => [name, one.title]));
  const wanted = search.trim().toLowerCase();
  const isWanted = (one: TunableRecord): boolean =>
    `${one.name} ${titles.get(one.agent) ?? ""} ${one.description}`.toLowerCase().includes(wanted);
  const groups = new Map<string, TunableRecord[]>();
  for (const [, one] of tunables) {
    if ((onlyDifferent && !isDifferent(one) && !changed.current.has(one.name)) || !isWanted(one)) continue;
    const group = one.agent || one.host;
    groups.set(group, [...(groups.get(group) ?? []), one]);
  }
  const isFirst = (name: string): number => (name === running ? 0 : 1);
  const sorted = [...groups].sort(([a], [b]) => isFirst(a) - isFirst(b) || a.localeCompare(b));
  return (
    <div className={shared.columns}>
      <div className={shared.main}>
        <div className={shared.bar}>
          <input
            type="search"
            aria-label={words.search}
            placeholder={words.search}
            value={search}
            onChange={(event) => go({ search: event.target.value }, false)}
          />
          <label>
            <input
              type="checkbox"
              checked={onlyDifferent}
              onChange={(event) => {
                changed.current.clear();
                setOnlyDifferent(event.target.checked);
              }}
            />{" "}
            {words.differs}
          </label>
          <span className={shared.faint}>
            {tunables.filter(([, one]) => isDifferent(one)).length} {words.differences}
          </span>
          <AuthorField />
        </div>
        <WhyNot of={may} />
        {tunables.length === 0 && <Empty>{words.none}</Empty>}
        {tunables.length > 0 && sorted.length === 0 && <p className={shared.faint}>{words.notFound}</p>}
        {sorted.map(([group, values]) => (
          <PanelBoundary key={group} label={group}>
            <Group
              name={group}
              isOpen={group === running || sorted.length === 1 || onlyDifferent || wanted !== ""}
              isRunning={group === running}
              changes={(name) => changed.current.add(name)}
              values={values}
              latest={latest}
              revisions={revisions}
            />
          </PanelBoundary>
        ))}
      </div>
      <div className={shared.side}>
        <Divider />
        <PanelBoundary label={words.keep}>
          <Keep />
        </PanelBoundary>
        {tunings.map(([host, one]) => (
          <PanelBoundary key={host} label={words.history}>
            <History host={host} record={one} />
          </PanelBoundary>
        ))}
      </div>
    </div>
  );
}

/** The agent that runs, or ran last; empty for none. */
function useRunning(): string {
  const runs = useCollection("runs", RUNS_MS).map(([, run]) => run);
  return runs.sort((a, b) => b.began_s - a.began_s)[0]?.agent ?? "";
}

const written = (tunable: TunableRecord, value: string): string =>
  tunable.unit && value.trim() !== "" && !Number.isNaN(Number(value)) ? `${value} ${tunable.unit}` : value;

const exact = (value: TunableRecord["value"]): string =>
  typeof value === "number" ? exactNumber(value) : String(value ?? "");

interface GroupProps {
  name: string;
  isOpen: boolean;
  isRunning: boolean;
  /** Called when somebody moves or types a value. */
  changes: (name: string) => void;
  values: TunableRecord[];
  latest: ReadonlyMap<string, TuningRecord>;
  revisions: ReadonlyMap<string, number>;
}

function Group({ name, isOpen, isRunning, changes, values, latest, revisions }: GroupProps) {
  const agent = useEntry("agents", name);
  const [asked, setAsked] = useState<boolean | null>(null);
  const open = asked ?? isOpen;
  const different = values.filter(isDifferent).length;
  return (
    <section className={shared.panel} aria-label={name}>
      {/* What somebody changes here stays, also when another agent runs. */}
      <details open={open} onChange={() => setAsked(true)}>
        <summary
          onClick={(event) => {
            event.preventDefault();
            setAsked(!open);
          }}
        >
          <h2>
            {agent?.title || name} {agent?.title && <span>{name}</span>}
          </h2>{" "}
          <span className={shared.faint}>
            {isRunning && `${words.running} · `}
            {values.length} {values.length === 1 ? words.value : words.values}
            {different > 0 && ` · ${different} ${words.differences}`}
          </span>
        </summary>
        {open &&
          values.map((one) => (
            <Control
              key={one.name}
              tunable={one}
              changes={changes}
              latest={latest.get(one.name)}
              revision={revisions.get(one.host) ?? 0}
            />
          ))}
        {open && agent && <Profile agent={agent} />}
      </details>
    </section>
  );
}

interface ControlProps {
  tunable: TunableRecord;
  changes: (name: string) => void;
  latest: TuningRecord | undefined;
  /** Revision of the last change of the host that this page has received. */
  revision: number;
}

function Control({ tunable, changes, latest, revision }: ControlProps) {
  const set = useOperation("tune");
  const slide = useOperation("tune");
  const current = exact(tunable.value);
  // The answer to a change may arrive before the change itself.
  const confirmed = useRef(0);
  const seenNow = useRef(0);
  seenNow.current = Math.max(revision, confirmed.current);
  const drafting = useDraft(current, seenNow.current);
  const { draft } = drafting;
  const isOvertaken = draft !== null && !set.isPending && draft.over !== current;
  const fields = (value: string, seen: number) => ({
    host: tunable.host,
    action: "SET" as const,
    author: author(),
    names: [tunable.name],
    values: [written(tunable, value)],
    compare: true,
    seen,
  });
  const note = (done: Answer, value: string): void => {
    if (!done.accepted) return;
    const revision = done.revision ?? 0;
    confirmed.current = revision;
    offerUndo({
      topic: tunable.name,
      from: current,
      to: value,
      text: (from) => `${tunable.name}: ${written(tunable, from)} → ${written(tunable, value)}`,
      takeBack: (from) => operate("tune", fields(from, revision)),
    });
  };
  const newest = useNewest();
  const commit = async (text: string, seenBefore?: number): Promise<void> => {
    await newest.stop();
    const seen = seenBefore ?? seenNow.current;
    const done = await set.ask(fields(text, seen));
    if (done === null) return;
    note(done, text);
    // Keep a value that no service received, or that was typed before another change.
    if (isUnheard(done)) drafting.keep({ text, over: draft?.over ?? current, seen });
    else if (done.code === "CHANGED_MEANWHILE" && draft) drafting.keep({ ...draft, seen: seenNow.current });
    else drafting.drop();
  };
  const finish = async (): Promise<void> => {
    if (draft === null || isOvertaken) return;
    if (draft.text === current) drafting.drop();
    else await commit(draft.text, draft.seen);
  };
  const moved = useRef(0);
  const slideTo = async (value: number): Promise<boolean> => {
    const done = await slide.ask(fields(exactNumber(value), seenNow.current));
    if (done !== null) note(done, exactNumber(value));
    if (done?.accepted) return true;
    if (done !== null && isUnheard(done)) drafting.write(exactNumber(moved.current));
    sliding.drop();
    return false;
  };
  const number = typeof tunable.value === "number" ? tunable.value : (tunable.minimum ?? 0);
  const sliding = useSliding(number, newest.isBusy);
  const id = `tunable-${tunable.name.replaceAll(".", "-")}`;
  const hasRange = tunable.minimum !== null && tunable.maximum !== null;
  const disabled = set.whyNot !== "";
  const isRate = tunable.kind === "LEARNING_RATE";
  return (
    <div className={fieldCss.row} onChange={() => changes(tunable.name)}>
      <label htmlFor={id}>
        {tunable.key} <small>{tunable.description}</small>
      </label>
      {tunable.type === "BOOLEAN" ? (
        <input
          id={id}
          type="checkbox"
          checked={tunable.value === true}
          disabled={disabled}
          onChange={(event) => void commit(String(event.target.checked))}
        />
      ) : (
        <>
          {hasRange && (
            <Slider
              label={`${tunable.name} slider`}
              scale={scaleOf(tunable.minimum ?? 0, tunable.maximum ?? 1, tunable.step, tunable.type === "INTEGER")}
              sliding={sliding}
              disabled={disabled}
              mark={typeof tunable.default === "number" ? tunable.default : undefined}
              move={(value) => {
                moved.current = value;
                drafting.drop();
                newest.push(tunable.name, () => slideTo(value));
              }}
            />
          )}
          <NumberField
            id={id}
            value={hasRange ? exactNumber(sliding.shown) : current}
            drafting={drafting}
            disabled={disabled}
            isNumber={hasRange}
            commit={() => void finish()}
          />
          <span className={fieldCss.unit}>{tunable.unit}</span>
        </>
      )}
      <small className={fieldCss.range}>
        {hasRange && `${words.range} ${exactNumber(tunable.minimum ?? 0)} – ${exactNumber(tunable.maximum ?? 0)} · `}
        {words.default} {exact(tunable.default)}
        {isRate && tunable.value === 0 && ` · ${words.frozen}`}
      </small>
      <span className={fieldCss.buttons}>
        {draft !== null && !isOvertaken && (
          <OperationButton of={set} ask={finish}>
            {words.set}
          </OperationButton>
        )}
        <OperationButton of={set} disabled={!isDifferent(tunable)} ask={() => commit(exact(tunable.default))}>
          {words.reset}
        </OperationButton>
        {isRate && (
          <OperationButton of={set} disabled={tunable.value === 0} ask={() => commit("0")}>
            {words.freeze}
          </OperationButton>
        )}
      </span>
      {isOvertaken && (
        <p className={fieldCss.overtaken} role="alert">
          {words.meanwhile}: {draft.over} → {current}
          {latest && ` ${words.by} ${latest.author}, ${formatTime(latest.at_s)}`}{" "}
          <OperationButton of={set} ask={() => commit(draft.text)}>
            {words.setMine} ({draft.text})
          </OperationButton>{" "}
          <button type="button" onClick={drafting.drop}>
            {words.takeTheirs}
          </button>
        </p>
      )}
      <Outcome of={[set, slide]} />
    </div>
  );
}

function Profile({ agent }: { agent: AgentRecord }) {
  const { hello } = useConnection();
  const order = useEntry("profiles", `${agent.name}|`);
  const give = useOperation("feedback");
  const manage = useOperation("profiles");
  const newest = useNewest();
  const names = Object.keys(order?.values ?? agent.current);
  const vector = (name: string, value: number) => names.map((one) => (one === name ? value : null));
  const fields = (name: string, value: number) => ({
    feedback_id: `tuning/${crypto.randomUUID()}`,
    agent: agent.name,
    kind: "SET" as const,
    values: vector(name, value),
    source: "tuning",
    reason: words.tunedBy,
  });
  const set = async (name: string, value: number, drop: (keeps: boolean) => void): Promise<boolean> => {
    const before = agent.current[name] ?? null;
    const done = await give.ask(fields(name, value));
    if (!done?.accepted) {
      drop(done !== null && isUnheard(done));
      return false;
    }
    if (before === null) return true;
    offerUndo({
      topic: `profile ${agent.name} ${name}`,
      from: exact(before),
      to: exact(value),
      text: (from) => `${agent.name}: ${name} ${from} → ${exact(value)}`,
      takeBack: (from) => operate("feedback", { ...fields(name, Number(from)), expected: vector(name, value) }),
    });
    return true;
  };
  const reset = async (): Promise<void> => {
    await newest.stop();
    const done = await manage.ask({ action: "RESET", agent: agent.name, author: author() });
    if (done?.accepted) {
      offerUndo({
        topic: `profile ${agent.name}`,
        from: "",
        text: () => done.message,
        takeBack: () => {
          const expected = names.map((name) => agent.profile[name] ?? null);
          return operate("profiles", { action: "UNDO", agent: agent.name, author: author(), expected });
        },
      });
    }
  };
  return (
    <details>
      <summary>{words.profile}</summary>
      {Object.entries(agent.current).map(([name, value]) => {
        const range = hello?.parameters.find((one) => one.name === name);
        const id = `profile-${agent.name}-${name}`;
        const inFile = agent.profile[name] ?? null;
        return (
          <div className={fieldCss.row} key={name}>
            <label htmlFor={id}>{name}</label>
            <NumberPair
              id={id}
              name={name}
              scale={scaleOf(range?.minimum ?? 0, range?.maximum ?? 1)}
              value={value ?? 0}
              mark={inFile ?? undefined}
              disabled={give.whyNot !== ""}
              isSent
              set={(next, drop) => newest.push(name, () => set(name, next, drop))}
            />
            <small className={fieldCss.range}>
              {words.default} {exact(inFile)}
            </small>
          </div>
        );
      })}
      <OperationButton of={manage} ask={reset}>
        {words.reset}
      </OperationButton>
      <Outcome of={[give, manage]} />
    </details>
  );
}

function Keep() {
  const keep = useOperation("keep");
  const [profile, setProfile] = useState(false);
  const [found, setFound] = useState<KeepRecord | null>(null);
  const look = async (): Promise<void> => {
    const done = await keep.ask({ profile });
    setFound(done?.accepted ? (done.record as KeepRecord) : null);
  };
  const write = async (digest: string): Promise<void> => {
    if ((await keep.ask({ profile, digest })) !== null) setFound(null);
  };
  return (
    <section className={shared.panel} aria-label={words.keep}>
      <h2>{words.keep}</h2>
      <div className={shared.bar}>
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
        <OperationButton of={keep} ask={look}>
          {words.showChange}
        </OperationButton>
      </div>
      <WhyNot of={keep} />
      {found === null && <Outcome of={[keep]} />}
      {found && found.diff === "" && <p className={shared.faint}>{words.nothingToKeep}</p>}
      {found && found.diff !== "" && (
        <>
          <pre tabIndex={0}>{found.diff}</pre>
          {found.tests.map((line) => (
            <p key={line} className={found.breaks ? shared.failure : shared.faint}>
              {line}
            </p>
          ))}
          <OperationButton of={keep} ask={() => write(found.digest)}>
            {found.breaks ? words.writeAnyway : words.write}
          </OperationButton>
        </>
      )}
    </section>
  );
}

interface HistoryProps {
  host: string;
  record: TuningsRecord;
}

function History({ host, record }: HistoryProps) {
  const tune = useOperation("tune");
  const [name, setName] = useState("");
  const ask = (action: "UNDO" | "REDO" | "SAVE", preset = ""): Promise<Answer | null> =>
    tune.ask({ host, action, preset, author: author() });
  const save = async (): Promise<void> => {
    const done = await ask("SAVE", name);
    if (done?.accepted) setName("");
  };
  const isTaken = record.presets.some((one) => one.name === name.trim());
  return (
    <section className={shared.panel} aria-label={words.history}>
      <h2>
        {words.history} <span>{host}</span>
      </h2>
      <div className={shared.bar}>
        <OperationButton of={tune} disabled={record.undo === ""} title={record.undo} ask={() => ask("UNDO")}>
          {words.undo}
        </OperationButton>
        <OperationButton of={tune} disabled={record.redo === ""} title={record.redo} ask={() => ask("REDO")}>
          {words.redo}
        </OperationButton>
      </div>
      <Outcome of={[tune]} />
      <h3>{words.presets}</h3>
      {record.presets.length === 0 && <p className={shared.faint}>{words.noPresets}</p>}
      {record.presets.map((one) => (
        <Preset key={one.name} host={host} preset={one} tune={tune} />
      ))}
      <form
        className={shared.bar}
        onSubmit={(event) => {
          event.preventDefault();
          void save();
        }}
      >
        <input aria-label={words.save} value={name} onChange={(event) => setName(event.target.value)} />
        <OperationButton of={tune} disabled={name === "" || isTaken}>
          {words.save}
        </OperationButton>
        {isTaken && (
          <OperationButton of={tune} ask={save}>
            {words.replace}
          </OperationButton>
        )}
      </form>
      <ol className={shared.lines} tabIndex={0}>
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

interface PresetProps {
  host: string;
  preset: PresetRecord;
  tune: Operation<"tune">;
}

/** A preset, and the changes that it would make now. */
function Preset({ host, preset, tune }: PresetProps) {
  const tunables = new Map(useCollection("tunables").map(([key, one]) => [key, one]));
  const changes = Object.entries(preset.settings).flatMap(([name, setting]) => {
    const tunable = tunables.get(`${host}|${name}`);
    if (tunable === undefined || String(tunable.value) === String(setting)) return [];
    return [{ name, tunable, written: preset.values[name] ?? "" }];
  });
  const ask = (action: "APPLY" | "FORGET"): Promise<Answer | null> =>
    tune.ask({ host, action, preset: preset.name, author: author() });
  const apply = async (): Promise<void> => {
    const before = {
      host,
      action: "SET" as const,
      author: author(),
      names: changes.map(({ name }) => name),
      values: changes.map(({ tunable }) => written(tunable, exact(tunable.value))),
    };
    const done = await ask("APPLY");
    if (!done?.accepted || changes.length === 0) return;
    offerUndo({
      topic: `preset ${host} ${preset.name}`,
      from: "",
      text: () => done.message,
      takeBack: () => operate("tune", { ...before, compare: true, seen: done.revision ?? 0 }),
    });
  };
  return (
    <details className={css.preset}>
      <summary>
        <b>{preset.name}</b>{" "}
        <span className={shared.faint}>{changes.length === 0 ? words.inForce : `${words.wouldChange} ${changes.length}`}</span>
      </summary>
      {changes.length > 0 && (
        <table>
          <tbody>
            {changes.map(({ name, tunable, written: after }) => (
              <tr key={name}>
                <th scope="row">{name}</th>
                <td>
                  {typeof tunable.value === "number" ? formatNumber(tunable.value) : String(tunable.value)} {tunable.unit} →{" "}
                  {after}
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
      <div className={shared.bar}>
        <OperationButton of={tune} ask={apply}>
          {words.apply}
        </OperationButton>
        <OperationButton of={tune} ask={() => ask("FORGET")}>
          {words.delete}
        </OperationButton>
      </div>
    </details>
  );
}
