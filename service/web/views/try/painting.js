/** The ways in which a cloud is coloured, each with its legend. */
import { colourOf, heightColour, toPixel } from "../../parts/colours.js";
import { h } from "../../parts/elements.js";
import { titleOf } from "../../parts/model.js";

/** The ways to colour a cloud, as values and words for a choice. @param {import("./seen.js").Seen|null} seen */
export function waysToColour(seen) {
  const words = Array.from({ length: seen?.levels ?? 0 }, (_, i) => [
    `word-${i + 1}`,
    `Visual word, of ${2 ** (i + 1)}`,
  ]);
  return seen
    ? [["segment", "Segment"], ...words, ["concept", "Concept"], ["height", "Height"]]
    : [["height", "Height"]];
}

/**
 * The colours of a cloud's points, and entries of a legend.
 *
 * @param {string} way one of `waysToColour`.
 * @param {import("./seen.js").Seen} seen
 * @param {number|null} object of a scene, whose segments the legend lists; null for a lone one.
 * @returns {{colours: Uint32Array, legend: HTMLElement[], note: string}}
 */
export function paint(way, seen, object) {
  if (way === "height") return paintHeights(seen.drawn, (point) => seen.height(point));
  const numberOf =
    {
      segment: (point) => seen.segments[point],
      concept: (point) => seen.concept(point),
    }[way] ?? ((point) => seen.word(point, Number(way.slice(5))));
  const colour = way === "concept" ? (concept) => seen.model.tree.colour(concept) : colourOf;
  const pixels = new Map();
  const counts = new Map();
  const colours = new Uint32Array(seen.drawn.count);
  for (let point = 0; point < colours.length; point += 1) {
    const number = numberOf(point);
    if (!pixels.has(number)) pixels.set(number, toPixel(colour(number)));
    colours[point] = pixels.get(number);
    if (number >= 0 && (object === null || seen.objects[point] === object || way === "concept")) {
      counts.set(number, (counts.get(number) ?? 0) + 1);
    }
  }
  const shown = [...counts].sort((one, other) => (way === "concept" ? other[1] - one[1] : one[0] - other[0]));
  const titles = { segment: (number) => `Segment ${number}`, concept: (number) => titleOf(seen.model, number) };
  const title = titles[way] ?? ((number) => `Word ${number}`);
  const legend = shown.map(([number]) => h("span", { class: "legend-entry" }, swatch(colour(number)), title(number)));
  return { colours, legend, note: NOTES[way === "concept" ? (seen.scene ? "concepts" : "concept") : way] ?? "" };
}

/** The colours of points by their heights alone, before anything else is known of them. */
export function paintHeights(drawn, heightOf) {
  const heights = Float32Array.from({ length: drawn.count }, (_, point) => heightOf(point));
  const sorted = Float32Array.from(heights).sort();
  const [low, high] = [0.01, 0.99].map((share) => sorted[Math.floor(share * (sorted.length - 1))]);
  const ramp = Array.from({ length: 64 }, (_, step) => toPixel(heightColour(step / 63)));
  const colours = Uint32Array.from(
    heights,
    (height) => ramp[Math.round(63 * Math.min(1, Math.max(0, (height - low) / (high - low || 1))))],
  );
  const bar = h(
    "span",
    { class: "legend-ramp" },
    Array.from({ length: 16 }, (_, step) => step / 15).map((share) => swatch(heightColour(share))),
  );
  return {
    colours,
    legend: [h("span", { class: "legend-entry" }, "low ", bar, ` high, ${((high - low) * 100).toFixed(1)} cm`)],
    note: "",
  };
}

/** A small square of a colour. */
export function swatch(colour) {
  const square = h("span", { class: "swatch" });
  square.style.background = colour;
  return square;
}

const NOTES = {
  concept: "Each segment has the colour of the concept that holds the training object whose part is most like it.",
  concepts: "Each object has the colour of its best concept.",
};
