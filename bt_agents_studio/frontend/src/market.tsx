// SPDX-License-Identifier: Apache-2.0
// Page "Market": rounds with their bids, profiles, and the causes of their changes.

import { useLayoutEffect, useRef, useState } from "react";
import { author } from "./author";
import { Bids, smallestChange } from "./bids";
import { operate } from "./connection";
import { causeOf, ProfileCourse, Shares } from "./course";
import { Divider } from "./divider";
import { DryRun } from "./dry_run";
import { Empty } from "./empty";
import { formatNumber, formatTime } from "./formatting";
import css from "./market.module.css";
import { go, useAddress } from "./navigation";
import { OperationButton, Outcome, useOperation, WhyNot } from "./operation";
import { PanelBoundary } from "./panel_boundary";
import type { RoundRecord } from "./protocol";
import shared from "./shared.module.css";
import { useCollection, useEntry } from "./store";
import { Strategy } from "./strategy";
import { texts } from "./texts";
import { offerUndo } from "./undo";

const words = texts.market;

export function Market() {
  const rounds = useCollection("rounds");
  const { round: asked } = useAddress();
  const key = asked || rounds.at(-1)?.[0] || "";
  const round = useEntry("rounds", key);
  return (
    <div className={shared.columns}>
      <div className={shared.main}>
        <PanelBoundary label={words.rounds}>
          <Rounds shown={key} show={(name) => go({ round: name }, true)} />
        </PanelBoundary>
        {round ? (
          <PanelBoundary key={key} label={words.bids}>
            <Round round={round} />
          </PanelBoundary>
        ) : (
          rounds.length > 0 && <Empty>{words.gone}</Empty>
        )}
        <PanelBoundary label={words.strategy}>
          <Strategy />
        </PanelBoundary>
        <PanelBoundary label={words.dryRun}>
          <DryRun />
        </PanelBoundary>
        <PanelBoundary label={words.shares}>
          <Shares />
        </PanelBoundary>
      </div>
      <div className={shared.side}>
        <Divider />
        <PanelBoundary label={words.profiles}>
          <Agents />
        </PanelBoundary>
        <PanelBoundary label={words.feedback}>
          <FeedbackList />
        </PanelBoundary>
      </div>
    </div>
  );
}

function Rounds({ shown, show }: { shown: string; show: (key: string) => void }) {
  const rounds = useCollection("rounds");
  const market = useEntry("market");
  const box = useRef<HTMLDivElement>(null);
  /** Button at the left edge of the frame, and its place; null at the newest round. */
  const edge = useRef<{ button: HTMLElement; left: number } | null>(null);
  const hold = (): void => {
    const left = box.current?.scrollLeft ?? 0;
    const button = ([...(box.current?.children ?? [])] as HTMLElement[]).find((one) => one.offsetLeft >= left);
    edge.current = left > 0 && button !== undefined ? { button, left: button.offsetLeft } : null;
  };
  // The browser keeps lines in place when others appear above, but not columns.
  useLayoutEffect(() => {
    const { button, left } = edge.current ?? {};
    if (button?.isConnected && left !== undefined) box.current?.scrollBy({ left: button.offsetLeft - left });
    hold();
  }, [rounds]);
  return (
    <section className={shared.panel} aria-label={words.rounds}>
      <h2>
        {words.rounds} <span>{market?.message}</span>
      </h2>
      {rounds.length === 0 && <Empty>{words.none}</Empty>}
      <div className={css.rounds} ref={box} onScroll={hold}>
        {[...rounds].reverse().map(([name, one]) => (
          <button key={name} type="button" aria-pressed={name === shown} onClick={() => show(name)}>
            <b>{one.round}</b> {one.scene.label || formatTime(one.at_s)}
            <br />
            {one.winner || one.outcome.toLowerCase().replaceAll("_", " ")}
          </button>
        ))}
      </div>
    </section>
  );
}

function Round({ round }: { round: RoundRecord }) {
  return (
    <section className={shared.panel} aria-label={words.bids}>
      <h2>
        {words.bids}{" "}
        <span>
          {round.strategy}
          {round.margin !== null && ` · ${words.margin} ${formatNumber(round.margin)}`}
        </span>
      </h2>
      {round.intervention && (
        <p>
          <b>{words.intervention}:</b> {round.intervention}
        </p>
      )}
      <Bids round={round} />
      <h3>{words.why}</h3>
      {round.explanation.split("\n").map((line) => (
        <p key={line}>{line}</p>
      ))}
      <p>{smallestChange(round)}</p>
      {round.refused.length > 0 && (
        <>
          <h3>{words.refused}</h3>
          <ul>
            {round.refused.map((one) => (
              <li key={one.agent + one.host}>
                <b>{one.agent || one.host}</b> {one.reason}
              </li>
            ))}
          </ul>
        </>
      )}
    </section>
  );
}

const INVERSE = { PIN: "UNPIN", UNPIN: "PIN", VETO: "ALLOW", ALLOW: "VETO" } as const;

