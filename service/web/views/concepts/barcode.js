/** The barcode of H_0: when each component is taken in by a larger one. */
import { pageColour } from "../../parts/colours.js";
import { counted, h } from "../../parts/elements.js";
import { timeChart } from "./time_axis.js";

const TALLEST = 6; // pixels of a bar

export class Barcode {
  /** @param {import("./selection.js").Selection} selection */
  constructor(selection) {
    this.selection = selection;
    this.chart = timeChart(
      selection,
      "Barcode: a bar for each training object, until its component is annexed; the slider sets the time as well",
      (context, x, width, height) => this.#paint(context, x, height),
      (_, at) => this.#pick(at),
    );
    this.note = h("p", { class: "fine" });
    this.element = h(
      "section",
      { class: "panel", "aria-label": "Barcode" },
      h("h2", {}, "Barcode"),
      this.chart.element,
      this.note,
    );
  }

  update() {
    this.chart.redraw();
  }

  close() {
    this.chart.close();
  }

  /** Where there are more bars than rows of pixels, each row is the longest bar of several. */
  #rows(height) {
    const { bars } = this.selection.model.tree;
    const rows = Math.min(bars.length, Math.floor(height));
    return { rows, each: height / rows, bar: (row) => bars[Math.floor((row * bars.length) / rows)] };
  }

  #paint(context, x, height) {
    const { model, assignment, shown } = this.selection;
    const { rows, each, bar } = this.#rows(height);
    const thick = Math.max(1, Math.min(TALLEST, each - (each > 2 ? 1 : 0)));
    for (let row = 0; row < rows; row += 1) {
      const leaf = bar(row);
      const concept = assignment[leaf];
      context.fillStyle = model.tree.colour(concept);
      context.globalAlpha = shown === null || concept === shown ? (concept < 0 ? 0.45 : 1) : 0.22;
      const end = Math.min(1, model.tree.death[leaf]);
      context.fillRect(x(0), row * each, Math.max(1, x(end) - x(0)), thick);
      if (model.tree.death[leaf] === Infinity) this.#drawArrow(context, x(1), row * each + thick / 2);
    }
    context.globalAlpha = 1;
    const several = Math.ceil(model.tree.leaves / rows);
    const thinned = several > 1 ? `; each row of pixels shows the longest of ${several}` : "";
    this.note.textContent =
      `${counted(model.tree.leaves)} bars, the longest first${thinned}. ` +
      "Drag to change the time; click a bar to choose its concept.";
  }

  #drawArrow(context, at, middle) {
    context.fillStyle = pageColour("ink");
    context.beginPath();
    context.moveTo(at, middle - 4);
    context.lineTo(at + 7, middle);
    context.lineTo(at, middle + 4);
    context.fill();
  }

  #pick(at) {
    const { rows, each, bar } = this.#rows(this.chart.element.clientHeight - 20);
    const row = Math.floor(at / each);
    if (row >= 0 && row < rows) this.selection.pick(this.selection.assignment[bar(row)]);
  }
}
