// SPDX-License-Identifier: Apache-2.0
// Stops whatever runs, in the same way on every page, by a button or a key.

import { useCallback, useState } from "react";
import { operate } from "./connection";
import { isUnheard } from "./operation";
import { texts } from "./texts";

const LIMIT_MS = 5000;

/** Result of the last request to stop. */
export interface StopAnswer {
  isAsked: boolean;
  isRefused: boolean;
  /** Text of the result; empty before the first request. */
  text: string;
}

const NONE: StopAnswer = { isAsked: false, isRefused: false, text: "" };

interface Words {
  stopping: string;
  /** If left out, the market's own message is shown. */
  stopped?: string;
  notStopped: string;
}

/** Stop the run and all scenes in line; `reason` says who asks. */
export function useStop(reason: string, words: Words = texts.stop): [StopAnswer, () => void, () => void] {
  const [answer, setAnswer] = useState(NONE);
  const stop = useCallback(() => {
    setAnswer({ isAsked: true, isRefused: false, text: words.stopping });
    void operate("cancel", { reason, by: "OPERATOR" }, LIMIT_MS).then((done) => {
      const said = done.accepted ? (words.stopped ?? done.message) : done.message;
      const text = isUnheard(done) ? `${words.notStopped} ${done.message}` : said;
      setAnswer({ isAsked: false, isRefused: !done.accepted, text });
    });
  }, [reason, words]);
  const forget = useCallback(() => setAnswer(NONE), []);
  return [answer, stop, forget];
}
