// SPDX-License-Identifier: Apache-2.0
// Application of the page Person: the robot, and links to other pages for users with the rights.

import { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import { startAppearance } from "./appearance";
import { connect, useConnection } from "./connection";
import { PanelBoundary } from "./panel_boundary";
import { Person } from "./person";
import { language, words } from "./person_texts";
import { Phase } from "./phase";
import { texts } from "./texts";

function PersonApplication() {
  const { hello, phase } = useConnection();
  const isStale = phase !== "open" && phase !== "connecting";
  return (
    <div data-stale={isStale || undefined}>
      <header>
        <h1>bt-agents</h1>
        {hello !== null && hello.role !== "person" && (
          <nav>
            {Object.entries(texts.pages).map(([name, title]) => (
              <a key={name} href={`/${name}`} {...(name === "person" ? { "aria-current": "page" as const } : {})}>
                {title}
              </a>
            ))}
          </nav>
        )}
        <Phase />
      </header>
      <main>
        <PanelBoundary label={texts.pages.person}>
          <Person />
        </PanelBoundary>
      </main>
    </div>
  );
}

/** Draw the page and connect it to its studio. */
export function start(root: HTMLElement): void {
  document.documentElement.lang = language;
  // Components that all pages share say these.
  Object.assign(texts.connection, words.connection);
  const { notConnected, noKey, viewOnly } = words;
  Object.assign(texts.may, { notConnected, noKey, roles: { view: viewOnly } });
  createRoot(root).render(
    <StrictMode>
      <PersonApplication />
    </StrictMode>,
  );
  startAppearance();
  connect("person");
}
