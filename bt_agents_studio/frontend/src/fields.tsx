// SPDX-License-Identifier: Apache-2.0
// Fields for numbers: a slider and a text field, each with a draft of its own.

import { useCallback, useEffect, useRef, useState } from "react";
import css from "./fields.module.css";
import { exactNumber } from "./formatting";
import { texts } from "./texts";

const STEPS = 100;
const PERIOD_MS = 100;
/** Longest wait until a new value shows. */
const FOLLOW_MS = 2000;

/** Ends and step of a slider; the ends are multiples of the step, or just outside the range. */
export interface Scale {
  minimum: number;
  maximum: number;
  step: number;
  low: number;
  high: number;
}

/** Return the scale of a range; without a given step, the step is 1, 2 or 5 of a decimal place. */
export function scaleOf(minimum: number, maximum: number, step = 0, isWhole = false): Scale {
  if (step > 0) return { minimum, maximum, step, low: minimum, high: maximum };
  if (!(maximum > minimum)) return { minimum, maximum, step: 1, low: minimum, high: maximum };
  const least = Math.max((maximum - minimum) / STEPS, isWhole ? 1 : 0);
  const place = 10 ** Math.floor(Math.log10(least));
  const factor = [1, 2, 5].find((one) => one * place >= least * (1 - 1e-9)) ?? 10;
  const found = short(factor * place);
  const low = short(Math.floor(minimum / found + 1e-9) * found);
  const high = short(Math.ceil(maximum / found - 1e-9) * found);
  return { minimum, maximum, step: found, low, high };
}

const short = (value: number): number => Number(value.toPrecision(12));

/** Place of a slider's thumb until the value itself follows. */
export interface Sliding {
  shown: number;
  move: (value: number) => void;
  end: () => void;
  drop: () => void;
}

/** State of a slider; the value follows later while earlier places are being sent. */
export function useSliding(value: number, isBusy = false): Sliding {
  const [moved, setMoved] = useState<number | null>(null);
  const isHeld = useRef(false);
  const timer = useRef(0);
  const drop = (): void => {
    if (!isHeld.current) setMoved(null);
  };
  useEffect(() => {
    if (!isBusy) drop();
  }, [value]);
  useEffect(() => () => window.clearTimeout(timer.current), []);
  const move = (next: number): void => {
    isHeld.current = true;
    setMoved(next);
  };
  const end = (): void => {
    isHeld.current = false;
    window.clearTimeout(timer.current);
    timer.current = window.setTimeout(drop, FOLLOW_MS);
  };
  return { shown: moved ?? value, move, end, drop };
}

interface SliderProps {
  id?: string;
  label?: string;
  scale: Scale;
  sliding: Sliding;
  disabled: boolean;
  /** A value to compare with, marked on the track. */
  mark?: number | undefined;
  /** Called with each value during a drag. */
  move?: (value: number) => void;
  /** Called with the final value when the slider is released. */
  set?: (value: number) => void;
  /** Called when the slider is pressed without being moved. */
  press?: (() => void) | undefined;
}

export function Slider({ id, label, scale, sliding, disabled, mark, move, set, press }: SliderProps) {
  const { minimum, maximum, step, low, high } = scale;
  const box = useRef<HTMLInputElement>(null);
  const read = (input: HTMLInputElement): number => Math.min(maximum, Math.max(minimum, Number(input.value)));
  const ended = useRef<() => void>(() => undefined);
  ended.current = () => {
    sliding.end();
    if (box.current !== null) set?.(read(box.current));
  };
  // React calls its onChange for each value of a drag, but has no event for the final one.
  useEffect(() => {
    const input = box.current;
    const changed = (): void => ended.current();
    input?.addEventListener("change", changed);
    return () => input?.removeEventListener("change", changed);
  }, []);
  const place = mark === undefined ? 0 : (mark - low) / Math.max(high - low, Number.MIN_VALUE);
  return (
    <span className={css.slider}>
      <input
        ref={box}
        id={id}
        type="range"
        aria-label={label}
        aria-valuetext={exactNumber(sliding.shown)}
        min={low}
        max={high}
        step={step}
        value={sliding.shown}
        disabled={disabled}
        onChange={(event) => {
          const next = read(event.target);
          sliding.move(next);
          move?.(next);
        }}
        onPointerUp={() => {
          sliding.end();
          press?.();
        }}
        onKeyDown={(event) => event.key === "Enter" && press?.()}
        onBlur={sliding.end}
      />
      {mark !== undefined && place >= 0 && place <= 1 && (
        <svg className={css.fileMark} viewBox="0 0 1000 1" preserveAspectRatio="none" aria-hidden="true">
          <rect x={place * 992} width={8} height={1} />
        </svg>
      )}
    </span>
  );
}

/** Text being typed in a field, the value in force when typing began, and its revision. */
export interface Draft {
  text: string;
  over: string;
  seen: number;
}

export interface Drafting {
  draft: Draft | null;
  write: (text: string) => void;
  keep: (draft: Draft) => void;
  drop: () => void;
}

