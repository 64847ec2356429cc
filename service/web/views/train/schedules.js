/** Jobs that are submitted again and again: a schedule is made of the job that the form describes, a panel lists all. */
import { get } from "../../api.js";
import { h } from "../../parts/elements.js";
import { loadInto } from "../../parts/load.js";
import { when } from "../../parts/words.js";
import { linkTo } from "../../place.js";
import { confirmed, doing, field, heard, tell } from "./changes.js";
import { whatOf } from "./jobs.js";

const TIMES = { "0 3 * * *": "every day at 3:00", "0 3 * * mon": "on Mondays at 3:00", "0 * * * *": "every hour" };

/**
 * What makes a schedule of a job.
 *
 * @param {import("./changes.js").Context} context
 * @param {function(): ?Object} described the job; null where its form is not filled in.
 */
export function scheduling(context, described) {
  const name = h("input", { pattern: "[a-z0-9][a-z0-9\\-]*", maxlength: "40", value: "nightly", spellcheck: "false" });
  const cron = h("input", { value: "0 3 * * *", list: "times-known", spellcheck: "false" });
  const zone = h("input", { value: Intl.DateTimeFormat().resolvedOptions().timeZone ?? "UTC", spellcheck: "false" });
  const state = h("div");
  const make = h("button", { type: "button", click: () => doing(make, state, async () => {
    const job = described();
    if (!job) return;
    const json = { name: name.value, cron: cron.value, zone: zone.value, job };
    const made = await get("v1/schedules", { json, signal: context.signal });
    state.replaceChildren(h("p", { class: "better", role: "status" }, `${made.name} is due next `, when(made.next_due),
      "."));
    tell(context, "schedules");
  }) }, "Make the schedule");
  return h("details", {}, h("summary", {}, "Again and again, on a schedule"),
    h("datalist", { id: "times-known" }, Object.entries(TIMES).map(([value, words]) => h("option", { value }, words))),
    field("Name of the schedule", name),
    h("div", { class: "two" }, field("Times", cron, "minute, hour, day of month, month, day of week"),
      field("Time zone", zone)),
    state, h("p", { class: "buttons" }, make));
}

/** The panel of schedules; it is not there while there are none. @param {import("./changes.js").Context} context */
export function schedulesPanel(context) {
  const { signal } = context;
  const problem = h("div");
  const list = h("div");
  const element = h("section", { class: "panel hidden", "aria-labelledby": "schedules-title" },
    h("h2", { id: "schedules-title" }, "Schedules"), problem, list);

  const refresh = () => loadInto(list, signal, async () => (await get("v1/schedules", { signal })).schedules, fill);

  function fill(schedules) {
    element.classList.toggle("hidden", !schedules.length);
    return h("ul", { class: "schedules" }, schedules.map(row));
  }

  function row(schedule) {
    const { name, state } = schedule;
    const act = (method, path) => (event) => doing(event.currentTarget, problem, async () => {
      const asked = () => confirmed(`Remove ${name}?`, "Jobs that it has submitted stay.", "Remove");
      if (method === "DELETE" && !(await asked())) return;
      await get(`v1/schedules/${name}${path}`, { method, signal });
      await refresh();
    });
    const paused = state !== "active";
    return h("li", {},
      h("p", {}, h("strong", {}, name), ` ${whatOf(schedule.job)}`),
      h("p", { class: "fine" }, h("code", {}, schedule.cron), ` ${schedule.zone} · `,
        paused ? "paused" : ["next due ", when(schedule.next_due)],
        schedule.last_job && [" · last ", h("a", { href: linkTo("train", { job: schedule.last_job }) }, "its job")]),
      schedule.fault && h("p", { class: "worse" }, schedule.fault),
      h("p", { class: "buttons" },
        h("button", { type: "button", click: act("POST", paused ? "/resume" : "/pause") }, paused ? "Resume" : "Pause"),
        h("button", { type: "button", class: "danger", click: act("DELETE", "") }, "Remove")));
  }

  heard(context, "schedules", refresh);
  refresh();
  return { element };
}
