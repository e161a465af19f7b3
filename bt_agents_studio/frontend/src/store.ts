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

/** Replace everything by a snapshot. */
export function replaceAll(snapshot: Snapshot): void {
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

/** Apply the changes of a delta. */
export function apply(delta: Delta): void {
  const topics = new Set<string>();
  for (const [name, key, value] of delta.changes) {
    let entries = collections.get(name);
    if (entries === undefined) collections.set(name, (entries = new Map()));
    if (value === null) entries.delete(key);
    else entries.set(key, value);
    lists.delete(name);
    topics.add(entryTopic(name, key)).add(name);
  }
  notify(topics);
}

export function readEntry<N extends Name>(name: N, key = ""): Collections[N] | undefined {
  return collections.get(name)?.get(key) as Collections[N] | undefined;
}

/** An entry; the component is rendered again when it changes. */
export function useEntry<N extends Name>(name: N, key = ""): Collections[N] | undefined {
  const topic = entryTopic(name, key);
  const subscribeTo = useCallback((listener: Listener) => subscribe(topic, listener), [topic]);
  return useSyncExternalStore(subscribeTo, () => readEntry(name, key));
}

const EMPTY: readonly [string, never][] = [];

/** All keys and values of a collection, in the order in which they were entered. */
export function useCollection<N extends Name>(name: N): readonly [string, Collections[N]][] {
  const subscribeTo = useCallback((listener: Listener) => subscribe(name, listener), [name]);
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
