/** The panel of jobs: the queue, and one of them followed live. */
import { get } from "../../api.js";
import { h } from "../../parts/elements.js";
import { loadInto } from "../../parts/load.js";
import { linkTo } from "../../place.js";
import { empty } from "../../parts/states.js";
import { when } from "../../parts/words.js";
import { heard, tell } from "./changes.js";
import { FollowedJob } from "./job.js";

const PAGE = 8;
const LOOK_AGAIN = 4000; // milliseconds, while jobs wait or are at work
const STATES = ["queued", "running", "done", "failed", "cancelled"];

/** @param {import("./changes.js").Context} context */
export function jobsPanel(context) {
  const { place, signal } = context;
  const list = h("div", { class: "job-list" });
  const state = h("select", { "aria-label": "Jobs of which state", change: () => refresh() },
    h("option", { value: "" }, "all"), STATES.map((one) => h("option", { value: one }, one)));
  const shown = h("div", { class: "job-shown" });
  const earlier = []; // ids before which the pages began, for the way back
  let followed = null;
  let timer = null;

  function refresh() {
    clearTimeout(timer);
    const query = { limit: PAGE, state: state.value || null, before: earlier.at(-1) ?? null };
    return loadInto(list, signal, () => get("v1/jobs", { query, signal }), (page) => {
      const underWay = page.jobs.some((job) => !over(job));
      if (underWay) timer = setTimeout(() => refresh(), LOOK_AGAIN);
      return rows(page);
    });
  }

  function rows(page) {
    if (!page.jobs.length) {
      return empty(state.value ? `There is no job that is ${state.value}.`
        : "There is no job yet. Submit one above or beside this; a worker (shape-concepts-worker run) takes it.");
    }
    const turn = (change, label) => h("button", { type: "button", click: () => { change(); refresh(); } }, label);
    return [
      h("ul", {}, page.jobs.map(row)),
      h("p", { class: "buttons" }, earlier.length > 0 && turn(() => earlier.pop(), "Later ones"),
        page.next && turn(() => earlier.push(page.next), "Earlier ones")),
    ];
  }

  function row(job) {
    const chosen = job.id === place.get("job");
    return h("li", {}, h("a", { href: linkTo("train", { ...Object.fromEntries(place.parameters), job: job.id }),
      "aria-current": chosen && "true" }, badge(job.state), h("span", { class: "what" }, whatOf(job.spec)),
    h("span", { class: "fine" }, when(job.submitted))));
  }

  /** Follows the job that the URL names. @param {boolean} byUser who has just asked for it, and wants to see it. */
  function follow(byUser = false) {
    const id = place.get("job");
    if (followed?.id === id) return;
    followed?.leave();
    followed = id ? new FollowedJob(context, id, ended) : null;
    shown.replaceChildren(...(followed ? [followed.element] : []));
    if (byUser) shown.scrollIntoView({ block: "nearest" });
  }

  function ended(job) {
    refresh();
    if (job.state === "done") tell(context, job.spec.kind === "simulate" ? "datasets" : "models");
  }

  signal.addEventListener("abort", () => { clearTimeout(timer); followed?.leave(); });
  heard(context, "jobs", () => { earlier.length = 0; refresh(); follow(true); });
  refresh();
  follow();
  return {
    element: h("section", { class: "panel", "aria-labelledby": "jobs-title" },
      h("div", { class: "title-row" }, h("h2", { id: "jobs-title" }, "Jobs"), state), shown, list),
    changed: () => { follow(true); refresh(); },
  };
}

/** Whether nothing more is done about a job. */
export function over(job) {
  return !["queued", "running"].includes(job.state);
}

/** A job's state as a coloured word. */
export function badge(state) {
  return h("span", { class: `badge badge-${state}` }, state);
}

/** What a job is to do, in words. */
export function whatOf(spec) {
  if (spec.kind === "simulate") return `simulate ${spec.count} objects into ${spec.dataset}`;
  if (spec.kind === "evaluate") return `judge ${spec.model} by ${spec.dataset}`;
  const sources = [...spec.datasets, spec.simulate && `${spec.simulate} simulated objects`, spec.clouds && "a folder",
    spec.extend && `what ${spec.extend} learnt from`].filter(Boolean);
  return `learn ${spec.name} from ${sources.join(" and ")}`;
}
