// SPDX-License-Identifier: Apache-2.0
// Colours of the pages: light, dark, or the system's; each browser keeps its choice.

import { useSyncExternalStore } from "react";

export const THEMES = ["system", "light", "dark"] as const;
export type Theme = (typeof THEMES)[number];

const KEY = "bt-agents theme";
const scheme = matchMedia("(prefers-color-scheme: dark)");
const listeners = new Set<() => void>();
let theme: Theme = "system";

/** Call back when the colours change, to redraw with them; return how to stop it. */
export function watchColours(changed: () => void): () => void {
  listeners.add(changed);
  scheme.addEventListener("change", changed);
  return () => {
    listeners.delete(changed);
    scheme.removeEventListener("change", changed);
  };
}

export function useTheme(): Theme {
  return useSyncExternalStore(watchColours, () => theme);
}

export function chooseTheme(chosen: Theme): void {
  localStorage.setItem(KEY, chosen);
  applyTheme();
}

/** Use the theme chosen in this browser, even if another tab changes it. */
export function startTheme(): void {
  applyTheme();
  window.addEventListener("storage", (event) => event.key === KEY && applyTheme());
}

function applyTheme(): void {
  theme = THEMES.find((one) => one === localStorage.getItem(KEY)) ?? "system";
  document.documentElement.dataset.theme = theme;
  for (const listener of listeners) listener();
}
