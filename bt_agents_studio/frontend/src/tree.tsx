// SPDX-License-Identifier: Apache-2.0
// Behaviour tree as SVG: one subscription a node; what is far outside of the view is not drawn.

import { hierarchy, tree as tidyTree } from "d3-hierarchy";
import { memo, useEffect, useLayoutEffect, useMemo, useRef, useState } from "react";
import type { NodeRecord, TreeNodeRecord, TreeRecord } from "./protocol";
import { readEntry, useEntry } from "./store";
import { texts } from "./texts";

const COLUMN = 210;
const ROW = 46;
const WIDTH = 176;
const HEIGHT = 36;
const CELL = 500;
const MARGIN = 24;

interface Shown {
  node: TreeNodeRecord;
  /** Modifiers around the node, outermost first. */
  modifiers: TreeNodeRecord[];
  children: Shown[];
  depth: number;
}

interface Placed {
  shown: Shown;
  x: number;
  y: number;
  parent: Placed | null;
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

function place(roots: Shown[], folded: ReadonlySet<string>): Placed[] {
  const virtual: Shown = { node: roots[0]!.node, modifiers: [], children: roots, depth: -1 };
  const root = hierarchy(virtual, (one) => (folded.has(one.node.path) && one !== virtual ? [] : one.children));
  tidyTree<Shown>().nodeSize([ROW, COLUMN])(root);
  const placed = new Map<unknown, Placed>();
  let top = Infinity;
  root.each((one) => {
    top = Math.min(top, one.x ?? 0);
  });
  const all: Placed[] = [];
  root.eachBefore((one) => {
    if (one.data === virtual) return;
    const item: Placed = {
      shown: one.data,
      x: (one.y ?? 0) - COLUMN + MARGIN,
      y: (one.x ?? 0) - top + MARGIN,
      parent: placed.get(one.parent) ?? null,
    };
    placed.set(one, item);
    all.push(item);
  });
  return all;
}

const status = (record: NodeRecord | undefined): string => (record?.status ?? "INVALID").toLowerCase();
const shorten = (text: string, most: number): string =>
  text.length > most ? `${text.slice(0, most - 1)}…` : text;

const Edge = memo(function Edge({ agent, item }: { agent: string; item: Placed }) {
  const record = useEntry("nodes", `${agent}|${item.shown.node.path}`);
  const from = item.parent;
  if (from === null) return null;
  const x = from.x + WIDTH;
  const middle = (x + item.x) / 2;
  const y0 = from.y + HEIGHT / 2;
  const y1 = item.y + HEIGHT / 2;
  return <path className={`edge ${status(record)}`} d={`M${x},${y0}C${middle},${y0} ${middle},${y1} ${item.x},${y1}`} />;
});

interface CellProps {
  agent: string;
  item: Placed;
  isTip: boolean;
  isChosen: boolean;
  isFound: boolean;
  isFolded: boolean;
  choose: (path: string) => void;
  fold: (path: string) => void;
}

const Cell = memo(function Cell({ agent, item, isTip, isChosen, isFound, isFolded, choose, fold }: CellProps) {
  const { node, modifiers, children, depth } = item.shown;
  const record = useEntry("nodes", `${agent}|${node.path}`);
  const state = status(record);
  const reason = state === "failure" ? (record?.message ?? "") : "";
  const classes = ["node", state, isTip && "tip", isChosen && "chosen", isFound && "found"].filter(Boolean).join(" ");
  const label = `${node.kind} ${node.name}, ${state}${reason ? `: ${reason}` : ""}`;
  return (
    <g
      className={classes}
      transform={`translate(${item.x},${item.y})`}
      role="treeitem"
      aria-level={depth + 1}
      aria-selected={isChosen}
      {...(children.length > 0 ? { "aria-expanded": !isFolded } : {})}
      aria-label={label}
      tabIndex={isChosen ? 0 : -1}
      data-path={node.path}
      onClick={() => choose(node.path)}
      onDoubleClick={() => children.length > 0 && fold(node.path)}
    >
      <rect width={WIDTH} height={HEIGHT} rx={7} />
      <text className="kind" x={10} y={14}>
        {shorten(node.kind, 26)}
      </text>
      <text className="name" x={10} y={28}>
        {shorten(reason || node.name, 24)}
      </text>
      {modifiers.map((one, index) => (
        <Badge key={one.path} agent={agent} node={one} x={WIDTH - 8 - index * 16} />
      ))}
      {isFolded && (
        <text className="folded" x={WIDTH + 6} y={HEIGHT / 2 + 4}>
          +{children.length}
        </text>
      )}
      <title>{`${label}\n${node.path}`}</title>
    </g>
  );
});

const Badge = memo(function Badge({ agent, node, x }: { agent: string; node: TreeNodeRecord; x: number }) {
  const record = useEntry("nodes", `${agent}|${node.path}`);
  return (
    <g className={`badge ${status(record)}`} transform={`translate(${x},2)`}>
      <circle r={8} />
      <text y={3.5} textAnchor="middle">
        {node.kind.slice(0, 1)}
      </text>
      <title>{`${node.kind}: ${status(record)} ${record?.message ?? ""}`}</title>
    </g>
  );
});

interface TreeProps {
  record: TreeRecord;
  tip: string;
  chosen: string;
  choose: (path: string) => void;
}

export function Tree({ record, tip, chosen, choose }: TreeProps) {
  const frame = useRef<HTMLDivElement>(null);
  const [folded, setFolded] = useState<ReadonlySet<string>>(new Set());
  const [search, setSearch] = useState("");
  const [zoom, setZoom] = useState(1);
  const [cells, setCells] = useState("0,0,3,3");
  const roots = useMemo(() => nest(record), [record]);
  const placed = useMemo(() => (roots.length > 0 ? place(roots, folded) : []), [roots, folded]);
  const width = Math.max(...placed.map((one) => one.x + WIDTH), 0) + MARGIN * 2;
  const height = Math.max(...placed.map((one) => one.y + HEIGHT), 0) + MARGIN;
  const tipNode = useMemo(() => withoutModifier(record, tip), [record, tip]);

  useEffect(() => setFolded(new Set()), [record.agent]);

  const measure = (): void => {
    const box = frame.current;
    if (box === null) return;
    const scale = zoom * CELL;
    const first = (value: number): number => Math.floor(value / scale) - 1;
    const last = (value: number): number => Math.floor(value / scale) + 1;
    setCells(
      [
        first(box.scrollLeft),
        first(box.scrollTop),
        last(box.scrollLeft + box.clientWidth),
        last(box.scrollTop + box.clientHeight),
      ].join(","),
    );
  };
  useLayoutEffect(measure, [zoom, placed]);

  const visible = useMemo(() => {
    const [left = 0, top = 0, right = 0, bottom = 0] = cells.split(",").map(Number);
    const within = (one: Placed): boolean => {
      const column = Math.floor(one.x / CELL);
      const row = Math.floor(one.y / CELL);
      return column >= left && column <= right && row >= top && row <= bottom;
    };
    return placed.filter((one) => within(one) || (one.parent !== null && within(one.parent)));
  }, [placed, cells]);

  const show = (path: string): void => {
    const item = placed.find((one) => one.shown.node.path === path);
    const box = frame.current;
    if (item === undefined || box === null) return;
    box.scrollTo({
      left: item.x * zoom - box.clientWidth / 2 + (WIDTH * zoom) / 2,
      top: item.y * zoom - box.clientHeight / 2,
    });
  };
  const fold = (path: string): void =>
    setFolded((before) => {
      const after = new Set(before);
      if (!after.delete(path)) after.add(path);
      return after;
    });
  const found = useMemo(() => {
    const wanted = search.trim().toLowerCase();
    if (wanted === "") return new Set<string>();
    const fits = (one: TreeNodeRecord): boolean =>
      `${one.kind} ${one.name} ${one.path}`.toLowerCase().includes(wanted);
    return new Set(record.nodes.filter(fits).map((one) => one.path));
  }, [record, search]);
  const onKeyDown = (event: React.KeyboardEvent): void => {
    const index = placed.findIndex((one) => one.shown.node.path === chosen);
    const current = placed[index];
    const next = {
      ArrowDown: placed[index + 1],
      ArrowUp: placed[index - 1],
      ArrowLeft: current?.parent ?? undefined,
      ArrowRight: placed.find((one) => one.parent !== null && one.parent === current),
      Home: placed[0],
      End: placed.at(-1),
    }[event.key];
    if (event.key === "Enter" && current && current.shown.children.length > 0) fold(chosen);
    else if (next) {
      choose(next.shown.node.path);
      show(next.shown.node.path);
    } else return;
    event.preventDefault();
  };

  useEffect(() => {
    const focused = frame.current?.querySelector<SVGGElement>('[aria-selected="true"]');
    if (document.activeElement?.closest(".tree") === frame.current) focused?.focus({ preventScroll: true });
  }, [chosen]);

  return (
    <section className="panel tree-panel" aria-label={texts.live.tree}>
      <div className="bar">
        <input
          type="search"
          aria-label={texts.live.search}
          placeholder={texts.live.search}
          value={search}
          onChange={(event) => setSearch(event.target.value)}
          onKeyDown={(event) => {
            const first = placed.find((one) => found.has(one.shown.node.path));
            if (event.key === "Enter" && first) {
              choose(first.shown.node.path);
              show(first.shown.node.path);
            }
          }}
        />
        <button type="button" disabled={tipNode === ""} onClick={() => show(tipNode)}>
          {texts.live.tip}
        </button>
        <button type="button" aria-label="smaller" onClick={() => setZoom((before) => Math.max(0.25, before / 1.25))}>
          −
        </button>
        <button type="button" aria-label="larger" onClick={() => setZoom((before) => Math.min(2, before * 1.25))}>
          +
        </button>
      </div>
      <div className="tree" ref={frame} onScroll={measure}>
        <svg
          width={width * zoom}
          height={height * zoom}
          viewBox={`0 0 ${width} ${height}`}
          role="tree"
          aria-label={record.agent}
          tabIndex={0}
          onKeyDown={onKeyDown}
        >
          <g role="presentation">
            {visible.map((one) => (
              <Edge key={one.shown.node.path} agent={record.agent} item={one} />
            ))}
          </g>
          {visible.map((one) => (
            <Cell
              key={one.shown.node.path}
              agent={record.agent}
              item={one}
              isTip={one.shown.node.path === tipNode}
              isChosen={one.shown.node.path === chosen}
              isFound={found.has(one.shown.node.path)}
              isFolded={folded.has(one.shown.node.path)}
              choose={choose}
              fold={fold}
            />
          ))}
        </svg>
      </div>
    </section>
  );
}

/** Path of the node that a tip which is a modifier belongs to. */
function withoutModifier(record: TreeRecord, tip: string): string {
  let index = record.nodes.findIndex((one) => one.path === tip);
  while (index >= 0 && isModifier(record.nodes[index]!)) {
    const parent: number = index;
    index = record.nodes.findIndex((one) => one.parent === parent);
  }
  return index >= 0 ? record.nodes[index]!.path : "";
}

export function lineOf(agent: string, path: string): TreeNodeRecord | undefined {
  return readEntry("trees", agent)?.nodes.find((one) => one.path === path);
}
