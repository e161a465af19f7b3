// SPDX-License-Identifier: Apache-2.0
// Empty panels: whether nothing has happened, no system is there, or this tab may not see it.

import { useConnection } from "./connection";
import { useCollection } from "./store";
import { texts } from "./texts";

/** What keeps the page from knowing anything, in words; empty when it knows what there is. */
export function useMissing(): string {
  const { phase, hello, atS } = useConnection();
  const parts = useCollection("parts");
  if (phase === "refused") return texts.connection.refused;
  if (hello === null) return phase === "lost" ? texts.connection.lost : texts.may.notConnected;
  if (atS !== null || parts.some(([, one]) => one.alive)) return "";
  return parts.length === 0 ? texts.empty.noSystem : texts.empty.silentSystem;
}

/** Sentence of a panel that has nothing to show. */
export function Empty({ children }: { children: string }) {
  return <p className="empty">{useMissing() || children}</p>;
}
