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

/** Stop what runs, whatever waits in line, too; `reason` says who wants it. */
export function useStop(reason: string): [StopAnswer, () => void, () => void] {
  const [answer, setAnswer] = useState(NONE);
  const stop = useCallback(() => {
    setAnswer({ isAsked: true, isRefused: false, text: texts.stop.stopping });
    void operate("cancel", { reason, by: "OPERATOR" }, LIMIT_MS).then((done) => {
      const isUnheard = done.code === "NO_STUDIO" || done.code === "NO_ANSWER";
      const text = isUnheard ? `${texts.stop.notStopped} ${done.message}` : done.message;
      setAnswer({ isAsked: false, isRefused: !done.accepted, text });
    });
  }, [reason]);
  const forget = useCallback(() => setAnswer(NONE), []);
  return [answer, stop, forget];
}
