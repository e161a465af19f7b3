// SPDX-License-Identifier: Apache-2.0
// Connection of the page to its studio: it comes back by itself, and goes on where it was.

import { useSyncExternalStore } from "react";
import { VERSION, type BookmarkRecord, type ClientMessage, type EventRecord, type Hello, type Operations, type ServerMessage } from "./protocol";
import { apply, replaceAll, setPresent } from "./store";

export interface ConnectionState {
  /** "refused" needs the printed address again; "outdated" needs the page to be loaded anew. */
  phase: "connecting" | "open" | "lost" | "refused" | "outdated";
  /** When the studio was heard last by the clock of this page [s since 1970], once it is lost; null before. */
  heardS: number | null;
  hello: Hello | null;
  /** Difference of the studio's clock to this one [s]. */
  offsetS: number;
  /** Moment that is shown [s since 1970]; null for now. */
  atS: number | null;
  source: string;
  firstS: number | null;
  /** Latest moment of the recording that is shown; null until it is known. */
  lastS: number | null;
  /** Marked moments of the recording that is shown. */
  bookmarks: BookmarkRecord[];
  failure: string;
}

const LIMIT_MS = 35_000;
const KEY = "key";
/** Entry that all tabs see; its change tells them that one of them has signed in. */
const SIGNED_IN = "bt-agents signed in";
const TOKEN = /^#[0-9a-f]{64}$/;
const RETRIES_MS = [250, 500, 1000, 2000];
/** Longest answer to whether the studio is there. */
const PROBE_MS = 3000;
const LOOK_MS = 250;
/** Time for which a refusal is shown. */
const FAILURE_MS = 10_000;
/** Looks without a message between them after which the studio is lost: it has something to say each second. */
const SILENT_LOOKS = 12;
/** The same while a snapshot is under way, as it may be large and the link slow. */
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
/** Of the last message [s since 1970]; null before the first. */
let heardS: number | null = null;
let looks = 0;
let isLoading = false;
/** Secret of the printed address that is still to be exchanged for a session. */
let token = "";
/** Number of the last try to come back; what an earlier one finds out comes too late. */
let trial = 0;
/** An earlier moment was asked for and has not come; until it does, only the newest wish counts. */
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
  // What comes without a greeting is the end of something that got lost.
  if (state.phase === "open" || message.type === "hello") looks = 0;
  switch (message.type) {
    case "hello":
      if (message.version !== VERSION) {
        update({ phase: "outdated", hello: message });
        return;
      }
      attempts = 0;
      // Before anything has happened, time begins now.
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
        // What is older than everything kept is shown as the oldest moment.
        atS: state.atS === null ? null : Math.max(state.atS, message.first_s ?? 0),
        firstS: message.first_s ?? state.firstS,
        lastS: message.last_s,
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
 * Sign in if the address has a secret, open the connection, and again whenever it is lost.
 *
 * A robot that appears in a browser talks to nobody unless a page Person is open, so that page names itself.
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
  // A newly pasted address differs in nothing else.
  window.addEventListener("hashchange", () => {
    takeToken();
    if (token) renew();
  });
}

/** Do not wait for the next try when there is a reason to believe that it succeeds. */
function comeBack(): void {
  const silentMs = Date.now() - (heardS ?? 0) * 1000;
  const isSilent = state.phase === "open" && silentMs > SILENT_LOOKS * LOOK_MS;
  if (!isSilent && state.phase !== "lost" && state.phase !== "refused") return;
  attempts = 0;
  renew();
}

/**
 * Give up a connection without messages, even if it is open, as it is when the studio hangs or the network is gone.
 *
 * Only looks are counted: a page that was asleep itself reads first what has come meanwhile.
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

/** Close the connection, if there still is one, and try again. */
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

/** Whether nobody is there or we are not let in, only a plain request can tell; the former is tried again. */
async function isAllowed(): Promise<boolean> {
  try {
    const answer = await fetch("/api/journals", { signal: AbortSignal.timeout(PROBE_MS) });
    return answer.status !== 401;
  } catch {
    return true;
  }
}

/** Move the secret of the printed address out of sight. */
function takeToken(): void {
  if (!TOKEN.test(location.hash)) return;
  token = location.hash.slice(1);
  history.replaceState(history.state, "", location.pathname + location.search);
}

/**
 * Exchange the secret for a session, if there is one; it is kept for the next try while nobody answers.
 * The cookie goes to all ports of this machine, so that whatever changes something needs a key, too.
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
  update({ atS, source, lastS: source === state.source ? state.lastS : null });
  isLoading = true;
  askForMoment();
}

/** Whether an earlier moment was asked for and has not come. */
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

/** What is shown is no state that changes can be applied to; only a snapshot replaces it. */
function leavePast(): void {
  if (state.atS !== null) sequence = 0;
  update({ atS: null, source: "" });
}

export interface Answer {
  accepted: boolean;
  code: string;
  message: string;
  /** What an operation of the studio itself has found. */
  record?: unknown;
  /** What this page has to send with whatever changes something. */
  key?: string;
  /** Of what the service has changed, where it counts that. */
  revision?: number;
}

/** Return the events of a recording; none while it cannot be read. */
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

/** Change something; the answer is that of the service, refusals included. */
export function operate<N extends keyof Operations>(
  name: N,
  fields: Operations[N],
  limitMs?: number,
): Promise<Answer> {
  return post(`/api/do/${name}`, fields, limitMs);
}

/** Whether this tab has a key, without which it can only look on. */
export function isSignedIn(): boolean {
  return (sessionStorage.getItem(KEY) ?? "") !== "";
}
