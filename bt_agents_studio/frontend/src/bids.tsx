// SPDX-License-Identifier: Apache-2.0
// Bids of a round, best first, and the change that would make the runner-up win.

import css from "./bids.module.css";
import { formatNumber } from "./formatting";
import type { RoundRecord } from "./protocol";
import { Legend, seriesColour, total } from "./series";
import shared from "./shared.module.css";
import { texts } from "./texts";

const words = texts.market;

export function Bids({ round }: { round: RoundRecord }) {
  const names = round.scene.values.map((one) => one.name);
  const longest = Math.max(...round.ranking.map((one) => total(one.contributions)), 1e-9);
  return (
    <>
      <Legend names={names} />
      <table className={css.bids}>
        <tbody>
          {round.ranking.map((bid) => (
            <tr key={bid.agent} data-winner={bid.agent === round.winner || undefined}>
              <th scope="row">{bid.agent}</th>
              <td className={shared.number}>{bid.score === null ? "–" : formatNumber(bid.score)}</td>
              <td className={css.stack}>
                <svg viewBox="0 0 100 6" preserveAspectRatio="none" role="img" aria-label={bid.calculation}>
                  {bid.contributions.map((value, index) => (
                    <rect
                      key={names[index]}
                      color={seriesColour(index)}
                      x={(total(bid.contributions.slice(0, index)) / longest) * 100}
                      width={(value / longest) * 100}
                      height={6}
                    />
                  ))}
                </svg>
              </td>
              <td>
                <small>{bid.calculation}</small>
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </>
  );
}

/** The smallest change of the scene that makes the runner-up win. */
export function smallestChange(round: RoundRecord): string {
  const change = Object.entries(round.change).map(([name, value]) => `${name} ${formatNumber(value)}`);
  if (change.length > 0) return `${words.change} ${change.join(", ")}.`;
  return round.ranking.length > 1 ? words.noChange : "";
}
