// SPDX-License-Identifier: Apache-2.0
// Entries of the studio in the page: one subscription an entry or a collection.

import { useCallback, useSyncExternalStore } from "react";
import type { Collections, Delta, Snapshot } from "./protocol";

type Name = keyof Collections;
type Listener = () => void;

const collections = new Map<string, Map<string, unknown>>();
const lists = new Map<string, readonly [string, unknown][]>();
const listeners = new Map<string, Set<Listener>>();

const entryTopic = (name: string, key: string): string => `${name}\u0000${key}`;

function subscribe(topic: string, listener: Listener): () => void {
  let all = listeners.get(topic);
  if (all === undefined) listeners.set(topic, (all = new Set()));
  all.add(listener);
  return () => {
    all.delete(listener);
    if (all.size === 0) listeners.delete(topic);
  };
}

function notify(topics: Iterable<string>): void {
  for (const topic of topics) for (const listener of listeners.get(topic) ?? []) listener();
}

/** Longest time until changes are applied where no frames are drawn, as in a tab that is hidden. */
const HIDDEN_MS = 500;

let waiting: Delta[] = [];
let frame = 0;
let timer = 0;

/** Replace everything by a snapshot. */
export function replaceAll(snapshot: Snapshot): void {
  waiting = [];
  const topics = new Set<string>();
  const names = new Set([...collections.keys(), ...Object.keys(snapshot.entries)]);
  for (const name of names) {
    const before = collections.get(name) ?? new Map<string, unknown>();
    const after = new Map(Object.entries(snapshot.entries[name] ?? {}));
    for (const key of new Set([...before.keys(), ...after.keys()])) topics.add(entryTopic(name, key));
    collections.set(name, after);
    lists.delete(name);
    topics.add(name);
  }
  notify(topics);
}

/**
 * Apply the changes of a delta with the next frame.
 *
 * A page that is busy draws fewer frames and applies more at once, instead of falling behind.
 */
export function apply(delta: Delta): void {
  waiting.push(delta);
  if (waiting.length > 1) return;
  frame = requestAnimationFrame(applyWaiting);
  timer = window.setTimeout(applyWaiting, HIDDEN_MS);
}

function applyWaiting(): void {
  cancelAnimationFrame(frame);
  window.clearTimeout(timer);
  const topics = new Set<string>();
  for (const [name, key, value] of waiting.flatMap((delta) => delta.changes)) {
    let entries = collections.get(name);
    if (entries === undefined) collections.set(name, (entries = new Map()));
    if (value === null) entries.delete(key);
    else entries.set(key, value);
    lists.delete(name);
    topics.add(entryTopic(name, key)).add(name);
  }
  waiting = [];
  notify(topics);
}

export function readEntry<N extends Name>(name: N, key = ""): Collections[N] | undefined {
  return collections.get(name)?.get(key) as Collections[N] | undefined;
}

/** Call back after each change of a collection, without rendering anything; returns how to end it. */
export function watchCollection(name: Name, watcher: () => void): () => void {
  return subscribe(name, watcher);
}

/** An entry; the component is rendered again when it changes. */
export function useEntry<N extends Name>(name: N, key = ""): Collections[N] | undefined {
  const topic = entryTopic(name, key);
  const subscribeTo = useCallback((listener: Listener) => subscribe(topic, listener), [topic]);
  return useSyncExternalStore(subscribeTo, () => readEntry(name, key));
}

const EMPTY: readonly [string, never][] = [];

/**
 * All keys and values of a collection, in the order in which they were entered.
 *
 * With a period the component is rendered again at most that often, for what changes quicker than it is read.
 */
export function useCollection<N extends Name>(name: N, periodMs = 0): readonly [string, Collections[N]][] {
  const subscribeTo = useCallback(
    (listener: Listener) => subscribe(name, periodMs > 0 ? later(listener, periodMs) : listener),
    [name, periodMs],
  );
  return useSyncExternalStore(subscribeTo, () => {
    let list = lists.get(name);
    if (list === undefined) {
      const entries = collections.get(name);
      list = entries === undefined ? EMPTY : [...entries];
      lists.set(name, list);
    }
    return list as readonly [string, Collections[N]][];
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
