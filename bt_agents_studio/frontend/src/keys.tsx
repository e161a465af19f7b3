// SPDX-License-Identifier: Apache-2.0
// List of keys, and the choices of colours and density; "?" opens it.

import { useCallback, useRef } from "react";
import { choose, CHOICES, useChosen, type Choice } from "./appearance";
import { useKey } from "./keyboard";
import css from "./keys.module.css";
import { texts } from "./texts";

const words = texts.keys;

export function Keys() {
  const dialog = useRef<HTMLDialogElement>(null);
  const open = useCallback(() => dialog.current?.showModal(), []);
  useKey("?", open);
  return (
    <>
      <button type="button" aria-haspopup="dialog" aria-label={words.title} title={words.title} onClick={open}>
        ?
      </button>
      <dialog className={css.keys} ref={dialog} aria-labelledby="keys-title">
        <h2 id="keys-title">{words.title}</h2>
        <dl>
          {words.list.map(([key, action]) => (
            <div key={key}>
              <dt>
                <kbd>{key}</kbd>
              </dt>
              <dd>{action}</dd>
            </div>
          ))}
        </dl>
        <Choices of="theme" />
        <Choices of="density" />
        <button type="button" className={css.close} onClick={() => dialog.current?.close()}>
          {words.close}
        </button>
      </dialog>
    </>
  );
}

function Choices({ of }: { of: Choice }) {
  const chosen = useChosen(of);
  const names: Readonly<Record<string, string>> = words.choices[of];
  return (
    <div className={css.choices} role="group" aria-label={words[of]}>
      {CHOICES[of].map((one) => (
        <button key={one} type="button" aria-pressed={one === chosen} onClick={() => choose(of, one)}>
          {names[one]}
        </button>
      ))}
    </div>
  );
}
