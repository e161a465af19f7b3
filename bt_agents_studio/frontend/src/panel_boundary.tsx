// SPDX-License-Identifier: Apache-2.0
// Error boundary of one panel: an exception in it leaves the rest of the page intact.

import { Component, type ReactNode } from "react";
import shared from "./shared.module.css";
import { texts } from "./texts";

interface Properties {
  /** Name of the panel, as in its heading. */
  label: string;
  children: ReactNode;
}

export class PanelBoundary extends Component<Properties, { error: unknown }> {
  override state: { error: unknown } = { error: null };

  static getDerivedStateFromError(error: unknown): { error: unknown } {
    return { error: error ?? new Error(texts.failure.unknown) };
  }

  override render(): ReactNode {
    if (this.state.error === null) return this.props.children;
    return (
      <section className={shared.panel} role="alert" aria-label={this.props.label}>
        <h2>{this.props.label}</h2>
        <p className={shared.failure}>{texts.failure.panel}</p>
        <pre tabIndex={0}>{String(this.state.error)}</pre>
        <button type="button" onClick={() => this.setState({ error: null })}>
          {texts.failure.again}
        </button>
      </section>
    );
  }
}
