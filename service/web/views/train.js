/**
 * Train: clouds are kept in datasets, jobs learn models from them, and versions are judged, promoted and taken back.
 *
 * Four panels, a module of train/ each. `shared` carries what one of them has changed: "datasets", "jobs", "models".
 */
import { h } from "../parts/elements.js";
import { datasetsPanel } from "./train/datasets.js";
import { jobsPanel } from "./train/jobs.js";
import { submissionPanel } from "./train/submission.js";
import { versionsPanel } from "./train/versions.js";

/** @param {HTMLElement} root @param {import("../place.js").Place} place */
export function show(root, place) {
  const leaving = new AbortController();
  const context = { place, shared: new EventTarget(), signal: leaving.signal };
  const panels = [datasetsPanel, submissionPanel, jobsPanel, versionsPanel].map((make) => make(context));
  const [datasets, submission, jobs, versions] = panels.map((panel) => panel.element);
  root.append(
    h("h1", { class: "unseen" }, "Train"),
    h("div", { class: "train" }, h("div", {}, datasets, submission), h("div", {}, jobs, versions)),
  );
  return {
    changed: () => panels.forEach((panel) => panel.changed?.()),
    leave: () => leaving.abort(),
  };
}
