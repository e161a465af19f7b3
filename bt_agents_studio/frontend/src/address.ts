// SPDX-License-Identifier: Apache-2.0
// The address of what is shown: page, agent, node, round, search, and moment of a recording or of the running system.

export const PAGES = ["live", "market", "tune", "world", "system"] as const;
export type Page = (typeof PAGES)[number];

/** Characters of a name; of a recording, as the studio takes no longer ones. */
const LONGEST = 1000;
const LONGEST_SOURCE = 255;

/** Moment after the end of every recording [s since 1970]. */
const END_S = 2 ** 40;

export interface Address {
  /** null for a path that is no page. */
  page: Page | null;
  /** Chosen on the page Live; empty for the one of the newest run. */
  agent: string;
  node: string;
  /** Chosen on the page Market; empty for the newest. */
  round: string;
  /** What the page Tune searches. */
  search: string;
  /** Recording that is shown; empty for the running system. */
  source: string;
  /** Moment that is shown [s since 1970]; null for now. */
  atS: number | null;
}

const isPage = (name: string): name is Page => PAGES.some((one) => one === name);

function pageOf(path: string): Page | null {
  const name = path.replace(/^\/|\/$/g, "") || "live";
  return isPage(name) ? name : null;
}

/** Return what a path and a query say; what is too long, or no number for a moment, is left out. */
export function readAddress(path: string, query: string): Address {
  const fields = new URLSearchParams(query);
  const text = (name: string, longest = LONGEST): string => {
    const found = fields.get(name) ?? "";
    return found.length <= longest ? found : "";
  };
  const source = text("from", LONGEST_SOURCE);
  const at = /^\d+(\.\d+)?$/.test(text("at")) ? Math.min(Number(text("at")), END_S) : null;
  return {
    page: pageOf(path),
    agent: text("agent"),
    node: text("node"),
    round: text("round"),
    search: text("search"),
    source,
    atS: at ?? (source ? END_S : null),
  };
}

/** Return path and query; a recording without a moment is shown at its end. */
export function writeAddress(address: Address): string {
  const { page, agent, node, round, search, source, atS } = address;
  const at = atS === null || (source && atS >= END_S) ? "" : String(Math.round(atS * 1000) / 1000);
  const fields = Object.entries({ agent, node, round, search, from: source, at }).filter(([, value]) => value);
  return `/${page ?? ""}${fields.length > 0 ? `?${new URLSearchParams(fields)}` : ""}`;
}
