// SPDX-License-Identifier: Apache-2.0
// Outline of a behaviour tree with one row per node; only rows near the frame are drawn.

import { memo, useCallback, useEffect, useLayoutEffect, useMemo, useRef, useState } from "react";
import { badgeText, nameWithoutKind } from "./badges";
import { BusyTime, TimeLeft } from "./control";
import css from "./outline.module.css";
import { drawnAt, heldPx, ROW_PX, rowsOf, type Row } from "./outline_rows";
import type { TreeNodeRecord } from "./protocol";
import shared from "./shared.module.css";
import { useEntry } from "./store";
import { texts } from "./texts";
import drawing from "./tree_drawing.module.css";
import { branchOf, type Shown } from "./tree_nesting";
import { statusOf, statusWords, type DrawingProps } from "./tree_drawing";

const INDENT_PX = 16;
const DEEPEST_INDENT = 16;

const rowId = (path: string): string => `row:${path}`;

export function Outline(props: DrawingProps) {
  const { record, roots, byPath, folded, tip, chosen, choose, fold, goal, found, stops, toggleStop } = props;
  const rows = useMemo(() => rowsOf(roots, folded), [roots, folded]);
  const places = useMemo(() => new Map(rows.map((one) => [one.shown.node.path, one])), [rows]);
  const box = useRef<HTMLDivElement>(null);
  /** Offset set by this component; the reader has scrolled if it differs. */
  const offset = useRef(0);
  const [first, setFirst] = useState(0);
  const [inFrame, setInFrame] = useState(0);
  const [isFollowing, setFollowing] = useState(true);

  /** The row of a node, or of the folded node that hides it. */
  const rowOf = (path: string): Row | undefined => {
    let shown: Shown | null | undefined = byPath.get(path);
    while (shown && !places.has(shown.node.path)) shown = shown.parent;
    return shown ? places.get(shown.node.path) : undefined;
  };
  const settle = useCallback((): void => {
    const frame = box.current;
    if (frame === null) return;
    offset.current = frame.scrollTop;
    setFirst(Math.floor(frame.scrollTop / ROW_PX));
    setInFrame(Math.ceil(frame.clientHeight / ROW_PX) + 1);
  }, []);
  const reveal = (row: Row | undefined, isCentred: boolean): void => {
    const frame = box.current;
    if (frame === null || row === undefined) return;
    const y = row.index * ROW_PX;
    const last = frame.clientHeight - ROW_PX;
    const above = heldPx(row);
    if (y >= frame.scrollTop + above && y <= frame.scrollTop + last) return;
    if (isCentred) frame.scrollTop = y - last / 2;
    else frame.scrollTop = y < frame.scrollTop + above ? y - above : y - last;
    settle();
  };

  useLayoutEffect(() => {
    const frame = box.current;
    if (frame === null) return;
    const observer = new ResizeObserver(settle);
    observer.observe(frame);
    return () => observer.disconnect();
  }, [settle]);
  // Fewer rows may have moved the frame.
  useLayoutEffect(settle, [rows, settle]);
  useLayoutEffect(() => {
    if (isFollowing) reveal(rowOf(tip), true);
  }, [isFollowing, tip, rows, inFrame]);
  useEffect(() => {
    if (goal.path === "") return;
    setFollowing(false);
    reveal(rowOf(goal.path), false);
  }, [goal]);

  const onScroll = (): void => {
    if (box.current?.scrollTop !== offset.current) setFollowing(false);
    settle();
  };
  const onKeyDown = (event: React.KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const current = rowOf(chosen);
    const path = current?.shown.node.path ?? "";
    const index = current?.index ?? -1;
    const isParent = current !== undefined && current.shown.children.length > 0;
    const isFolded = folded.has(path);
    const next = {
      ArrowDown: rows[Math.min(index + 1, rows.length - 1)],
      ArrowUp: rows[Math.max(index - 1, 0)],
      ArrowRight: isParent && !isFolded ? rows[index + 1] : undefined,
      ArrowLeft: isParent && !isFolded ? undefined : rows[current?.parent ?? -1],
      Home: rows[0],
      End: rows.at(-1),
    }[event.key];
    if (next !== undefined) {
      choose(next.shown.node.path);
      setFollowing(false);
      reveal(next, false);
    } else if ((event.key === "ArrowLeft" && !isFolded) || (event.key === "ArrowRight" && isFolded)) {
      if (isParent) fold(path);
    } else if (event.key === "Enter" && current !== undefined) props.showDetails();
    else if (event.key === "b" && current !== undefined) toggleStop(path);
    else if (event.key === "t") setFollowing(true);
    else if (event.key === "/") props.focusSearch();
    else return;
    event.preventDefault();
  };

  const drawn = drawnAt(rows, first, inFrame);
  const active = places.get(chosen);
  const isDrawn = active === undefined || drawn.held.includes(active) || drawn.rows.includes(active);
  const draw = (row: Row, y: number) => {
    const path = row.shown.node.path;
    return (
      <OutlineRow
        key={path}
        agent={record.agent}
        host={record.host}
        row={row}
        y={y}
        isTip={path === tip}
        isChosen={path === chosen}
        isFound={found.has(path)}
        isFolded={folded.has(path)}
        isStop={stops.includes(path)}
        choose={choose}
        fold={fold}
        toggleStop={toggleStop}
      />
    );
  };
  return (
    <>
      <div className={shared.bar}>
        {props.tools}
        <button type="button" aria-pressed={isFollowing} onClick={() => setFollowing(!isFollowing)}>
          {texts.live.following}
        </button>
      </div>
      <div className={drawing.frame}>
        <div
          className={css.outline}
          ref={box}
          role="tree"
          aria-label={record.agent}
          tabIndex={0}
          {...(active ? { "aria-activedescendant": rowId(chosen) } : {})}
          onScroll={onScroll}
          onKeyDown={onKeyDown}
        >
          <div className={css.held}>{drawn.held.map((one, index) => draw(one, index * ROW_PX))}</div>
          <div className={css.rows} style={{ height: rows.length * ROW_PX }}>
            {drawn.rows.map((one) => draw(one, one.index * ROW_PX))}
            {!isDrawn && draw(active, active.index * ROW_PX)}
          </div>
        </div>
      </div>
    </>
  );
}

