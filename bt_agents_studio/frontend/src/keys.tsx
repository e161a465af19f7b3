// SPDX-License-Identifier: Apache-2.0
// List of keys, and the choice of colours; "?" opens it.

import { useCallback, useRef } from "react";
import { useKey } from "./keyboard";
import { texts } from "./texts";
import { chooseTheme, THEMES, useTheme } from "./theme";

const words = texts.keys;

export function Keys() {
  const dialog = useRef<HTMLDialogElement>(null);
  const theme = useTheme();
  const open = useCallback(() => dialog.current?.showModal(), []);
  useKey("?", open);
  return (
    <>
      <button type="button" aria-haspopup="dialog" aria-label={words.title} title={words.title} onClick={open}>
        ?
      </button>
      <dialog className="keys" ref={dialog} aria-labelledby="keys-title">
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
        <div className="bar">
          {THEMES.map((one) => (
            <button key={one} type="button" aria-pressed={one === theme} onClick={() => chooseTheme(one)}>
              {words.themes[one]}
            </button>
          ))}
          <button type="button" className="close" onClick={() => dialog.current?.close()}>
            {words.close}
          </button>
        </div>
      </dialog>
    </>
  );
}
