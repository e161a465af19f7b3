// SPDX-License-Identifier: Apache-2.0
// State of the page in the address bar, so that a reload, a link and the back button restore it.

import { useEffect, useSyncExternalStore } from "react";
import { readAddress, writeAddress, type Address } from "./address";
import { follow, seek, useConnection } from "./connection";

/** A browser refuses an address that changes with each pixel of a drag. */
const WRITE_MS = 250;

let address = readAddress(location.pathname, location.search);
const listeners = new Set<() => void>();
let timer = 0;

export function useAddress(): Address {
  return useSyncExternalStore(
    (listener) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    () => address,
  );
}

/** Change the page's state; the back button undoes a step with the smaller changes after it. */
export function go(change: Partial<Address>, isStep: boolean): void {
  const after = { ...address, ...change };
  if (isStep) {
    write();
    if (writeAddress(after) !== writeAddress(address)) history.pushState(null, "", writeAddress(after));
  } else timer ||= window.setTimeout(write, WRITE_MS);
  address = after;
  for (const listener of listeners) listener();
}

function write(): void {
  if (timer) history.replaceState(null, "", writeAddress(address));
  window.clearTimeout(timer);
  timer = 0;
}

/** Keep the moment on show and the moment of the address the same. */
export function useMomentInAddress(): void {
  const { atS, source, failure } = useConnection();
  useEffect(() => {
    if (atS === address.atS && source === address.source) return;
    const isMove = atS !== null && address.atS !== null && source === address.source;
    go({ atS, source }, !isMove && failure === "");
  }, [atS, source, failure]);
}

/** Show the state in the address, and follow the back button. */
export function startNavigation(): void {
  if (address.atS !== null) seek(address.source, address.atS);
  window.addEventListener("popstate", () => {
    window.clearTimeout(timer);
    timer = 0;
    const before = address;
    address = readAddress(location.pathname, location.search);
    if (address.atS === null && before.atS !== null) follow();
    if (address.atS !== null && (address.atS !== before.atS || address.source !== before.source)) {
      seek(address.source, address.atS);
    }
    for (const listener of listeners) listener();
  });
}
