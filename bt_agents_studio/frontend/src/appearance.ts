// SPDX-License-Identifier: Apache-2.0
// Colours and density of the pages; each browser keeps its choices.

import { useSyncExternalStore } from "react";

/** Choices, the usual one first. */
export const CHOICES = {
  theme: ["system", "light", "dark"],
  density: ["comfortable", "compact"],
} as const;
export type Choice = keyof typeof CHOICES;

const keyOf = (choice: Choice): string => `bt-agents ${choice}`;
const scheme = matchMedia("(prefers-color-scheme: dark)");
const listeners = new Set<() => void>();
const chosen = document.documentElement.dataset;

/** Call back when the colours may have changed, to redraw with them; return how to stop it. */
export function watchColours(changed: () => void): () => void {
  listeners.add(changed);
  scheme.addEventListener("change", changed);
  return () => {
    listeners.delete(changed);
    scheme.removeEventListener("change", changed);
  };
}

export function useChosen(choice: Choice): string | undefined {
  return useSyncExternalStore(watchColours, () => chosen[choice]);
}

export function choose(choice: Choice, value: string): void {
  localStorage.setItem(keyOf(choice), value);
  apply();
}

/** Apply the choices of this browser, even if another tab changes them. */
export function startAppearance(): void {
  apply();
  window.addEventListener("storage", apply);
}

function apply(): void {
  for (const choice of ["theme", "density"] as const) {
    const kept = localStorage.getItem(keyOf(choice));
    chosen[choice] = CHOICES[choice].find((one) => one === kept) ?? CHOICES[choice][0];
  }
  for (const listener of listeners) listener();
}
