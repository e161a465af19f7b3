// SPDX-License-Identifier: Apache-2.0
// Page "World": the robot's sensor values, given by hand.

import { useEffect, useState } from "react";
import { useConnection } from "./connection";
import { Divider } from "./divider";
import { Empty } from "./empty";
import { NumberPair, scaleOf } from "./fields";
import fieldCss from "./fields.module.css";
import { exactNumber } from "./formatting";
import { OperationButton, Outcome, useOperation, WhyNot, type Operation } from "./operation";
import { PanelBoundary } from "./panel_boundary";
import { PersonLink } from "./person_link";
import type { ListeningRecord, Operations, ParameterRecord, QuestionRecord } from "./protocol";
import { Recording } from "./recording";
import shared from "./shared.module.css";
import { useCollection, useEntry } from "./store";
import { texts } from "./texts";
import css from "./world.module.css";

const words = texts.world;
type Person = NonNullable<Operations["scene"]["person"]>;

export function World() {
  return (
    <div className={shared.columns}>
      <div className={shared.main}>
        <PanelBoundary label={words.scene}>
          <Play />
        </PanelBoundary>
      </div>
      <div className={shared.side}>
        <Divider />
        <PanelBoundary label={words.person}>
          <Presence />
        </PanelBoundary>
        <PanelBoundary label={words.questions}>
          <Questions />
        </PanelBoundary>
        <PanelBoundary label={words.topics}>
          <Topics />
        </PanelBoundary>
        <PanelBoundary label={words.visitor}>
          <PersonLink />
        </PanelBoundary>
        <PanelBoundary label={words.recording}>
          <Recording />
        </PanelBoundary>
      </div>
    </div>
  );
}

/** Switch that reports at once whether somebody is present. */
function Presence() {
  const live = useEntry("live");
  const scene = useEntry("scene");
  const sense = useOperation("scene");
  const [asked, setAsked] = useState<boolean | null>(null);
  useEffect(() => setAsked(null), [live?.at_s]);
  const there = asked ?? live?.person ?? scene?.person ?? false;
  const set = async (person: boolean): Promise<void> => {
    const done = await sense.ask({ person: person ? "PRESENT" : "ABSENT", announce: false });
    if (done?.accepted) setAsked(person);
  };
  return (
    <section className={shared.panel} aria-label={words.person}>
      <label className={shared.bar}>
        <input
          type="checkbox"
          role="switch"
          checked={there}
          disabled={sense.whyNot !== ""}
          aria-disabled={sense.isPending || undefined}
          onChange={(event) => void set(event.target.checked)}
        />
        {words.person}
        {sense.isPending && " …"}
      </label>
      <WhyNot of={sense} />
      <Outcome of={[sense]} />
    </section>
  );
}

function Questions() {
  const record = useEntry("questions");
  const answer = useOperation("answer");
  const open = record?.questions ?? [];
  return (
    <section className={shared.panel} aria-label={words.questions}>
      <h2>{words.questions}</h2>
      {open.length === 0 && <Empty>{words.noQuestions}</Empty>}
      {open.map((one) => (
        <Question key={`${one.at_s} ${one.text}`} question={one} answer={answer} />
      ))}
      {open.length > 0 && <WhyNot of={answer} />}
      <Outcome of={[answer]} />
    </section>
  );
}

function Question({ question, answer }: { question: QuestionRecord; answer: Operation<"answer"> }) {
  const [own, setOwn] = useState("");
  return (
    <form
      onSubmit={(event) => {
        event.preventDefault();
        void answer.ask({ text: own });
      }}
    >
      <p>{question.text}</p>
      <div className={shared.bar}>
        {question.choices.map((one) => (
          <OperationButton key={one} of={answer} ask={() => answer.ask({ text: one })}>
            {one}
          </OperationButton>
        ))}
        <input aria-label={words.ownAnswer} placeholder={words.ownAnswer} value={own} onChange={(event) => setOwn(event.target.value)} />
        <OperationButton of={answer} disabled={own.trim() === ""}>
          {words.answer}
        </OperationButton>
      </div>
    </form>
  );
}

function Topics() {
  const topics = useCollection("listening");
  const publish = useOperation("publish");
  return (
    <section className={shared.panel} aria-label={words.topics}>
      <h2>{words.topics}</h2>
      {topics.length === 0 && <Empty>{words.noTopics}</Empty>}
      {topics.map(([name, one]) => (
        <Topic key={name} name={name} record={one} publish={publish} />
      ))}
      {topics.length > 0 && <WhyNot of={publish} />}
      <Outcome of={[publish]} />
    </section>
  );
}

