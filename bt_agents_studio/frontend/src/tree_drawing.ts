// SPDX-License-Identifier: Apache-2.0
// Shared types and functions of the drawings of a tree.

import type { ReactNode } from "react";
import type { NodeRecord, TreeRecord } from "./protocol";
import { texts } from "./texts";
import type { Shown } from "./tree_nesting";

export const statusOf = (record: NodeRecord | undefined): string => record?.status ?? "INVALID";
export const statusWords = (record: NodeRecord | undefined): string => {
  const status = statusOf(record);
  return texts.live.statuses[status] ?? status;
};

export interface DrawingProps {
  record: TreeRecord;
  roots: readonly Shown[];
  byPath: ReadonlyMap<string, Shown>;
  folded: ReadonlySet<string>;
  fold: (path: string) => void;
  /** Path of the tip, without modifiers; empty without a run. */
  tip: string;
  chosen: string;
  choose: (path: string) => void;
  /** Node to bring into view when it changes; empty for none. */
  goal: { path: string };
  goTo: (path: string) => void;
  /** Paths that the search matches. */
  found: ReadonlySet<string>;
  /** Paths of the nodes with a breakpoint. */
  stops: readonly string[];
  toggleStop: (path: string) => void;
  showDetails: () => void;
  focusSearch: () => void;
  /** Controls of the bar in every drawing. */
  tools: ReactNode;
}
