// SPDX-License-Identifier: Apache-2.0
// The address of what is shown: page, agent, node, round, and moment of a recording or of the running system.

export const PAGES = ["live", "market", "tune", "world", "system", "person"] as const;
export type Page = (typeof PAGES)[number];

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

/** Return what a path and a query say; what is no number is no moment. */
export function readAddress(path: string, query: string): Address {
  const fields = new URLSearchParams(query);
  const text = (name: string): string => fields.get(name) ?? "";
  const source = text("from");
  const at = /^\d+(\.\d+)?$/.test(text("at")) ? Math.min(Number(text("at")), END_S) : null;
  return {
    page: pageOf(path),
    agent: text("agent"),
    node: text("node"),
    round: text("round"),
    source,
    atS: at ?? (source ? END_S : null),
  };
}

/** Return path and query; a recording without a moment is shown at its end. */
export function writeAddress(address: Address): string {
  const { page, agent, node, round, source, atS } = address;
  const at = atS === null || (source && atS >= END_S) ? "" : String(Math.round(atS * 1000) / 1000);
  const fields = Object.entries({ agent, node, round, from: source, at }).filter(([, value]) => value);
  return `/${page ?? ""}${fields.length > 0 ? `?${new URLSearchParams(fields)}` : ""}`;
}
