// SPDX-License-Identifier: Apache-2.0
// Places of a tree's nodes, and which of them a search finds; nothing here draws.

import { hierarchy, tree as tidyTree } from "d3-hierarchy";
import type { TreeNodeRecord, TreeRecord } from "./protocol";

export const WIDTH = 176;
export const HEIGHT = 36;
const COLUMN = 210;
const ROW = 52;
const MARGIN = 24;

export interface Shown {
  node: TreeNodeRecord;
  /** Modifiers around the node, outermost first. */
  modifiers: TreeNodeRecord[];
  children: Shown[];
  depth: number;
}

export interface Placed {
  shown: Shown;
  x: number;
  y: number;
  parent: Placed | null;
}

export interface Layout {
  /** Nodes that are not below a folded one, parents before children. */
  placed: readonly Placed[];
  at: ReadonlyMap<string, Placed>;
  width: number;
  height: number;
}

const isModifier = (node: TreeNodeRecord): boolean =>
  (node.path.split("/").at(-1) ?? "").includes("@");

/** Nodes with their modifiers as badges, instead of as nodes of their own. */
export function nest(record: TreeRecord): Shown[] {
  const made = new Map<number, Shown>();
  const roots: Shown[] = [];
  const pending = new Map<number, TreeNodeRecord[]>();
  record.nodes.forEach((node, index) => {
    if (isModifier(node)) {
      pending.set(index, [...(pending.get(node.parent) ?? []), node]);
      return;
    }
    const modifiers = pending.get(node.parent) ?? [];
    const outermost = modifiers[0] ?? node;
    const parent = made.get(outermost.parent);
    const shown: Shown = { node, modifiers, children: [], depth: parent ? parent.depth + 1 : 0 };
    made.set(index, shown);
    if (parent) parent.children.push(shown);
    else roots.push(shown);
  });
  return roots;
}

/** Places of all nodes but those below a folded one. */
export function layOut(roots: readonly Shown[], folded: ReadonlySet<string>): Layout {
  const placed: Placed[] = [];
  const at = new Map<string, Placed>();
  const first = roots[0];
  if (first === undefined) return { placed, at, width: 0, height: 0 };
  const virtual: Shown = { node: first.node, modifiers: [], children: [...roots], depth: -1 };
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

/** Whether a node is below another one, as its path says. */
export const isBelow = (path: string, other: string): boolean => path.startsWith(`${other}/`);

/** Path of the node that a modifier belongs to; the same path for any other node. */
export const withoutModifier = (path: string): string => path.replace(/@[^/]*$/, "");

/** Paths of the nodes that a search finds, in the order of the tree; a modifier stands for its node. */
export function find(record: TreeRecord, search: string): string[] {
  const wanted = search.trim().toLowerCase();
  if (wanted === "") return [];
  const fits = (one: TreeNodeRecord): boolean => `${one.kind} ${one.name} ${one.path}`.toLowerCase().includes(wanted);
  return [...new Set(record.nodes.filter(fits).map((one) => withoutModifier(one.path)))];
}
