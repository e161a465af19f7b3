// SPDX-License-Identifier: Apache-2.0
import { describe, expect, test } from "vitest";
import { badgeText } from "../src/badges";
import { drawnAt, rowsOf } from "../src/outline_rows";
import type { TreeNodeRecord, TreeRecord } from "../src/protocol";
import { HEIGHT, layOut, WIDTH, type Layout } from "../src/tree_layout";
import { byPathOf, find, nest, type Shown } from "../src/tree_nesting";

/** A tree of paths and the indices of their parents. */
function tree(...nodes: readonly [path: string, parent: number, kind: string, name?: string][]): TreeRecord {
  const place = { file: "agent.yaml", line: 1, column: 1 };
  return { agent: "agent", host: "/agents", nodes: nodes.map(([path, parent, kind, name]) => ({ path, parent, kind, name: name ?? kind, ...place })) };
}

/** A sequence of so many nodes, each with a child. */
const wide = (count: number): TreeRecord =>
  tree(
    ["tree", -1, "sequence"],
    ...Array.from({ length: count }, (_, index): [string, number, string][] => [
      [`tree/${index}`, 0, "sequence"],
      [`tree/${index}/0`, 2 * index + 1, "say"],
    ]).flat(),
  );

/** Nodes below each other. */
const deep = (count: number): TreeRecord =>
  tree(...Array.from({ length: count }, (_, depth): [string, number, string] => [`tree${"/0".repeat(depth)}`, depth - 1, "sequence"]));

const NONE: ReadonlySet<string> = new Set();
const paths = (shown: readonly Shown[]): string[] => shown.map((one) => one.node.path);

function overlaps({ placed }: Layout): boolean {
  const sorted = [...placed].sort((one, other) => one.x - other.x || one.y - other.y);
  return sorted.some((one, index) => {
    const next = sorted[index + 1];
    return next !== undefined && next.x < one.x + WIDTH && next.y < one.y + HEIGHT && next.x >= one.x;
  });
}

describe("nest", () => {
  const decorated = tree(
    ["tree", -1, "sequence"],
    ["tree/0@retry", 0, "retry", "retry 3"],
    ["tree/0@retry@timeout", 1, "timeout", "timeout 8 s"],
    ["tree/0", 2, "ask"],
    ["tree/1@on_failure", 0, "on_failure"],
    ["tree/1", 4, "drive"],
    ["tree/1@on_failure/0", 4, "say"],
  );

  test("decorators are badges of their node, outermost first", () => {
    const [root] = nest(decorated);
    expect(root?.children[0]?.node.path).toBe("tree/0");
    expect(root?.children[0]?.modifiers.map((one) => one.kind)).toEqual(["retry", "timeout"]);
  });

  test("a handler is a labelled branch below its node", () => {
    const drive = byPathOf(nest(decorated)).get("tree/1");
    expect(drive?.modifiers).toEqual([]);
    expect(drive?.children.map((one) => [one.node.path, one.handles])).toEqual([["tree/1@on_failure/0", "on_failure"]]);
  });

  test("a parent that comes later creates no cycle", () => {
    expect(paths(nest(tree(["a", 1, "say"], ["b", 0, "say"])))).toEqual(["a"]);
    expect(paths(nest(tree(["a", 0, "say"])))).toEqual(["a"]);
  });
});

describe("layOut", () => {
  test("no node lies on another one", () => {
    expect(overlaps(layOut(nest(wide(200)), NONE))).toBe(false);
  });

  test("children stand to the right of their parents, within the layout", () => {
    const layout = layOut(nest(wide(20)), NONE);
    for (const { x, y, parent } of layout.placed) {
      if (parent !== null) expect(x).toBeGreaterThanOrEqual(parent.x + WIDTH);
      expect(x + WIDTH).toBeLessThanOrEqual(layout.width);
      expect(y + HEIGHT).toBeLessThanOrEqual(layout.height);
    }
  });

  test("descendants of a folded node are not drawn", () => {
    const { placed } = layOut(nest(wide(2)), new Set(["tree/0"]));
    expect(placed.map((one) => one.shown.node.path)).toEqual(["tree", "tree/0", "tree/1", "tree/1/0"]);
  });

  test("a tree without nodes has no size", () => {
    expect(layOut([], NONE)).toMatchObject({ width: 0, height: 0 });
  });
});

describe("outline", () => {
  test("rows know their place among their siblings", () => {
    const rows = rowsOf(nest(wide(2)), NONE);
    expect(rows.map((one) => [one.shown.node.path, one.parent, one.place, one.siblings])).toEqual([
      ["tree", -1, 1, 1],
      ["tree/0", 0, 1, 2],
      ["tree/0/0", 1, 1, 1],
      ["tree/1", 0, 2, 2],
      ["tree/1/0", 3, 1, 1],
    ]);
  });

  test("a frame of 2,000 nodes draws only the rows in it and near it", () => {
    const rows = rowsOf(nest(wide(1_000)), NONE);
    expect(rows).toHaveLength(2_001);
    const drawn = drawnAt(rows, 1_000, 40);
    expect(drawn.rows.length).toBeLessThanOrEqual(40 + 2 * 8);
    expect(drawn.rows.some((one) => one.index === 1_039)).toBe(true);
  });

  test("the root and the nearest ancestors stay on top", () => {
    const rows = rowsOf(nest(deep(20)), NONE);
    const held = drawnAt(rows, 12, 5).held.map((one) => one.index);
    expect(held[0]).toBe(0);
    expect(held).toHaveLength(6);
    expect(held.slice(1)).toEqual([...held.slice(1)].sort((one, other) => one - other));
    expect(Math.max(...held)).toBeGreaterThan(12);
  });

  test("the first rows of a tree keep no ancestors on top", () => {
    expect(drawnAt(rowsOf(nest(deep(20)), NONE), 0, 5).held).toEqual([]);
  });
});

describe("find", () => {
  const record = tree(["tree", -1, "sequence"], ["tree/0@retry", 0, "retry"], ["tree/0", 1, "say", "say Hello"]);

  test("a search ignores case, and finds a node by its decorator", () => {
    expect(find(record, " HELLO ")).toEqual(["tree/0"]);
    expect(find(record, "retry")).toEqual(["tree/0"]);
  });

  test("an empty search finds nothing", () => {
    expect(find(record, "  ")).toEqual([]);
  });
});

describe("badgeText", () => {
  const node = (kind: string, name: string): TreeNodeRecord => ({ ...tree(["a@b", -1, kind, name]).nodes[0]! });

  test.each([
    ["retry", "retry 3", null, "↻ 3"],
    ["retry", "retry 3", 1, "↻ 2 of 3"],
    ["timeout", "timeout 8 s", null, "timeout 8 s"],
    ["guard", "guard …", null, "guard"],
  ])("%s is %s, %s left: %s", (kind, name, left, text) => {
    expect(badgeText(node(kind, name), left)).toBe(text);
  });
});
