// SPDX-License-Identifier: Apache-2.0
// The application: its pages, each with an address, its connection and its time bar.

import { StrictMode, useEffect, useState } from "react";
import { createRoot } from "react-dom/client";
import { connect, follow, logIn, seek, useConnection } from "./connection";
import { formatTime } from "./formatting";
import { Bookmarks, Marks } from "./recording";
import { Live } from "./live";
import { Market } from "./market";
import { PanelBoundary } from "./panel_boundary";
import { Phase } from "./phase";
import { System } from "./system";
import { texts } from "./texts";
import { Tune } from "./tune";
import { World } from "./world";

const PAGES = { live: Live, market: Market, tune: Tune, world: World, system: System };
type Page = keyof typeof PAGES;

const isPage = (name: string): name is Page => name in PAGES;

function pageOf(path: string): Page {
  const name = path.split("/")[1] ?? "";
  return isPage(name) ? name : "live";
}

function App() {
  const [page, setPage] = useState(pageOf(location.pathname));
  const isPerson = useConnection().hello?.role === "person";
  useEffect(() => {
    const changed = (): void => setPage(pageOf(location.pathname));
    window.addEventListener("popstate", changed);
    return () => window.removeEventListener("popstate", changed);
  }, []);
  useEffect(() => {
    if (isPerson) location.replace("/person");
  }, [isPerson]);
  const Shown = PAGES[page];
  return (
    <>
      <header>
        <h1>bt-agents</h1>
        {!isPerson && (
          <>
            <nav>
              {Object.keys(PAGES).filter(isPage).map((name) => (
                <a
                  key={name}
                  href={`/${name}`}
                  {...(name === page ? { "aria-current": "page" as const } : {})}
                  onClick={(event) => {
                    if (event.metaKey || event.ctrlKey) return;
                    event.preventDefault();
                    history.pushState(null, "", `/${name}`);
                    setPage(name);
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
      </header>
      <main>
        {!isPerson && (
          <PanelBoundary key={page} label={texts.pages[page]}>
            <Shown />
          </PanelBoundary>
        )}
      </main>
    </>
  );
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
  void logIn().then(connect);
}
