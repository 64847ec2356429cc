/** Figures of a model, as bars: 1 is best. */
import { h } from "../../parts/elements.js";

const MEANING = {
  knn: "nearest neighbour",
  svm: "support vector machine",
  within: "share of a region's clouds that bear its label",
  assigned: "share of a label's clouds in its regions",
};

/**
 * @param {Object<string, number>} told by name, in [0, 1].
 * @param {?Object<string, number>} before those of another version, to compare with.
 */
export function figures(told, before = null) {
  const rows = Object.entries(told).map(([name, value]) => {
    const bar = h("span", { class: "bar-track" }, h("span", { class: "bar-fill" }));
    bar.firstChild.style.width = `${100 * Math.min(1, Math.max(0, value))}%`;
    const change = before && name in before ? value - before[name] : null;
    const meaning = MEANING[name] && h("span", { class: "fine" }, ` ${MEANING[name]}`);
    return h("tr", {}, h("th", { scope: "row" }, name, meaning),
      h("td", {}, bar), h("td", { class: "number" }, value.toFixed(3)),
      before && h("td", { class: `number ${change < 0 ? "worse" : "better"}` },
        change === null ? "–" : `${change < 0 ? "−" : "+"}${Math.abs(change).toFixed(3)}`));
  });
  return h("table", { class: "figures" }, h("tbody", {}, rows));
}
