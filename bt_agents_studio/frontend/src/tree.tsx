// SPDX-License-Identifier: Apache-2.0
// Map of a behaviour tree as SVG with one subscription per node; omits nodes far from the view.

import { memo, useEffect, useMemo } from "react";
import { badgeText } from "./badges";
import { Left } from "./control";
import type { TreeNodeRecord } from "./protocol";
import shared from "./shared.module.css";
import { useEntry } from "./store";
import { texts } from "./texts";
import css from "./tree.module.css";
import { statusOf, statusWords, type DrawingProps } from "./tree_drawing";
import drawing from "./tree_drawing.module.css";
import { HEIGHT, layOut, WIDTH, type Placed } from "./tree_layout";
import { TreeMap } from "./tree_map";
import { branchOf } from "./tree_nesting";
import { READABLE, STEP, useViewport } from "./tree_view";

/** Characters in the first line of a node. */
const LINE = 32;

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
  return (
    <path
      className={css.edge}
      data-status={statusOf(record)}
      data-handler={item.shown.handles !== "" || undefined}
      d={`M${x},${y0}C${middle},${y0} ${middle},${y1} ${item.x},${y1}`}
    />
  );
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
  const status = statusOf(record);
  const reason = status === "FAILURE" ? (record?.message ?? "") : "";
  const words = statusWords(record);
  const stop = isStop ? `, ${texts.control.breakpoint}` : "";
  const branch = item.shown.handles && `${branchOf(item.shown)}: `;
  const label = `${branch}${node.kind} ${node.name}, ${words}${reason ? `: ${reason}` : ""}${stop}`;
  const kind = shorten(branch + node.kind, 26);
  const room = Math.max(Math.floor((LINE - kind.length) / Math.max(modifiers.length, 1)) - 1, 2);
  const paths = useMemo(() => [node.path, ...modifiers.map((one) => one.path)], [node, modifiers]);
  return (
    <g
      className={css.node}
      transform={`translate(${item.x},${item.y})`}
      role="treeitem"
      aria-level={depth + 1}
      aria-selected={isChosen}
      {...(children.length > 0 ? { "aria-expanded": !isFolded } : {})}
      aria-label={label}
      tabIndex={isChosen ? 0 : -1}
      data-path={node.path}
      data-status={status}
      data-tip={isTip || undefined}
      data-found={isFound || undefined}
      onClick={() => choose(node.path)}
      onDoubleClick={() => children.length > 0 && fold(node.path)}
    >
      <rect width={WIDTH} height={HEIGHT} rx={7} />
      {isReadable && (
        <>
          <text className={css.kind} x={10} y={14}>
            {kind}
          </text>
          <text className={css.kind} x={WIDTH - 8} y={14} textAnchor="end">
            {modifiers.map((one, index) => (
              <Badge key={one.path} agent={agent} node={one} dx={index > 0 ? 6 : 0} most={room} />
            ))}
          </text>
          <text className={css.name} x={10} y={28}>
            {shorten(node.name, 24)}
          </text>
          {reason && (
            <text className={css.reason} x={10} y={HEIGHT + 11}>
              {shorten(reason, 24)}
            </text>
          )}
          <Left agent={agent} host={host} paths={paths} x={WIDTH - 8} y={HEIGHT + 11} />
        </>
      )}
      <g
        className={css.breakpoint}
        data-set={isStop || undefined}
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
        <text className={css.folded} x={WIDTH + 6} y={HEIGHT / 2 + 4}>
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
  dx: number;
  /** Characters that fit. */
  most: number;
}

const Badge = memo(function Badge({ agent, node, dx, most }: BadgeProps) {
  const key = `${agent}|${node.path}`;
  const record = useEntry("nodes", key);
  const text = badgeText(node, useEntry("countdowns", key)?.remaining ?? null);
  const words = statusWords(record);
  return (
    <tspan className={drawing.badge} data-status={statusOf(record)} dx={dx} data-badge={node.path}>
      {shorten(text, most)}
      <title>{`${node.name}, ${words}${record?.message ? `: ${record.message}` : ""}`}</title>
    </tspan>
  );
});

export function Tree(props: DrawingProps) {
  const { record, roots, folded, fold, tip, chosen, choose, goal, goTo, found, stops, toggleStop } = props;
  const layout = useMemo(() => layOut(roots, folded), [roots, folded]);
  const view = useViewport(layout);
  const { frame, zoom, show } = view;
  const { placed } = layout;

  // The chosen node may have the keyboard focus, so it is drawn however far away.
  const drawn = useMemo(() => {
    const item = layout.at.get(chosen);
    return item === undefined || view.near.includes(item) ? view.near : [...view.near, item];
  }, [layout, view.near, chosen]);

  // A node has no place until the nodes that hide it are unfolded.
  useEffect(() => show(goal.path || tip || (roots[0]?.node.path ?? "")), [goal]);

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
      t: () => tip !== "" && goTo(tip),
      "/": props.focusSearch,
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
    if (frame.current?.contains(document.activeElement)) focused?.focus({ preventScroll: true });
  }, [chosen]);

  return (
    <>
      <div className={shared.bar}>
        {props.tools}
        <button type="button" disabled={tip === ""} onClick={() => goTo(tip)}>
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
      <div className={drawing.frame}>
        <div className={css.tree} ref={frame} onScroll={view.onScroll} onPointerDown={view.onPointerDown}>
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
              <path className={css.hatched} d="M0,0V6" />
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
                isTip={one.shown.node.path === tip}
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
    </>
  );
}
