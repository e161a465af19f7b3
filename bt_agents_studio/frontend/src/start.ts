// SPDX-License-Identifier: Apache-2.0
// Starts a document: loads its part of the page, and shows a text if that fails.

import "./language";
import "./base.css";
import shared from "./shared.module.css";
import { texts } from "./texts";

interface Part {
  start: (root: HTMLElement) => void;
}

export function load(part: () => Promise<Part>): void {
  const root = document.getElementById("root");
  if (root !== null) part().then(({ start }) => start(root)).catch((error: unknown) => report(root, error));
}

function report(root: HTMLElement, error: unknown): void {
  const panel = document.createElement("section");
  panel.className = shared.panel ?? "";
  panel.setAttribute("role", "alert");
  for (const [name, text] of [
    ["h1", texts.failure.loading],
    ["p", texts.failure.outside],
    ["pre", String(error)],
  ] as const) {
    panel.append(Object.assign(document.createElement(name), { textContent: text }));
  }
  root.replaceChildren(panel);
}
