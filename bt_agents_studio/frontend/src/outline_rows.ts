// SPDX-License-Identifier: Apache-2.0
// Rows of a tree's outline, and the rows to draw at a scroll offset; no drawing here.

import type { Shown } from "./tree_nesting";

export const ROW_PX = 24;
/** Rows drawn above and below the frame, so that scrolling shows no gap. */
const MARGIN = 8;
/** Most rows held on top: the root and the nearest ancestors. */
const MOST_HELD = 6;

export interface Row {
  shown: Shown;
  index: number;
  /** Index of the parent's row, -1 for a root. */
  parent: number;
  /** Place among its siblings, from 1, and the number of siblings. */
  place: number;
  siblings: number;
}

/** Rows of all nodes except those below a folded one, parents before children. */
export function rowsOf(roots: readonly Shown[], folded: ReadonlySet<string>): Row[] {
  const rows: Row[] = [];
  const add = (siblings: readonly Shown[], parent: number): void =>
    siblings.forEach((shown, at) => {
      const index = rows.length;
      rows.push({ shown, index, parent, place: at + 1, siblings: siblings.length });
      if (!folded.has(shown.node.path)) add(shown.children, index);
    });
  add(roots, -1);
  return rows;
}

/** Height of the held rows when a row is the first one below them [px]. */
export const heldPx = (row: Row): number => Math.min(row.shown.depth, MOST_HELD) * ROW_PX;

/** Ancestors of a row that are held on top: the root and the nearest ones. */
function heldAbove(rows: readonly Row[], row: Row | undefined): Row[] {
  const held: Row[] = [];
  for (let one = rows[row?.parent ?? -1]; one !== undefined; one = rows[one.parent]) held.unshift(one);
  held.splice(1, Math.max(held.length - MOST_HELD, 0));
  return held;
}

export interface Drawn {
  /** Root and ancestors of the first visible row, which stay on top. */
  held: readonly Row[];
  /** Placed rows in and near the frame. */
  rows: readonly Row[];
}

/** Rows to draw when a row is the first one in a frame of a given height. */
export function drawnAt(rows: readonly Row[], first: number, inFrame: number): Drawn {
  let covered = 0;
  while (covered < MOST_HELD && (rows[first + covered]?.shown.depth ?? 0) > covered) covered += 1;
  const held = heldAbove(rows, rows[first + covered]);
  const near = rows.slice(Math.max(first - MARGIN, 0), first + inFrame + MARGIN);
  return { held, rows: near.filter((one) => !held.includes(one)) };
}
