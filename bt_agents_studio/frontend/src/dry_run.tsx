// SPDX-License-Identifier: Apache-2.0
// Dry run: the winner for a scene, and a map of where other agents would win.

import { useRef, useState } from "react";
import { Bids, smallestChange } from "./bids";
import { useConnection, type Answer } from "./connection";
import css from "./dry_run.module.css";
import { NumberPair, scaleOf, useNewest } from "./fields";
import fieldCss from "./fields.module.css";
import { formatNumber } from "./formatting";
import { OperationButton, useOperation, WhyNot } from "./operation";
import type { DryRunRecord, Operations, ParameterRecord, RoundRecord, SceneMapRecord } from "./protocol";
import { Legend, seriesColour } from "./series";
import shared from "./shared.module.css";
import { useEntry } from "./store";
import { texts } from "./texts";

const words = texts.market;
const SIDE = 240;
const COLOURS = 12;

type Values = Readonly<Record<string, number>>;

/** A map, and the scene around which it was drawn. */
interface Drawn {
  map: SceneMapRecord;
  values: Values;
}

export function DryRun() {
  const { hello } = useConnection();
  const parameters = hello?.parameters ?? [];
  const scene = useEntry("scene");
  const [given, setGiven] = useState<Values>({});
  const wanted = useRef(given);
  const [axes, setAxes] = useState<{ across?: string; up?: string }>({});
  const race = useOperation("dry_run");
  const drawing = useOperation("dry_run");
  const newest = useNewest();
  const [round, setRound] = useState<RoundRecord | null>(null);
  const [drawn, setDrawn] = useState<Drawn | null>(null);
  const [refusal, setRefusal] = useState("");
  const valuesOf = (some: Values): Values =>
    Object.fromEntries(
      parameters.map(({ name, default: usual }) => [
        name,
        some[name] ?? scene?.values.find((one) => one.name === name)?.value ?? usual,
      ]),
    );
  const values = valuesOf(given);
  const across = axes.across ?? parameters[0]?.name ?? "";
  const up = axes.up ?? parameters.find((one) => one.name !== across)?.name ?? across;
  const show = (done: Answer): void => {
    setRound(done.accepted ? (done.record as DryRunRecord).round : null);
    setRefusal(done.accepted ? "" : done.message);
  };
  const step = async (fields: Operations["dry_run"]): Promise<boolean> => {
    const done = await race.ask(fields);
    if (done !== null) show(done);
    // A refused scene says nothing about the scene that waits.
    return true;
  };
  const follow = (change: Values): void => {
    wanted.current = { ...wanted.current, ...change };
    setGiven(wanted.current);
    const next = fieldsOf(valuesOf(wanted.current));
    newest.push("scene", () => step(next));
  };
  const draw = async (): Promise<void> => {
    const asked = wanted.current;
    const done = await drawing.ask({ ...fieldsOf(values), across, up });
    if (done === null) return;
    const map = done.accepted ? (done.record as DryRunRecord).map : null;
    setDrawn(map && { map, values });
    // Meanwhile the bids may belong to another scene.
    if (asked === wanted.current) show(done);
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
    <section className={shared.panel} aria-label={words.dryRun}>
      <h2>{words.dryRun}</h2>
      <p className={shared.faint}>{words.dryRunAbout}</p>
      {parameters.map(({ name, minimum, maximum }) => (
        <div className={fieldCss.row} key={name}>
          <label htmlFor={`dry-run-${name}`}>{name}</label>
          <NumberPair
            id={`dry-run-${name}`}
            name={name}
            scale={scaleOf(minimum, maximum)}
            value={values[name] ?? minimum}
            disabled={race.whyNot !== ""}
            move={(value) => follow({ [name]: value })}
            set={(value) => wanted.current[name] !== value && follow({ [name]: value })}
          />
        </div>
      ))}
      <WhyNot of={race} />
      {refusal && <output className={shared.failure}>{refusal}</output>}
      {round && (
        <>
          <p>
            <b>{round.winner || words.nobody}</b> {words.wouldWin}. {round.reason}
          </p>
          <Bids round={round} />
          <p className={shared.bar}>
            {smallestChange(round)}
            {Object.keys(round.change).length > 0 && (
              <button type="button" disabled={race.whyNot !== ""} onClick={() => follow(round.change)}>
                {words.goThere}
              </button>
            )}
          </p>
        </>
      )}
      <div className={shared.bar}>
        {choose(words.across, across, "across")}
        {choose(words.up, up, "up")}
        <OperationButton of={drawing} disabled={parameters.length === 0} ask={draw}>
          {words.drawMap}
        </OperationButton>
      </div>
      {drawn && <SceneMap drawn={drawn} values={values} parameters={parameters} />}
    </section>
  );
}

