/** The list of those who publish: a line for each key, with rate, latency and the best concept. */
import { h } from "../../parts/elements.js";
import { duration } from "../../parts/words.js";

const MOST = 40; // keys, those heard of last
const REMEMBERED = 30; // clouds of a key, for its rate
const WINDOW = 10; // seconds over which a rate is taken
const SILENT = 5; // seconds after which a line says how long nothing came

export class Robots {
  /** @param {function(string): void} choose is told the key that the user picks. */
  constructor(choose) {
    this.choosing = choose;
    this.lines = new Map();
    this.list = h("ul");
    this.element = h("nav", { class: "panel robots", "aria-label": "Keys that clouds came on" }, this.list);
  }

  /** Takes a cloud in. @param {Object} told an event of /v1/streams/events. */
  add(told) {
    const line = this.lines.get(told.key) ?? this.#line(told.key);
    line.last = told;
    line.heard = Date.now() / 1000;
    line.times.push({ at: told.at, clouds: 1 + told.skipped });
    line.times = line.times.slice(-REMEMBERED);
    line.dropped += (told.answer ?? told.problem).dropped ?? 0;
    line.said.textContent = bestOf(told);
    line.said.classList.toggle("worse", told.problem !== null);
    this.#measure(line);
  }

  /** The last cloud of a key. */
  last(key) {
    return this.lines.get(key)?.last ?? null;
  }

  choose(key) {
    this.chosen = key;
    for (const [name, line] of this.lines) line.button.setAttribute("aria-current", String(name === key));
  }

  clear() {
    this.lines.clear();
    this.list.replaceChildren();
  }

  /** Says of each that is silent for how long it has been. */
  tick() {
    for (const line of this.lines.values()) this.#measure(line);
  }

  #line(key) {
    const [said, rate, latency] = [h("span", { class: "said" }), h("span", { class: "number fine" }),
      h("span", { class: "number fine" })];
    const button = h("button", { type: "button", "aria-current": String(key === this.chosen),
      click: () => this.choosing(key) }, h("span", { class: "key" }, key), said,
    h("span", { class: "row" }, rate, latency));
    const line = { item: h("li", {}, button), button, said, rate, latency, times: [], dropped: 0 };
    this.lines.set(key, line);
    if (this.lines.size > MOST) {
      const silent = [...this.lines].sort(([, one], [, other]) => (one.heard ?? Infinity) - (other.heard ?? Infinity));
      silent[0][1].item.remove();
      this.lines.delete(silent[0][0]);
    }
    const after = [...this.lines.keys()].sort().indexOf(key);
    this.list.insertBefore(line.item, this.list.children[after] ?? null);
    return line;
  }

  #measure(line) {
    const silent = Date.now() / 1000 - line.heard;
    line.button.classList.toggle("silent", silent > SILENT);
    if (silent > SILENT) {
      line.rate.textContent = `silent for ${duration(silent)}`;
      line.latency.textContent = "";
      return;
    }
    const rate = rateOf(line.times);
    line.rate.textContent = rate === null ? "" : `${rate.toFixed(rate < 10 ? 1 : 0)} a second`;
    const latency = line.last.latency_s;
    line.latency.textContent = [latency === null ? null : `${Math.round(1000 * latency)} ms`,
      line.dropped > 0 ? `${line.dropped} dropped` : null].filter(Boolean).join(" · ");
  }
}

/** Clouds a second of late; null while there is but one. */
function rateOf(times) {
  const late = times.filter(({ at }) => at > times.at(-1).at - WINDOW);
  const took = late.at(-1).at - late[0].at;
  return took > 0 ? late.slice(1).reduce((total, { clouds }) => total + clouds, 0) / took : null;
}

function bestOf({ answer, problem }) {
  if (problem) return problem.title;
  if (answer.objects) return `${answer.objects.length} objects`;
  const best = answer.concepts[0];
  return best ? best.name ?? `Concept ${best.id}` : "no concept";
}
