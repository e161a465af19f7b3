// SPDX-License-Identifier: Apache-2.0
// The timeline: events in lanes, and the moment on show.

import { lazy, Suspense, useEffect, useMemo, useRef, useState, type KeyboardEvent, type PointerEvent } from "react";
import { Bookmarks, useBookmarks } from "./bookmarks";
import { fetchEvents, follow, seek, useConnection } from "./connection";
import { formatSeconds, formatTime } from "./formatting";
import type { BookmarkRecord, EventRecord, ParameterRecord } from "./protocol";
import shared from "./shared.module.css";
import { useCollection, useEntry, usePresent, usePresentCollection } from "./store";
import { texts } from "./texts";
import css from "./timeline.module.css";
import { saveMessages, savePicture, saveTable } from "./timeline_export";
import {
  blockAt,
  blocksOf,
  eventAt,
  isFailure,
  LANE_PX,
  lanesIn,
  MARK_PX,
  momentAt,
  NAMES_PX,
  neighbour,
  ordered,
  panned,
  placeOf,
  ticksOf,
  TICKS_PX,
  viewWith,
  windowOf,
  zoomed,
  type Block,
  type Lane,
  type Span,
  type View,
} from "./timeline_lanes";
import { close, Menu } from "./timeline_menu";
import { PlayerButtons, usePlayer } from "./timeline_player";
import { DRAG_PX, STEP } from "./tree_view";
import { useWidth } from "./width";

const words = texts.time;
const PERIOD_MS = 250;
/** Least room for a text: for the mark of a run, and for words of the robot. */
const TEXT_PX: Partial<Record<Lane, number>> = { AGENT: 14, ROBOT: 40, RECORDING: 40 };
const LETTER_PX = 7;
const MARKS: Record<string, string> = { RUNNING: "●", CANCELLING: "●", SUCCEEDED: "✔", CANCELLED: "■" };

const Recording = lazy(() => import("./recording").then((one) => ({ default: one.Recording })));

interface Hover {
  x: number;
  text: string;
}

interface Drag {
  x: number;
  shown: Span;
  isMoved: boolean;
}

export function Timeline() {
  const { atS, source, isWhole, failure } = useConnection();
  const whole = useWhole();
  const events = useEvents();
  const titleOf = useTitles();
  const bookmarks = useBookmarks(whole);
  const box = useRef<HTMLDivElement>(null);
  const [view, setView] = useState<View | null>(null);
  const isAway = atS !== null || (view !== null && view.endS !== null);
  const moment = Math.min(atS ?? whole.toS, whole.toS);
  useEffect(() => setView(null), [source]);
  useEffect(() => {
    if (atS !== null) setView((before) => viewWith(atS, before, whole));
    // The window moves with the moment, not with the growth of the whole time.
  }, [atS]);
  const toNow = (): void => {
    setView((before) => before && { ...before, endS: null });
    if (atS !== null) follow();
  };
  const toEnd = (): void => (source ? seek(source, whole.toS) : toNow());
  const player = usePlayer(events, whole, toEnd);
  return (
    <div className={css.timeline}>
      <div className={css.moment}>
        <time>{formatTime(moment)}</time>
        {isAway ? (
          <button type="button" onClick={toNow}>
            {words.back}
          </button>
        ) : (
          <span>{words.now}</span>
        )}
        {atS !== null && <PlayerButtons of={player} />}
        <Bookmarks of={bookmarks} moment={moment} />
        <RecordingMenu />
        <Export
          events={events}
          bookmarks={bookmarks.all}
          shown={windowOf(view, whole)}
          endsNow={source === "" && (view === null || view.endS === null)}
          lanes={box}
        />
        {source && <span className={css.source}>{isWhole ? source : `${source} ${words.reading}`}</span>}
        {failure && <span className={shared.failure}>{failure}</span>}
      </div>
      <Lanes
        box={box}
        events={events}
        bookmarks={bookmarks.all}
        whole={whole}
        view={view}
        moment={moment}
        describe={(event) => describe(event, titleOf(event.agent))}
        titleOf={titleOf}
        setView={setView}
        toEnd={toEnd}
        play={player.toggle}
      />
    </div>
  );
}

/** Menu that starts and stops a recording. */
function RecordingMenu() {
  const box = useRef<HTMLDetailsElement>(null);
  const [isOpened, setOpened] = useState(false);
  return (
    <Menu box={box} label={words.record} onOpen={() => setOpened(true)}>
      {isOpened && (
        <Suspense>
          <Recording />
        </Suspense>
      )}
    </Menu>
  );
}

interface ExportProps {
  events: EventRecord[];
  bookmarks: readonly BookmarkRecord[];
  shown: Span;
  /** Whether the window moves with the time, once a second. */
  endsNow: boolean;
  lanes: React.RefObject<HTMLElement | null>;
}