const fieldsOf = (values: Values): Operations["dry_run"] => ({
  names: Object.keys(values),
  values: Object.values(values),
});

interface SceneMapProps {
  drawn: Drawn;
  /** The scene now; if it differs in more than the two axes, the map belongs to another scene. */
  values: Values;
  parameters: readonly ParameterRecord[];
}

function SceneMap({ drawn: { map, values: around }, values, parameters }: SceneMapProps) {
  const columns = map.xs.length;
  const width = SIDE / columns;
  const height = SIDE / map.ys.length;
  const at = (name: string): number => {
    const parameter = parameters.find((one) => one.name === name);
    const value = values[name];
    if (parameter === undefined || value === undefined) return 0;
    return (value - parameter.minimum) / Math.max(parameter.maximum - parameter.minimum, 1e-9);
  };
  const isOther = parameters.some(
    ({ name }) => name !== map.across && name !== map.up && values[name] !== around[name],
  );
  // Neighbours with the same winner form one area.
  const areas: { x: number; y: number; count: number; winner: number }[] = [];
  map.winners.forEach((winner, place) => {
    const x = place % columns;
    const last = areas.at(-1);
    if (last && x > 0 && last.winner === winner) last.count += 1;
    else areas.push({ x, y: Math.floor(place / columns), count: 1, winner });
  });
  return (
    <>
      <svg className={css.map} viewBox={`-30 -4 ${SIDE + 40} ${SIDE + 40}`} role="img" aria-label={`${map.across}, ${map.up}`}>
        {areas.map((one) => (
          <rect
            key={`${one.x} ${one.y}`}
            color={seriesColour(one.winner, COLOURS)}
            x={one.x * width}
            y={SIDE - (one.y + 1) * height}
            width={one.count * width + 0.3}
            height={height + 0.3}
          >
            <title>{map.agents[one.winner] || words.nobody}</title>
          </rect>
        ))}
        <circle cx={width / 2 + at(map.across) * (SIDE - width)} cy={SIDE - height / 2 - at(map.up) * (SIDE - height)} r={6} />
        <text x={0} y={SIDE + 16}>{formatNumber(map.xs[0] ?? 0)}</text>
        <text x={SIDE / 2} y={SIDE + 30} textAnchor="middle">{map.across}</text>
        <text x={SIDE} y={SIDE + 16} textAnchor="end">{formatNumber(map.xs.at(-1) ?? 0)}</text>
        <text x={-4} y={SIDE} textAnchor="end">{formatNumber(map.ys[0] ?? 0)}</text>
        <text x={-4} y={10} textAnchor="end">{formatNumber(map.ys.at(-1) ?? 0)}</text>
        <text x={-12} y={SIDE / 2} textAnchor="middle" transform={`rotate(-90 -12 ${SIDE / 2})`}>{map.up}</text>
      </svg>
      <Legend names={map.agents.map((one) => one || words.nobody)} colours={COLOURS} />
      <p className={shared.faint}>{map.is_asked ? words.askedMarket : words.computed}</p>
      {isOther && <p className={shared.warning}>{words.otherMap}</p>}
    </>
  );
}
