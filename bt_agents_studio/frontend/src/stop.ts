// SPDX-License-Identifier: Apache-2.0
// Stop of whatever runs: the same from every page, by a button or a key.

import { useCallback, useState } from "react";
import { operate } from "./connection";
import { texts } from "./texts";

const LIMIT_MS = 5000;

/** How the last request to stop went. */
export interface StopAnswer {
  isAsked: boolean;
  isRefused: boolean;
  /** In words; empty before the first request. */
  text: string;
}

const NONE: StopAnswer = { isAsked: false, isRefused: false, text: "" };

interface Words {
  stopping: string;
  /** Without it, the market says what it has stopped. */
  stopped?: string;
  notStopped: string;
}

/** Stop what runs, whatever waits in line, too; `reason` says who wants it. */
export function useStop(reason: string, words: Words = texts.stop): [StopAnswer, () => void, () => void] {
  const [answer, setAnswer] = useState(NONE);
  const stop = useCallback(() => {
    setAnswer({ isAsked: true, isRefused: false, text: words.stopping });
    void operate("cancel", { reason, by: "OPERATOR" }, LIMIT_MS).then((done) => {
      const isUnheard = done.code === "NO_STUDIO" || done.code === "NO_ANSWER";
      const said = done.accepted ? (words.stopped ?? done.message) : done.message;
      const text = isUnheard ? `${words.notStopped} ${done.message}` : said;
      setAnswer({ isAsked: false, isRefused: !done.accepted, text });
    });
  }, [reason, words]);
  const forget = useCallback(() => setAnswer(NONE), []);
  return [answer, stop, forget];
}
