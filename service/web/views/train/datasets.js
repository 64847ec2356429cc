/** The panel of datasets: which there are, what they hold, and files dropped into one of them. */
import { get, pathOf, Problem } from "../../api.js";
import { h } from "../../parts/elements.js";
import { loadInto } from "../../parts/load.js";
import { empty, failure } from "../../parts/states.js";
import { bytes, count } from "../../parts/words.js";
import { datasetNames, doing, field, heard, tell, tick } from "./changes.js";
import { filesIn, filesOf } from "./dropped.js";
import { send } from "./sending.js";
import { Verdicts } from "./verdicts.js";

const PAGE = 50; // clouds that are listed at a time
const UNITS = ["m", "cm", "mm", "in"];

/** @param {import("./changes.js").Context} context */
export function datasetsPanel(context) {
  const { place, signal } = context;
  const name = h("input", { pattern: "[a-z0-9][a-z0-9\\-]*", maxlength: "63", placeholder: "scans", spellcheck: "false",
    autocomplete: "off" });
  const chosen = h("select");
  const naming = h("div", { class: "hidden" }, field("Name of the new dataset", name,
    "lower-case letters, digits and hyphens; it is made when you drop files"));
  const holds = h("div", { class: "holds" });
  const drop = dropZone(context, () => chosen.value || name.value.trim(), made);
  const state = h("div");

  async function list() {
    const names = await datasetNames(signal);
    const kept = chosen.options.length > 1 || name.value ? chosen.value : null; // a new one is chosen by nobody at first
    const wanted = place.get("dataset") ?? kept ?? names[0] ?? "";
    chosen.replaceChildren(...names.map((one) => h("option", { value: one }, one)),
      h("option", { value: "" }, "A new dataset …"));
    chosen.value = names.includes(wanted) ? wanted : "";
    choose();
  }

  function choose() {
    naming.classList.toggle("hidden", chosen.value !== "");
    place.set({ dataset: chosen.value || null });
    if (chosen.value) loadInto(holds, signal, () => get(`v1/datasets/${chosen.value}`, { signal }), contents);
    else holds.replaceChildren(empty("A dataset holds the clouds that a model learns from: files that a depth camera "
      + "took of one object each. Labels are not needed; with some, models can be judged."));
  }

  /** After files were added: this panel hears of it as well. */
  function made(dataset) {
    place.set({ dataset });
    tell(context, "datasets");
  }

  async function refresh() {
    try {
      await list();
      state.replaceChildren();
    } catch (error) {
      if (!signal.aborted) state.replaceChildren(failure(error, { again: refresh }));
    }
  }

  function contents(dataset) {
    if (!dataset.clouds) return empty("It holds no cloud yet.");
    const clouds = h("details", {}, h("summary", {}, "Its clouds"), h("div"));
    clouds.addEventListener("toggle", () => {
      if (clouds.open && !clouds.lastChild.hasChildNodes()) listClouds(clouds.lastChild, dataset.name, signal);
    });
    return [
      dataset.description && h("p", {}, dataset.description),
      h("p", {}, `${count(dataset.clouds, "cloud")}, ${bytes(dataset.bytes)}. `, told(dataset.categories,
        "No labels yet: drop a labels.csv with the columns file and category to judge models by them.")),
      clouds,
    ];
  }

  chosen.addEventListener("change", choose);
  heard(context, "datasets", () => refresh()); // a job that simulates fills one, too
  refresh();
  const element = h(
    "section",
    { class: "panel", "aria-labelledby": "datasets-title" },
    h("h2", { id: "datasets-title" }, "Clouds"),
    state,
    field("Dataset", chosen),
    naming,
    drop.element,
    holds,
  );
  return {
    element,
    changed: () => {
      if ((place.get("dataset") ?? chosen.value) !== chosen.value) refresh();
    },
  };
}

