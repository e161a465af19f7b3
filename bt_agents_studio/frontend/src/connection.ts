// SPDX-License-Identifier: Apache-2.0
// Connection of the page to its studio; it reconnects by itself and resumes where it was.

import { useSyncExternalStore } from "react";
import { VERSION, type BookmarkRecord, type ClientMessage, type EventRecord, type Hello, type Operations, type ServerMessage } from "./protocol";
import { apply, replaceAll, setPresent } from "./store";

export interface ConnectionState {
  /** "refused" needs the printed address again; "outdated" needs a reload of the page. */
  phase: "connecting" | "open" | "lost" | "refused" | "outdated";
  /** Last message of a lost studio by this page's clock [s since 1970]; else null. */
  heardS: number | null;
  hello: Hello | null;
  /** Difference between the studio's clock and this one [s]. */
  offsetS: number;
  /** Moment on show [s since 1970]; null for now. */
  atS: number | null;
  source: string;
  firstS: number | null;
  /** Latest moment of the recording on show; null until it is known. */
  lastS: number | null;
  /** Whether the recording on show has been read to its end. */
  isWhole: boolean;
  /** Bookmarks of the recording on show. */
  bookmarks: BookmarkRecord[];
  failure: string;
}

const LIMIT_MS = 35_000;
const KEY = "key";
/** Storage entry that all tabs share; its change tells them that one of them has signed in. */
const SIGNED_IN = "bt-agents signed in";
const TOKEN = /^#[0-9a-f]{64}$/;
const RETRIES_MS = [250, 500, 1000, 2000];
/** Longest wait for an answer to the question whether the studio runs. */
const PROBE_MS = 3000;
const LOOK_MS = 250;
/** How long a refusal stays on show. */
const FAILURE_MS = 10_000;
/** Looks without a message until the studio counts as lost: it sends a message each second. */
const SILENT_LOOKS = 12;
/** The same while a snapshot loads, which may be large on a slow link. */
const LOADING_LOOKS = 40;

let state: ConnectionState = {
  phase: "connecting",
  heardS: null,
  hello: null,
  offsetS: 0,
  atS: null,
  source: "",
  firstS: null,
  lastS: null,
  isWhole: true,
  bookmarks: [],
  failure: "",
};
const listeners = new Set<() => void>();
let socket: WebSocket | null = null;
let query = "";
let sequence = 0;
let known = "";
let attempts = 0;
let timer = 0;
/** Time of the last message [s since 1970]; null before the first. */
let heardS: number | null = null;
let looks = 0;
let isLoading = false;
/** Secret of the printed address until the page exchanges it for a session. */
let token = "";
/** Number of the last attempt to reconnect; results of earlier attempts are ignored. */
let trial = 0;
/** A requested earlier moment has not arrived; until then only the newest request counts. */
let awaited = false;

function update(change: Partial<ConnectionState>): void {
  state = { ...state, ...change };
  for (const listener of listeners) listener();
}

export function useConnection(): ConnectionState {
  return useSyncExternalStore(
    (listener) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    () => state,
  );
}

