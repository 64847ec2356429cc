/** One job, followed live: its stages, the time left, its log, and what came of it. */
import { get, pathOf } from "../../api.js";
import { h } from "../../parts/elements.js";
import { follow } from "../../parts/events.js";
import { failure, loading } from "../../parts/states.js";
import { count, duration, when } from "../../parts/words.js";
import { linkTo } from "../../place.js";
import { doing } from "./changes.js";
import { badge, over, whatOf } from "./jobs.js";
import { reportOf } from "./report.js";
import { figures } from "./figures.js";

const LINES = 2000; // of the log that are kept

export class FollowedJob {
  /**
   * @param {import("./changes.js").Context} context
   * @param {string} id of the job.
   * @param {function(Object): void} ended is told once the job is over, if it was not when it was first seen.
   */
  constructor(context, id, ended) {
    Object.assign(this, { context, id, ended });
    this.head = h("div", {}, loading());
    this.actions = h("p", { class: "buttons" });
    this.problem = h("div");
    this.outcome = h("div");
    this.lost = h("p", { class: "fine hidden", role: "status" }, "The connection is lost; trying again …");
    this.log = h("pre", { class: "log", tabindex: "0", "aria-label": "Log of the job" });
    this.logs = h("details", { open: true }, h("summary", {}, "Log"), this.log);
    this.element = h("article", { class: "job", "aria-live": "off" }, this.head, this.actions, this.problem, this.lost, this.outcome,
      this.logs);
    this.ticking = setInterval(() => this.tick(), 1000);
    this.begin();
  }

  leave() {
    this.following.abort();
    clearInterval(this.ticking);
  }

  async begin() {
    this.following = new AbortController();
    const signal = AbortSignal.any([this.following.signal, this.context.signal]);
    this.log.replaceChildren();
    try {
      await follow(pathOf`v1/jobs/${this.id}/events`, {
        signal,
        on: (event) => this.told(event),
        connected: (is) => this.lost.classList.toggle("hidden", is || this.isOver()),
      });
    } catch (error) {
      if (!signal.aborted) this.head.replaceChildren(failure(error, { again: () => this.begin() }));
    }
  }

  isOver() {
    return this.job !== undefined && over(this.job);
  }

  told({ kind, data }) {
    if (kind === "log") this.addLine(JSON.parse(data));
    if (kind === "job") this.show(JSON.parse(data));
    return kind !== "end";
  }

  addLine({ at, line }) {
    const atEnd = this.log.scrollTop + this.log.clientHeight >= this.log.scrollHeight - 8;
    this.log.append(h("span", { class: "at" }, new Date(at).toLocaleTimeString()), ` ${line}\n`);
    while (this.log.childNodes.length > 2 * LINES) this.log.firstChild.remove();
    if (atEnd) this.log.scrollTop = this.log.scrollHeight;
  }

  show(job) {
    const before = this.job;
    const wasUnderWay = before !== undefined && !over(before);
    this.job = job;
    this.left = job.progress?.left_s ?? null;
    this.toldAt = Date.now();
    this.head.replaceChildren(
      h("div", { class: "title-row" }, h("h3", {}, whatOf(job.spec)), badge(job.state)),
      h("p", { class: "fine" }, "Submitted ", when(job.submitted), job.started && [", begun ", when(job.started)],
        job.finished && [", over ", when(job.finished)], job.worker && ` · worker ${job.worker}`,
        " · ", h("code", {}, job.id)),
      ...[this.progress(job)].filter(Boolean),
    );
    // The buttons stay while it goes on, so that they can be hit between two reports.
    if (before?.state !== job.state) this.actions.replaceChildren(...[this.button(job)].filter(Boolean));
    this.outcome.replaceChildren(...[this.outcomeOf(job)].flat().filter(Boolean));
    if (over(job)) this.logs.open = job.state !== "done";
    if (wasUnderWay && over(job)) this.ended(job);
  }

