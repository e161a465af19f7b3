// SPDX-License-Identifier: Apache-2.0
// Pause, steps and breakpoints of a run, and the countdowns and values of its nodes.

import { memo, useEffect, useState } from "react";
import { author } from "./author";
import { useConnection } from "./connection";
import css from "./control.module.css";
import { formatNumber, formatSeconds } from "./formatting";
import { OperationButton, useOperation, type Operation } from "./operation";
import type { ControlRecord, NodeRecord, Operations, TreeRecord } from "./protocol";
import shared from "./shared.module.css";
import { readEntry, useCollection, useEntry } from "./store";
import { texts } from "./texts";

const FRAME_MS = 200;

type Action = NonNullable<Operations["control"]["action"]>;

const none: readonly string[] = [];

/** Paths of the nodes of an agent before which its runs pause. */
export function useBreakpoints(host: string, agent: string): readonly string[] {
  return useEntry("controls", host)?.breakpoints[agent] ?? none;
}

/** Set or remove the breakpoint of a node; returns the host's answer. */
export async function toggleBreakpoint(
  ask: Operation<"control">["ask"],
  host: string,
  agent: string,
  path: string,
): Promise<string> {
  const before = readEntry("controls", host)?.breakpoints[agent] ?? none;
  const paths = before.includes(path) ? before.filter((one) => one !== path) : [...before, path];
  const done = await ask({ host, action: "BREAKPOINTS", agent, paths, author: author() });
  return done?.message ?? "";
}

interface ControlsProps {
  host: string;
  agent: string;
  say: (answer: string) => void;
}

/** Buttons that pause, resume and step the tree; enabled only while this agent runs. */
export function Controls({ host, agent, say }: ControlsProps) {
  const control = useEntry("controls", host);
  const { atS } = useConnection();
  const hold = useOperation("control");
  const isOn = atS === null && control !== undefined && control.agent === agent && agent !== "";
  const isPaused = isOn && control.paused;
  const ask = async (action: Action): Promise<void> => {
    const { epoch, round } = control ?? { epoch: "", round: 0 };
    const done = await hold.ask({ host, action, epoch, round, author: author() });
    if (done !== null) say(done.message);
  };
  return (
    <>
      <OperationButton of={hold} disabled={!isOn || isPaused} ask={() => ask("PAUSE")}>
        {texts.control.pause}
      </OperationButton>
      <OperationButton of={hold} disabled={!isPaused} ask={() => ask("RESUME")}>
        {texts.control.resume}
      </OperationButton>
      <OperationButton of={hold} disabled={!isPaused} ask={() => ask("STEP")}>
        {texts.control.step}
      </OperationButton>
    </>
  );
}

/** Why the run is paused; empty while it runs. */
export function PauseBanner({ host, tree, tip }: { host: string; tree: TreeRecord; tip: string }) {
  const control = useEntry("controls", host);
  const isPaused = control?.paused === true && control.agent === tree.agent;
  const nameOf = (path: string): string => {
    const node = tree.nodes.find((one) => one.path === path);
    return node ? `${node.name} (${path})` : path;
  };
  return (
    <div className={isPaused ? `${shared.panel} ${css.paused}` : shared.hidden} role="status">
      {isPaused && <b>{pauseText(control, nameOf, tip)}</b>}
      {isPaused && <span> {texts.control.held}</span>}
    </div>
  );
}

function pauseText(control: ControlRecord, nameOf: (path: string) => string, tip: string): string {
  if (control.paused_at) return `${texts.control.before} ${nameOf(control.paused_at)}`;
  const by = control.author && ` ${texts.control.by} ${control.author}`;
  return `${texts.control.paused}${by}${tip && `, ${texts.control.at} ${nameOf(tip)}`}`;
}

interface LeftProps {
  agent: string;
  host: string;
  paths: readonly string[];
  x: number;
  y: number;
}

