// SPDX-License-Identifier: Apache-2.0
// Page "System": the parts of the system, their health, and the recordings.

import { useEffect, useState } from "react";
import { seek, useConnection } from "./connection";
import { Divider } from "./divider";
import { Empty } from "./empty";
import { formatTime } from "./formatting";
import { PanelBoundary } from "./panel_boundary";
import type { HealthRecord, JournalRecord } from "./protocol";
import shared from "./shared.module.css";
import { useCollection, useEntry } from "./store";
import css from "./system.module.css";
import { texts } from "./texts";

const words = texts.system;

export function System() {
  return (
    <div className={shared.columns}>
      <div className={shared.main}>
        <PanelBoundary label={words.processes}>
          <Processes />
        </PanelBoundary>
        <PanelBoundary label={words.problems}>
          <Problems />
        </PanelBoundary>
        <PanelBoundary label={words.health}>
          <HealthList />
        </PanelBoundary>
        <PanelBoundary label={words.hosts}>
          <Hosts />
        </PanelBoundary>
      </div>
      <div className={shared.side}>
        <Divider />
        <PanelBoundary label={words.parts}>
          <Parts />
        </PanelBoundary>
        <PanelBoundary label={words.journals}>
          <Journals />
        </PanelBoundary>
      </div>
    </div>
  );
}

function Hosts() {
  const hosts = useCollection("hosts");
  const agents = useCollection("agents");
  return (
    <section className={shared.panel} aria-label={words.hosts}>
      <h2>{words.hosts}</h2>
      {hosts.length === 0 && <Empty>{words.noHosts}</Empty>}
      {hosts.map(([name, host]) => (
        <div key={name}>
          <h3>{name}</h3>
          <p>{host.trees}</p>
          <ul>
            {agents
              .filter(([, one]) => one.host === name)
              .map(([key, one]) => (
                <li key={key}>
                  <b>{one.title || key}</b> · {words.version} {one.version}
                  {one.waiting && ` · ${words.waiting}`}
                  {one.degraded && ` · ${words.degraded}`}
                  <br />
                  <small>{one.description}</small>
                </li>
              ))}
          </ul>
        </div>
      ))}
    </section>
  );
}

function Problems() {
  const hosts = useCollection("hosts");
  const market = useEntry("market");
  const broken = [...hosts.flatMap(([, host]) => host.problems), ...(market?.problems ?? [])];
  const problems = [
    ...(market?.refused_hosts ?? []).map((host) => `${words.refuses} ${host}`),
    ...new Set(broken.map((one) => one.message)),
  ];
  const failures = useEntry("health", "studio: messages");
  return (
    <section className={shared.panel} aria-label={words.problems}>
      <h2>{words.problems}</h2>
      {problems.length === 0 && failures === undefined && <Empty>{words.noProblems}</Empty>}
      {failures && (
        <pre tabIndex={0}>
          {[failures.message, ...Object.entries(failures.values).map((one) => one.join(": "))].join("\n")}
        </pre>
      )}
      {problems.map((one) => (
        <pre key={one} tabIndex={0}>
          {one}
        </pre>
      ))}
    </section>
  );
}

function Parts() {
  const parts = useCollection("parts");
  return (
    <section className={shared.panel} aria-label={words.parts}>
      <h2>{words.parts}</h2>
      {parts.length === 0 && <Empty>{words.noParts}</Empty>}
      <ul className={css.parts}>
        {parts.map(([name, one]) => (
          <li key={name} data-alive={one.alive || undefined}>
            <b>{name}</b> {one.alive ? words.alive : `${words.gone} ${formatTime(one.seen_s)}`}
          </li>
        ))}
      </ul>
    </section>
  );
}

const SEVERITY = ["ERROR", "STALE", "WARN", "OK"];

type Told = readonly [string, HealthRecord];

/** Worst first. */
function bySeverity([a, one]: Told, [b, other]: Told): number {
  return SEVERITY.indexOf(one.level) - SEVERITY.indexOf(other.level) || a.localeCompare(b);
}

/** Name of a process in the health from "bt-agents up", after a namespace: machine, process. */
const PROCESS = /(?:^|\/)up on ([^:]*): (?!parameters$)(.*)$/;

