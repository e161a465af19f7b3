// SPDX-License-Identifier: Apache-2.0
// Page "World": what the robot would sense, given by hand.

import { useEffect, useState } from "react";
import { operate, useConnection } from "./connection";
import { formatNumber } from "./formatting";
import { PanelBoundary } from "./panel_boundary";
import type { ListeningRecord, Operations, ParameterRecord, QuestionRecord } from "./protocol";
import { Recording } from "./recording";
import { useCollection, useEntry } from "./store";
import { texts } from "./texts";

const words = texts.world;
type Person = NonNullable<Operations["scene"]["person"]>;

export function World() {
  return (
    <div className="columns">
      <div className="main">
        <PanelBoundary label={words.scene}>
          <Play />
        </PanelBoundary>
      </div>
      <div className="side">
        <PanelBoundary label={words.person}>
          <Presence />
        </PanelBoundary>
        <PanelBoundary label={words.questions}>
          <Questions />
        </PanelBoundary>
        <PanelBoundary label={words.topics}>
          <Topics />
        </PanelBoundary>
        <PanelBoundary label={words.recording}>
          <Recording />
        </PanelBoundary>
      </div>
    </div>
  );
}

/** Switch that says at once whether somebody is there. */
function Presence() {
  const live = useEntry("live");
  const scene = useEntry("scene");
  const { atS } = useConnection();
  const [asked, setAsked] = useState<boolean | null>(null);
  const [answer, setAnswer] = useState("");
  useEffect(() => setAsked(null), [live?.at_s]);
  const there = asked ?? live?.person ?? scene?.person ?? false;
  const set = async (person: boolean): Promise<void> => {
    const done = await operate("scene", { person: person ? "PRESENT" : "ABSENT", announce: false });
    setAnswer(done.message);
    if (done.accepted) setAsked(person);
  };
  return (
    <section className="panel" aria-label={words.person}>
      <label className="bar">
        <input
          type="checkbox"
          role="switch"
          checked={there}
          disabled={atS !== null}
          onChange={(event) => void set(event.target.checked)}
        />
        {words.person}
      </label>
      <output>{answer}</output>
    </section>
  );
}

function Questions() {
  const record = useEntry("questions");
  const [answer, setAnswer] = useState("");
  const open = record?.questions ?? [];
  return (
    <section className="panel" aria-label={words.questions}>
      <h2>{words.questions}</h2>
      {open.length === 0 && <p className="empty">{words.noQuestions}</p>}
      {open.map((one) => (
        <Question key={`${one.at_s} ${one.text}`} question={one} report={setAnswer} />
      ))}
      <output>{answer}</output>
    </section>
  );
}

function Question({ question, report }: { question: QuestionRecord; report: (text: string) => void }) {
  const { atS } = useConnection();
  const [own, setOwn] = useState("");
  const give = async (text: string): Promise<void> => report((await operate("answer", { text })).message);
  return (
    <form
      onSubmit={(event) => {
        event.preventDefault();
        void give(own);
      }}
    >
      <p>{question.text}</p>
      <div className="bar">
        {question.choices.map((one) => (
          <button key={one} type="button" disabled={atS !== null} onClick={() => void give(one)}>
            {one}
          </button>
        ))}
        <input aria-label={words.ownAnswer} placeholder={words.ownAnswer} value={own} onChange={(event) => setOwn(event.target.value)} />
        <button type="submit" disabled={atS !== null || own.trim() === ""}>
          {words.answer}
        </button>
      </div>
    </form>
  );
}

function Topics() {
  const topics = useCollection("listening");
  const [answer, setAnswer] = useState("");
  return (
    <section className="panel" aria-label={words.topics}>
      <h2>{words.topics}</h2>
      {topics.length === 0 && <p className="empty">{words.noTopics}</p>}
      {topics.map(([name, one]) => (
        <Topic key={name} name={name} record={one} report={setAnswer} />
      ))}
      <output>{answer}</output>
    </section>
  );
}

interface TopicProps {
  name: string;
  record: ListeningRecord;
  report: (text: string) => void;
}