interface OutlineRowProps {
  agent: string;
  host: string;
  row: Row;
  y: number;
  isTip: boolean;
  isChosen: boolean;
  isFound: boolean;
  isFolded: boolean;
  isStop: boolean;
  choose: (path: string) => void;
  fold: (path: string) => void;
  toggleStop: (path: string) => void;
}

const OutlineRow = memo(function OutlineRow(props: OutlineRowProps) {
  const { agent, host, row, y, isTip, isChosen, isFound, isFolded, isStop, choose, fold, toggleStop } = props;
  const { node, modifiers, children, depth } = row.shown;
  const record = useEntry("nodes", `${agent}|${node.path}`);
  const status = statusOf(record);
  const branch = row.shown.handles && `${branchOf(row.shown)}: `;
  // Most names begin with the kind.
  const name = ` ${nameWithoutKind(node)}`;
  const message = status === "INVALID" ? "" : (record?.message ?? "");
  const isCut = status === "STOPPED" || status === "UNKNOWN";
  const note = isCut ? statusWords(record) : message;
  const stop = isStop ? `, ${texts.control.breakpoint}` : "";
  const label = `${branch}${node.kind}${name}, ${statusWords(record)}${message && `: ${message}`}${stop}`;
  const without = (act: (path: string) => void) => (event: React.MouseEvent) => {
    event.stopPropagation();
    act(node.path);
  };
  return (
    <div
      id={rowId(node.path)}
      className={css.node}
      style={{ top: y }}
      role="treeitem"
      aria-level={depth + 1}
      aria-setsize={row.siblings}
      aria-posinset={row.place}
      aria-selected={isChosen}
      {...(children.length > 0 ? { "aria-expanded": !isFolded } : {})}
      title={`${label}\n${node.path}`}
      data-path={node.path}
      data-status={status}
      data-tip={isTip || undefined}
      data-found={isFound || undefined}
      onClick={() => choose(node.path)}
      onDoubleClick={() => children.length > 0 && fold(node.path)}
    >
      <span
        className={css.breakpoint}
        data-set={isStop || undefined}
        title={texts.control.hint}
        aria-hidden="true"
        onClick={without(toggleStop)}
        onDoubleClick={(event) => event.stopPropagation()}
      />
      <span
        className={css.fold}
        style={{ marginLeft: Math.min(depth, DEEPEST_INDENT) * INDENT_PX }}
        aria-hidden="true"
        onClick={children.length > 0 ? without(fold) : undefined}
        onDoubleClick={(event) => event.stopPropagation()}
      />
      <span className={css.mark} aria-hidden="true" />
      <span className={css.title}>
        {branch && <i>{branch}</i>}
        <b>{node.kind}</b>
        {name}
      </span>
      <span className={shared.hidden}>
        {!isCut && `, ${statusWords(record)}`}
        {stop}
      </span>
      <span className={css.more}>
        {isFolded && <small>+{children.length}</small>}
        {[...modifiers, node].map((one) => (
          <RowLimit key={one.path} agent={agent} host={host} node={one} isBadge={one !== node} />
        ))}
        {note && <span className={css.message}>{note}</span>}
      </span>
      <span className={css.busy}>
        {record && (record.status === "RUNNING" || record.busy_s > 0) && <BusyTime record={record} />}
      </span>
    </div>
  );
});

interface RowLimitProps {
  agent: string;
  host: string;
  node: TreeNodeRecord;
  isBadge: boolean;
}

/** Badge of a modifier, and the remaining time of the modifier or of the node itself. */
const RowLimit = memo(function RowLimit({ agent, host, node, isBadge }: RowLimitProps) {
  const key = `${agent}|${node.path}`;
  const record = useEntry("nodes", key);
  const remaining = useEntry("countdowns", key)?.remaining ?? null;
  return (
    <>
      {isBadge && (
        <span className={drawing.badge} data-status={statusOf(record)} data-badge={node.path}>
          {badgeText(node, remaining)}
        </span>
      )}
      <TimeLeft agent={agent} host={host} path={node.path} />
    </>
  );
});
