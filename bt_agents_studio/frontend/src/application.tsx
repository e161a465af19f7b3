// SPDX-License-Identifier: Apache-2.0
// The application: its pages with their addresses, its connection and its timeline.

import { lazy, StrictMode, Suspense, useEffect } from "react";
import { createRoot } from "react-dom/client";
import { PAGES, writeAddress, type Page } from "./address";
import { startAppearance } from "./appearance";
import css from "./application.module.css";
import { connect, useConnection } from "./connection";
import { Keys } from "./keys";
import { Live } from "./live";
import { go, startNavigation, useAddress, useMomentInAddress } from "./navigation";
import { Palette } from "./palette";
import { PanelBoundary } from "./panel_boundary";
import { Phase } from "./phase";
import shared from "./shared.module.css";
import { StatusStrip } from "./status_strip";
import { usePresent } from "./store";
import { texts } from "./texts";
import { Timeline } from "./timeline";
import { loadMap } from "./tree_panel";
import { Undo } from "./undo";

/** Pages that load when somebody opens them. */
const LATER = {
  market: () => import("./market").then((one) => ({ default: one.Market })),
  tune: () => import("./tune").then((one) => ({ default: one.Tune })),
  world: () => import("./world").then((one) => ({ default: one.World })),
  system: () => import("./system").then((one) => ({ default: one.System })),
};
const SHOWN = {
  live: Live,
  market: lazy(LATER.market),
  tune: lazy(LATER.tune),
  world: lazy(LATER.world),
  system: lazy(LATER.system),
};
/** Delay before these and the map load anyway [ms], so that they open even without a studio. */
const LATER_MS = 3000;

function App() {
  const address = useAddress();
  const { phase, hello } = useConnection();
  const isStale = phase !== "open" && phase !== "connecting";
  const isPerson = hello?.role === "person";
  const { page } = address;
  const Shown = page === null ? NoPage : SHOWN[page];
  useMomentInAddress();
  useEffect(() => {
    if (phase !== "open") return;
    const timer = window.setTimeout(() => {
      for (const load of [...Object.values(LATER), loadMap]) void load().catch(() => undefined);
    }, LATER_MS);
    return () => window.clearTimeout(timer);
  }, [phase]);
  useEffect(() => {
    if (isPerson) location.replace("/person");
  }, [isPerson]);
  return (
    <div className={css.application} data-stale={isStale || undefined}>
      <header>
        <div className={css.rail}>
          <h1>bt-agents</h1>
          {!isPerson && (
            <>
              <nav>
                {PAGES.map((name) => (
                  <a
                    key={name}
                    href={writeAddress({ ...address, page: name })}
                    {...(name === page ? { "aria-current": "page" as const } : {})}
                    onClick={(event) => {
                      if (event.metaKey || event.ctrlKey) return;
                      event.preventDefault();
                      go({ page: name }, true);
                    }}
                  >
                    {texts.pages[name]}
                  </a>
                ))}
                {/* It is a document of its own. */}
                <a href="/person">{texts.pages.person}</a>
              </nav>
              <Keys />
              <Palette />
            </>
          )}
        </div>
        {!isPerson && (
          <PanelBoundary label={texts.time.bar}>
            <Timeline />
          </PanelBoundary>
        )}
        <div className={css.status}>
          <Phase />
          {!isPerson && (
            <PanelBoundary label={texts.strip.label}>
              <StatusStrip />
            </PanelBoundary>
          )}
        </div>
      </header>
      <main>
        {!isPerson && (
          <PanelBoundary key={page} label={page === null ? texts.address.none : texts.pages[page]}>
            <Suspense>
              <Shown />
            </Suspense>
          </PanelBoundary>
        )}
      </main>
      <Undo />
      <Title page={page} chosen={isPerson ? "" : address.agent} />
    </div>
  );
}

function NoPage() {
  return (
    <section className={shared.panel}>
      <h2>{texts.address.none}</h2>
      <a href="/live">{texts.address.toLive}</a>
    </section>
  );
}

/** Title of the browser's tab: the page, and the agent that is chosen or running. */
function Title({ page, chosen }: { page: Page | null; chosen: string }) {
  const market = usePresent("market");
  const name = chosen || (market?.agent ?? "");
  const agent = usePresent("agents", name)?.title || name;
  const parts = [page === null ? texts.address.none : texts.pages[page], agent, texts.address.studio];
  const title = parts.filter(Boolean).join(" · ");
  useEffect(() => {
    document.title = title;
  }, [title]);
  return null;
}

/** Draw the page and connect it to its studio. */
export function start(root: HTMLElement): void {
  createRoot(root).render(
    <StrictMode>
      <App />
    </StrictMode>,
  );
  startAppearance();
  startNavigation();
  connect();
}
