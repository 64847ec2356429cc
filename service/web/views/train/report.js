/** The report of an evaluation: what tells labels apart, label by label. */
import { get, hasKey, pathOf, pictureUrl } from "../../api.js";
import { h } from "../../parts/elements.js";
import { loadInto } from "../../parts/load.js";

/** @param {string} job id of the job that has evaluated. @param {AbortSignal} signal */
export function reportOf(job, signal) {
  const place = h("div");
  loadInto(place, signal, () => get(pathOf`v1/jobs/${job}/report.json`, { signal }), (report) => [
    byLabel(report),
    Object.keys(report.data.unanswered).length > 0 && h("details", {}, h("summary", {}, "Clouds that it refused"),
      h("ul", { class: "fine" }, Object.entries(report.data.unanswered).slice(0, 100).map(([file, why]) =>
        h("li", {}, h("code", {}, file), ` ${why}`)))),
    h("p", { class: "buttons" }, wholeReport(job, signal)),
  ]);
  return place;
}

function byLabel(report) {
  const heads = ["Label", "Clouds", "knn", "svm", "within", "assigned"];
  const rows = Object.entries(report.by_label).map(([label, told]) => h("tr", {}, h("th", { scope: "row" }, label),
    h("td", { class: "number" }, report.data.categories[label] ?? ""),
    ["knn", "svm", "within", "assigned"].map((name) => h("td", { class: "number" }, told[name].toFixed(2)))));
  return h("div", { class: "wide" }, h("table", {}, h("thead", {}, h("tr", {}, heads.map((head) =>
    h("th", { scope: "col" }, head)))), h("tbody", {}, rows)));
}

/** The page of figures: opened, or, where a key is needed, which a link cannot send, saved as a file. */
function wholeReport(job, signal) {
  const path = pathOf`v1/jobs/${job}/report.html`;
  if (!hasKey()) return h("a", { class: "button", href: path, target: "_blank", rel: "noopener" }, "The whole report");
  const save = async () => {
    const url = await pictureUrl(path, { signal });
    h("a", { href: url, download: `report-${job}.html` }).click();
    setTimeout(() => URL.revokeObjectURL(url), 10_000);
  };
  return h("button", { type: "button", click: save }, "Save the whole report");
}
