// SPDX-License-Identifier: Apache-2.0
// Connection of the page to its studio: it comes back by itself, and goes on where it was.

import { useSyncExternalStore } from "react";
import { VERSION, type BookmarkRecord, type ClientMessage, type Hello, type Operations, type ServerMessage } from "./protocol";
import { apply, replaceAll } from "./store";

export interface ConnectionState {
  /** "refused" needs the printed address again; "outdated" needs the page to be loaded anew. */
  phase: "connecting" | "open" | "lost" | "refused" | "outdated";
  hello: Hello | null;
  /** Difference of the studio's clock to this one [s]. */
  offsetS: number;
  /** Moment that is shown [s since 1970]; null for now. */
  atS: number | null;
  source: string;
  firstS: number | null;
  lastS: number | null;
  /** Marked moments of the recording that is shown. */
  bookmarks: BookmarkRecord[];
  failure: string;
}

const LIMIT_MS = 35_000;
const KEY = "key";
const RETRIES_MS = [250, 500, 1000, 2000];

let state: ConnectionState = {
  phase: "connecting",
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
let sequence = 0;
let known = "";
let attempts = 0;
let timer = 0;
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
        hello: message,
        offsetS: message.now_s - Date.now() / 1000,
        firstS: state.firstS ?? message.now_s,
      });
      send({ type: "resume", version: VERSION, studio: known, sequence: known === message.studio ? sequence : 0 });
      known = message.studio;
      awaited = false;
      askForMoment();
      return;
    case "snapshot":
      if (message.at_s === null) sequence = message.sequence;
      else awaited = false;
      if ((message.at_s === null) !== (state.atS === null)) return;
      if (message.at_s !== state.atS || message.source !== state.source) askForMoment();
      replaceAll(message);
      update({
        firstS: message.first_s ?? state.firstS,
        lastS: message.last_s,
        bookmarks: message.bookmarks,
        failure: "",
      });
      return;
    case "delta":
      sequence = message.sequence;
      if (state.atS === null) apply(message);
      return;
    case "failure":
      awaited = false;
      update({ failure: message.message, atS: null, source: "" });
  }
}

/** Open the connection, and again whenever it is lost. */
export function connect(): void {
  window.clearTimeout(timer);
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const opened = new WebSocket(`${scheme}://${location.host}/api/socket`);
  socket = opened;
  opened.onmessage = (event) => handle(JSON.parse(event.data as string) as ServerMessage);
  opened.onclose = () => {
    if (socket !== opened || state.phase === "outdated") return;
    void retry();
  };
}

async function retry(): Promise<void> {
  update({ phase: "lost" });
  // Whether nobody is there or we are not let in, only a plain request can tell.
  try {
    const answer = await fetch("/api/journals");
    if (answer.status === 401) {
      update({ phase: "refused" });
      return;
    }
  } catch {
    // It is not there; it is tried again below.
  }
  const wait = RETRIES_MS[Math.min(attempts, RETRIES_MS.length - 1)];
  attempts += 1;
  timer = window.setTimeout(connect, wait);
}

/**
 * Exchange the token of the printed address for a session, if there is one.
 * Its cookie goes to all ports of this machine, so that whatever changes something needs a key, too.
 */
export async function logIn(): Promise<void> {
  const token = location.hash.slice(1);
  if (!/^[0-9a-f]{64}$/.test(token)) return;
  history.replaceState(null, "", location.pathname + location.search);
  const { key } = await post("/api/session", { token });
  if (key) sessionStorage.setItem(KEY, key);
}

export function seek(source: string, atS: number): void {
  update({ atS, source });
  askForMoment();
}

function askForMoment(): void {
  if (awaited || state.atS === null) return;
  awaited = true;
  send({ type: "seek", source: state.source, at_s: state.atS });
}

export function follow(): void {
  awaited = false;
  update({ atS: null, source: "" });
  send({ type: "follow" });
}

export interface Answer {
  accepted: boolean;
  code: string;
  message: string;
  /** What an operation of the studio itself has found. */
  record?: unknown;
  /** What this page has to send with whatever changes something. */
  key?: string;
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
