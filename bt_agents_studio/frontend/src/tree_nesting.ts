// SPDX-License-Identifier: Apache-2.0
// Nodes of a tree as they are shown: modifiers as badges, handlers as branches; and the search in them.

import type { TreeNodeRecord, TreeRecord } from "./protocol";
import { texts } from "./texts";

export interface Shown {
  node: TreeNodeRecord;
  /** Modifiers around the node, outermost first, without those that have a handler. */
  modifiers: TreeNodeRecord[];
  /** Key of the handler, such as "on_failure", if the node is one; else empty. */
  handles: string;
  /** The parent; for a handler, the node that it handles. */
  parent: Shown | null;
  /** Handlers come last. */
  children: Shown[];
  depth: number;
}

const isModifier = (node: TreeNodeRecord): boolean =>
  (node.path.split("/").at(-1) ?? "").includes("@");

/** Whether a node is the handler of the decorator around it, not the decorated node. */
const isHandler = (node: TreeNodeRecord, around: TreeNodeRecord): boolean =>
  isModifier(around) && isBelow(node.path, around.path);

/** Nodes with modifiers as badges, and handlers as branches of the nodes that they handle. */
export function nest(record: TreeRecord): Shown[] {
  const { nodes } = record;
  // Parents come before children; ignore any other place, which would form a cycle.
  const aroundOf = (index: number): number => {
    const parent = nodes[index]?.parent ?? -1;
    return parent < index ? parent : -1;
  };
  const withHandler = new Set<number>();
  nodes.forEach((node, index) => {
    const around = nodes[aroundOf(index)];
    if (around !== undefined && isHandler(node, around)) withHandler.add(aroundOf(index));
  });
  const made = new Map<string, Shown>();
  const roots: Shown[] = [];
  nodes.forEach((node, index) => {
    if (isModifier(node)) return;
    const modifiers: TreeNodeRecord[] = [];
    let inner = node;
    let place = aroundOf(index);
    let around = nodes[place];
    while (around !== undefined && isModifier(around) && !isHandler(inner, around)) {
      if (!withHandler.has(place)) modifiers.unshift(around);
      inner = around;
      place = aroundOf(place);
      around = nodes[place];
    }
    const parent = (around && made.get(withoutModifier(around.path))) ?? null;
    const isRoot = parent === null;
    const handles = around && isModifier(around) ? around.kind : isRoot && roots.length > 0 ? node.path : "";
    const shown: Shown = { node, modifiers, handles, parent, children: [], depth: isRoot ? 0 : parent.depth + 1 };
    made.set(node.path, shown);
    (isRoot ? roots : parent.children).push(shown);
  });
  return roots;
}

/** All nodes below some roots, including the roots. */
export function byPathOf(roots: readonly Shown[], found = new Map<string, Shown>()): ReadonlyMap<string, Shown> {
  for (const one of roots) {
    found.set(one.node.path, one);
    byPathOf(one.children, found);
  }
  return found;
}

/** When a handler runs, as text; empty for any other node. */
export const branchOf = (shown: Shown): string => texts.live.handlers[shown.handles] ?? shown.handles;

/** Whether a node is below another one, according to its path. */
const isBelow = (path: string, other: string): boolean => path.startsWith(`${other}/`);

/** Path of the node that a modifier belongs to; the same path for any other node. */
export const withoutModifier = (path: string): string => path.replace(/@[^/]*$/, "");

/** Paths of the matching nodes in tree order; a match in a modifier yields its node. */
export function find(record: TreeRecord, search: string): string[] {
  const wanted = search.trim().toLowerCase();
  if (wanted === "") return [];
  const fits = (one: TreeNodeRecord): boolean => `${one.kind} ${one.name} ${one.path}`.toLowerCase().includes(wanted);
  return [...new Set(record.nodes.filter(fits).map((one) => withoutModifier(one.path)))];
}
