// SPDX-License-Identifier: Apache-2.0
// Names of nodes, and badges of decorators: a symbol or key, and the value.

import type { TreeNodeRecord } from "./protocol";
import { texts } from "./texts";

/** Symbols that the common fonts have, as text: coloured ones would hide the colour of the status. */
const SYMBOLS: Record<string, string> = { cooldown: "❄\uFE0E", retry: "↻" };

/** The name of a node without the kind that it may begin with. */
export function nameWithoutKind(node: TreeNodeRecord): string {
  const [kind, ...rest] = node.name.split(" ");
  return kind === node.kind ? rest.join(" ") : node.name;
}

/** The value that an author has written for a decorator; empty for none, or one of several parts. */
function written(node: TreeNodeRecord): string {
  const value = nameWithoutKind(node);
  return value === "…" ? "" : value;
}

/** Text of a badge; with the attempts or rounds that remain, it says which one runs. */
export function badgeText(node: TreeNodeRecord, remaining: number | null): string {
  const value = written(node);
  const whole = Number(value);
  const parts = [SYMBOLS[node.kind] ?? node.kind];
  if (remaining !== null && Number.isInteger(whole) && whole > remaining)
    parts.push(`${whole - remaining} ${texts.live.of} ${whole}`);
  else {
    if (value !== "") parts.push(value);
    if (remaining !== null) parts.push(`(${remaining} ${texts.control.more})`);
  }
  return parts.join(" ");
}
