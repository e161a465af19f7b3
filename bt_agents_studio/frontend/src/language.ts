// SPDX-License-Identifier: Apache-2.0
// The language of the browser: one whose locale is C or POSIX has "en-US@posix", which is no
// language tag, so that uPlot would throw when it is loaded. Imported before all others.

try {
  Intl.getCanonicalLocales(navigator.language);
} catch {
  Object.defineProperty(navigator, "language", { value: "en-US" });
}
