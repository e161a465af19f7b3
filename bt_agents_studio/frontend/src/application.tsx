// SPDX-License-Identifier: Apache-2.0
// The application: its pages, each with an address, its connection and its time bar.

import { StrictMode, useEffect, useState } from "react";
import { createRoot } from "react-dom/client";
import { connect, follow, seek, useConnection } from "./connection";
import { formatTime } from "./formatting";
import { Bookmarks, Marks } from "./recording";
import { PAGES, writeAddress, type Page } from "./address";
import { Keys } from "./keys";
import { Live } from "./live";
import { Market } from "./market";
import { go, startNavigation, useAddress, useMomentInAddress } from "./navigation";
import { PanelBoundary } from "./panel_boundary";
import { Phase } from "./phase";
import { StatusStrip } from "./status_strip";
import { System } from "./system";
import { usePresent } from "./store";
import { texts } from "./texts";
import { startTheme } from "./theme";
import { Tune } from "./tune";
import { World } from "./world";

const SHOWN = { live: Live, market: Market, tune: Tune, world: World, system: System };

function App() {
  const address = useAddress();
  const { phase, hello } = useConnection();
  const isStale = phase !== "open" && phase !== "connecting";
  const isPerson = hello?.role === "person";
  const { page } = address;
  const Shown = page === null ? NoPage : SHOWN[page];
  useMomentInAddress();
  useEffect(() => {
    if (isPerson) location.replace("/person");
  }, [isPerson]);
  return (
    <>
      <header className={isStale ? "stale" : ""}>
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
            <PanelBoundary label={texts.time.bar}>
              <TimeBar />
            </PanelBoundary>
          </>
        )}
        <Phase />
        {!isPerson && (
          <>
            <Keys />
            <PanelBoundary label={texts.strip.label}>
              <StatusStrip />
            </PanelBoundary>
          </>
        )}
      </header>
      <main className={isStale ? "stale" : ""}>
        {!isPerson && (
          <PanelBoundary key={page} label={page === null ? texts.address.none : texts.pages[page]}>
            <Shown />
          </PanelBoundary>
        )}
      </main>
      <Title page={page} chosen={isPerson ? "" : address.agent} />
    </>
  );
}

function NoPage() {
  return (
    <section className="panel">
      <h2>{texts.address.none}</h2>
      <a href="/live">{texts.address.toLive}</a>
    </section>
  );
}

/** Title of the browser's tab: page, and agent that is chosen or runs. */
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

function TimeBar() {
  const { atS, source, firstS, lastS, offsetS, failure } = useConnection();
  const [nowS, setNowS] = useState(Date.now() / 1000);
  useEffect(() => {
    const timer = window.setInterval(() => setNowS(Date.now() / 1000), 1000);
    return () => window.clearInterval(timer);
  }, []);
  const last = source ? (lastS ?? 0) : nowS + offsetS;
  const first = firstS ?? last;
  const shown = Math.min(atS ?? last, last);
  return (
    <div className="time">
      <span className="track">
        <input
          type="range"
          aria-label={texts.time.bar}
          aria-valuetext={formatTime(shown)}
          min={first}
          max={last}
          step={0.1}
          value={shown}
          disabled={first >= last}
          onChange={(event) => seek(source, Number(event.target.value))}
        />
        <Marks firstS={first} lastS={last} />
      </span>
      <Bookmarks firstS={first} lastS={last} />
      <time>{formatTime(shown)}</time>
      {atS === null ? (
        <span>{texts.time.now}</span>
      ) : (
        <button type="button" onClick={follow}>
          {texts.time.back}
        </button>
      )}
      {source && <span>{source}</span>}
      {failure && <span className="failure">{failure}</span>}
    </div>
  );
}

/** Draw the page and connect it to its studio. */
export function start(root: HTMLElement): void {
  createRoot(root).render(
    <StrictMode>
      <App />
    </StrictMode>,
  );
  startTheme();
  startNavigation();
  connect();
}
