// SPDX-License-Identifier: Apache-2.0
// Whether the page is connected to its studio.

import { useConnection } from "./connection";
import { texts } from "./texts";

export function Phase() {
  const { phase } = useConnection();
  return (
    <>
      <p className={`phase ${phase}`} role="status">
        {texts.connection[phase]}
      </p>
      {phase === "outdated" && (
        <button type="button" onClick={() => location.reload()}>
          {texts.connection.reload}
        </button>
      )}
    </>
  );
}
