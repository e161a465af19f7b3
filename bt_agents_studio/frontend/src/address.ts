// SPDX-License-Identifier: Apache-2.0
// Address: page, agent, node, round, search, and a moment of a recording or the running system.

export const PAGES = ["live", "market", "tune", "world", "system"] as const;
export type Page = (typeof PAGES)[number];

/** Longest name, and longest name of a recording that the studio accepts [characters]. */
const LONGEST = 1000;
const LONGEST_SOURCE = 255;

/** Moment after the end of every recording [s since 1970]. */
const END_S = 2 ** 40;

export interface Address {
  /** null for a path that is not a page. */
  page: Page | null;
  /** Chosen on the page Live; empty for the agent of the newest run. */
  agent: string;
  node: string;
  /** Chosen on the page Market; empty for the newest round. */
  round: string;
  /** Search text of the page Tune. */
  search: string;
  /** Recording on show; empty for the running system. */
  source: string;
  /** Moment on show [s since 1970]; null for now. */
  atS: number | null;
}

const isPage = (name: string): name is Page => PAGES.some((one) => one === name);

function pageOf(path: string): Page | null {
  const name = path.replace(/^\/|\/$/g, "") || "live";
  return isPage(name) ? name : null;
}

/** Parse a path and a query; ignore texts that are too long and moments that are not numbers. */
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

/** Return path and query; a recording without a moment opens at its end. */
export function writeAddress(address: Address): string {
  const { page, agent, node, round, search, source, atS } = address;
  const at = atS === null || (source && atS >= END_S) ? "" : String(Math.round(atS * 1000) / 1000);
  const fields = Object.entries({ agent, node, round, search, from: source, at }).filter(([, value]) => value);
  return `/${page ?? ""}${fields.length > 0 ? `?${new URLSearchParams(fields)}` : ""}`;
}
