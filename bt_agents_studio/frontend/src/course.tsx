// SPDX-License-Identifier: Apache-2.0
// Changes over rounds and feedback: profiles, and contributions to distances.

import { useState } from "react";
import { useConnection } from "./connection";
import css from "./course.module.css";
import { formatNumber, formatTime } from "./formatting";
import type { ProfileStepRecord } from "./protocol";
import { Legend, seriesColour, total } from "./series";
import shared from "./shared.module.css";
import { useCollection } from "./store";
import { texts } from "./texts";

const words = texts.market;
const WIDTH = 600;
const HEIGHT = 150;
const EDGE = 8;

/** Cause of a step: who, why, and by which rule. */
export function causeOf(step: ProfileStepRecord): string {
  const rule = [`${words.rate} ${formatNumber(step.learning_rate)}`, `${words.weight} ${formatNumber(step.weight)}`];
  const wanted = step.parameters
    .map((name, index) => [name, step.target[index]] as const)
    .filter((one): one is readonly [string, number] => typeof one[1] === "number");
  if (wanted.length > 0) {
    rule.push(`${words.towards} ${wanted.map(([name, value]) => `${name} ${formatNumber(value)}`).join(", ")}`);
  }
  if (step.leaf) rule.push(`${words.leaf} ${step.leaf}`);
  if (step.false_rate !== null) rule.push(`${words.falseRate} ${Math.round(step.false_rate * 100)} %`);
  return rule.join(" · ");
}

/** One line per parameter, with a dot for each feedback that has moved it. */
export function ProfileCourse({ agent, layer }: { agent: string; layer: string }) {
  const { hello } = useConnection();
  const steps = useCollection("feedback")
    .map(([, one]) => one)
    .filter((one) => one.agent === agent && one.layer === layer);
  const first = steps[0];
  const last = steps.at(-1);
  if (first === undefined || last === undefined) return <p className={shared.faint}>{words.noSteps}</p>;
  const span = Math.max(last.at_s - first.at_s, 1);
  const x = (atS: number): number => EDGE * 3 + ((atS - first.at_s) / span) * (WIDTH - EDGE * 6);
  const range = (name: string): [number, number] => {
    const found = hello?.parameters.find((one) => one.name === name);
    return [found?.minimum ?? 0, found?.maximum ?? 1];
  };
  const y = (name: string, value: number): number => {
    const [low, high] = range(name);
    return HEIGHT - EDGE - ((value - low) / Math.max(high - low, 1e-9)) * (HEIGHT - 2 * EDGE);
  };
  return (
    <>
      <Legend names={first.parameters} />
      <svg className={css.course} viewBox={`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label={`${words.course}: ${agent}`}>
        {first.parameters.map((name, index) => {
          const begin = first.before[index];
          let path = typeof begin === "number" ? `M 0 ${y(name, begin)}` : "";
          for (const step of steps) {
            const value = step.after[index];
            if (typeof value !== "number") continue;
            path += path === "" ? `M ${x(step.at_s)} ${y(name, value)}` : ` H ${x(step.at_s)} V ${y(name, value)}`;
          }
          return (
            <g key={name} color={seriesColour(index)}>
              <path d={`${path} H ${WIDTH}`} />
              {steps.map((step) => {
                const value = step.after[index];
                if (typeof value !== "number" || value === step.before[index]) return null;
                return (
                  <circle key={step.revision} cx={x(step.at_s)} cy={y(name, value)} r={4}>
                    <title>
                      {`${formatTime(step.at_s)} ${name} ${formatNumber(value)}: ${step.kind.toLowerCase()}, ${step.source}` +
                        `${step.reason && `: ${step.reason}`} (${causeOf(step)})`}
                    </title>
                  </circle>
                );
              })}
            </g>
          );
        })}
      </svg>
      <p className={shared.faint}>
        {formatTime(first.at_s)} – {formatTime(last.at_s)}
      </p>
    </>
  );
}

/** Contribution of each parameter to the distance of one agent, round by round. */
export function Shares() {
  const rounds = useCollection("rounds").map(([, one]) => one);
  const names = rounds.at(-1)?.scene.values.map((one) => one.name) ?? [];
  const agents = [...new Set(rounds.flatMap((one) => one.ranking.map((bid) => bid.agent)))].sort();
  const [asked, setAsked] = useState("");
  const agent = asked || rounds.at(-1)?.winner || agents[0] || "";
  const shown = rounds
    .flatMap((round) => round.ranking.filter((bid) => bid.agent === agent).map((bid) => ({ round, bid })))
    .slice(-40);
  const longest = Math.max(...shown.map((one) => total(one.bid.contributions)), 1e-9);
  const step = WIDTH / Math.max(shown.length, 10);
  return (
    <section className={shared.panel} aria-label={words.shares}>
      <h2>{words.shares}</h2>
      <label>
        {texts.live.agent}{" "}
        <select value={agent} onChange={(event) => setAsked(event.target.value)}>
          {agents.map((one) => (
            <option key={one}>{one}</option>
          ))}
        </select>
      </label>
      <Legend names={names} />
      <svg className={css.shares} viewBox={`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label={`${words.shares}: ${agent}`}>
        {shown.map(({ round, bid }, place) => (
          <g key={`${round.epoch}/${round.round}`}>
            <title>{`${words.rounds} ${round.round}: ${bid.calculation}${round.winner === agent ? `, ${words.winner}` : ""}`}</title>
            {bid.contributions.map((value, index) => {
              const height = (value / longest) * (HEIGHT - 2 * EDGE);
              const below = (total(bid.contributions.slice(0, index)) / longest) * (HEIGHT - 2 * EDGE);
              return (
                <rect
                  key={names[index]}
                  color={seriesColour(index)}
                  x={place * step + 1}
                  y={HEIGHT - EDGE - below - height}
                  width={Math.max(step - 2, 1)}
                  height={height}
                />
              );
            })}
            {round.winner === agent && <circle cx={place * step + step / 2} cy={HEIGHT - EDGE / 2} r={3} />}
          </g>
        ))}
      </svg>
    </section>
  );
}
