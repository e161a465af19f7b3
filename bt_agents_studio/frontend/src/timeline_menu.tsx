// SPDX-License-Identifier: Apache-2.0
// Buttons of the timeline that open a small panel; only one panel is open at a time.

import type { ReactNode, RefObject } from "react";
import shared from "./shared.module.css";
import css from "./timeline_menu.module.css";

type Box = RefObject<HTMLDetailsElement | null>;

interface MenuProps {
  box: Box;
  label: string;
  onOpen?: () => void;
  children: ReactNode;
}

export function Menu({ box, label, onOpen, children }: MenuProps) {
  return (
    <details
      ref={box}
      className={css.menu}
      name="timeline"
      onToggle={(event) => event.currentTarget.open && onOpen?.()}
      onKeyDown={(event) => event.key === "Escape" && close(box)}
    >
      <summary>{label}</summary>
      <div className={`${shared.panel} ${css.content}`}>{children}</div>
    </details>
  );
}

export function close(box: Box): void {
  if (box.current === null) return;
  box.current.open = false;
  box.current.querySelector("summary")?.focus();
}
