// SPDX-License-Identifier: Apache-2.0
// The browser's language, replaced where it is no language tag. Chromium without a locale says
// "en-US@posix", and uPlot gives that to Intl.NumberFormat while it is loaded, which throws.

try {
  new Intl.NumberFormat(navigator.language);
} catch {
  Object.defineProperty(navigator, "language", { value: "en-US" });
}