export function useDraft(value: string, seen = 0): Drafting {
  const [draft, keep] = useState<Draft | null>(null);
  const write = (text: string): void =>
    keep((before) => ({ text, over: before?.over ?? value, seen: before?.seen ?? seen }));
  return { draft, write, keep, drop: () => keep(null) };
}

interface NumberFieldProps {
  id: string;
  label?: string;
  /** Text on show while nobody types. */
  value: string;
  drafting: Drafting;
  disabled: boolean;
  isNumber?: boolean;
  /** Called when Enter is pressed. */
  commit: () => void;
  leave?: () => void;
}

/** Field for the exact value; Escape discards the typed text. */
export function NumberField(props: NumberFieldProps) {
  const { id, label, value, drafting, disabled, isNumber = true, commit, leave } = props;
  return (
    <input
      id={id}
      type="text"
      inputMode={isNumber ? "decimal" : "text"}
      aria-label={label}
      className={css.number}
      data-draft={drafting.draft !== null || undefined}
      value={drafting.draft?.text ?? value}
      disabled={disabled}
      onChange={(event) => drafting.write(event.target.value)}
      onBlur={leave}
      onKeyDown={(event) => {
        if (event.key === "Enter") commit();
        if (event.key === "Escape") drafting.drop();
      }}
    />
  );
}

interface NumberPairProps {
  /** Id of the slider; the field's id adds a suffix. */
  id: string;
  name: string;
  scale: Scale;
  value: number;
  disabled: boolean;
  mark?: number | undefined;
  /** Called with each value during a drag of the slider. */
  move?: (value: number) => void;
  /** Whether a typed value is sent at once, so that only Enter sets it. */
  isSent?: boolean;
  /** Called with the typed or final value; `drop` shows the value in force again, or keeps this one in the field. */
  set?: (value: number, drop: (keeps?: boolean) => void) => void;
  press?: () => void;
}

/** Slider and field of a number, which is sent later, or only when the slider is released. */
export function NumberPair(props: NumberPairProps) {
  const { id, name, scale, value, disabled, mark, isSent = false, move, set, press } = props;
  const sliding = useSliding(value);
  const drafting = useDraft(exactNumber(value));
  const isSliding = useRef(false);
  const settle = (next: number): void => {
    isSliding.current = false;
    set?.(next, (keeps = false) => {
      if (keeps) drafting.write(exactNumber(next));
      sliding.drop();
    });
  };
  const written = drafting.draft?.text.trim() ?? "";
  const number = Number(written);
  const isNumber = Number.isFinite(number);
  const commit = (): void => {
    if (!isNumber) return;
    drafting.drop();
    if (written !== "" && number !== value) settle(number);
  };
  return (
    <>
      {/* The slider is pressed before the field is left. */}
      <span className={css.slides} onPointerDown={() => (isSliding.current = true)}>
        <Slider
          id={id}
          scale={scale}
          sliding={sliding}
          disabled={disabled}
          mark={mark}
          move={(next) => {
            drafting.drop();
            move?.(next);
          }}
          set={settle}
          press={() => {
            isSliding.current = false;
            press?.();
          }}
        />
      </span>
      <NumberField
        id={`${id}-value`}
        label={`${name}, ${texts.fields.value}`}
        value={exactNumber(sliding.shown)}
        drafting={drafting}
        disabled={disabled}
        commit={commit}
        leave={() => {
          if (!isSliding.current && !isSent) commit();
        }}
      />
      {!isNumber && (
        <small className={css.overtaken} role="alert">
          {texts.fields.notNumber}
        </small>
      )}
    </>
  );
}

export interface Newest {
  /** Send a value of a key in place of a waiting one; `send` returns whether it is accepted. */
  push: (key: string, send: () => Promise<boolean>) => void;
  /** Drop all waiting values; resolves when no request is pending. */
  stop: () => Promise<void>;
  isBusy: boolean;
}

/**
 * Send the newest value of each key: one at a time, at most ten a second, and always the last one.
 *
 * A refused value of a key also drops the value that waits for that key.
 */
export function useNewest(): Newest {
  const waiting = useRef(new Map<string, () => Promise<boolean>>());
  const sending = useRef<Promise<void> | null>(null);
  const [isBusy, setBusy] = useState(false);
  const push = useCallback((key: string, send: () => Promise<boolean>): void => {
    waiting.current.set(key, send);
    if (sending.current !== null) return;
    setBusy(true);
    const sendAll = async (): Promise<void> => {
      for (let [next] = waiting.current; next !== undefined; [next] = waiting.current) {
        const [name, ask] = next;
        waiting.current.delete(name);
        const drop = (isTaken: boolean): unknown => isTaken || waiting.current.delete(name);
        await Promise.all([ask().then(drop), later(PERIOD_MS)]);
      }
      sending.current = null;
      setBusy(false);
    };
    sending.current = sendAll();
  }, []);
  const stop = useCallback(async (): Promise<void> => {
    waiting.current.clear();
    await sending.current;
  }, []);
  return { push, stop, isBusy };
}

const later = (ms: number): Promise<void> => new Promise((resolve) => window.setTimeout(resolve, ms));
