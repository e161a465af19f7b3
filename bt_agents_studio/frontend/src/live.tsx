// SPDX-License-Identifier: Apache-2.0
// Page "Live": the running tree and its context.

import { useCallback, useEffect, useMemo, useRef, useState } from "react";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { watchColours } from "./appearance";
import { nameWithoutKind } from "./badges";
import { BusyTime, Controls, NodeValues, PauseBanner, toggleBreakpoint, useBreakpoints } from "./control";
import { Divider } from "./divider";
import { Empty } from "./empty";
import { formatNumber, formatSeconds } from "./formatting";
import css from "./live.module.css";
import { Log, NodeResults } from "./log";
import { go, useAddress } from "./navigation";
import { useOperation, WhyNot } from "./operation";
import { PanelBoundary } from "./panel_boundary";
import type { SceneRecord } from "./protocol";
import shared from "./shared.module.css";
import { useCollection, useEntry } from "./store";
import { texts } from "./texts";
import { lineOf, TreePanel } from "./tree_panel";
import { useWidth } from "./width";

const PLOT_PX = 120;

export function Live() {
  const runs = useCollection("runs");
  const latest = useMemo(
    () => runs.map(([, run]) => run).sort((a, b) => b.began_s - a.began_s)[0],
    [runs],
  );
  const { agent: asked, node: chosen } = useAddress();
  const agent = asked || latest?.agent || "";
  const run = useEntry("runs", agent);
  const tree = useEntry("trees", agent);
  const trees = useCollection("trees");
  const card = useEntry("agents", agent);
  // Bind the node to its agent, so that another run does not replace it.
  const choose = useCallback((node: string) => go({ agent, node }, false), [agent]);
  const [answer, setAnswer] = useState("");
  const host = tree?.host ?? "";
  const stops = useBreakpoints(host, agent);
  const control = useOperation("control");
  const toggleStop = useCallback(
    (path: string): void => void toggleBreakpoint(control.ask, host, agent, path).then(setAnswer),
    [control.ask, host, agent],
  );
  const details = useRef<HTMLElement>(null);
  const showDetails = useCallback((): void => {
    details.current?.scrollIntoView({ block: "nearest" });
    details.current?.focus({ preventScroll: true });
  }, []);
  return (
    <div className={shared.columns}>
      <div className={shared.main}>
        <div className={shared.bar}>
          <label>
            {texts.live.agent}{" "}
            <select value={asked} onChange={(event) => go({ agent: event.target.value, node: "" }, true)}>
              <option value="">
                {texts.live.newest} {latest?.agent ?? "–"}
              </option>
              {asked && tree === undefined && <option>{asked}</option>}
              {trees.map(([name]) => (
                <option key={name}>{name}</option>
              ))}
            </select>
          </label>
          {run && (
            <span className={css.run}>
              {texts.live.round} {run.round} · {run.ended_s === null ? run.event.toLowerCase() : run.outcome.toLowerCase()}{" "}
              · {texts.live.tick} {run.tick}
              {run.message && ` · ${run.message}`}
            </span>
          )}
          <Controls host={host} agent={agent} say={setAnswer} />
          <output>{answer}</output>
        </div>
        <WhyNot of={control} />
        {tree ? (
          <>
            <PauseBanner host={host} tree={tree} tip={run?.tip ?? ""} />
            <PanelBoundary label={texts.live.tree}>
              <TreePanel
                key={agent}
                record={tree}
                tip={run?.ended_s === null ? run.tip : ""}
                chosen={chosen}
                choose={choose}
                stops={stops}
                toggleStop={toggleStop}
                showDetails={showDetails}
              />
            </PanelBoundary>
          </>
        ) : (
          <Empty>{agent ? (card ? texts.live.noTree : texts.live.noAgent) : texts.live.nobody}</Empty>
        )}
        <PanelBoundary label={texts.live.node}>
          <NodeDetails agent={agent} path={chosen} panel={details} />
        </PanelBoundary>
      </div>
      <div className={shared.side}>
        <Divider />
        <PanelBoundary label={texts.live.scene}>
          <ScenePanel />
        </PanelBoundary>
        <PanelBoundary label={texts.live.mood}>
          <MoodPanel agent={agent} />
        </PanelBoundary>
        <PanelBoundary label={texts.live.questions}>
          <Questions />
        </PanelBoundary>
        <PanelBoundary label={texts.live.log}>
          <Log />
        </PanelBoundary>
      </div>
    </div>
  );
}

interface NodeDetailsProps {
  agent: string;
  path: string;
  panel: React.RefObject<HTMLElement | null>;
}

