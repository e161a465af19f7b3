// SPDX-License-Identifier: Apache-2.0
// Page "Person": the robot as seen by the person in front of it, for a tablet.

import { useCallback, useEffect, useRef, useState, type ReactNode } from "react";
import { useConnection, type Answer } from "./connection";
import { scaleOf, useNewest } from "./fields";
import { formatNumber } from "./formatting";
import { useEscapeTwice } from "./keyboard";
import { OperationButton, useOperation, WhyNot } from "./operation";
import { PanelBoundary } from "./panel_boundary";
import css from "./person.module.css";
import { words } from "./person_texts";
import type { ParameterRecord, RobotActRecord } from "./protocol";
import shared from "./shared.module.css";
import { useStop } from "./stop";
import { useEntry } from "./store";

const SCAN_MS = 2000;
/** How long a reply stays on show. */
const TOLD_MS = 15_000;
/** Texts for the log and the rounds. */
const STOPPED = "stopped by the person";
const VISITOR = "a visitor at the screen";

const isSpoken = (act: RobotActRecord): boolean => act.kind === "SAY" || act.kind === "ASK";

export function Person() {
  const robot = useEntry("robot");
  const part = useEntry("parts", "robot");
  const { hello, phase } = useConnection();
  const acts = robot?.acts ?? [];
  const speech = acts.findLast(isSpoken);
  const question = acts.findLast((one) => one.kind === "ASK");
  const [answer, setAnswer] = useState("");
  const [speaks, setSpeaks] = useState(false);
  const [scans, setScans] = useState(false);
  const [encounter, setEncounter] = useState(0);
  const box = useRef<HTMLDivElement>(null);
  useEffect(() => {
    const timer = window.setTimeout(() => setAnswer(""), TOLD_MS);
    return () => window.clearTimeout(timer);
  }, [answer]);
  useVoice(speech, speaks);
  useScan(box, scans, question?.number);
  const report = useCallback((done: Answer, said = words.thanks) => setAnswer(done.accepted ? said : done.message), []);
  const scene = useOperation("scene");
  const mood = hello?.parameters.find((one) => one.is_mood);
  const there = phase === "open" && part?.alive === true;
  return (
    <div className={css.person} ref={box}>
      <div className={shared.bar}>
        <Light colour={robot?.light ?? "off"} blinks={robot?.light_blinks ?? false} />
        <span className={css.away}>{there ? "" : words.away}</span>
        {"speechSynthesis" in window && (
          <Toggle on={speaks} set={setSpeaks}>
            {words.speak}
          </Toggle>
        )}
        <Toggle on={scans} set={setScans}>
          {words.scan}
        </Toggle>
      </div>
      <WhyNot of={scene} />
      <PanelBoundary label={words.says}>
        <Subtitles speech={speech} />
        <Shown acts={acts} sound={robot?.sounds ? robot.sound : ""} />
      </PanelBoundary>
      <div className={css.stack}>
        {question && (
          <PanelBoundary key={question.number} label={words.answer}>
            <Question question={question} report={report} />
          </PanelBoundary>
        )}
        <div className={css.panels}>
          <PanelBoundary label={words.who}>
            <WhoYouAre
              parameters={hello?.parameters ?? []}
              report={report}
              begun={() => setEncounter((before) => before + 1)}
            />
          </PanelBoundary>
          <div className={css.stack}>
            {mood && (
              <PanelBoundary key={encounter} label={words.mood}>
                <Mood parameter={mood} report={report} />
              </PanelBoundary>
            )}
            <PanelBoundary label={words.judge}>
              <Judge parameters={hello?.parameters ?? []} report={report} />
            </PanelBoundary>
          </div>
        </div>
        <p role="status" className={css.told}>
          {answer}
        </p>
      </div>
      <Stop key={encounter} />
    </div>
  );
}

interface ToggleProps {
  on: boolean;
  set: (on: boolean) => void;
  children: ReactNode;
}

function Toggle({ on, set, children }: ToggleProps) {
  return (
    <button type="button" aria-pressed={on} onClick={() => set(!on)}>
      {children}
    </button>
  );
}

function Light({ colour, blinks }: { colour: string; blinks: boolean }) {
  const known = Object.hasOwn(words.colours, colour) ? colour : "off";
  const label = `${words.light}: ${words.colours[known]}${blinks ? `, ${words.blinking}` : ""}`;
  return (
    <span className={css.light} data-colour={known} data-blinks={blinks || undefined} role="img" aria-label={label} title={label} />
  );
}

