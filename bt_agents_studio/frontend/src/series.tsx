// SPDX-License-Identifier: Apache-2.0
// Colours of the series in charts, and their legend.

import css from "./series.module.css";

/** Parameters with a colour of their own in a chart of parameters. */
const PARAMETERS = 6;

export const seriesColour = (index: number, colours = PARAMETERS): string => `var(--series-${index % colours})`;

export function Legend({ names, colours = PARAMETERS }: { names: readonly string[]; colours?: number }) {
  return (
    <ul className={css.legend}>
      {names.map((name, index) => (
        <li key={name}>
          <span className={css.swatch} style={{ color: seriesColour(index, colours) }} />
          {name}
        </li>
      ))}
    </ul>
  );
}

export const total = (values: readonly number[]): number => values.reduce((added, value) => added + value, 0);
