/** The merge tree: which components became one, and when. */
import { pageColour } from "../../parts/colours.js";
import { counted, h } from "../../parts/elements.js";
import { BOTTOM, timeChart } from "./time_axis.js";

const LEAST = 1.2; // pixels that a branch needs to be drawn in full

export class Tree {
  /** @param {import("./selection.js").Selection} selection */
  constructor(selection) {
    this.selection = selection;
    this.chart = timeChart(
      selection,
      "Merge tree: training objects at the left join into concepts towards the right, as the list of concepts says",
      (context, x, width, height) => this.#paint(context, x, height),
      (time, at) => this.#pick(at),
    );
    this.note = h("p", { class: "fine" });
    this.element = h(
      "section",
      { class: "panel", "aria-label": "Merge tree" },
      h("h2", {}, "Merge tree"),
      this.chart.element,
      this.note,
    );
    this.chart.element.classList.add("tree");
  }

  update() {
    this.chart.redraw();
  }

  close() {
    this.chart.close();
  }

  #paint(context, x, height) {
    const { tree } = this.selection.model;
    const least = Math.ceil((LEAST * tree.leaves) / height);
    const y = (node) => ((tree.first[node] + tree.size[node] / 2) / tree.leaves) * height;
    const paths = new Map(); // lines of one colour and strength are drawn at once
    const walk = [2 * tree.leaves - 2];
    while (walk.length) {
      const node = walk.pop();
      const path = this.#path(paths, node);
      const here = x(tree.time[node]);
      if (node < tree.leaves || tree.size[node] < least) {
        path.moveTo(x(0), y(node));
        path.lineTo(here, y(node));
        continue;
      }
      const children = [tree.children[2 * node], tree.children[2 * node + 1]];
      for (const child of children) {
        const own = this.#path(paths, child);
        own.moveTo(x(tree.time[child]), y(child));
        own.lineTo(here, y(child));
        walk.push(child);
      }
      path.moveTo(here, y(children[0]));
      path.lineTo(here, y(children[1]));
    }
    for (const [style, path] of paths) this.#stroke(context, style, path);
    const thinned = least > 2 ? `; branches of fewer than ${least} are drawn as one line` : "";
    this.note.textContent = `${counted(tree.leaves)} objects${thinned}. Click a branch to choose its concept.`;
  }

  /** The lines of a node's colour at this time: that of the concept that it is part of. */
  #path(paths, node) {
    const { assignment, shown, model, time } = this.selection;
    const inside = node < model.tree.leaves || model.tree.time[node] <= time;
    const concept = inside ? assignment[model.tree.arranged[model.tree.first[node]]] : -1;
    const strength = shown === null ? (concept < 0 ? "plain" : "full") : concept === shown ? "chosen" : "pale";
    const style = `${concept < 0 ? "" : model.tree.colour(concept)} ${strength}`;
    if (!paths.has(style)) paths.set(style, new Path2D());
    return paths.get(style);
  }

  #stroke(context, style, path) {
    const [colour, strength] = style.split(" ");
    context.strokeStyle = colour || pageColour("faint");
    context.globalAlpha = { plain: 0.5, full: 0.95, chosen: 1, pale: 0.22 }[strength];
    context.lineWidth = strength === "chosen" ? 2 : 1;
    context.stroke(path);
    context.globalAlpha = 1;
  }

  #pick(at) {
    const { tree } = this.selection.model;
    const place = Math.floor((at / (this.chart.element.clientHeight - BOTTOM)) * tree.leaves);
    if (place >= 0 && place < tree.leaves) this.selection.pick(this.selection.assignment[tree.arranged[place]]);
  }
}