/** Processes started by "bt-agents up", worst first. */
function Processes() {
  const found = useCollection("health").filter(([name]) => PROCESS.test(name)).sort(bySeverity);
  const machines = new Set(found.map(([name]) => PROCESS.exec(name)?.[1]));
  return (
    <section className={shared.panel} aria-label={words.processes}>
      <h2>{words.processes}</h2>
      <p className={shared.faint}>{found.length === 0 ? words.noProcesses : words.onlyOfUp}</p>
      {found.length > 0 && (
        <div className={css.processes} tabIndex={0}>
          <table>
            <thead>
              <tr>
                {Object.entries(words.columns).map(([key, title]) => (
                  <th key={key}>{title}</th>
                ))}
              </tr>
            </thead>
            <tbody>
              {found.map(([name, one]) => {
                const [, machine, process] = PROCESS.exec(name) ?? [];
                const { since, pid, restarts, cpu, memory, log, "last exit": exit } = one.values;
                return (
                  <tr key={name} data-level={one.level}>
                    <th>
                      {process} {machines.size > 1 && <small>{machine}</small>}
                    </th>
                    <td className={css.level}>{one.message}</td>
                    <td>{formatMoment(one.level === "STALE" ? one.since_s : Date.parse(since ?? "") / 1000)}</td>
                    <td>{pid}</td>
                    <td>{restarts}</td>
                    <td>{exit}</td>
                    <td>{cpu}</td>
                    <td>{memory}</td>
                    <td className={css.log}>{log}</td>
                  </tr>
                );
              })}
            </tbody>
          </table>
        </div>
      )}
    </section>
  );
}

/** A moment for people; empty if it is not a valid time. */
function formatMoment(atS: number): string {
  return Number.isFinite(atS) ? formatTime(atS) : "";
}

/** Health of the parts of the nodes, worst first. */
function HealthList() {
  const found = useCollection("health").filter(([name]) => !PROCESS.test(name));
  const sorted = [...found].sort(bySeverity);
  return (
    <section className={shared.panel} aria-label={words.health}>
      <h2>{words.health}</h2>
      {found.length === 0 && <Empty>{words.noHealth}</Empty>}
      <ul className={css.health}>
        {sorted.map(([name, one]) => (
          <li key={name} data-level={one.level}>
            <details>
              <summary>
                <b>{name}</b>{" "}
                <span className={css.level}>
                  {words.levels[one.level] ?? one.level} {words.since} {formatTime(one.since_s)}
                </span>{" "}
                {one.message}
              </summary>
              <dl>
                {Object.entries(one.values).map(([key, value]) => (
                  <div key={key}>
                    <dt>{key}</dt>
                    <dd>{value}</dd>
                  </div>
                ))}
              </dl>
            </details>
          </li>
        ))}
      </ul>
    </section>
  );
}

function Journals() {
  const { phase } = useConnection();
  const [found, setFound] = useState<JournalRecord[]>([]);
  const recording = useEntry("recording");
  useEffect(() => {
    if (phase !== "open") return;
    void fetch("/api/journals")
      .then((answer) => (answer.ok ? answer.json() : []))
      .then(setFound, () => setFound([]));
  }, [phase, recording?.file, recording?.recording]);
  return (
    <section className={shared.panel} aria-label={words.journals}>
      <h2>{words.journals}</h2>
      {recording === undefined && <Empty>{texts.world.noJournal}</Empty>}
      {found.length === 0 && <p className={shared.faint}>{phase === "refused" ? texts.connection.refused : words.noJournals}</p>}
      <ul>
        {found.map((one) => (
          <li key={one.name}>
            {one.label && <b>{one.label} </b>}
            {one.name} <small>{(one.bytes / 1e6).toFixed(1)} MB</small>{" "}
            <button type="button" onClick={() => seek(one.name, 2 ** 40)}>
              {words.look}
            </button>{" "}
            {/* A bag is a folder of files. */}
            {one.name.endsWith(".mcap") && (
              <a href={`/api/journals/${encodeURIComponent(one.name)}`} download={one.name}>
                {words.download}
              </a>
            )}
          </li>
        ))}
      </ul>
    </section>
  );
}
