// SPDX-License-Identifier: Apache-2.0
// State of the page's connection to its studio.

import { useConnection } from "./connection";
import { formatTime } from "./formatting";
import css from "./phase.module.css";
import { texts } from "./texts";

export function Phase() {
  const { phase, heardS } = useConnection();
  return (
    <>
      <p className={css.phase} data-phase={phase} role="status">
        {phase === "lost" && heardS !== null
          ? `${texts.connection.stale} ${formatTime(heardS)}, ${texts.connection.again}`
          : texts.connection[phase]}
      </p>
      {phase === "outdated" && (
        <button type="button" onClick={() => location.reload()}>
          {texts.connection.reload}
        </button>
      )}
    </>
  );
}
