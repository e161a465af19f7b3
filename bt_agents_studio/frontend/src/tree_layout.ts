// SPDX-License-Identifier: Apache-2.0
// Places of a tree's nodes in its map.

import { hierarchy, tree as tidyTree } from "d3-hierarchy";
import type { Shown } from "./tree_nesting";

export const WIDTH = 176;
export const HEIGHT = 36;
const COLUMN = 210;
const ROW = 52;
const MARGIN = 24;

export interface Placed {
  shown: Shown;
  x: number;
  y: number;
  parent: Placed | null;
}

export interface Layout {
  /** Nodes outside folded ones, parents before children. */
  placed: readonly Placed[];
  at: ReadonlyMap<string, Placed>;
  width: number;
  height: number;
}

/** Places of all nodes except those below a folded one. */
export function layOut(roots: readonly Shown[], folded: ReadonlySet<string>): Layout {
  const placed: Placed[] = [];
  const at = new Map<string, Placed>();
  const first = roots[0];
  if (first === undefined) return { placed, at, width: 0, height: 0 };
  const virtual: Shown = { ...first, children: [...roots], depth: -1 };
  const root = hierarchy(virtual, (one) => (folded.has(one.node.path) && one !== virtual ? [] : one.children));
  tidyTree<Shown>().nodeSize([ROW, COLUMN])(root);
  let top = Infinity;
  root.each((one) => {
    top = Math.min(top, one.x ?? 0);
  });
  let width = 0;
  let height = 0;
  root.eachBefore((one) => {
    if (one.data === virtual) return;
    const parent = one.parent === null ? null : (at.get(one.parent.data.node.path) ?? null);
    const item: Placed = {
      shown: one.data,
      x: (one.y ?? 0) - COLUMN + MARGIN,
      y: (one.x ?? 0) - top + MARGIN,
      parent: one.depth > 1 ? parent : null,
    };
    at.set(one.data.node.path, item);
    placed.push(item);
    width = Math.max(width, item.x + WIDTH);
    height = Math.max(height, item.y + HEIGHT);
  });
  return { placed, at, width: width + MARGIN * 2, height: height + MARGIN };
}