function Stop() {
  const [answer, stopRun] = useStop(STOPPED, words);
  const stop = useCallback(() => {
    if ("speechSynthesis" in window) speechSynthesis.cancel();
    stopRun();
  }, [stopRun]);
  useEscapeTwice(stop, true);
  return (
    <div className={css.stopBar} data-live>
      <span role="alert" className={css.alert}>
        {answer.text}
      </span>
      <button type="button" className={shared.stop} onClick={stop}>
        {words.stop}
      </button>
    </div>
  );
}

function Subtitles({ speech }: { speech: RobotActRecord | undefined }) {
  const [last, setLast] = useState("");
  useEffect(() => {
    if (speech) setLast(speech.text);
  }, [speech]);
  return (
    <p className={css.subtitles} data-past={speech === undefined || undefined} aria-live="polite" aria-label={words.says}>
      {speech?.text ?? (last || words.quiet)}
    </p>
  );
}

function Shown({ acts, sound }: { acts: readonly RobotActRecord[]; sound: string }) {
  return (
    <div className={css.shown}>
      {acts.map((act) => {
        if (act.kind === "DRIVE") return <p key={act.number}>{`${words.drives} ${act.text}`}</p>;
        if (act.kind !== "SHOW") return null;
        return (
          <figure key={act.number}>
            {act.clip && <figcaption>{act.clip}</figcaption>}
            {act.text && <p>{act.text}</p>}
          </figure>
        );
      })}
      {sound && <p className={css.sound}>{`${words.sound} ${sound}`}</p>}
    </div>
  );
}

interface QuestionProps {
  question: RobotActRecord;
  report: (done: Answer, said: string) => void;
}

