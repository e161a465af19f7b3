// SPDX-License-Identifier: Apache-2.0
// Behaviour tree as SVG: one subscription a node; what is far outside of the view is not drawn.

import { memo, useEffect, useMemo, useRef, useState } from "react";
import { badgeText } from "./badges";
import { Left } from "./control";
import type { NodeRecord, TreeNodeRecord, TreeRecord } from "./protocol";
import { readEntry, useEntry } from "./store";
import { texts } from "./texts";
import { branchOf, find, HEIGHT, layOut, nest, WIDTH, withoutModifier, type Placed, type Shown } from "./tree_layout";
import { TreeMap } from "./tree_map";
import { READABLE, STEP, useViewport } from "./tree_view";

/** Characters in the first line of a node. */
const LINE = 32;

const statusOf = (record: NodeRecord | undefined): string => record?.status ?? "INVALID";
const classOf = (record: NodeRecord | undefined): string => statusOf(record).toLowerCase();
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
  const classes = item.shown.handles ? `edge handler ${classOf(record)}` : `edge ${classOf(record)}`;
  return <path className={classes} d={`M${x},${y0}C${middle},${y0} ${middle},${y1} ${item.x},${y1}`} />;
});

interface CellProps {
  agent: string;
  item: Placed;
  isTip: boolean;
  isChosen: boolean;
  isFound: boolean;
  isFolded: boolean;
  isReadable: boolean;
  isStop: boolean;
  host: string;
  choose: (path: string) => void;
  fold: (path: string) => void;
  toggleStop: (path: string) => void;
}

const Cell = memo(function Cell(props: CellProps) {
  const { agent, item, isTip, isChosen, isFound, isFolded, isReadable, isStop, host, choose, fold, toggleStop } = props;
  const { node, modifiers, children, depth } = item.shown;
  const record = useEntry("nodes", `${agent}|${node.path}`);
  const state = classOf(record);
  const reason = state === "failure" ? (record?.message ?? "") : "";
  const words = texts.live.statuses[statusOf(record)] ?? state;
  const classes = ["node", state, isTip && "tip", isChosen && "chosen", isFound && "found"].filter(Boolean).join(" ");
  const stop = isStop ? `, ${texts.control.breakpoint}` : "";
  const branch = item.shown.handles && `${branchOf(item.shown)}: `;
  const label = `${branch}${node.kind} ${node.name}, ${words}${reason ? `: ${reason}` : ""}${stop}`;
  const kind = shorten(branch + node.kind, 26);
  const room = Math.max(Math.floor((LINE - kind.length) / Math.max(modifiers.length, 1)) - 1, 2);
  const paths = useMemo(() => [node.path, ...modifiers.map((one) => one.path)], [node, modifiers]);
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
      {isReadable && (
        <>
          <text className="kind" x={10} y={14}>
            {kind}
          </text>
          <text className="kind" x={WIDTH - 8} y={14} textAnchor="end">
            {modifiers.map((one) => (
              <Badge key={one.path} agent={agent} node={one} most={room} />
            ))}
          </text>
          <text className="name" x={10} y={28}>
            {shorten(node.name, 24)}
          </text>
          {reason && (
            <text className="reason" x={10} y={HEIGHT + 11}>
              {shorten(reason, 36)}
            </text>
          )}
          <Left agent={agent} host={host} paths={paths} x={10} y={HEIGHT + 11} />
        </>
      )}
      <g
        className={isStop ? "breakpoint set" : "breakpoint"}
        transform={`translate(-9,${HEIGHT / 2})`}
        onClick={(event) => {
          event.stopPropagation();
          toggleStop(node.path);
        }}
        onDoubleClick={(event) => event.stopPropagation()}
      >
        <rect x={-12} y={-HEIGHT / 2} width={20} height={HEIGHT} />
        <circle r={5} />
        <title>{texts.control.hint}</title>
      </g>
      {isFolded && (
        <text className="folded" x={WIDTH + 6} y={HEIGHT / 2 + 4}>
          +{children.length}
        </text>
      )}
      <title>{`${label}\n${node.path}`}</title>
    </g>
  );
});

interface BadgeProps {
  agent: string;
  node: TreeNodeRecord;
  /** Characters that there is room for. */
  most: number;
}

const Badge = memo(function Badge({ agent, node, most }: BadgeProps) {
  const key = `${agent}|${node.path}`;
  const record = useEntry("nodes", key);
  const text = badgeText(node, useEntry("countdowns", key)?.remaining ?? null);
  const words = texts.live.statuses[statusOf(record)] ?? "";
  return (
    <tspan className={`badge ${classOf(record)}`} dx={6} data-badge={node.path}>
      {shorten(text, most)}
      <title>{`${node.name}, ${words}${record?.message ? `: ${record.message}` : ""}`}</title>
    </tspan>
  );
});

interface TreeProps {
  record: TreeRecord;
  tip: string;
  chosen: string;
  choose: (path: string) => void;
  /** Paths of the nodes with a breakpoint. */
  stops: readonly string[];
  toggleStop: (path: string) => void;
}

const NOTHING: ReadonlySet<string> = new Set();

function index(roots: readonly Shown[], found = new Map<string, Shown>()): ReadonlyMap<string, Shown> {
  for (const one of roots) {
    found.set(one.node.path, one);
    index(one.children, found);
  }
  return found;
}