/** Menu that exports the time span in the window to files. */
function Export({ events, bookmarks, shown, endsNow, lanes }: ExportProps) {
  const { source, offsetS } = useConnection();
  const written = usePresent("recording");
  const box = useRef<HTMLDetailsElement>(null);
  const [isPending, setPending] = useState(false);
  const [failure, setFailure] = useState("");
  const save = (form: "CSV" | "PNG"): void => {
    close(box);
    const drawing = lanes.current?.querySelector("svg");
    if (form === "CSV") saveTable(events, bookmarks, shown, source);
    else if (drawing) savePicture(drawing, shown, source);
  };
  const saveRecorded = async (): Promise<void> => {
    if (isPending) return;
    setPending(true);
    setFailure("");
    const recording = source || (written?.recording === true ? written.file : "");
    const missing = written === undefined ? texts.world.noJournal : texts.world.notRecorded;
    const toS = endsNow ? Date.now() / 1000 + offsetS : shown.toS;
    const why = recording === "" ? missing : await saveMessages({ ...shown, toS }, recording);
    setPending(false);
    setFailure(why);
    if (why === "") close(box);
  };
  return (
    <Menu box={box} label={words.save} onOpen={() => setFailure("")}>
      <div className={shared.bar}>
        <button type="button" onClick={() => save("CSV")}>
          {words.saveTable}
        </button>
        <button type="button" onClick={() => save("PNG")}>
          {words.savePicture}
        </button>
        <button type="button" aria-disabled={isPending || undefined} onClick={() => void saveRecorded()}>
          {words.saveMessages}
          {isPending && " …"}
        </button>
      </div>
      <output className={failure && shared.failure}>{failure}</output>
    </Menu>
  );
}

/** From the first moment that can be shown to the last. */
function useWhole(): Span {
  const { source, firstS, lastS, offsetS, hello } = useConnection();
  const [nowS, setNowS] = useState(Date.now() / 1000);
  useEffect(() => {
    const timer = window.setInterval(() => setNowS(Date.now() / 1000), 1000);
    return () => window.clearInterval(timer);
  }, []);
  if (source) return { fromS: firstS ?? lastS ?? 0, toS: lastS ?? firstS ?? 0 };
  const toS = nowS + offsetS;
  return { fromS: Math.min(Math.max(firstS ?? toS, toS - (hello?.span_s ?? 0)), toS), toS };
}

/** Events in order of time: all events of a recording, or the events that the studio keeps. */
function useEvents(): EventRecord[] {
  const { source, lastS } = useConnection();
  const kept = usePresentCollection("events", PERIOD_MS);
  const [recorded, setRecorded] = useState<{ source: string; events: EventRecord[] }>({ source: "", events: [] });
  useEffect(() => {
    // The end of the recording is unknown until its first moment arrives.
    if (!source || lastS === null) return;
    const ended = new AbortController();
    void fetchEvents(source, ended.signal).then((events) => {
      if (!ended.signal.aborted) setRecorded({ source, events });
    });
    return () => ended.abort();
    // A recording that grows gains events.
  }, [source, lastS]);
  return useMemo(() => {
    if (source) return recorded.source === source ? ordered(recorded.events) : [];
    return ordered(kept.map(([, one]) => one));
  }, [source, recorded, kept]);
}

function useTitles(): (agent: string) => string {
  const agents = useCollection("agents", PERIOD_MS);
  return useMemo(() => {
    const titles = new Map(agents.map(([name, one]) => [name, one.title]));
    return (agent) => titles.get(agent) || agent;
  }, [agents]);
}

/** Text of an event and its time. */
function describe(event: EventRecord, title: string): string {
  const kind = event.kind.toLowerCase().replaceAll("_", " ");
  const parts = [formatTime(event.began_s)];
  if (event.ended_s === null) parts.push(words.goesOn);
  else if (event.ended_s > event.began_s) parts.push(formatSeconds(event.ended_s - event.began_s));
  const lane = words.lanes[event.lane as Lane];
  return `${parts.join(", ")} · ${lane}: ${[title, kind, event.text].filter(Boolean).join(" · ")}`;
}

interface LanesProps {
  box: React.RefObject<HTMLDivElement | null>;
  events: EventRecord[];
  bookmarks: readonly BookmarkRecord[];
  whole: Span;
  view: View | null;
  moment: number;
  describe: (event: EventRecord) => string;
  titleOf: (agent: string) => string;
  setView: (view: View | null) => void;
  toEnd: () => void;
  play: () => void;
}