function Agents() {
  const agents = useCollection("agents");
  const market = useEntry("market");
  const order = useOperation("operate");
  const award = (agent: string) => order.ask({ action: "AWARD", agent, author: author() });
  const toggle = async (action: keyof typeof INVERSE, agent: string): Promise<void> => {
    const pinned = market?.pinned ?? "";
    const done = await order.ask({ action, agent, author: author() });
    if (!done?.accepted) return;
    const before = action === "PIN" && pinned ? { action, agent: pinned } : { action: INVERSE[action], agent };
    offerUndo({
      topic: `${action} ${agent}`,
      from: "",
      text: () => done.message,
      takeBack: () => operate("operate", { ...before, author: author() }),
    });
  };
  return (
    <section className={shared.panel} aria-label={words.profiles}>
      <h2>
        {words.profiles} <span>{market && `${words.strategy} ${market.strategy}`}</span>
      </h2>
      <WhyNot of={order} />
      <Outcome of={[order]} />
      {agents.length === 0 && <Empty>{words.noAgents}</Empty>}
      <ul className={css.agents}>
        {agents.map(([name, agent]) => {
          const pinned = market?.pinned === name;
          const vetoed = market?.vetoed.includes(name) ?? false;
          return (
            <li key={name}>
              <b title={agent.description}>{agent.title || name}</b>
              {pinned && <em> {words.pinned}</em>}
              {vetoed && <em> {words.vetoed}</em>}
              <div className={shared.values}>
                {Object.entries(agent.current).map(([parameter, value]) => (
                  <span key={parameter}>
                    {parameter} {value === null ? "–" : formatNumber(value)}
                  </span>
                ))}
              </div>
              <div className={shared.bar}>
                <OperationButton of={order} ask={() => toggle(pinned ? "UNPIN" : "PIN", name)}>
                  {pinned ? words.unpin : words.pin}
                </OperationButton>
                <OperationButton of={order} ask={() => toggle(vetoed ? "ALLOW" : "VETO", name)}>
                  {vetoed ? words.allow : words.veto}
                </OperationButton>
                <OperationButton of={order} ask={() => award(name)}>
                  {words.award}
                </OperationButton>
              </div>
            </li>
          );
        })}
      </ul>
    </section>
  );
}

function FeedbackList() {
  const feedback = useCollection("feedback");
  const judge = useOperation("feedback");
  const manage = useOperation("profiles");
  const give = (kind: "POSITIVE" | "NEGATIVE") =>
    judge.ask({ feedback_id: crypto.randomUUID(), kind, source: "button" });
  const undo = (agent: string, layer: string) =>
    manage.ask({ action: "UNDO", agent, layer, author: author() });
  const [asked, setAsked] = useState("");
  const profiles = [...new Set(feedback.map(([, one]) => `${one.agent}|${one.layer}`))].sort();
  const [agent = "", layer = ""] = asked.split("|");
  const newest = new Map(feedback.map(([, one]) => [`${one.agent}|${one.layer}`, one.revision]));
  return (
    <section className={shared.panel} aria-label={words.feedback}>
      <h2>{words.feedback}</h2>
      <div className={shared.bar}>
        <OperationButton of={judge} ask={() => give("POSITIVE")}>
          <span aria-hidden="true">☺</span> {words.good}
        </OperationButton>
        <OperationButton of={judge} ask={() => give("NEGATIVE")}>
          <span aria-hidden="true">☹</span> {words.bad}
        </OperationButton>
      </div>
      <WhyNot of={judge} />
      <Outcome of={[judge, manage]} />
      <label className={shared.bar}>
        {words.course}{" "}
        <select value={asked} onChange={(event) => setAsked(event.target.value)}>
          <option value="">{words.allAgents}</option>
          {profiles.map((one) => (
            <option key={one} value={one}>
              {one.split("|")[0]} {one.split("|")[1] || words.everybody}
            </option>
          ))}
        </select>
      </label>
      {asked && <ProfileCourse agent={agent} layer={layer} />}
      <ol className={shared.lines} tabIndex={0}>
        {[...feedback].reverse().filter(([, one]) => asked === "" || `${one.agent}|${one.layer}` === asked).map(([key, one]) => (
          <li key={key}>
            <time>{formatTime(one.at_s)}</time> <b>{one.agent}</b> {one.layer} {one.kind.toLowerCase()} · {one.source}
            {one.reason && `: ${one.reason}`}
            <div className={shared.values}>
              {one.parameters.map((name, index) => (
                <span key={name}>
                  {name} {format(one.before[index])} → {format(one.after[index])}
                </span>
              ))}
            </div>
            <small>{causeOf(one)}</small>{" "}
            {newest.get(`${one.agent}|${one.layer}`) === one.revision && (
              <OperationButton of={manage} ask={() => undo(one.agent, one.layer)}>
                {words.undo}
              </OperationButton>
            )}
          </li>
        ))}
      </ol>
    </section>
  );
}

const format = (value: number | null | undefined): string =>
  value === null || value === undefined ? "–" : formatNumber(value);
