// SPDX-License-Identifier: Apache-2.0
// Strategy of the market: the active one, its options, and a switch to another one.

import { useEffect, useState } from "react";
import { useConnection } from "./connection";
import { NumberPair, scaleOf } from "./fields";
import fieldCss from "./fields.module.css";
import { OperationButton, Outcome, useOperation, WhyNot } from "./operation";
import type { StrategiesRecord } from "./protocol";
import shared from "./shared.module.css";
import { useEntry } from "./store";
import { texts } from "./texts";

const words = texts.market;

export function Strategy() {
  const market = useEntry("market");
  const { phase } = useConnection();
  const read = useOperation("strategy");
  const change = useOperation("strategy");
  const [found, setFound] = useState<StrategiesRecord | null>(null);
  const [chosen, setChosen] = useState("");
  const [given, setGiven] = useState<Record<string, number>>({});
  const inForce = market?.strategy ?? "";
  useEffect(() => {
    if (inForce === "" || phase !== "open") return;
    void read.ask({}).then((done) => done?.accepted && setFound(done.record as StrategiesRecord));
  }, [phase, market?.epoch, inForce, read.ask]);
  if (market === undefined) return null;
  const name = chosen || inForce;
  const options = found?.options[name] ?? [];
  const drop = (): void => {
    setChosen("");
    setGiven({});
  };
  const set = async (): Promise<void> => {
    const done = await change.ask({ name, options: Object.keys(given), values: Object.values(given) });
    if (!done?.accepted) return;
    setFound(done.record as StrategiesRecord);
    drop();
  };
  const isChanged = name !== inForce || Object.keys(given).length > 0;
  return (
    <section className={shared.panel} aria-label={words.strategy}>
      <h2>{words.strategy}</h2>
      <WhyNot of={change} />
      <label className={shared.bar}>
        {words.ranks}{" "}
        <select
          value={name}
          disabled={change.whyNot !== ""}
          onChange={(event) => {
            setChosen(event.target.value);
            setGiven({});
          }}
        >
          {!market.strategies.some((one) => one.name === name) && <option>{name}</option>}
          {market.strategies.map((one) => (
            <option key={one.name}>{one.name}</option>
          ))}
        </select>
      </label>
      <p>{market.strategies.find((one) => one.name === name)?.description}</p>
      {options.map((one) => (
        <div className={fieldCss.row} key={`${name}.${one.name}`}>
          <label htmlFor={`strategy-${one.name}`}>
            {one.name} <small>{one.description}</small>
          </label>
          <NumberPair
            id={`strategy-${one.name}`}
            name={one.name}
            scale={scaleOf(one.minimum, one.maximum)}
            value={given[one.name] ?? one.value}
            disabled={change.whyNot !== ""}
            set={(value) => setGiven((before) => ({ ...before, [one.name]: value }))}
          />
        </div>
      ))}
      {isChanged && (
        <div className={shared.bar}>
          <OperationButton of={change} ask={set}>
            {words.setStrategy}
          </OperationButton>
          <button type="button" onClick={drop}>
            {words.leaveStrategy}
          </button>
        </div>
      )}
      {read.answer?.accepted === false && <p className={shared.warning}>{read.answer.message}</p>}
      <Outcome of={[change]} />
    </section>
  );
}
