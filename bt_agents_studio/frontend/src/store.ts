// SPDX-License-Identifier: Apache-2.0
// The studio's entries in the page, with one subscription per entry or collection.

import { useCallback, useSyncExternalStore } from "react";
import type { Collections, Delta, Present, Snapshot } from "./protocol";

type Name = keyof Collections;
/** Collections whose present state is known while the page shows an earlier moment. */
type PresentName = "agents" | "bookmarks" | "events" | "live" | "market" | "parts" | "recording" | "runs" | "trees";
type Listener = () => void;

const collections = new Map<string, Map<string, unknown>>();
/** The same maps; while the page shows an earlier moment, the entries of the present. */
const present = new Map<string, Map<string, unknown>>();
/** Topic of a collection → list of its entries, until they change. */
const lists = new Map<string, readonly [string, unknown][]>();
const listeners = new Map<string, Set<Listener>>();

const entryTopic = (name: string, key: string): string => `${name}\u0000${key}`;
const presentTopic = (name: string, key: string): string => `\u0000${name}\u0000${key}`;
const presentListTopic = (name: string): string => `\u0000${name}`;

function subscribe(topic: string, listener: Listener): () => void {
  let all = listeners.get(topic);
  if (all === undefined) listeners.set(topic, (all = new Set()));
  all.add(listener);
  return () => {
    all.delete(listener);
    if (all.size === 0) listeners.delete(topic);
  };
}

function notify(topics: ReadonlySet<string>): void {
  for (const topic of topics) lists.delete(topic);
  for (const topic of topics) for (const listener of listeners.get(topic) ?? []) listener();
}

/** Longest wait before changes are applied where no frames are drawn, as in a hidden tab. */
const HIDDEN_MS = 500;

let waiting: (Delta | Present)[] = [];
let frame = 0;
let timer = 0;

/** Replace everything by a snapshot, but keep the present if it is of an earlier moment. */
export function replaceAll(snapshot: Snapshot): void {
  applyWaiting();
  const topics = new Set<string>();
  const names = new Set([...collections.keys(), ...Object.keys(snapshot.entries)]);
  for (const name of names) {
    const before = collections.get(name) ?? new Map<string, unknown>();
    const after = new Map(Object.entries(snapshot.entries[name] ?? {}));
    for (const key of new Set([...before.keys(), ...after.keys()])) topics.add(entryTopic(name, key));
    collections.set(name, after);
    topics.add(name);
  }
  notify(topics);
  if (snapshot.at_s === null) replacePresent(collections);
}

/** Replace the present by a snapshot, while the page shows an earlier moment. */
export function setPresent(snapshot: Snapshot): void {
  applyWaiting();
  replacePresent(new Map(Object.entries(snapshot.entries).map(([name, one]) => [name, new Map(Object.entries(one))])));
}

function replacePresent(entries: ReadonlyMap<string, Map<string, unknown>>): void {
  const topics = new Set<string>();
  for (const [name, values] of [...present, ...entries]) {
    topics.add(presentListTopic(name));
    for (const key of values.keys()) topics.add(presentTopic(name, key));
  }
  present.clear();
  for (const [name, values] of entries) present.set(name, values);
  notify(topics);
}

/**
 * Apply changes with the next frame: a delta to the entries on show, other changes to the present.
 *
 * A busy page draws fewer frames and applies more changes at once, so it does not fall behind.
 */
export function apply(changes: Delta | Present): void {
  waiting.push(changes);
  if (waiting.length > 1) return;
  frame = requestAnimationFrame(applyWaiting);
  timer = window.setTimeout(applyWaiting, HIDDEN_MS);
}

function applyWaiting(): void {
  cancelAnimationFrame(frame);
  window.clearTimeout(timer);
  const all = waiting;
  waiting = [];
  const topics = new Set<string>();
  for (const message of all) {
    if (message.type === "present" && message.is_whole) replacePresent(new Map());
    for (const [name, key, value] of message.changes) {
      if (message.type === "delta") {
        change(collections, name, key, value);
        topics.add(entryTopic(name, key)).add(name);
        const entries = collections.get(name);
        if (entries) present.set(name, entries);
      } else change(present, name, key, value);
      topics.add(presentTopic(name, key)).add(presentListTopic(name));
    }
  }
  notify(topics);
}

function change(all: Map<string, Map<string, unknown>>, name: string, key: string, value: unknown): void {
  let entries = all.get(name);
  if (entries === undefined) all.set(name, (entries = new Map()));
  if (value === null) entries.delete(key);
  else entries.set(key, value);
}

export function readEntry<N extends Name>(name: N, key = ""): Collections[N] | undefined {
  return collections.get(name)?.get(key) as Collections[N] | undefined;
}

/** Call back after each change of a collection, without rendering; return how to stop it. */
export function watchCollection(name: Name, watcher: () => void): () => void {
  return subscribe(name, watcher);
}

/** An entry; a change renders the component again. */
export function useEntry<N extends Name>(name: N, key = ""): Collections[N] | undefined {
  const topic = entryTopic(name, key);
  const subscribeTo = useCallback((listener: Listener) => subscribe(topic, listener), [topic]);
  return useSyncExternalStore(subscribeTo, () => readEntry(name, key));
}

/** The present state of an entry, even while the page shows an earlier moment. */
export function usePresent<N extends PresentName>(name: N, key = ""): Collections[N] | undefined {
  const topic = presentTopic(name, key);
  const subscribeTo = useCallback((listener: Listener) => subscribe(topic, listener), [topic]);
  return useSyncExternalStore(subscribeTo, () => present.get(name)?.get(key) as Collections[N] | undefined);
}

const EMPTY: readonly [string, never][] = [];

/**
 * All keys and values of a collection in order of entry.
 *
 * A period limits how often the component renders, for values that change faster than people read.
 */
export function useCollection<N extends Name>(name: N, periodMs = 0): readonly [string, Collections[N]][] {
  return useList(name, () => collections.get(name), periodMs) as readonly [string, Collections[N]][];
}

/** The present state of a collection, even while the page shows an earlier moment. */
export function usePresentCollection<N extends PresentName>(name: N, periodMs = 0): readonly [string, Collections[N]][] {
  return useList(presentListTopic(name), () => present.get(name), periodMs) as readonly [string, Collections[N]][];
}

function useList(
  topic: string,
  read: () => ReadonlyMap<string, unknown> | undefined,
  periodMs: number,
): readonly [string, unknown][] {
  const subscribeTo = useCallback(
    (listener: Listener) => subscribe(topic, periodMs > 0 ? later(listener, periodMs) : listener),
    [topic, periodMs],
  );
  return useSyncExternalStore(subscribeTo, () => {
    let list = lists.get(topic);
    if (list === undefined) {
      const entries = read();
      list = entries === undefined ? EMPTY : [...entries];
      lists.set(topic, list);
    }
    return list;
  });
}

function later(listener: Listener, periodMs: number): Listener {
  let timer = 0;
  return () => {
    timer ||= window.setTimeout(() => {
      timer = 0;
      listener();
    }, periodMs);
  };
}
