/** Why an answer is what it is: segments, motifs that fired, training objects; each is highlighted in the cloud. */
import { colourOf } from "../../parts/colours.js";
import { h } from "../../parts/elements.js";
import { labelOf } from "./answer.js";
import { swatch } from "./painting.js";

/**
 * @param {Object} answer with an explanation.
 * @param {import("../../parts/model.js").Model} model
 * @param {{highlight: function(number[]|null): void}} ways
 */
export function whyPanel({ explanation }, model, { highlight }) {
  const strongest = Math.max(...explanation.vertices.map((vertex) => vertex.stimulus));
  return h(
    "section",
    { class: "panel why", "aria-label": "Why" },
    h("h2", {}, "Why"),
    h("p", { class: "fine" }, "Point at, or tab to, a row: its segments stand out in the cloud."),
    h("h3", {}, "Motifs that fired"),
    h(
      "ul",
      { class: "lines" },
      explanation.vertices.map((vertex) => motif(vertex, strongest, model, highlight)),
    ),
    h("h3", {}, "Segments"),
    h(
      "ul",
      { class: "lines" },
      explanation.segments.map((segment, number) => segmentRow(segment, number, model, highlight)),
    ),
    h("h3", {}, "Training objects most like the whole"),
    h(
      "div",
      { class: "thumbnails" },
      explanation.wholes.map((near) => likeness(near, model, "nats")),
    ),
  );
}

/** A row whose segments are highlighted while it is pointed at or has the focus. */
function lighting(segments, highlight, ...children) {
  const on = () => highlight(segments);
  const off = () => highlight(null);
  return h("li", { tabindex: "0", class: "line", mouseenter: on, mouseleave: off, focus: on, blur: off }, children);
}

function motif(vertex, strongest, model, highlight) {
  const bar = h("span", { class: "bar-fill" });
  bar.style.width = `${(100 * vertex.stimulus) / strongest}%`;
  const words = vertex.words.length > 6 ? `${vertex.words.slice(0, 6).join(", ")} …` : vertex.words.join(", ");
  const from = [vertex.hierarchy, ...vertex.also_in].map((f) => `H${f}`).join(", ");
  return lighting(
    vertex.segments,
    highlight,
    h(
      "span",
      { class: "line-title" },
      `Word${vertex.words.length > 1 ? "s" : ""} ${words}`,
      h("span", { class: "fine block" }, `level ${vertex.level} of ${from}; ${vertex.prototypes} motif prototypes`),
    ),
    h(
      "span",
      { class: "swatches" },
      vertex.segments.map((segment) => swatch(colourOf(segment))),
    ),
    h(
      "span",
      {
        class: "bar-track",
        role: "img",
        "aria-label": `stimulus ${vertex.stimulus.toPrecision(3)}`,
        title: `stimulus ${vertex.stimulus.toPrecision(3)}`,
      },
      bar,
    ),
    h(
      "span",
      { class: "thumbnails" },
      vertex.nearest.map((near) => likeness(near, model, "nats")),
    ),
  );
}

function segmentRow(segment, number, model, highlight) {
  return lighting(
    [number],
    highlight,
    h(
      "span",
      { class: "line-title" },
      `Segment ${number}`,
      h(
        "span",
        { class: "fine block" },
        `${Math.round(100 * segment.share)} % of the surface, ${(100 * segment.extent_m).toFixed(1)} cm`,
      ),
    ),
    h("span", { class: "swatches" }, swatch(colourOf(number))),
    h("span", { class: "fine" }, `words ${segment.words.join(", ")}`),
    h(
      "span",
      { class: "thumbnails" },
      segment.nearest.map((near) => likeness(near, model, "nats")),
    ),
  );
}

function likeness(near, model, unit) {
  return model.thumbnails.show(
    near.object,
    `${labelOf(model, near.object)}: ${near.distance.toPrecision(3)} ${unit} away`,
  );
}
