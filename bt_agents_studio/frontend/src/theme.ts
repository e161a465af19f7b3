// SPDX-License-Identifier: Apache-2.0
// Colours of the pages: light, dark, or those of the system; each browser keeps its choice.

import { useSyncExternalStore } from "react";

export const THEMES = ["system", "light", "dark"] as const;
export type Theme = (typeof THEMES)[number];

const KEY = "bt-agents theme";
const scheme = matchMedia("(prefers-color-scheme: dark)");
const listeners = new Set<() => void>();
let theme: Theme = "system";

/** Call back when the colours have changed, for what is drawn with them; returns how to end it. */
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

/** Use the theme that was chosen in this browser, also when another tab chooses one. */
export function startTheme(): void {
  applyTheme();
  window.addEventListener("storage", (event) => event.key === KEY && applyTheme());
}

function applyTheme(): void {
  theme = THEMES.find((one) => one === localStorage.getItem(KEY)) ?? "system";
  document.documentElement.dataset.theme = theme;
  for (const listener of listeners) listener();
}