function Topic({ name, record, report }: TopicProps) {
  const { atS } = useConnection();
  const [values, setValues] = useState<Record<string, string>>({});
  const send = async (texts: string[]): Promise<void> =>
    report((await operate("publish", { topic: name, values: texts })).message);
  const isButton = record.type === "std_msgs/msg/Bool";
  return (
    <form
      className="topic"
      onSubmit={(event) => {
        event.preventDefault();
        void send(isButton ? ["data=true"] : Object.entries(values).map(([field, value]) => `${field}=${value}`));
      }}
    >
      <p>
        <b>{name}</b> <small>{record.type}</small>
      </p>
      <div className="bar">
        {!isButton &&
          Object.entries(record.fields).map(([field, type]) => (
            <label key={field}>
              {field} <small>{type}</small>{" "}
              <input
                value={values[field] ?? ""}
                onChange={(event) => {
                  const { [field]: _left, ...others } = values;
                  setValues(event.target.value === "" ? others : { ...others, [field]: event.target.value });
                }}
              />
            </label>
          ))}
        <button type="submit" disabled={atS !== null}>
          {isButton ? words.press : words.publish}
        </button>
      </div>
    </form>
  );
}

function Play() {
  const { hello, atS } = useConnection();
  const live = useEntry("live");
  const [given, setGiven] = useState<Record<string, number>>({});
  const [person, setPerson] = useState<Person>("AS_MEASURED");
  const [label, setLabel] = useState("");
  const [urgent, setUrgent] = useState(false);
  const [answer, setAnswer] = useState("");
  const parameters = hello?.parameters ?? [];
  const standing = (one: ParameterRecord): number =>
    given[one.name] ?? live?.values.find((found) => found.name === one.name)?.value ?? one.default;
  const count = parameters.filter((one) => given[one.name] !== undefined).length;
  const isAll = count > 0 && count === parameters.length;
  const giveAll = (all: boolean): void =>
    setGiven(all ? Object.fromEntries(parameters.map((one) => [one.name, standing(one)])) : {});
  const give = async (announce: boolean): Promise<void> => {
    const names = Object.keys(given);
    const values = Object.values(given);
    const done = await operate("scene", { label, names, values, person, urgent, announce });
    setAnswer(done.message);
  };
  return (
    <section className="panel world" aria-label={words.scene}>
      <h2>{words.scene}</h2>
      <p className="empty">{words.explain}</p>
      <label className="bar">
        <input
          type="checkbox"
          checked={isAll}
          ref={(box) => {
            if (box) box.indeterminate = count > 0 && !isAll;
          }}
          disabled={atS !== null}
          onChange={(event) => giveAll(event.target.checked)}
        />
        {words.giveAll}
      </label>
      {parameters.map((one) => {
        const value = given[one.name];
        const shown = standing(one);
        const id = `world-${one.name}`;
        const change = (next: number | null): void =>
          setGiven((before) => {
            const { [one.name]: _left, ...others } = before;
            return next === null ? others : { ...others, [one.name]: next };
          });
        return (
          <div className="control" key={one.name}>
            <label htmlFor={id}>
              {one.name} <small>{one.description}</small>
            </label>
            <input
              id={id}
              type="range"
              min={one.minimum}
              max={one.maximum}
              step={(one.maximum - one.minimum) / 100}
              value={shown}
              disabled={atS !== null}
              onChange={(event) => change(Number(event.target.value))}
              onPointerUp={(event) => change(Number(event.currentTarget.value))}
              onKeyDown={(event) => event.key === "Enter" && change(shown)}
            />
            <span>
              {formatNumber(shown)} {one.labels[String(shown)] ?? ""}
            </span>
            <label className="give">
              <input
                type="checkbox"
                checked={value !== undefined}
                disabled={atS !== null}
                onChange={(event) => change(event.target.checked ? shown : null)}
              />{" "}
              {words.give}
            </label>
          </div>
        );
      })}
      <div className="bar">
        <label>
          {words.announcedPerson}{" "}
          <select value={person} onChange={(event) => setPerson(event.target.value as Person)}>
            <option value="AS_MEASURED">{words.measured}</option>
            <option value="PRESENT">{words.present}</option>
            <option value="ABSENT">{words.absent}</option>
          </select>
        </label>
        <label>
          {words.label} <input value={label} onChange={(event) => setLabel(event.target.value)} />
        </label>
        <label>
          <input type="checkbox" checked={urgent} onChange={(event) => setUrgent(event.target.checked)} />{" "}
          {words.urgent}
        </label>
      </div>
      <div className="bar">
        <button type="button" disabled={atS !== null} onClick={() => void give(true)}>
          {words.announce}
        </button>
        <button type="button" disabled={atS !== null} onClick={() => void give(false)}>
          {words.sense}
        </button>
        <output>{answer}</output>
      </div>
    </section>
  );
}
