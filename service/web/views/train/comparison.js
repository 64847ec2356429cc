/** Two versions compared: what became of the concepts of the one in the other. */
import { get, pathOf } from "../../api.js";
import { h } from "../../parts/elements.js";
import { loadInto } from "../../parts/load.js";
import { count } from "../../parts/words.js";
import { linkTo } from "../../place.js";
import { figures } from "./figures.js";

const FATES = {
  persists: "the same",
  merges: "merged into a larger one",
  splits: "split",
  disappears: "gone",
  untold: "untold",
};

/**
 * @param {string[]} pair NAME:VERSION of both, the earlier one first.
 * @param {AbortSignal} signal
 * @returns {{element: HTMLElement, filled: Promise<void>}}
 */
export function comparison([old, later], signal) {
  const place = h("div", { class: "comparison" });
  const [name, version] = old.split(":");
  const [laterName, laterVersion] = later.split(":");
  const filled = loadInto(place, signal, () => Promise.all([
    get(pathOf`v1/models/${name}/versions/${version}/compare`, { query: { with: later }, signal }),
    get(pathOf`v1/models/${name}/versions/${version}`, { signal }),
    get(pathOf`v1/models/${laterName}/versions/${laterVersion}`, { signal }),
  ]), ([told, before, after]) => [
    h("h3", {}, `From ${old} to ${later}`),
    h("p", { class: "fine" }, `Compared by ${count(told.shared, "cloud")} that both learnt from`,
      told.asked > 0 && `, and by ${told.asked} that one of them was asked about`, "."),
    fates(told),
    after.metrics && before.metrics && figures(after.metrics, before.metrics),
    concepts(told),
  ]);
  return { element: place, filled };
}

/** How many concepts have each fate, as one bar. */
function fates(told) {
  const all = told.old_concepts.length || 1;
  const parts = Object.entries(told.fates);
  const bar = h("div", { class: "fates", role: "img", "aria-label": parts.map(([fate, number]) =>
    `${number} ${FATES[fate]}`).join(", ") });
  for (const [fate, number] of parts) {
    const part = h("span", { class: `fate fate-${fate}` });
    part.style.flexGrow = number / all;
    bar.append(part);
  }
  const fresh = told.origins.appears ?? 0;
  return [bar, h("p", { class: "legend" }, parts.map(([fate, number]) => h("span", {}, h("span", {
    class: `swatch fate-${fate}` }), ` ${number} ${FATES[fate]}`)), h("span", {}, h("span", {
    class: "swatch fate-appears" }), ` ${fresh} new`))];
}

function concepts(told) {
  const called = (version, concept) => h("a", { href: linkTo("concepts", { model: `${version.model}:${version.version}`,
    concept: concept.id, time: version.time }) }, concept.name ?? `Concept ${concept.id}`);
  const related = (concept) => concept.concepts.slice(0, 3).map((other) => h("div", {}, called(told.new, other),
    h("span", { class: "fine" }, ` ${Math.round(100 * other.jaccard)} % alike`)));
  const olds = told.old_concepts.map((concept) => h("tr", {}, h("th", { scope: "row" }, called(told.old, concept)),
    h("td", { class: "number" }, concept.prototypes),
    h("td", {}, h("span", { class: `swatch fate-${concept.fate}` }), ` ${FATES[concept.fate]}`),
    h("td", {}, related(concept))));
  const fresh = told.new_concepts.filter((concept) => concept.origin === "appears").map((concept) => h("tr", {},
    h("th", { scope: "row" }, "–"), h("td", { class: "number" }, concept.prototypes),
    h("td", {}, h("span", { class: "swatch fate-appears" }), " new"), h("td", {}, called(told.new, concept))));
  const heads = ["Concept", "Objects", "Became", "In the other version"];
  return h("div", { class: "wide tall" }, h("table", {}, h("thead", {}, h("tr", {}, heads.map((head) =>
    h("th", { scope: "col" }, head)))), h("tbody", {}, olds, fresh)));
}
