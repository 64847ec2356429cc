/** An answer: the concepts that an object resembles, ranked; how new it is; how long it took; and why. */
import { h } from "../../parts/elements.js";
import { titleOf } from "../../parts/model.js";
import { linkTo } from "../../place.js";
import { swatch } from "./painting.js";
import { whyPanel } from "./why.js";

const FIRST = 6; // concepts that are listed at first
const PROTOTYPES = 6; // thumbnails of each

/**
 * @param {Object} answer of one object.
 * @param {import("../../parts/model.js").Model} model that answered.
 * @param {{highlight: function(number[]|null): void}} ways
 */
export function answerPanel(answer, model, ways) {
  const own = answer.concepts.filter((concept) => concept.time === answer.time);
  const others = answer.concepts.filter((concept) => concept.time !== answer.time);
  const best = answer.concepts[0];
  return h(
    "div",
    { class: "answer" },
    h(
      "section",
      { class: "panel", "aria-label": "Concepts" },
      best ? headline(best, model) : h("p", {}, "The model has no concept at this filtration time."),
      answer.warnings.map((warning) => h("p", { class: "warning" }, warning)),
      novelty(answer.novelty),
      h("p", { class: "fine" }, seenAs(answer)),
      ranked(own, answer, model),
      others.length > 0 &&
        h(
          "details",
          {},
          h("summary", {}, `Concepts of other filtration times (${others.length})`),
          ranked(others, answer, model),
        ),
    ),
    answer.explanation && whyPanel(answer, model, ways),
    timings(answer),
  );
}

function headline(best, model) {
  const nearest = h("div", { class: "best" }, swatch(model.tree.colour(best.id)), h("h2", {}, titleOf(model, best.id)));
  const about = `The closest of the model's concepts; ${best.prototypes} training objects make it up.`;
  return h("div", { role: "status" }, nearest, h("p", { class: "fine" }, about));
}

function seenAs({ segments, extent_m: extent, truncated }) {
  const cut = truncated ? "; constellations were left out, as there were too many" : "";
  return `Seen as ${segments} segment${segments === 1 ? "" : "s"}, ${(100 * extent).toFixed(1)} cm across${cut}.`;
}

function novelty(share) {
  const percent = Math.round(100 * share);
  const words = share >= 0.95 ? "unlike what was learned" : share >= 0.75 ? "rather new" : "like what was learned";
  return h(
    "div",
    { class: "novelty" },
    h("span", {}, "Novelty"),
    h("meter", {
      min: 0,
      max: 1,
      low: 0.75,
      high: 0.95,
      optimum: 0,
      value: share,
      "aria-label": `Novelty ${percent} percent`,
    }),
    h("span", { class: "number" }, `${percent} %`),
    h("span", { class: "fine" }, words),
  );
}

function ranked(concepts, answer, model) {
  const responses = concepts.map((concept) => concept.response);
  const [nearest, farthest] = [Math.min(...responses), Math.max(...responses)];
  const closeness = (response) => (farthest > nearest ? (farthest - response) / (farthest - nearest) : 1);
  const list = h(
    "ol",
    { class: "ranked" },
    concepts.slice(0, FIRST).map((concept) => row(concept, closeness, answer, model)),
  );
  const rest = concepts.slice(FIRST);
  const more = h(
    "button",
    {
      type: "button",
      class: "quiet",
      click: () => {
        more.remove();
        list.append(...rest.map((concept) => row(concept, closeness, answer, model)));
      },
    },
    `Show ${rest.length} more`,
  );
  return h("div", {}, list, rest.length > 0 && more);
}

function row(concept, closeness, answer, model) {
  const title = titleOf(model, concept.id);
  const bar = h("span", { class: "bar-fill" });
  bar.style.width = `${Math.max(1, 100 * closeness(concept.response))}%`;
  bar.style.background = model.tree.colour(concept.id);
  const place = { model: model.reference, concept: concept.id };
  if (concept.time !== model.epsilonMax) place.time = concept.time; // otherwise it goes without saying
  const [response, distance] = [concept.response.toFixed(2), concept.distance.toFixed(2)];
  const exact = `response ${response}, mean distance ${distance} (Eq. 4); smaller is closer`;
  return h(
    "li",
    { class: "rank", title: exact },
    h(
      "span",
      { class: "rank-title" },
      h("a", { href: linkTo("concepts", place), class: "rank-name" }, title),
      h("span", { class: "fine" }, ` ${concept.prototypes} objects`),
    ),
    h("span", { class: "bar-track", role: "img", "aria-label": exact }, bar),
    h("span", { class: "number fine" }, concept.response.toFixed(1)),
    h(
      "span",
      { class: "thumbnails" },
      prototypesOf(concept.id, answer, model).map(({ object, label }) => model.thumbnails.show(object, label)),
    ),
  );
}

/** The prototypes of a concept that are shown: those nearest to the cloud, where that is told, then others. */
function prototypesOf(concept, answer, model) {
  const told = answer.explanation?.concepts.find((one) => one.id === concept)?.nearest ?? [];
  const away = new Map(told.map((near) => [near.object, `: Mahalanobis distance ${near.distance.toPrecision(3)}`]));
  return [...new Set([...away.keys(), ...model.tree.objectsOf(concept)])]
    .slice(0, PROTOTYPES)
    .map((object) => ({ object, label: labelOf(model, object) + (away.get(object) ?? "") }));
}

/** What a training object is called. */
export function labelOf(model, object) {
  const category = model.categories[object];
  return `${model.objects[object].key}${category ? ` (${category})` : ""}`;
}

function timings({ timings_ms: stages }) {
  const total = Object.values(stages).reduce((sum, time) => sum + time, 0);
  const entry = ([stage, time]) => {
    const bar = h("span", { class: "bar-fill" });
    bar.style.width = `${Math.max(0.5, (100 * time) / total)}%`;
    return h(
      "li",
      {},
      h("span", {}, stage),
      h("span", { class: "bar-track" }, bar),
      h("span", { class: "number fine" }, `${time.toFixed(1)} ms`),
    );
  };
  return h(
    "section",
    { class: "panel", "aria-label": "Time" },
    h("h2", {}, `Answered in ${total.toFixed(0)} ms`),
    h("ul", { class: "timings" }, Object.entries(stages).map(entry)),
  );
}
