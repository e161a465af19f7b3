// SPDX-License-Identifier: Apache-2.0
// Replaces the browser's language if it is not a language tag. Chromium without a locale reports
// "en-US@posix", which uPlot passes to Intl.NumberFormat while it loads, and that throws.

try {
  new Intl.NumberFormat(navigator.language);
} catch {
  Object.defineProperty(navigator, "language", { value: "en-US" });
}
