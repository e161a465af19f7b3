// SPDX-License-Identifier: Apache-2.0
// Dry run: who would win for a scene, and from where on somebody else.

import { useState } from "react";
import { Legend } from "./course";
import { useConnection } from "./connection";
import { NumberPair, scaleOf } from "./fields";
import { formatNumber } from "./formatting";
import { OperationButton, Outcome, useOperation, WhyNot } from "./operation";
import type { DryRunRecord, ParameterRecord, SceneMapRecord } from "./protocol";
import { useEntry } from "./store";
import { texts } from "./texts";

const words = texts.market;
const SIDE = 240;
const COLOURS = 12;

export function DryRun() {
  const { hello } = useConnection();
  const parameters = hello?.parameters ?? [];
  const scene = useEntry("scene");
  const [given, setGiven] = useState<Record<string, number>>({});
  const [axes, setAxes] = useState<{ across?: string; up?: string }>({});
  const dryRun = useOperation("dry_run");
  const [found, setFound] = useState<DryRunRecord | null>(null);
  const valueOf = (one: ParameterRecord): number =>
    given[one.name] ?? scene?.values.find((value) => value.name === one.name)?.value ?? one.default;
  const across = axes.across ?? parameters[0]?.name ?? "";
  const up = axes.up ?? parameters.find((one) => one.name !== across)?.name ?? across;
  const ask = async (): Promise<void> => {
    const names = parameters.map((one) => one.name);
    const done = await dryRun.ask({ names, values: parameters.map(valueOf), across, up });
    if (done?.accepted) setFound(done.record as DryRunRecord);
  };
  const choose = (label: string, value: string, side: "across" | "up") => (
    <label>
      {label}{" "}
      <select value={value} onChange={(event) => setAxes({ ...axes, [side]: event.target.value })}>
        {parameters.map((one) => (
          <option key={one.name}>{one.name}</option>
        ))}
      </select>
    </label>
  );
  return (
    <section className="panel" aria-label={words.dryRun}>
      <h2>{words.dryRun}</h2>
      <p className="empty">{words.dryRunAbout}</p>
      {parameters.map((one) => (
        <div className="control" key={one.name}>
          <label htmlFor={`dry-run-${one.name}`}>{one.name}</label>
          <NumberPair
            id={`dry-run-${one.name}`}
            name={one.name}
            scale={scaleOf(one.minimum, one.maximum)}
            value={valueOf(one)}
            disabled={dryRun.whyNot !== ""}
            move={(value) => setGiven((before) => ({ ...before, [one.name]: value }))}
            set={(value) => setGiven((before) => ({ ...before, [one.name]: value }))}
          />
        </div>
      ))}
      <div className="bar">
        {choose(words.across, across, "across")}
        {choose(words.up, up, "up")}
        <OperationButton of={dryRun} disabled={parameters.length === 0} ask={ask}>
          {words.tryIt}
        </OperationButton>
        {dryRun.answer?.accepted === false && <Outcome of={[dryRun]} />}
      </div>
      <WhyNot of={dryRun} />
      {found && <Found record={found} parameters={parameters} />}
    </section>
  );
}

function Found({ record, parameters }: { record: DryRunRecord; parameters: readonly ParameterRecord[] }) {
  const { round, map } = record;
  const change = Object.entries(round.change).map(([name, value]) => `${name} ${formatNumber(value)}`);
  return (
    <>
      <p className="would-win">
        <b>{round.winner || words.nobody}</b> {words.wouldWin}. {round.reason}
      </p>
      <p>{change.length > 0 ? `${words.change} ${change.join(", ")}.` : words.noChange}</p>
      <SceneMap map={map} record={record} parameters={parameters} />
      <Legend names={map.agents.map((one) => one || words.nobody)} colours={COLOURS} />
      <p className="place">{map.is_asked ? words.askedMarket : words.computed}</p>
    </>
  );
}

interface SceneMapProps {
  map: SceneMapRecord;
  record: DryRunRecord;
  parameters: readonly ParameterRecord[];
}

function SceneMap({ map, record, parameters }: SceneMapProps) {
  const columns = map.xs.length;
  const width = SIDE / columns;
  const height = SIDE / map.ys.length;
  const at = (name: string): number => {
    const parameter = parameters.find((one) => one.name === name);
    const value = record.round.scene.values.find((one) => one.name === name)?.value;
    if (parameter === undefined || typeof value !== "number") return 0;
    return (value - parameter.minimum) / Math.max(parameter.maximum - parameter.minimum, 1e-9);
  };
  // Neighbours with the same winner are one area.
  const areas: { x: number; y: number; count: number; winner: number }[] = [];
  map.winners.forEach((winner, place) => {
    const x = place % columns;
    const last = areas.at(-1);
    if (last && x > 0 && last.winner === winner) last.count += 1;
    else areas.push({ x, y: Math.floor(place / columns), count: 1, winner });
  });
  return (
    <svg className="map" viewBox={`-30 -4 ${SIDE + 40} ${SIDE + 40}`} role="img" aria-label={`${map.across}, ${map.up}`}>
      {areas.map((one) => (
        <rect
          key={`${one.x} ${one.y}`}
          className={`series-${one.winner % COLOURS}`}
          x={one.x * width}
          y={SIDE - (one.y + 1) * height}
          width={one.count * width + 0.3}
          height={height + 0.3}
        >
          <title>{map.agents[one.winner] || words.nobody}</title>
        </rect>
      ))}
      <circle className="here" cx={width / 2 + at(map.across) * (SIDE - width)} cy={SIDE - height / 2 - at(map.up) * (SIDE - height)} r={6} />
      <text x={0} y={SIDE + 16}>{formatNumber(map.xs[0] ?? 0)}</text>
      <text x={SIDE / 2} y={SIDE + 30} textAnchor="middle">{map.across}</text>
      <text x={SIDE} y={SIDE + 16} textAnchor="end">{formatNumber(map.xs.at(-1) ?? 0)}</text>
      <text x={-4} y={SIDE} textAnchor="end">{formatNumber(map.ys[0] ?? 0)}</text>
      <text x={-4} y={10} textAnchor="end">{formatNumber(map.ys.at(-1) ?? 0)}</text>
      <text x={-12} y={SIDE / 2} textAnchor="middle" transform={`rotate(-90 -12 ${SIDE / 2})`}>{map.up}</text>
    </svg>
  );
}