function send(message: ClientMessage): void {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function handle(message: ServerMessage): void {
  heardS = Date.now() / 1000;
  // A message without a greeting is the rest of a lost connection.
  if (state.phase === "open" || message.type === "hello") looks = 0;
  switch (message.type) {
    case "hello":
      if (message.version !== VERSION) {
        update({ phase: "outdated", hello: message });
        return;
      }
      attempts = 0;
      // Without a first moment, time begins now.
      update({
        phase: "open",
        heardS: null,
        hello: message,
        offsetS: message.now_s - Date.now() / 1000,
        firstS: state.firstS ?? message.now_s,
      });
      // Another role sees other collections.
      if (known !== message.studio || state.hello?.role !== message.role) sequence = 0;
      known = message.studio;
      isLoading = sequence === 0;
      send({ type: "resume", version: VERSION, studio: known, sequence });
      awaited = false;
      askForMoment();
      return;
    case "snapshot":
      isLoading = false;
      if (message.at_s === null) sequence = message.sequence;
      else awaited = false;
      if (message.at_s === null && state.atS !== null) {
        setPresent(message);
        return;
      }
      if (message.at_s !== null && state.atS === null) return;
      if (message.at_s !== state.atS || message.source !== state.source) askForMoment();
      if (message.source !== state.source) return;
      replaceAll(message);
      update({
        // A moment older than everything kept becomes the oldest moment.
        atS: state.atS === null ? null : Math.max(state.atS, message.first_s ?? 0),
        firstS: message.first_s ?? state.firstS,
        lastS: message.last_s,
        isWhole: message.is_whole,
        bookmarks: message.bookmarks,
      });
      return;
    case "delta":
      sequence = message.sequence;
      apply(state.atS === null ? message : { type: "present", changes: message.changes, is_whole: false });
      return;
    case "present":
      apply(message);
      return;
    case "beat":
      return;
    case "failure":
      awaited = false;
      leavePast();
      update({ failure: message.message });
      window.setTimeout(() => update({ failure: "" }), FAILURE_MS);
  }
}

/**
 * Sign in if the address has a secret, open the connection, and reopen it whenever it is lost.
 *
 * The page Person names itself: a robot that appears in a browser talks only while one is open.
 */
export function connect(page?: "person"): void {
  if (page) query = `?page=${page}`;
  takeToken();
  void logIn().then(() => {
    if (trial === 0) open();
  });
  window.setInterval(watch, LOOK_MS);
  window.addEventListener("online", comeBack);
  document.addEventListener("visibilitychange", () => !document.hidden && comeBack());
  window.addEventListener("focus", comeBack);
  window.addEventListener("storage", (event) => event.key === SIGNED_IN && comeBack());
  // A newly pasted address may differ only in its hash.
  window.addEventListener("hashchange", () => {
    takeToken();
    if (token) renew();
  });
}

/** Retry at once when there is a reason to expect success. */
function comeBack(): void {
  const silentMs = Date.now() - (heardS ?? 0) * 1000;
  const isSilent = state.phase === "open" && silentMs > SILENT_LOOKS * LOOK_MS;
  if (!isSilent && state.phase !== "lost" && state.phase !== "refused") return;
  attempts = 0;
  renew();
}

/**
 * Give up a silent connection, even an open one: the studio may hang, or the network be down.
 *
 * Count looks, not time: after a sleep, the page first reads the messages that have arrived.
 */
function watch(): void {
  if (socket === null) return;
  looks += 1;
  if (looks >= (isLoading ? LOADING_LOOKS : SILENT_LOOKS)) renew();
}

function open(): void {
  window.clearTimeout(timer);
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const opened = new WebSocket(`${scheme}://${location.host}/api/socket${query}`);
  socket = opened;
  looks = 0;
  isLoading = false;
  opened.onmessage = (event) => {
    if (socket === opened) handle(JSON.parse(event.data as string) as ServerMessage);
  };
  opened.onclose = () => {
    if (socket === opened) renew();
  };
}

/** Close the connection, if there is one, and try again. */
function renew(): void {
  if (state.phase === "outdated") return;
  window.clearTimeout(timer);
  const closing = socket;
  socket = null;
  closing?.close();
  if (state.phase !== "refused") update({ phase: "lost", heardS });
  const mine = (trial += 1);
  const checked = logIn().then(isAllowed);
  void checked.then((allowed) => {
    if (mine !== trial) return;
    if (!allowed) {
      update({ phase: "refused" });
      return;
    }
    const wait = RETRIES_MS[Math.min(attempts, RETRIES_MS.length - 1)];
    attempts += 1;
    timer = window.setTimeout(open, wait);
  });
}

/** Ask with a plain request whether the studio lets this tab in; true also if nobody answers. */
async function isAllowed(): Promise<boolean> {
  try {
    const answer = await fetch("/api/journals", { signal: AbortSignal.timeout(PROBE_MS) });
    return answer.status !== 401;
  } catch {
    return true;
  }
}

/** Remove the secret of the printed address from the address bar. */
function takeToken(): void {
  if (!TOKEN.test(location.hash)) return;
  token = location.hash.slice(1);
  history.replaceState(history.state, "", location.pathname + location.search);
}

/**
 * Exchange the secret for a session; keep it for the next attempt if nobody answers.
 * All ports of this machine receive the cookie, so each change also needs a key.
 */
async function logIn(): Promise<void> {
  const sent = token;
  if (!sent) return;
  const { key, code } = await post("/api/session", { token: sent }, PROBE_MS);
  if (code !== "NO_STUDIO" && token === sent) token = "";
  if (!key) return;
  sessionStorage.setItem(KEY, key);
  localStorage.setItem(SIGNED_IN, String(Date.now()));
}

export function seek(source: string, atS: number): void {
  update(source === state.source ? { atS } : { atS, source, lastS: null, isWhole: false });
  isLoading = true;
  askForMoment();
}

/** Whether a requested earlier moment has not arrived yet. */
export function isAwaited(): boolean {
  return awaited;
}

function askForMoment(): void {
  if (awaited || state.atS === null) return;
  awaited = true;
  send({ type: "seek", source: state.source, at_s: state.atS });
}

export function follow(): void {
  awaited = false;
  leavePast();
  isLoading = true;
  send({ type: "follow" });
}

/** Changes cannot be applied to the past on show; only a snapshot replaces it. */
function leavePast(): void {
  if (state.atS !== null) sequence = 0;
  update({ atS: null, source: "" });
}

export interface Answer {
  accepted: boolean;
  code: string;
  message: string;
  /** Result of one of the studio's own operations. */
  record?: unknown;
  /** Key that this page sends with each change. */
  key?: string;
  /** Revision after the change, where the service counts revisions. */
  revision?: number;
}

/** Return the events of a recording; none if it cannot be read. */
export async function fetchEvents(source: string, signal: AbortSignal): Promise<EventRecord[]> {
  try {
    const answer = await fetch(`/api/journals/${encodeURIComponent(source)}/events`, { signal });
    return answer.ok ? ((await answer.json()) as { events: EventRecord[] }).events : [];
  } catch {
    return [];
  }
}

async function post(path: string, body: unknown, limitMs = LIMIT_MS): Promise<Answer> {
  try {
    const answer = await fetch(path, {
      method: "POST",
      headers: { "Content-Type": "application/json", Authorization: `Bearer ${sessionStorage.getItem(KEY) ?? ""}` },
      body: JSON.stringify(body),
      signal: AbortSignal.timeout(limitMs),
    });
    const found = (await answer.json()) as Partial<Answer>;
    return { accepted: false, code: "", message: "", ...found };
  } catch {
    return { accepted: false, code: "NO_STUDIO", message: "the studio does not answer" };
  }
}

/** Change something; return the answer of the service, even a refusal. */
export function operate<N extends keyof Operations>(
  name: N,
  fields: Operations[N],
  limitMs?: number,
): Promise<Answer> {
  return post(`/api/do/${name}`, fields, limitMs);
}

/** Whether this tab has a key; without one it can only look on. */
export function isSignedIn(): boolean {
  return (sessionStorage.getItem(KEY) ?? "") !== "";
}
