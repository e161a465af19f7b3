// SPDX-License-Identifier: Apache-2.0
// Address of the page Person as a QR code for a visitor's phone or tablet.

import { encode } from "uqr";
import { OperationButton, Outcome, useOperation, WhyNot } from "./operation";
import css from "./person_link.module.css";
import type { PersonLinkRecord } from "./protocol";
import shared from "./shared.module.css";
import { texts } from "./texts";

const words = texts.world;
/** Light modules around the code, which scanners need. */
const BORDER = 4;

export function PersonLink() {
  const link = useOperation("person_link", true);
  const found = link.answer?.accepted ? (link.answer.record as PersonLinkRecord) : null;
  return (
    <section className={shared.panel} aria-label={words.visitor}>
      <h2>{words.visitor}</h2>
      <p className={shared.faint}>{words.visitorExplain}</p>
      <WhyNot of={link} />
      {found === null && (
        <OperationButton of={link} ask={() => link.ask({})}>
          {words.showAddress}
        </OperationButton>
      )}
      {found?.is_local && <p>{words.onlyHere}</p>}
      {found?.is_local === false && (
        <>
          <QrCode text={found.address} />
          <code>{found.address}</code>
        </>
      )}
      {found === null && <Outcome of={[link]} />}
    </section>
  );
}

/** Dark on light in both themes, since not every camera reads the inverse. */
function QrCode({ text }: { text: string }) {
  const { data, size } = encode(text, { border: BORDER });
  const path = data.flatMap((row, y) => row.map((dark, x) => (dark ? `M${x} ${y}h1v1h-1z` : ""))).join("");
  return (
    <svg className={css.code} role="img" aria-label={words.code} viewBox={`0 0 ${size} ${size}`}>
      <rect width={size} height={size} fill="#fff" />
      <path d={path} fill="#000" />
    </svg>
  );
}
