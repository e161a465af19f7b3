// SPDX-License-Identifier: Apache-2.0
// Empty panels: nothing has happened, there is no system, or this tab lacks the rights.

import { useConnection } from "./connection";
import shared from "./shared.module.css";
import { useCollection } from "./store";
import { texts } from "./texts";

/** Why the page has no data, as text; empty if it has. */
export function useMissing(): string {
  const { phase, hello, atS } = useConnection();
  const parts = useCollection("parts");
  if (phase === "refused") return texts.connection.refused;
  if (hello === null) return phase === "lost" ? texts.connection.lost : texts.may.notConnected;
  if (atS !== null || parts.some(([, one]) => one.alive)) return "";
  return parts.length === 0 ? texts.empty.noSystem : texts.empty.silentSystem;
}

/** Text of a panel without content. */
export function Empty({ children }: { children: string }) {
  return <p className={shared.faint}>{useMissing() || children}</p>;
}