function Question({ question, report }: QuestionProps) {
  const [text, setText] = useState("");
  const { choices } = question;
  const answer = useOperation("answer");
  const { ask } = answer;
  const give = useCallback(
    async (text: string): Promise<void> => {
      const done = await ask({ text });
      if (done !== null) report(done, `${words.answer}: ${text}`);
    },
    [ask, report],
  );
  useEffect(() => {
    const pressed = (event: KeyboardEvent): void => {
      const choice = choices[Number(event.key) - 1];
      const writes = event.target instanceof HTMLInputElement && event.target.type === "text";
      if (choice === undefined || writes || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      void give(choice);
    };
    window.addEventListener("keydown", pressed);
    return () => window.removeEventListener("keydown", pressed);
  }, [choices, give]);
  return (
    <section className={css.question} aria-label={words.answer}>
      {choices.length === 0 ? (
        <form
          onSubmit={(event) => {
            event.preventDefault();
            void give(text);
          }}
        >
          <input
            type="text"
            aria-label={words.answer}
            maxLength={1000}
            value={text}
            onChange={(event) => setText(event.target.value)}
          />
          <OperationButton of={answer} disabled={text.trim() === ""}>
            {words.send}
          </OperationButton>
        </form>
      ) : (
        choices.map((choice, index) => (
          <OperationButton key={choice} of={answer} ask={() => give(choice)}>
            {index < 9 && (
              <kbd aria-hidden="true">{index + 1}</kbd>
            )}
            {choice}
          </OperationButton>
        ))
      )}
    </section>
  );
}

interface MoodProps {
  parameter: ParameterRecord;
  report: (done: Answer) => void;
}

function Mood({ parameter, report }: MoodProps) {
  const live = useEntry("live");
  const measured = live?.values.find((one) => one.name === parameter.name)?.value;
  const [chosen, setChosen] = useState<number | null>(null);
  const scene = useOperation("scene");
  const value = chosen ?? measured ?? parameter.default;
  const newest = useNewest();
  const sense = async (next: number): Promise<boolean> => {
    const done = await scene.ask({ names: [parameter.name], values: [next], person: "PRESENT", announce: false });
    if (done?.accepted === false) report(done);
    return done?.accepted === true;
  };
  const disabled = scene.whyNot !== "";
  const move = (next: number): void => {
    const bounded = Math.min(parameter.maximum, Math.max(parameter.minimum, next));
    setChosen(bounded);
    newest.push(parameter.name, () => sense(bounded));
  };
  return (
    <section className={shared.panel} aria-label={words.mood}>
      <h2 id="mood-question">{words.mood}</h2>
      <div className={css.scale}>
        <button type="button" disabled={disabled} onClick={() => move(value - 1)}>
          <Face smile={-1} /> {words.worse}
        </button>
        <Slider
          parameter={parameter}
          value={value}
          choose={move}
          disabled={disabled}
          aria-labelledby="mood-question"
        />
        <button type="button" disabled={disabled} onClick={() => move(value + 1)}>
          <Face smile={1} /> {words.better}
        </button>
      </div>
      <p className={css.label}>{labelOf(parameter, value)}</p>
    </section>
  );
}

interface SliderProps {
  parameter: ParameterRecord;
  value: number;
  choose: (value: number) => void;
  disabled?: boolean;
  "aria-label"?: string;
  "aria-labelledby"?: string;
}

function Slider({ parameter, value, choose, ...named }: SliderProps) {
  return (
    <input
      type="range"
      {...named}
      aria-valuetext={labelOf(parameter, value)}
      min={parameter.minimum}
      max={parameter.maximum}
      step={scaleOf(parameter.minimum, parameter.maximum).step}
      value={value}
      onChange={(event) => choose(Number(event.target.value))}
    />
  );
}

function labelOf(parameter: ParameterRecord, value: number): string {
  const nearest = Object.entries(parameter.labels).sort(
    ([one], [other]) => Math.abs(Number(one) - value) - Math.abs(Number(other) - value),
  )[0];
  return nearest?.[1] ?? formatNumber(value);
}

function Face({ smile }: { smile: 1 | -1 }) {
  return (
    <svg className={css.face} viewBox="0 0 24 24" aria-hidden="true">
      <circle cx="12" cy="12" r="10" />
      <circle className={css.eye} cx="8.5" cy="9.5" r="1.3" />
      <circle className={css.eye} cx="15.5" cy="9.5" r="1.3" />
      <path d={`M7 15.5 Q12 ${15.5 + 4 * smile} 17 15.5`} />
    </svg>
  );
}

interface ParametersProps {
  parameters: readonly ParameterRecord[];
  report: (done: Answer, said?: string) => void;
}

function Judge({ parameters, report }: ParametersProps) {
  const [asks, setAsks] = useState(false);
  const feedback = useOperation("feedback");
  const judge = async (kind: "POSITIVE" | "NEGATIVE"): Promise<void> => {
    const done = await feedback.ask({ kind });
    if (done !== null) report(done);
  };
  return (
    <section className={shared.panel} aria-label={words.judge}>
      <h2>{words.judge}</h2>
      <div className={shared.bar}>
        <OperationButton of={feedback} ask={() => judge("POSITIVE")}>
          <Face smile={1} /> {words.good}
        </OperationButton>
        <OperationButton of={feedback} ask={() => judge("NEGATIVE")}>
          <Face smile={-1} /> {words.bad}
        </OperationButton>
        <Toggle on={asks} set={setAsks}>
          {words.more}
        </Toggle>
      </div>
      {asks && <Opinion parameters={parameters} report={report} end={() => setAsks(false)} />}
    </section>
  );
}

function Opinion({ parameters, report, end }: ParametersProps & { end: () => void }) {
  const feedback = useOperation("feedback");
  const [given, setGiven] = useState<(number | null)[]>([]);
  const parameter = parameters[given.length];
  const [value, setValue] = useState<number | null>(null);
  if (parameter === undefined) return null;
  const shown = value ?? parameter.default;
  const next = async (opinion: number | null): Promise<void> => {
    const all = [...given, opinion];
    setValue(null);
    if (all.length < parameters.length) {
      setGiven(all);
      return;
    }
    const done = all.some((one) => one !== null) ? await feedback.ask({ kind: "DIRECT", values: all }) : null;
    end();
    if (done !== null) report(done);
  };
  return (
    <div>
      <h3 id="opinion">{`${words.suits} (${given.length + 1}/${parameters.length}): ${parameter.description || parameter.name}`}</h3>
      <Slider parameter={parameter} value={shown} choose={setValue} aria-labelledby="opinion" />
      <p className={css.label}>{labelOf(parameter, shown)}</p>
      <div className={shared.bar}>
        <OperationButton of={feedback} ask={() => next(shown)}>
          {words.next}
        </OperationButton>
        <OperationButton of={feedback} ask={() => next(null)}>
          {words.noOpinion}
        </OperationButton>
      </div>
    </div>
  );
}

function WhoYouAre({ parameters, report, begun }: ParametersProps & { begun: () => void }) {
  const [chosen, setChosen] = useState<Record<string, number>>({});
  const scene = useOperation("scene");
  const tell = (done: Answer | null, said: string): void => {
    if (done !== null) report(done, said);
  };
  const begin = async (): Promise<void> => {
    window.scrollTo(0, 0);
    const done = await scene.ask({
      label: VISITOR,
      names: Object.keys(chosen),
      values: Object.values(chosen),
      person: "PRESENT",
      announce: true,
    });
    tell(done, words.begun);
    if (done?.accepted) begun();
  };
  const leave = async (): Promise<void> => {
    const done = await scene.ask({ person: "ABSENT", announce: false });
    // Nobody to leave: the encounter has ended.
    const isGone = done?.accepted === true || done?.code === "NOT_RUNNING";
    tell(done && { ...done, accepted: isGone }, words.gone);
    if (isGone) setChosen({});
  };
  return (
    <section className={`${shared.panel} ${css.who}`} aria-label={words.who}>
      <h2>{words.who}</h2>
      {parameters.map((one) => (
        <Choice
          key={one.name}
          parameter={one}
          value={chosen[one.name]}
          choose={(value) => setChosen((before) => ({ ...before, [one.name]: value }))}
        />
      ))}
      <div className={shared.bar}>
        <OperationButton of={scene} className={css.begin} ask={begin}>
          {words.begin}
        </OperationButton>
        <OperationButton of={scene} ask={leave}>
          {words.leave}
        </OperationButton>
      </div>
    </section>
  );
}

interface ChoiceProps {
  parameter: ParameterRecord;
  value: number | undefined;
  choose: (value: number) => void;
}

function Choice({ parameter, value, choose }: ChoiceProps) {
  const labels = Object.entries(parameter.labels);
  return (
    <fieldset>
      <legend>{parameter.description || parameter.name}</legend>
      {labels.length > 0 ? (
        labels.map(([at, label]) => (
          <button key={at} type="button" aria-pressed={value === Number(at)} onClick={() => choose(Number(at))}>
            {label}
          </button>
        ))
      ) : (
        <Slider
          parameter={parameter}
          value={value ?? parameter.default}
          choose={choose}
          aria-label={parameter.name}
        />
      )}
    </fieldset>
  );
}

/** Speak each new text once with the browser's voice. */
function useVoice(speech: RobotActRecord | undefined, speaks: boolean): void {
  const spoken = useRef("");
  useEffect(() => {
    if (!speaks) {
      if ("speechSynthesis" in window) speechSynthesis.cancel();
      return;
    }
    const name = speech ? `${speech.number} ${speech.at_s}` : "";
    if (speech === undefined || spoken.current === name) return;
    spoken.current = name;
    const utterance = new SpeechSynthesisUtterance(speech.text);
    utterance.rate = speech.rate;
    speechSynthesis.speak(utterance);
  }, [speech, speaks]);
}

/** Move the focus from button to button, so that one switch, or a touch anywhere, presses them. */
function useScan(box: React.RefObject<HTMLDivElement | null>, scans: boolean, question: number | undefined): void {
  useEffect(() => {
    const element = box.current;
    if (!scans || element === null) return;
    const buttons = (): HTMLButtonElement[] => [...element.querySelectorAll<HTMLButtonElement>("button:enabled")];
    const focused = (): number => buttons().findIndex((one) => one === document.activeElement);
    const move = (): void => {
      const all = buttons();
      all[(focused() + 1) % all.length]?.focus();
    };
    const isStop = (event: Event): boolean => event.target instanceof Element && event.target.closest(`.${css.stopBar} button`) !== null;
    const press = (event: PointerEvent): void => {
      if (isStop(event)) return;
      event.preventDefault();
      event.stopPropagation();
      buttons()[focused()]?.click();
    };
    // The touch presses the focused button; it is not a click on the element under it.
    const swallow = (event: MouseEvent): void => {
      if (event.isTrusted && event.detail > 0 && !isStop(event)) {
        event.preventDefault();
        event.stopPropagation();
      }
    };
    if (question !== undefined) element.querySelector<HTMLButtonElement>(`.${css.question} button`)?.focus();
    const timer = window.setInterval(move, SCAN_MS);
    window.addEventListener("pointerdown", press, true);
    window.addEventListener("click", swallow, true);
    return () => {
      window.clearInterval(timer);
      window.removeEventListener("pointerdown", press, true);
      window.removeEventListener("click", swallow, true);
    };
  }, [box, scans, question]);
}
