// SPDX-License-Identifier: Apache-2.0
// Operations in the user interface: whether this tab may do one, its progress, and its result.

import { useCallback, useEffect, useRef, useState, type ReactNode } from "react";
import { isSignedIn, operate, useConnection, type Answer } from "./connection";
import css from "./operation.module.css";
import { OPERATION_ROLES, type Operations } from "./protocol";
import shared from "./shared.module.css";
import { texts } from "./texts";

interface Numbered extends Answer {
  /** Counts up over all operations of the page. */
  number: number;
}

export interface Asked {
  /** Why this tab may not do it now, as text; empty if it may. */
  whyNot: string;
  isPending: boolean;
  answer: Numbered | null;
}

export interface Operation<N extends keyof Operations> extends Asked {
  /** Do it; null if not sent, because this tab may not or the last request is pending. */
  ask: (fields: Operations[N], limitMs?: number) => Promise<Answer | null>;
}

let asked = 0;

/** One operation of a panel, perhaps on the past. Its answer stays until the next request. */
export function useOperation<N extends keyof Operations>(name: N, isOfPast = false): Operation<N> {
  const whyNot = useWhyNot(name, isOfPast);
  const [isPending, setPending] = useState(false);
  const [answer, setAnswer] = useState<Numbered | null>(null);
  const isAsked = useRef(false);
  const ask = useCallback(
    async (fields: Operations[N], limitMs?: number): Promise<Answer | null> => {
      if (isAsked.current || whyNot !== "") return null;
      isAsked.current = true;
      asked += 1;
      const number = asked;
      setPending(true);
      setAnswer(null);
      const done = await operate(name, fields, limitMs);
      isAsked.current = false;
      setPending(false);
      setAnswer({ ...done, number });
      return done;
    },
    [name, whyNot],
  );
  return { whyNot, isPending, answer, ask };
}

/** Why this tab may not do an operation now; empty if it may. */
export function useWhyNot(name: keyof Operations, isOfPast = false): string {
  const { phase, hello, atS } = useConnection();
  if (phase === "refused") return texts.connection.refused;
  if (hello === null) return texts.may.notConnected;
  if (!OPERATION_ROLES[name].includes(hello.role)) return texts.may.roles[hello.role] ?? texts.may.noKey;
  if (!isSignedIn()) return texts.may.noKey;
  return atS === null || isOfPast ? "" : texts.may.past;
}

const UNHEARD = ["NO_STUDIO", "NO_ANSWER", "NO_SESSION", "NO_KEY", "UNKNOWN_HOST"];

/** Whether no service received the request, so that the user's input must be kept. */
export const isUnheard = (done: Answer): boolean => UNHEARD.includes(done.code);

interface ButtonProps {
  of: Asked;
  /** Called on a click; without it, the button submits its form. */
  ask?: (() => Promise<unknown>) | undefined;
  disabled?: boolean | undefined;
  className?: string | undefined;
  title?: string | undefined;
  children: ReactNode;
}

/** Button of an operation: shows that it waits, and ignores further clicks meanwhile. */
export function OperationButton({ of, ask, disabled = false, className, title, children }: ButtonProps) {
  const [isMine, setMine] = useState(false);
  const click = async (): Promise<void> => {
    if (ask === undefined || of.isPending) return;
    setMine(true);
    await ask();
    setMine(false);
  };
  // It keeps the focus while it waits; a disabled button would lose it.
  return (
    <button
      type={ask ? "button" : "submit"}
      className={className}
      disabled={disabled || of.whyNot !== ""}
      aria-disabled={of.isPending || undefined}
      title={of.whyNot || title}
      onClick={ask && (() => void click())}
    >
      {children}
      {(ask ? isMine : of.isPending) && " …"}
    </button>
  );
}

/** Why the controls of a panel are disabled; nothing if they are enabled. */
export function WhyNot({ of }: { of: Asked }) {
  return of.whyNot === "" ? null : <p className={shared.warning}>{of.whyNot}</p>;
}

/** Result of the newest of some operations; a failure scrolls into view. */
export function Outcome({ of }: { of: readonly Asked[] }) {
  const [newest] = of.flatMap((one) => one.answer ?? []).sort((one, other) => other.number - one.number);
  const box = useRef<HTMLOutputElement>(null);
  useEffect(() => {
    if (newest?.accepted === false) box.current?.scrollIntoView({ block: "nearest" });
  }, [newest]);
  return (
    <output ref={box} className={newest?.accepted === false ? `${css.answer} ${shared.failure}` : css.answer}>
      {newest?.message}
    </output>
  );
}
