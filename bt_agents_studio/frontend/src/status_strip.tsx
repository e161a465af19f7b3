// SPDX-License-Identifier: Apache-2.0
// Status strip on every page, always of the present: the current run, with Stop.

import { useEffect, useMemo } from "react";
import { useConnection } from "./connection";
import { formatNumber, formatTime } from "./formatting";
import { useEscapeTwice } from "./keyboard";
import { OPERATION_ROLES } from "./protocol";
import shared from "./shared.module.css";
import css from "./status_strip.module.css";
import { useStop } from "./stop";
import { usePresent } from "./store";
import { texts } from "./texts";
import { withoutModifier } from "./tree_nesting";

const words = texts.strip;

export function StatusStrip() {
  const market = usePresent("market");
  const part = usePresent("parts", "marketplace");
  const { atS, hello } = useConnection();
  const [answer, stop, forget] = useStop(texts.live.stopped);
  const state = market?.state ?? "";
  const isSilent = part?.alive === false;
  const isStopping = answer.isAsked || state === "CANCELLING";
  // A page that has lost its connection may try: the answer says that the robot was not stopped.
  const mayStop = hello === null || OPERATION_ROLES.cancel.includes(hello.role);
  const isRunning = market !== undefined && (state !== "IDLE" || market.waiting.length > 0);
  const canStop = mayStop && !isStopping && isRunning;
  useEscapeTwice(stop, canStop);
  // Forget the answer to Stop when another run begins.
  useEffect(forget, [market?.since_s, forget]);
  return (
    <section className={css.strip} aria-label={words.label} data-state={state} data-silent={isSilent || undefined}>
      {atS !== null && <span>{words.now}</span>}
      <span className={css.dot} aria-hidden="true" />
      <b>{isSilent ? `${words.silent} ${formatTime(part.seen_s)}` : (words.states[state] ?? words.none)}</b>
      {market?.agent && <Running name={market.agent} />}
      {market && <span>{`${words.since} ${formatTime(market.since_s)}`}</span>}
      <Mood />
      <span className={css.alert} role="alert">
        {answer.isRefused && answer.text}
      </span>
      <button type="button" className={`${shared.stop} ${css.stop}`} title={mayStop ? words.key : texts.may.roles[hello.role]} disabled={!canStop} onClick={stop}>
        {isStopping ? texts.stop.stopping : texts.stop.stop} <kbd aria-hidden="true">Esc Esc</kbd>
      </button>
    </section>
  );
}

function Running({ name }: { name: string }) {
  const agent = usePresent("agents", name);
  const run = usePresent("runs", name);
  const tree = usePresent("trees", name);
  const tip = run?.ended_s === null ? withoutModifier(run.tip) : "";
  const node = useMemo(() => tree?.nodes.find((one) => one.path === tip), [tree, tip]);
  return (
    <>
      <span className={css.agent}>{agent?.title || name}</span>
      {tip && (
        <span className={css.node} title={tip}>
          {node?.name || tip}
        </span>
      )}
    </>
  );
}

function Mood() {
  const { hello } = useConnection();
  const live = usePresent("live");
  const parameter = hello?.parameters.find((one) => one.is_mood);
  const mood = live?.values.find((one) => one.name === parameter?.name)?.value ?? null;
  if (mood === null) return null;
  return <span>{`${words.mood} ${formatNumber(mood)}`}</span>;
}