function NodeDetails({ agent, path, panel }: NodeDetailsProps) {
  const record = useEntry("nodes", `${agent}|${path}`);
  const node = lineOf(agent, path);
  const host = useEntry("trees", agent)?.host ?? "";
  const file = useCollection("files").find(
    ([key]) => key.startsWith(`${host}|`) && node?.file.endsWith(key.slice(host.length + 1)),
  )?.[1];
  const lines = useMemo(() => {
    if (file === undefined || node === undefined) return [];
    return file.text
      .split("\n")
      .slice(Math.max(node.line - 2, 0), node.line + 7)
      .map((text, index) => ({ number: Math.max(node.line - 2, 0) + index + 1, text }));
  }, [file, node]);
  return (
    <section className={`${shared.panel} ${css.details}`} aria-label={texts.live.node} ref={panel} tabIndex={-1}>
      {node === undefined ? (
        <p className={shared.faint}>{texts.live.chooseNode}</p>
      ) : (
        <>
          <h2>
            {node.kind} <span>{nameWithoutKind(node)}</span>
          </h2>
          <p className={css.status} data-status={record?.status}>
            {texts.live.statuses[record?.status ?? "INVALID"] ?? record?.status}
            {record?.message && `: ${record.message}`}
          </p>
          {record && (
            <dl>
              <dt>{texts.live.starts}</dt>
              <dd>{record.starts}</dd>
              <dt>{texts.live.successes}</dt>
              <dd>{record.successes}</dd>
              <dt>{texts.live.failures}</dt>
              <dd>
                {record.failures} {record.reason && `(${texts.live.last}: ${record.reason})`}
              </dd>
              <dt>{texts.live.busy}</dt>
              <dd>
                <BusyTime record={record} />
              </dd>
            </dl>
          )}
          <NodeValues agent={agent} path={path} />
          <NodeResults agent={agent} path={path} />
          <p className={shared.faint}>
            {node.file}:{node.line} · {node.path}
          </p>
          <pre tabIndex={0}>
            {lines.map((line) => (
              <span key={line.number} className={line.number === node.line ? css.here : undefined}>
                {String(line.number).padStart(4)} {line.text}
                {"\n"}
              </span>
            ))}
          </pre>
        </>
      )}
    </section>
  );
}

function ScenePanel() {
  const scene = useEntry("scene");
  const live = useEntry("live");
  const names = (scene ?? live)?.values.map((one) => one.name) ?? [];
  return (
    <section className={shared.panel} aria-label={texts.live.scene}>
      <h2>
        {texts.live.scene} <span>{scene?.label}</span>
      </h2>
      <table>
        <thead>
          <tr>
            <th scope="col">
              <span className={shared.hidden}>{texts.live.scene}</span>
            </th>
            <th scope="col">{texts.live.awarded}</th>
            <th scope="col">{texts.live.liveScene}</th>
          </tr>
        </thead>
        <tbody>
          {names.map((name) => (
            <tr key={name}>
              <th scope="row">{name}</th>
              <Value scene={scene} name={name} />
              <Value scene={live} name={name} />
            </tr>
          ))}
        </tbody>
      </table>
    </section>
  );
}

function Value({ scene, name }: { scene: SceneRecord | undefined; name: string }) {
  const value = scene?.values.find((one) => one.name === name);
  if (value === undefined) return <td>–</td>;
  if (value.value === null) return <td className={shared.warning}>{texts.live.missing}</td>;
  const deviation = value.std ? ` ± ${formatNumber(value.std)}` : "";
  return (
    <td title={value.source}>
      {formatNumber(value.value)}
      {deviation} <small>{value.origin.toLowerCase()}{value.confidence < 1 ? `, ${Math.round(value.confidence * 100)} %` : ""}</small>
    </td>
  );
}

function MoodPanel({ agent }: { agent: string }) {
  const moods = useCollection("moods");
  const card = useEntry("agents", agent);
  const box = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const width = useWidth(box);
  useEffect(() => {
    if (box.current === null) return;
    const shade = (name: string) => () => getComputedStyle(document.body).getPropertyValue(name).trim();
    const line = shade("--line");
    const axis = { stroke: shade("--faint"), grid: { stroke: line }, ticks: { stroke: line } };
    plot.current = new uPlot(
      {
        width: box.current.clientWidth || 300,
        height: PLOT_PX,
        legend: { show: false },
        cursor: { show: false },
        axes: [axis, { ...axis, size: 34 }],
        series: [{}, { stroke: shade("--accent"), width: 2 }],
      },
      [[], []],
      box.current,
    );
    const unwatch = watchColours(() => plot.current?.redraw());
    return () => {
      unwatch();
      plot.current?.destroy();
    };
  }, []);
  useEffect(() => {
    if (width > 0) plot.current?.setSize({ width, height: PLOT_PX });
  }, [width]);
  useEffect(() => {
    plot.current?.setData([moods.map(([, one]) => one.at_s), moods.map(([, one]) => one.mood)]);
  }, [moods]);
  return (
    <section className={shared.panel} aria-label={texts.live.mood}>
      <h2>{texts.live.mood}</h2>
      <div className={css.plot} ref={box} />
      <ul className={css.rules}>
        {card?.rules.map((rule) => (
          <li key={rule.when}>
            <code>{rule.when}</code> {rule.hold_s > 0 && `for ${formatSeconds(rule.hold_s)}`} → {rule.give.toLowerCase()}
            {rule.cancels && ", stop"}
          </li>
        ))}
      </ul>
    </section>
  );
}

function Questions() {
  const record = useEntry("questions");
  if (record === undefined || record.questions.length === 0) return null;
  return (
    <section className={shared.panel} aria-label={texts.live.questions}>
      <h2>{texts.live.questions}</h2>
      {record.questions.map((one) => (
        <p key={one.at_s}>
          {one.text} <small>{one.choices.join(" · ") || texts.live.anyAnswer}</small>
        </p>
      ))}
    </section>
  );
}