interface TopicProps {
  name: string;
  record: ListeningRecord;
  publish: Operation<"publish">;
}

function Topic({ name, record, publish }: TopicProps) {
  const [values, setValues] = useState<Record<string, string>>({});
  const isButton = record.type === "std_msgs/msg/Bool";
  return (
    <form
      className={css.topic}
      onSubmit={(event) => {
        event.preventDefault();
        const given = Object.entries(values).map(([field, value]) => `${field}=${value}`);
        void publish.ask({ topic: name, values: isButton ? ["data=true"] : given });
      }}
    >
      <p>
        <b>{name}</b> <small>{record.type}</small>
      </p>
      <div className={shared.bar}>
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
        <OperationButton of={publish}>{isButton ? words.press : words.publish}</OperationButton>
      </div>
    </form>
  );
}

function Play() {
  const { hello } = useConnection();
  const live = useEntry("live");
  const [given, setGiven] = useState<Record<string, number>>({});
  const [person, setPerson] = useState<Person>("AS_MEASURED");
  const [name, setName] = useState("");
  const [label, setLabel] = useState("");
  const [urgent, setUrgent] = useState(false);
  const scene = useOperation("scene");
  const disabled = scene.whyNot !== "";
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
    // Only an announced scene may name its person.
    const done = await scene.ask({ label, names, values, person, urgent, announce, ...(announce ? { name } : {}) });
    // The scene has the values now; the next one begins with the measured ones.
    if (announce && done?.accepted) setGiven({});
  };
  return (
    <section className={`${shared.panel} ${css.play}`} aria-label={words.scene}>
      <h2>{words.scene}</h2>
      {parameters.length === 0 ? <Empty>{words.noParameters}</Empty> : <p className={shared.faint}>{words.explain}</p>}
      <label className={shared.bar}>
        <input
          type="checkbox"
          checked={isAll}
          ref={(box) => {
            if (box) box.indeterminate = count > 0 && !isAll;
          }}
          disabled={disabled}
          onChange={(event) => giveAll(event.target.checked)}
        />
        {words.giveAll}
      </label>
      {parameters.map((one) => {
        const shown = standing(one);
        const id = `world-${one.name}`;
        const nearest = one.labels[exactNumber(shown)];
        const change = (next: number | null): void =>
          setGiven((before) => {
            const { [one.name]: _left, ...others } = before;
            return next === null ? others : { ...others, [one.name]: next };
          });
        return (
          <div className={fieldCss.row} key={one.name}>
            <label htmlFor={id}>
              {one.name} <small>{one.description}</small>
            </label>
            <NumberPair
              id={id}
              name={one.name}
              scale={scaleOf(one.minimum, one.maximum)}
              value={shown}
              disabled={disabled}
              move={change}
              set={change}
              press={() => setGiven((before) => ({ [one.name]: shown, ...before }))}
            />
            <small className={fieldCss.range}>
              {texts.tune.range} {exactNumber(one.minimum)} – {exactNumber(one.maximum)}
              {nearest && ` · ${nearest}`}
            </small>
            <label className={fieldCss.give}>
              <input
                type="checkbox"
                checked={given[one.name] !== undefined}
                disabled={disabled}
                onChange={(event) => change(event.target.checked ? shown : null)}
              />{" "}
              {words.give}
            </label>
          </div>
        );
      })}
      <div className={`${shared.bar} ${css.actions}`}>
        <label>
          {words.announcedPerson}{" "}
          <select value={person} onChange={(event) => setPerson(event.target.value as Person)}>
            <option value="AS_MEASURED">{words.measured}</option>
            <option value="PRESENT">{words.present}</option>
            <option value="ABSENT">{words.absent}</option>
          </select>
        </label>
        <label>
          {words.knownAs} <input value={name} onChange={(event) => setName(event.target.value)} />
        </label>
        <label>
          {words.label} <input value={label} onChange={(event) => setLabel(event.target.value)} />
        </label>
        <label>
          <input type="checkbox" checked={urgent} onChange={(event) => setUrgent(event.target.checked)} />{" "}
          {words.urgent}
        </label>
      </div>
      <WhyNot of={scene} />
      <div className={`${shared.bar} ${css.actions}`}>
        <OperationButton of={scene} ask={() => give(true)}>
          {words.announce}
        </OperationButton>
        <OperationButton of={scene} ask={() => give(false)}>
          {words.sense}
        </OperationButton>
        <Outcome of={[scene]} />
      </div>
    </section>
  );
}