function Lanes({ box, events, bookmarks, whole, view, moment, describe, titleOf, setView, toEnd, play }: LanesProps) {
  const { atS, source } = useConnection();
  const width = useWidth(box);
  const [hover, setHover] = useState<Hover | null>(null);
  const drag = useRef<Drag | null>(null);
  const shown = windowOf(view, whole);
  const lanes = lanesIn(width);
  const drawn = useMemo(() => events.filter((one) => lanes.includes(one.lane as Lane)), [events, lanes]);
  const blocks = blocksOf(drawn, shown, width);
  const isEmpty = whole.fromS >= whole.toS;
  const height = lanes.length * LANE_PX + TICKS_PX;
  const placeIn = (event: { clientX: number; clientY: number }): { x: number; y: number } => {
    const found = box.current?.getBoundingClientRect();
    return { x: event.clientX - (found?.x ?? 0), y: event.clientY - (found?.y ?? 0) };
  };

  const wheel = useRef<(event: WheelEvent) => void>(() => undefined);
  wheel.current = (event) => {
    event.preventDefault();
    const at = momentAt(placeIn(event).x, shown, width);
    setView(zoomed(shown, whole, at, event.deltaY > 0 ? STEP : 1 / STEP));
  };
  useEffect(() => {
    const found = box.current;
    const turned = (event: WheelEvent): void => wheel.current(event);
    // React's own listener cannot keep the page from scrolling.
    found?.addEventListener("wheel", turned, { passive: false });
    return () => found?.removeEventListener("wheel", turned);
  }, []);

  const jump = (direction: 1 | -1): void => {
    const found = neighbour(drawn, whole, moment, direction);
    if (found !== null) seek(source, found);
    else if (direction === 1) toEnd();
  };
  const around = atS ?? shown.toS;
  const keys: Record<string, () => void> = {
    ArrowLeft: () => jump(-1),
    ArrowRight: () => jump(1),
    Home: () => seek(source, whole.fromS),
    End: toEnd,
    "+": () => setView(zoomed(shown, whole, around, 1 / STEP)),
    "-": () => setView(zoomed(shown, whole, around, STEP)),
    "0": () => setView(null),
    " ": play,
  };
  const onKeyDown = (event: KeyboardEvent): void => {
    const act = keys[event.key];
    if (act === undefined || isEmpty || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    act();
  };
  const onPointerDown = (event: PointerEvent): void => {
    if (event.button !== 0 || isEmpty) return;
    event.currentTarget.setPointerCapture(event.pointerId);
    drag.current = { x: event.clientX, shown, isMoved: false };
    setHover(null);
  };
  const onPointerMove = (event: PointerEvent): void => {
    const { x, y } = placeIn(event);
    const held = drag.current;
    if (held === null) {
      const marked = bookmarks.find((one) => Math.abs(placeOf(one.at_s, shown, width) - x) < MARK_PX);
      const block = blockAt(blocks, lanes[Math.floor(y / LANE_PX)], x);
      const text = marked === undefined ? textOf(block, describe) : `${formatTime(marked.at_s)} · ${words.mark}: ${marked.label}`;
      setHover({ x, text: text ?? formatTime(momentAt(x, shown, width)) });
      return;
    }
    const byPx = event.clientX - held.x;
    held.isMoved ||= Math.abs(byPx) > DRAG_PX;
    const byS = (byPx / Math.max(width - NAMES_PX, 1)) * (held.shown.toS - held.shown.fromS);
    if (held.isMoved) setView(panned(held.shown, whole, -byS));
  };
  const onPointerUp = (event: PointerEvent): void => {
    const held = drag.current;
    drag.current = null;
    if (held !== null && !held.isMoved) seek(source, momentAt(placeIn(event).x, shown, width));
  };
  const present = eventAt(drawn, moment);
  const told = [atS === null ? words.now : formatTime(moment)];
  if (present !== undefined) told.push(describe(present));
  return (
    <div
      ref={box}
      className={css.lanes}
      role="slider"
      tabIndex={0}
      aria-label={words.bar}
      aria-valuemin={whole.fromS}
      aria-valuemax={whole.toS}
      aria-valuenow={moment}
      aria-valuetext={told.join("; ")}
      aria-disabled={isEmpty}
      onKeyDown={onKeyDown}
      onPointerDown={onPointerDown}
      onPointerMove={onPointerMove}
      onPointerUp={onPointerUp}
      onPointerCancel={() => (drag.current = null)}
      onPointerLeave={() => setHover(null)}
    >
      <svg width={width} height={height} aria-hidden="true">
        {lanes.map((lane, place) => (
          <g key={lane} className={css.lane}>
            <line x1={0} x2={width} y1={(place + 1) * LANE_PX} y2={(place + 1) * LANE_PX} />
            <text x={0} y={(place + 1) * LANE_PX - 2}>
              {words.lanes[lane]}
            </text>
          </g>
        ))}
        {ticksOf(shown, width).map((tick) => (
          <text key={tick} className={css.tick} x={placeOf(tick, shown, width)} y={height - 2}>
            {formatTime(tick)}
          </text>
        ))}
        {lanes.includes("MOOD") && <MoodLine shown={shown} width={width} top={lanes.indexOf("MOOD") * LANE_PX} />}
        {blocks.map((one, place) => (
          <BlockShape
            key={place}
            block={one}
            top={lanes.indexOf(one.lane) * LANE_PX}
            title={titleOf(one.event.agent)}
          />
        ))}
        <g className={css.marks}>
          {bookmarks
            .filter((one) => one.at_s >= shown.fromS && one.at_s <= shown.toS)
            .map((one) => (
              <rect key={`${one.at_s} ${one.label}`} x={placeOf(one.at_s, shown, width) - 1} width={2} height={height - TICKS_PX} />
            ))}
        </g>
        {moment >= shown.fromS && moment <= shown.toS && (
          <rect className={css.cursor} x={Math.min(placeOf(moment, shown, width), width - 1) - 1} width={2} height={height} />
        )}
      </svg>
      {hover !== null && (
        <span
          className={css.hover}
          aria-hidden="true"
          style={{ left: hover.x, top: height, transform: `translateX(-${(hover.x / Math.max(width, 1)) * 100}%)` }}
        >
          {hover.text}
        </span>
      )}
    </div>
  );
}

function textOf(block: Block | undefined, describe: (event: EventRecord) => string): string | undefined {
  if (block === undefined) return undefined;
  return describe(block.event) + (block.count > 1 ? ` (${block.count - 1} ${words.more})` : "");
}

function BlockShape({ block, top, title }: { block: Block; top: number; title: string }) {
  const { event, x, width, lane } = block;
  const text = lane === "AGENT" ? `${MARKS[event.kind] ?? "✘"} ${title}` : event.text;
  const hasText = width >= (TEXT_PX[lane] ?? Infinity);
  return (
    <g className={css.block} data-lane={lane} data-kind={event.kind} data-failed={isFailure(event) || undefined}>
      <rect x={x} y={top + 1} width={Math.max(width - 1, MARK_PX - 1)} height={LANE_PX - 2} rx={2} />
      {hasText && (
        <text x={x + 3} y={top + LANE_PX - 2}>
          {text.slice(0, Math.floor((width - 6) / LETTER_PX))}
        </text>
      )}
    </g>
  );
}

/** The mood during the run on show. */
function MoodLine({ shown, width, top }: { shown: Span; width: number; top: number }) {
  const moods = useCollection("moods", PERIOD_MS);
  const { hello } = useConnection();
  const parameter = hello?.parameters.find((one) => one.is_mood);
  const thresholds = useThresholds(parameter, moods[0]?.[1].mood);
  if (parameter === undefined) return null;
  const y = (mood: number): number => {
    const share = (mood - parameter.minimum) / Math.max(parameter.maximum - parameter.minimum, 1e-9);
    return top + LANE_PX - 1 - Math.min(Math.max(share, 0), 1) * (LANE_PX - 2);
  };
  const points = moods
    .map(([, one]) => one)
    .filter((one) => one.at_s >= shown.fromS && one.at_s <= shown.toS)
    .map((one) => `${placeOf(one.at_s, shown, width)},${y(one.mood)}`);
  return (
    <>
      {thresholds.map(({ mood, give, fromS, toS }, place) => (
        <line
          key={place}
          className={css.threshold}
          data-give={give}
          x1={placeOf(Math.max(fromS, shown.fromS), shown, width)}
          x2={placeOf(Math.max(Math.min(toS, shown.toS), shown.fromS), shown, width)}
          y1={y(mood)}
          y2={y(mood)}
        />
      ))}
      <polyline className={css.mood} points={points.join(" ")} />
    </>
  );
}

/** Mood values at which a rule gives feedback in the run on show. */
function useThresholds(parameter: ParameterRecord | undefined, sensed: number | undefined) {
  const runs = useCollection("runs", PERIOD_MS);
  const run = runs.map(([, one]) => one).sort((one, other) => other.began_s - one.began_s)[0];
  const rules = useEntry("agents", run?.agent ?? "")?.rules ?? [];
  const awarded = useEntry("scene")?.values.find((one) => one.name === parameter?.name);
  // The first sensed mood replaces a given one.
  const start = awarded?.origin === "GIVEN" ? (sensed ?? awarded.value) : (awarded?.value ?? sensed ?? null);
  if (run === undefined || parameter === undefined || start === null) return [];
  return rules
    .flatMap(({ changes, give }) => changes.map((change) => ({ mood: start + change, give })))
    .filter(({ mood }) => mood >= parameter.minimum && mood <= parameter.maximum)
    .map((one) => ({ ...one, fromS: run.began_s, toS: run.ended_s ?? Infinity }));
}
