/** The map: each training object where its responses lie, computed in training; near ones respond alike. */
import { Chart } from "../../parts/chart.js";
import { pageColour } from "../../parts/colours.js";
import { h } from "../../parts/elements.js";
import { titleOf } from "../../parts/model.js";

const MARGIN = 14; // pixels
const REACH = 14; // pixels from a dot that count as on it
const MANY = 2500; // dots, beyond which they are small

export class ConceptMap {
  /** @param {import("./selection.js").Selection} selection */
  constructor(selection) {
    this.selection = selection;
    this.chart = new Chart("Map of the training objects, coloured by concept", (context, width, height) =>
      this.#paint(context, width, height),
    );
    this.hover = h("div", { class: "map-hover hidden" });
    this.chart.element.append(this.hover);
    this.chart.element.classList.add("tall");
    const { canvas } = this.chart;
    canvas.addEventListener("pointermove", (event) => this.#tell(this.chart.at(event)));
    canvas.addEventListener("pointerleave", () => this.#tell(null));
    canvas.addEventListener("click", (event) => {
      const found = this.#nearest(this.chart.at(event));
      this.selection.pick(found < 0 ? null : this.selection.assignment[found]);
    });
    this.element = h(
      "section",
      { class: "panel", "aria-label": "Map" },
      h("h2", {}, "Map"),
      this.chart.element,
      h(
        "p",
        { class: "fine" },
        "Objects that lie together respond alike; grey ones are part of no concept. Click one to choose its concept.",
      ),
    );
  }

  update() {
    this.chart.redraw();
  }

  close() {
    this.chart.close();
  }

  #paint(context, width, height) {
    const { model, assignment, shown } = this.selection;
    context.clearRect(0, 0, width, height);
    this.places = fit(model.objects, width, height);
    const size = model.objects.length > MANY ? 2 : 4;
    const order = model.objects.map((_, object) => object); // the chosen ones last, above all others
    const level = (object) => (assignment[object] < 0 ? 0 : assignment[object] === shown ? 2 : 1);
    order.sort((one, other) => level(one) - level(other));
    for (const object of order) {
      const chosen = shown !== null && assignment[object] === shown;
      context.fillStyle = model.tree.colour(assignment[object]);
      context.globalAlpha = shown === null || chosen ? (assignment[object] < 0 ? 0.5 : 0.95) : 0.28;
      context.beginPath();
      context.arc(this.places[2 * object], this.places[2 * object + 1], chosen ? size + 1.5 : size, 0, 2 * Math.PI);
      context.fill();
      if (chosen && size > 2) {
        context.strokeStyle = pageColour("ink");
        context.lineWidth = 1;
        context.stroke();
      }
    }
    context.globalAlpha = 1;
  }

  #nearest([x, y]) {
    let [best, least] = [-1, REACH ** 2];
    for (let object = 0; object < (this.places?.length ?? 0) / 2; object += 1) {
      const away = (this.places[2 * object] - x) ** 2 + (this.places[2 * object + 1] - y) ** 2;
      if (away < least) [best, least] = [object, away];
    }
    return best;
  }

  #tell(point) {
    const { model, assignment } = this.selection;
    const object = point ? this.#nearest(point) : -1;
    this.hover.classList.toggle("hidden", object < 0);
    if (object < 0 || object === this.told) return;
    this.told = object;
    const { key } = model.objects[object];
    const concept = assignment[object];
    this.hover.replaceChildren(
      model.thumbnails.show(object, key),
      h(
        "span",
        {},
        key,
        model.categories[object] ? h("span", { class: "block" }, model.categories[object]) : null,
        h("span", { class: "fine block" }, concept < 0 ? "no concept" : titleOf(model, concept)),
      ),
    );
    this.hover.style.left = `${Math.min(this.places[2 * object] + 12, this.chart.element.clientWidth - 180)}px`;
    this.hover.style.top = `${Math.max(4, this.places[2 * object + 1] - 60)}px`;
  }
}

/** The places of objects in pixels: x, y of each, one scale for both. */
function fit(objects, width, height) {
  const range = (axis) =>
    objects.reduce(
      ([low, high], { map }) => [Math.min(low, map[axis]), Math.max(high, map[axis])],
      [Infinity, -Infinity],
    );
  const [[left, right], [top, bottom]] = [range(0), range(1)];
  const scale = Math.min((width - 2 * MARGIN) / (right - left || 1), (height - 2 * MARGIN) / (bottom - top || 1));
  const places = new Float32Array(2 * objects.length);
  objects.forEach(({ map }, object) => {
    places[2 * object] = width / 2 + (map[0] - (left + right) / 2) * scale;
    places[2 * object + 1] = height / 2 - (map[1] - (top + bottom) / 2) * scale;
  });
  return places;
}
