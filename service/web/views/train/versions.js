/** The panel of versions: how each was made and judged, which one serves, and two of them compared. */
import { get } from "../../api.js";
import { h } from "../../parts/elements.js";
import { loadInto } from "../../parts/load.js";
import { empty } from "../../parts/states.js";
import { when } from "../../parts/words.js";
import { linkTo } from "../../place.js";
import { confirmed, doing, field, heard, models, tell } from "./changes.js";
import { comparison } from "./comparison.js";

const PAGE = 10; // versions

/** @param {import("./changes.js").Context} context */
export function versionsPanel(context) {
  const { place, signal } = context;
  const list = h("div");
  const problem = h("div");
  const compared = h("div");
  let shown = PAGE;

  function refresh() {
    return loadInto(list, signal, load, fill);
  }

  async function load() {
    const known = await models(signal);
    const model = known.find((one) => one.name === place.get("model")) ?? known[0];
    if (!model) return { known };
    const versions = [...model.versions].reverse().slice(0, shown);
    const [{ aliases }, ...manifests] = await Promise.all([
      get(`v1/models/${model.name}/aliases`, { signal }),
      ...versions.map((version) => get(`v1/models/${model.name}/versions/${version}`, { signal })),
    ]);
    return { known, model, manifests, held: heldBy(aliases.production ?? []) };
  }

  function fill({ known, model, manifests, held }) {
    if (!model) return empty("There is no model yet: submit a job that learns one.");
    const chosen = h("select", { change: () => { place.set({ model: chosen.value, compare: null }, { push: true });
      shown = PAGE; changed(); } }, known.map((one) => h("option", { value: one.name, selected: one === model },
      one.name)));
    return [
      field("Model", chosen),
      model.built_in && h("p", { class: "fine" }, "It comes with the service and only answers, until the store holds a "
        + "model of your own."),
      table(model, manifests),
      manifests.length > 1 && h("p", { class: "fine" }, "Tick two versions to compare them."),
      model.versions.length > shown && h("button", { type: "button", click: () => { shown += PAGE; refresh(); } },
        "Earlier versions"),
      !model.built_in && served(model, held),
    ];
  }

  function table(model, manifests) {
    const names = [...new Set(manifests.flatMap((one) => Object.keys(one.metrics ?? {})))];
    const heads = ["", "Version", "Made", "Objects", "Concepts", ...names, ""];
    const pair = pairOf(place);
    const rows = manifests.map((one) => {
      const reference = `${one.name}:${one.version}`;
      const aliases = Object.entries(model.aliases).filter(([, version]) => version === one.version);
      const serves = model.aliases.production === one.version;
      const box = h("input", { type: "checkbox", value: reference, checked: pair.includes(reference),
        "aria-label": `Compare ${reference}`, change: (event) => pick(event.target) });
      return h("tr", {}, h("td", {}, manifests.length > 1 && box),
        h("th", { scope: "row" }, h("a", { href: linkTo("concepts", { model: reference }) }, reference),
          aliases.map(([alias]) => h("span", { class: "chip" }, alias))),
        h("td", {}, when(one.created), one.parent && h("span", { class: "fine" }, ` after ${one.parent}`)),
        h("td", { class: "number" }, one.counts.objects ?? "–"), h("td", { class: "number" },
          one.counts.concepts ?? "–"),
        names.map((name) => h("td", { class: "number" }, one.metrics?.[name]?.toFixed(3) ?? "–")),
        h("td", {}, !serves && !model.built_in && h("button", { type: "button",
          "aria-label": `Promote ${reference}`, click: (event) => promote(event.currentTarget, reference) }, "Promote")));
    });
    return h("div", { class: "wide" }, h("table", { class: "versions" }, h("thead", {}, h("tr", {}, heads.map((head) =>
      h("th", { scope: "col" }, head)))), h("tbody", {}, rows)));
  }

  /** Takes a version into the pair that is compared, or out of it; of three, the one taken first goes. */
  function pick(box) {
    const others = pairOf(place).filter((reference) => reference !== box.value);
    const pair = box.checked ? [...others, box.value].slice(-2) : others;
    place.set({ compare: pair.join(",") || null }, { push: true });
    changed();
  }

  /** What serves, and the way back. @param {number[]} held what production has meant and would mean again. */
  function served(model, held) {
    const [before, serving] = [held.at(-2), held.at(-1)];
    if (serving === undefined) return h("p", { class: "fine" }, "None of them serves: promote one.");
    if (before === undefined) return h("p", { class: "fine" }, `No version served before version ${serving}.`);
    return h("p", { class: "buttons" }, h("button", { type: "button", class: "danger",
      click: (event) => rollBack(event.currentTarget, model.name, serving, before) },
    `Roll back to version ${before}`));
  }

  async function promote(button, reference) {
    const sure = await confirmed(`Let ${reference} serve?`, "Requests that name the model without a version, and the "
      + "alias production, are answered by it within seconds, by every replica. It can be rolled back.", "Promote");
    if (sure) await act(button, `v1/models/${reference}/promote`);
  }

  async function rollBack(button, name, leaving, to) {
    const sure = await confirmed(`Let ${name}:${to} serve again?`, `It did before ${name}:${leaving} was promoted. `
      + "No version is lost: any can be promoted again.", "Roll back");
    if (sure) await act(button, `v1/models/${name}/rollback`, { leaving });
  }

  function act(button, path, query) {
    return doing(button, problem, async () => {
      await get(path, { method: "POST", query, signal });
      await refresh();
      tell(context, "served");
    });
  }

  /** Compares what the URL says. @param {boolean} byLink from elsewhere in the page: it is to be seen. */
  function compare(byLink) {
    const pair = pairOf(place);
    if (compared.dataset.pair === pair.join()) return;
    compared.dataset.pair = pair.join();
    compared.replaceChildren();
    if (pair.length !== 2) return;
    const { element, filled } = comparison(pair, signal);
    compared.append(element);
    if (byLink) filled.then(() => element.scrollIntoView({ block: "nearest" }));
  }

  function changed(byLink = false) {
    refresh();
    compare(byLink);
  }

  heard(context, "models", refresh);
  changed();
  return {
    element: h("section", { class: "panel", "aria-labelledby": "versions-title" },
      h("h2", { id: "versions-title" }, "Versions"), problem, list, compared),
    changed: () => changed(true),
  };
}

/** What an alias goes back to, the present last: a promotion adds to it, a rollback takes away. */
function heldBy(history) {
  const held = [];
  for (const { action, version } of history) {
    if (action !== "rollback") held.push(version);
    else if (held.length > 1) held.pop();
  }
  return held;
}

/** The versions that the URL asks to be compared, the earlier one first. */
function pairOf(place) {
  const pair = (place.get("compare") ?? "").split(",").filter(Boolean);
  const number = (reference) => Number(reference.split(":")[1]);
  return pair.sort((one, other) => number(one) - number(other));
}
