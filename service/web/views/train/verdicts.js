/** What becomes of each file that is sent: how far that is, and why some are refused. */
import { h } from "../../parts/elements.js";
import { bytes, count } from "../../parts/words.js";

const LISTED = 300; // verdicts
const WORDS = {
  accepted: "taken",
  replaced: "replaced",
  "already-there": "already there",
  refused: "refused",
  "left-out": "left out",
};
const WORST_FIRST = ["refused", "left-out", "replaced", "already-there", "accepted"];

export class Verdicts {
  constructor() {
    this.bar = h("progress", { max: "1", value: "0", "aria-label": "Sent" });
    this.said = h("p", { class: "fine", role: "status" });
    this.stop = h("button", { type: "button" }, "Stop");
    this.list = h("div", { class: "wide verdicts" });
    this.underWay = h("div", { class: "under-way hidden" }, this.bar, this.stop);
    this.element = h("div", {}, this.underWay, this.said, this.list);
  }

  /**
   * Follows files that are sent, to the end or until the user stops it.
   *
   * @param {import("./dropped.js").Dropped[]} files
   * @param {AbortSignal} signal of the view.
   * @param {function(Object): AsyncGenerator<Array>} sending as `send`, given `signal` and `sent`.
   */
  async follow(files, signal, sending) {
    const stopping = new AbortController();
    const all = files.reduce((total, { file }) => total + file.size, 0);
    const told = [];
    let gone = 0;
    const draw = (end = "") => {
      this.bar.value = all ? gone / all : 1;
      this.said.textContent = `${told.length ? `${summary(told)}. ` : ""}${end || `${bytes(gone)} of ${bytes(all)} of `
        + `${count(files.length, "file")} sent …`}`;
    };
    this.stop.onclick = () => stopping.abort();
    this.underWay.classList.remove("hidden");
    this.list.replaceChildren();
    draw();
    let end = "All is there.";
    try {
      const both = AbortSignal.any([signal, stopping.signal]);
      for await (const some of sending({ signal: both, sent: (more) => { gone += more; draw(); } })) {
        told.push(...some);
        this.tell(told);
        draw();
      }
    } catch (error) {
      end = "Stopped; what was taken stays. Drop the same files again to go on: nothing is taken twice.";
      if (!stopping.signal.aborted) throw error;
    } finally {
      this.underWay.classList.add("hidden");
      draw(end);
    }
  }

  tell(told) {
    const order = (verdict) => WORST_FIRST.indexOf(verdict.outcome);
    const sorted = [...told].sort((one, other) => order(one) - order(other));
    const rows = sorted.slice(0, LISTED).map(({ key, outcome, error }) => h("tr", { class: `verdict-${outcome}` },
      h("td", {}, key), h("td", {}, WORDS[outcome] ?? outcome), h("td", {}, error?.detail ?? "")));
    if (sorted.length > LISTED) {
      rows.push(h("tr", {}, h("td", { colspan: "3" }, `… and ${sorted.length - LISTED} more`)));
    }
    const heads = ["File", "Verdict", "Why"].map((head) => h("th", { scope: "col" }, head));
    this.list.replaceChildren(h("table", {}, h("thead", {}, h("tr", {}, heads)), h("tbody", {}, rows)));
  }
}

/** As "12 taken, 1 refused". */
function summary(told) {
  const found = WORST_FIRST.map((outcome) => [outcome, told.filter((verdict) => verdict.outcome === outcome).length]);
  return found.filter(([, number]) => number).reverse().map(([outcome, number]) => `${number} ${WORDS[outcome]}`)
    .join(", ");
}
