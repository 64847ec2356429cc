/**
 * Train: clouds are kept in datasets, jobs learn models from them, and versions are judged, promoted and taken back.
 *
 * Each panel is a module of train/. `shared` carries what one of them has changed: "datasets", "jobs", "models",
 * "schedules".
 */
import { h } from "../parts/elements.js";
import { failure, loading } from "../parts/states.js";
import { models } from "./train/changes.js";
import { datasetsPanel } from "./train/datasets.js";
import { jobsPanel } from "./train/jobs.js";
import { schedulesPanel } from "./train/schedules.js";
import { submissionPanel } from "./train/submission.js";
import { versionsPanel } from "./train/versions.js";

/** @param {HTMLElement} root @param {import("../place.js").Place} place */
export function show(root, place) {
  const leaving = new AbortController();
  let panels = [];
  begin();
  return {
    changed: () => panels.forEach((panel) => panel.changed?.()),
    leave: () => leaving.abort(),
  };

  /** Shows the panels; where a key is needed, that is said once. What a key does not allow, each says of itself. */
  async function begin() {
    root.replaceChildren(h("h1", { class: "unseen" }, "Train"), loading());
    try {
      await models(leaving.signal);
    } catch (error) {
      if (leaving.signal.aborted) return;
      if (error.status !== 403) {
        root.lastChild.replaceWith(failure(error, { again: begin }));
        return;
      }
    }
    if (!leaving.signal.aborted) panels = fill(root, { place, shared: new EventTarget(), signal: leaving.signal });
  }
}

/** @param {HTMLElement} root @param {import("./train/changes.js").Context} context */
function fill(root, context) {
  const makers = [datasetsPanel, submissionPanel, jobsPanel, versionsPanel, schedulesPanel];
  const panels = makers.map((make) => make(context));
  const [datasets, submission, jobs, versions, schedules] = panels.map((panel) => panel.element);
  root.lastChild.replaceWith(
    h("div", { class: "train" }, h("div", {}, datasets, submission), h("div", {}, jobs, versions, schedules)),
  );
  return panels;
}