  progress(job) {
    this.time = h("span", { class: "number" });
    if (job.state === "queued") return h("p", {}, "Waits for a worker.");
    if (job.state !== "running") return null;
    const told = job.progress;
    if (!told) return h("p", {}, "A worker begins …");
    const inStage = told.total ? told.done / told.total : 0;
    const all = (told.stages_done + inStage) / told.stages;
    const bar = h("div", { class: "stages", role: "progressbar", "aria-valuemin": 0, "aria-valuemax": 100,
      "aria-valuenow": Math.round(100 * all), "aria-label": "How far the job is" });
    for (let stage = 0; stage < told.stages; stage += 1) {
      const fill = h("span");
      fill.style.width = `${100 * Math.min(1, Math.max(0, told.stages_done + inStage - stage))}%`;
      bar.append(h("span", { class: "stage" }, fill));
    }
    this.tick();
    const pieces = told.total ? ` (${told.done} of ${told.total})` : "";
    return h("div", {}, bar, h("p", { class: "title-row" },
      h("span", {}, h("strong", {}, told.stage), pieces, h("span", { class: "fine" },
        ` · stage ${Math.min(told.stages_done + 1, told.stages)} of ${told.stages}`)), this.time));
  }

  /** Counts the time left down between two reports. */
  tick() {
    if (!this.time || this.left === null || this.left === undefined) return;
    this.time.textContent = `about ${duration(this.left - (Date.now() - this.toldAt) / 1000)} left`;
  }

  button(job) {
    const act = (what) => (event) => doing(event.currentTarget, this.problem, async () => {
      await get(pathOf`v1/jobs/${this.id}/${what}`, { method: "POST", signal: this.context.signal });
      if (what === "retry") {
        this.following.abort();
        this.begin();
      }
    });
    if (!over(job)) return h("button", { type: "button", class: "danger", click: act("cancel") }, "Cancel");
    if (job.state === "done") return null;
    return h("button", { type: "button", click: act("retry") }, "Retry, from the stage at which it ended");
  }

  outcomeOf(job) {
    if (job.error) {
      return h("div", { class: "state state-error", role: "alert" }, h("p", { class: "title" }, "The job failed"),
        h("p", {}, job.error.detail));
    }
    const made = job.result;
    if (made?.kind === "simulate") return h("p", {}, `${count(made.clouds, "cloud was", "clouds were")} added to ${made.dataset}.`);
    if (made?.kind === "evaluate") {
      return [h("p", {}, `Judged by ${made.clouds} clouds; the model refused ${made.unanswered} others.`),
        figures(made.metrics), reportOf(this.id, this.context.signal)];
    }
    return made ? this.trained(made) : null;
  }

  trained(made) {
    const version = `${made.model}:${made.version}`;
    const promoted = made.promoted ? "and serves now" : "and was not promoted";
    const { parameters } = this.context.place;
    const compare = made.parent && linkTo("train", { ...Object.fromEntries(parameters), model: made.model,
      compare: `${made.parent},${version}` });
    return h("div", { class: "made" },
      h("p", {}, h("strong", {}, version), ` was learnt from ${count(made.clouds - made.left_out, "cloud")} ${promoted}.`,
        made.left_out > 0 && ` ${count(made.left_out, "cloud")} could not be learnt from: the log says which.`,
        made.names_carried > 0 && ` ${count(made.names_carried, "name was", "names were")} carried over.`),
      made.reasons.length > 0 && h("ul", {}, made.reasons.map((reason) => h("li", {}, reason))),
      made.metrics && figures(made.metrics),
      h("p", { class: "buttons" }, h("a", { class: "button", href: linkTo("concepts", { model: version }) },
        "See its concepts"), h("a", { class: "button", href: linkTo("try", { model: version }) }, "Try it"),
      compare && h("a", { class: "button", href: compare }, `Compare with ${made.parent}`)));
  }
}
