// SPDX-License-Identifier: Apache-2.0
// Names of nodes, and badges of decorators: a symbol or key, and the value.

import type { TreeNodeRecord } from "./protocol";
import { texts } from "./texts";

/** Symbols in common fonts, as text: coloured symbols would hide the colour of the status. */
const SYMBOLS: Record<string, string> = { cooldown: "❄\uFE0E", retry: "↻" };

/** Name of a node without its kind, which the name may begin with. */
export function nameWithoutKind(node: TreeNodeRecord): string {
  const [kind, ...rest] = node.name.split(" ");
  return kind === node.kind ? rest.join(" ") : node.name;
}

/** The decorator's value as the author wrote it; empty for none, or for one of several parts. */
function written(node: TreeNodeRecord): string {
  const value = nameWithoutKind(node);
  return value === "…" ? "" : value;
}

/** Text of a badge; if attempts or rounds remain, it names the current one. */
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
