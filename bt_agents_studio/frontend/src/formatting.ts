// SPDX-License-Identifier: Apache-2.0
// Numbers and times for people.

/** Enough digits to read the exact value back; other formats are for display only. */
export const exactNumber = (value: number): string => String(value);

export function formatNumber(value: number): string {
  return String(Math.round(value * 1000) / 1000);
}

export function formatSeconds(seconds: number): string {
  if (seconds < 90) return `${formatNumber(Math.round(seconds * 10) / 10)} s`;
  const whole = Math.round(seconds);
  return `${Math.floor(whole / 60)} min ${whole % 60} s`;
}

// Making a formatter takes longer than drawing a line of the log.
const TIME = new Intl.DateTimeFormat([], { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23" });

export function formatTime(atS: number): string {
  return TIME.format(atS * 1000);
}