/** Remaining limits of a node and its modifiers, counted down between messages. */
export const Left = memo(function Left({ agent, host, paths, x, y }: LeftProps) {
  return (
    <text className={css.left} aria-hidden="true" x={x} y={y}>
      {paths.map((path) => (
        <LeftOf key={path} agent={agent} host={host} path={path} />
      ))}
    </text>
  );
});

function LeftOf({ agent, host, path }: Omit<LeftProps, "paths" | "x" | "y"> & { path: string }) {
  const left = useLeft(agent, host, path);
  if (left === null) return null;
  const { kind, remaining } = left.countdown;
  const parts = [left.text, remaining !== null && `${formatNumber(remaining)} ${texts.control.more}`].filter(Boolean);
  return (
    <tspan dx={path.includes("@") ? 8 : 0} data-left={path}>
      {kind} {parts.join(", ")}
    </tspan>
  );
}

/** Remaining time of a node or a modifier, as a bar and text; nothing without a time limit. */
export function TimeLeft({ agent, host, path }: { agent: string; host: string; path: string }) {
  const left = useLeft(agent, host, path);
  if (left === null || left.text === "") return null;
  const percent = left.countdown.whole_s ? (100 * left.seconds) / left.countdown.whole_s : 0;
  return (
    <span className={css.timeLeft} data-left={path}>
      <span className={css.whole}>
        <span style={{ width: `${percent}%` }} />
      </span>
      {left.text} {texts.live.left}
    </span>
  );
}

/** Countdown of a node, and the time that remains at the moment on show. */
function useLeft(agent: string, host: string, path: string) {
  const countdown = useEntry("countdowns", `${agent}|${path}`);
  const control = useEntry("controls", host);
  const { atS, offsetS } = useConnection();
  const stands = control?.paused === true;
  const runs = countdown !== undefined && countdown.remaining_s !== null && !stands && atS === null;
  const nowS = useNow(runs) + offsetS;
  if (countdown === undefined) return null;
  const passed = stands ? 0 : Math.max((atS ?? nowS) - countdown.at_s, 0);
  const seconds = Math.max((countdown.remaining_s ?? 0) - passed, 0);
  const text = countdown.remaining_s === null ? "" : `${seconds.toFixed(seconds < 10 ? 1 : 0)} s`;
  return { countdown, seconds, text };
}

/** Total running time of a node, including the current stretch. */
export function BusyTime({ record }: { record: NodeRecord }) {
  const { atS, offsetS } = useConnection();
  const isRunning = record.status === "RUNNING";
  const nowS = useNow(isRunning && atS === null) + offsetS;
  const stretchS = isRunning ? Math.max((atS ?? nowS) - record.since_s, 0) : 0;
  return <>{formatSeconds(record.busy_s + stretchS)}</>;
}

/** Clock of the page [s since 1970]; advances only while needed. */
function useNow(isNeeded: boolean): number {
  const [nowS, setNowS] = useState(Date.now() / 1000);
  useEffect(() => {
    if (!isNeeded) return;
    const tick = (): void => setNowS(Date.now() / 1000);
    tick();
    const timer = window.setInterval(tick, FRAME_MS);
    return () => window.clearInterval(timer);
  }, [isNeeded]);
  return nowS;
}

/** Values that a node and its modifiers have read and written, newest first. */
export function NodeValues({ agent, path }: { agent: string; path: string }) {
  const own = `${agent}|${path}`;
  const shown = useCollection("values")
    .filter(([key]) => key === own || key.startsWith(`${own}@`))
    .flatMap(([key, record]) => record.values.map((one) => ({ ...one, key })))
    .sort((one, other) => other.at_s - one.at_s);
  if (shown.length === 0) return null;
  return (
    <table className={css.nodeValues}>
      <caption>{texts.control.values}</caption>
      <tbody>
        {shown.map((one) => (
          <tr key={`${one.key} ${one.name} ${String(one.written)}`}>
            <th scope="row">{one.name}</th>
            <td>
              <code>{one.value}</code>
            </td>
            <td>
              <small>
                {one.written ? texts.control.written : texts.control.read}, {texts.live.tick} {one.tick}
              </small>
            </td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
