/** Colours of data, the same in every view, in light and dark; and those of the page for what is drawn on a canvas. */

// Apart from one another also for those who see red and green alike (Okabe and Ito), as far as eight can be.
const FIRST = ["#0f7ac0", "#e07b00", "#0b9e77", "#c95aa0", "#8e6bd1", "#c8a415", "#4fb4e6", "#d14b2f"];
const GOLDEN = 137.50776405; // degrees: each further hue is as far as can be from those before
const NONE = "#8b94a0";

/** The colour of a number: a segment, a visual word, or a component of the filtration by its rank; -1 is none. */
export function colourOf(number) {
  if (number < 0) return NONE;
  if (number < FIRST.length) return FIRST[number];
  const hue = (number * GOLDEN) % 360;
  return hex(hue, 0.5 + 0.2 * ((number % 3) / 2), 0.45 + 0.08 * (number % 3));
}

/** The colour of a height from 0, the lowest, to 1: dark blue over green to yellow, ever lighter. */
export function heightColour(share) {
  const stops = [
    [59, 76, 162],
    [38, 130, 142],
    [63, 170, 110],
    [190, 200, 60],
    [250, 220, 90],
  ];
  const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const below = Math.min(Math.floor(at), stops.length - 2);
  const mixed = stops[below].map((low, axis) => low + (stops[below + 1][axis] - low) * (at - below));
  return `#${mixed.map((value) => Math.round(value).toString(16).padStart(2, "0")).join("")}`;
}

/** A colour "#rrggbb" as the pixels of a canvas have it: 0xAABBGGRR. */
export function toPixel(colour) {
  const value = parseInt(colour.slice(1), 16);
  return (0xff000000 | ((value & 0xff) << 16) | (value & 0xff00) | (value >> 16)) >>> 0;
}

/** A colour of the page, by the name of its variable in style.css. */
export function pageColour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** Calls a function when the page becomes light or dark; returns one that ends this. */
export function onLightChange(listener) {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", listener);
  return () => dark.removeEventListener("change", listener);
}

function hex(hue, saturation, lightness) {
  const reach = saturation * Math.min(lightness, 1 - lightness);
  const channel = (offset) => {
    const k = (offset + hue / 30) % 12;
    const value = lightness - reach * Math.max(-1, Math.min(k - 3, 9 - k, 1));
    return Math.round(255 * value)
      .toString(16)
      .padStart(2, "0");
  };
  return `#${channel(0)}${channel(8)}${channel(4)}`;
}
