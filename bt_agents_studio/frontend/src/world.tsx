// SPDX-License-Identifier: Apache-2.0
// Page "World": what the robot would sense, given by hand.

import { useState } from "react";
import { operate, useConnection } from "./connection";
import { formatNumber } from "./formatting";
import type { Operations } from "./protocol";
import { useEntry } from "./store";
import { texts } from "./texts";

const words = texts.world;
type Person = NonNullable<Operations["scene"]["person"]>;

export function World() {
  const { hello, atS } = useConnection();
  const live = useEntry("live");
  const [given, setGiven] = useState<Record<string, number>>({});
  const [person, setPerson] = useState<Person>("AS_MEASURED");
  const [label, setLabel] = useState("");
  const [urgent, setUrgent] = useState(false);
  const [answer, setAnswer] = useState("");
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
      {hello?.parameters.map((one) => {
        const value = given[one.name];
        const now = live?.values.find((found) => found.name === one.name)?.value;
        const shown = value ?? now ?? one.default;
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
          {words.person}{" "}
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