export const Tree = memo(function Tree({ record, tip, chosen, choose, stops, toggleStop }: TreeProps) {
  const [folded, setFolded] = useState(NOTHING);
  const [search, setSearch] = useState("");
  const [goal, setGoal] = useState({ path: "" });
  const searching = useRef<HTMLInputElement>(null);
  const roots = useMemo(() => nest(record), [record]);
  const byPath = useMemo(() => index(roots), [roots]);
  const layout = useMemo(() => layOut(roots, folded), [roots, folded]);
  const view = useViewport(layout);
  const { frame, zoom, show } = view;
  const { placed } = layout;
  const tipNode = withoutModifier(tip);
  const results = useMemo(() => find(record, search), [record, search]);
  const found = useMemo(() => new Set(results), [results]);

  // The chosen node is drawn even far away, as it may have the keyboard.
  const drawn = useMemo(() => {
    const item = layout.at.get(chosen);
    return item === undefined || view.near.includes(item) ? view.near : [...view.near, item];
  }, [layout, view.near, chosen]);

  useEffect(() => {
    setFolded(NOTHING);
    setGoal({ path: tipNode || (roots[0]?.node.path ?? "") });
  }, [record.agent]);

  /** Bring a node into view, unfolded if need be. */
  const goTo = (path: string): void => {
    setFolded((before) => {
      const after = new Set(before);
      for (let one = byPath.get(path)?.parent; one; one = one.parent) after.delete(one.node.path);
      return after.size < before.size ? after : before;
    });
    setGoal({ path });
  };
  // The node has its place only after what hid it is unfolded.
  useEffect(() => show(goal.path), [goal]);

  const fold = useMemo(
    () =>
      (path: string): void =>
        setFolded((before) => {
          const after = new Set(before);
          if (!after.delete(path)) after.add(path);
          return after;
        }),
    [],
  );
  const goToResult = (step: number): void => {
    const index = results.indexOf(chosen);
    const from = index < 0 && step < 0 ? 0 : index;
    const next = results[(from + step + results.length) % results.length];
    if (next === undefined) return;
    choose(next);
    goTo(next);
  };
  const onKeyDown = (event: React.KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
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
    const act = {
      "+": () => view.zoomBy(STEP),
      "-": () => view.zoomBy(1 / STEP),
      "0": () => view.fit(),
      t: () => tipNode !== "" && goTo(tipNode),
      "/": () => searching.current?.focus(),
    }[event.key];
    if (event.key === "b" && current) toggleStop(chosen);
    else if (event.key === "Enter" && current && current.shown.children.length > 0) fold(chosen);
    else if (act) act();
    else if (next) {
      choose(next.shown.node.path);
      goTo(next.shown.node.path);
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
          ref={searching}
          type="search"
          aria-label={texts.live.search}
          placeholder={texts.live.search}
          value={search}
          onChange={(event) => setSearch(event.target.value)}
          onKeyDown={(event) => {
            if (event.key === "Enter") goToResult(event.shiftKey ? -1 : 1);
          }}
        />
        {search.trim() !== "" && (
          <output>
            {found.has(chosen) ? `${results.indexOf(chosen) + 1} ${texts.live.of} ` : ""}
            {results.length} {texts.live.found}
          </output>
        )}
        <button type="button" disabled={tipNode === ""} onClick={() => goTo(tipNode)}>
          {texts.live.tip}
        </button>
        <button type="button" aria-label={texts.live.smaller} onClick={() => view.zoomBy(1 / STEP)}>
          −
        </button>
        <button type="button" aria-label={texts.live.larger} onClick={() => view.zoomBy(STEP)}>
          +
        </button>
        <button type="button" onClick={view.fit}>
          {texts.live.fit}
        </button>
      </div>
      <div className="tree-frame">
        <div className="tree" ref={frame} onScroll={view.onScroll} onPointerDown={view.onPointerDown}>
          <svg
            width={layout.width * zoom}
            height={layout.height * zoom}
            viewBox={`0 0 ${layout.width} ${layout.height}`}
            role="tree"
            aria-label={record.agent}
            tabIndex={0}
            data-zoom={zoom.toFixed(2)}
            onKeyDown={onKeyDown}
          >
            <pattern id="hatched" width={6} height={6} patternUnits="userSpaceOnUse" patternTransform="rotate(45)">
              <path d="M0,0V6" />
            </pattern>
            <g role="presentation">
              {drawn.map((one) => (
                <Edge key={one.shown.node.path} agent={record.agent} item={one} />
              ))}
            </g>
            {drawn.map((one) => (
              <Cell
                key={one.shown.node.path}
                agent={record.agent}
                item={one}
                isTip={one.shown.node.path === tipNode}
                isChosen={one.shown.node.path === chosen}
                isFound={found.has(one.shown.node.path)}
                isFolded={folded.has(one.shown.node.path)}
                isReadable={zoom >= READABLE}
                isStop={stops.includes(one.shown.node.path)}
                host={record.host}
                choose={choose}
                fold={fold}
                toggleStop={toggleStop}
              />
            ))}
          </svg>
        </div>
        {view.isPart && <TreeMap agent={record.agent} layout={layout} part={view.part} watch={view.watch} centre={view.centre} />}
      </div>
    </section>
  );
});

export function lineOf(agent: string, path: string): TreeNodeRecord | undefined {
  return readEntry("trees", agent)?.nodes.find((one) => one.path === path);
}