/** The labels of a dataset, most frequent first. */
function told(categories, none) {
  const found = Object.entries(categories).sort((one, other) => other[1] - one[1]);
  if (!found.length) return h("span", { class: "fine" }, none);
  return found.slice(0, 24).map(([category, clouds]) =>
    h("span", { class: "chip" }, category, h("span", { class: "number" }, ` ${clouds}`)));
}

async function listClouds(element, name, signal, after = "") {
  const page = await get(`v1/datasets/${name}/clouds`, { query: { after, limit: PAGE }, signal }).catch((error) => {
    element.replaceChildren(failure(error, { again: () => listClouds(element, name, signal) }));
  });
  if (!page) return;
  const rows = page.clouds.map((cloud) => h("tr", {}, h("td", {}, cloud.key),
    h("td", { class: "number" }, cloud.points.toLocaleString("en")), h("td", {}, cloud.label?.category ?? "–")));
  if (after) element.querySelector("tbody").append(...rows);
  else {
    const heads = ["Cloud", "Points", "Label"].map((head) => h("th", { scope: "col" }, head));
    element.replaceChildren(h("div", { class: "wide" },
      h("table", {}, h("thead", {}, h("tr", {}, heads)), h("tbody", {}, rows))));
  }
  element.querySelector(".more")?.remove();
  if (page.after) {
    element.append(h("button", { type: "button", class: "more", click: () =>
      listClouds(element, name, signal, page.after) }, "More"));
  }
}

/** An error that the user can mend. */
function refusal(title, detail) {
  return new Problem({ status: 422, title, detail });
}

/** Where files are dropped, or picked, and what becomes of each. */
function dropZone(context, target, made) {
  const files = h("input", { type: "file", multiple: true, class: "unseen", tabindex: "-1", "aria-hidden": "true" });
  const folder = h("input", { type: "file", webkitdirectory: true, class: "unseen", tabindex: "-1",
    "aria-hidden": "true" });
  const unit = h("select", {}, h("option", { value: "" }, "as the files say, or metres"),
    UNITS.map((one) => h("option", { value: one }, one)));
  const replace = h("input", { type: "checkbox" });
  const problem = h("div");
  const pick = h("button", { type: "button", class: "main", click: () => files.click() }, "Choose files");
  const pickFolder = h("button", { type: "button", click: () => folder.click() }, "Choose a folder");
  const verdicts = new Verdicts();
  const element = h(
    "div",
    { class: "drop", role: "group", "aria-label": "Add files" },
    h("p", {}, h("strong", {}, "Drop clouds here"), ", whole folders, zip or tar.gz, and labels.csv"),
    h("p", { class: "buttons" }, pick, pickFolder),
    files,
    folder,
    h("details", {}, h("summary", {}, "How they are read"), field("Unit of the coordinates", unit),
      tick("Put clouds in the place of others of the same name", replace)),
    problem,
    verdicts.element,
  );

  async function take(found) {
    const dataset = target();
    if (!found.length) return;
    if (pick.disabled) {
      problem.replaceChildren(failure(refusal("Files are being sent", "Drop these again when that is done.")));
      return;
    }
    await doing(pick, problem, async () => {
      if (!dataset) throw refusal("The dataset has no name", "Type a name for the new dataset, then drop the files again.");
      const how = { unit: unit.value || null, replace: replace.checked };
      await get(pathOf`v1/datasets/${dataset}`, { method: "PUT", signal: context.signal });
      try {
        await verdicts.follow(found, context.signal, (more) => send(dataset, found, { ...how, ...more }));
      } finally {
        made(dataset);
      }
    });
  }

  const over = (event) => { event.preventDefault(); element.classList.add("over"); };
  element.addEventListener("dragenter", over);
  element.addEventListener("dragover", over);
  element.addEventListener("dragleave", () => element.classList.remove("over"));
  element.addEventListener("drop", async (event) => {
    event.preventDefault();
    element.classList.remove("over");
    take(await filesOf(event.dataTransfer));
  });
  for (const input of [files, folder]) {
    input.addEventListener("change", () => { take(filesIn(input)); input.value = ""; });
  }
  return { element };
}
