// SPDX-License-Identifier: Apache-2.0
// Name of this browser's user, which others see with each change.

import { useState } from "react";
import shared from "./shared.module.css";
import { texts } from "./texts";

const KEY = "author";
const LONGEST = 60;

/** The name entered in this browser; else the studio's. */
export const author = (): string => localStorage.getItem(KEY) ?? texts.tune.author;

export function AuthorField() {
  const [name, setName] = useState(localStorage.getItem(KEY) ?? "");
  const change = (next: string): void => {
    setName(next);
    if (next.trim() === "") localStorage.removeItem(KEY);
    else localStorage.setItem(KEY, next.trim());
  };
  return (
    <label className={shared.bar}>
      {texts.tune.yourName}{" "}
      <input value={name} maxLength={LONGEST} placeholder={texts.tune.author} onChange={(event) => change(event.target.value)} />
    </label>
  );
}
