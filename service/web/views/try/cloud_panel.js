/** The picture of the cloud, how it is coloured, and what is highlighted in it. */
import { CloudView } from "../../parts/cloud_view.js";
import { counted, h } from "../../parts/elements.js";
import { loading } from "../../parts/states.js";
import { paint, paintHeights, waysToColour } from "./painting.js";
import { Seen } from "./seen.js";

export class CloudPanel {
  /**
   * @param {import("../../place.js").Place} place its parameter `colour` says how the cloud is coloured.
   * @param {function(number): void} onObject told the number of the object of a scene that was picked.
   */
  constructor(place, onObject) {
    this.place = place;
    this.view = new CloudView({
      label: "The cloud",
      onHover: (point) => this.#tell(point),
      onPick: (point) =>
        this.seen?.scene && point >= 0 && this.seen.objects[point] >= 0 && onObject(this.seen.objects[point]),
    });
    this.onObject = onObject;
    this.choice = h("select", { id: "colour", change: () => this.#choose() });
    this.title = h("h2", {});
    this.told = h("p", { class: "fine told" });
    this.legend = h("div", { class: "legend" });
    this.over = h("div", { class: "cloud-over" });
    const bar = h("div", { class: "bar" }, this.title, h("label", { for: "colour" }, "Coloured by ", this.choice));
    this.element = h(
      "section",
      { class: "panel try-cloud hidden", "aria-label": "Picture of the cloud" },
      bar,
      h("div", { class: "cloud-frame" }, this.view.element, this.over),
      this.legend,
      this.told,
    );
  }

  close() {
    this.view.close();
  }

  /** Makes room for another cloud. */
  begin(cloud) {
    this.seen = this.drawn = null;
    this.object = cloud.scene ? 0 : null;
    this.element.classList.remove("hidden");
    this.title.textContent = cloud.name;
    this.view.setMarks([]);
    this.view.setPoints(new Float32Array());
    this.legend.replaceChildren();
    this.over.replaceChildren(loading("Reading the cloud …"));
    this.told.textContent = "";
  }

  /** Says that there is nothing to be seen. @param {?HTMLElement} why unless that stands beside. */
  fail(why = null) {
    this.element.classList.toggle("hidden", why === null);
    if (why) this.over.replaceChildren(why);
  }

  /** @param {import("../../parts/ply.js").Drawn} drawn */
  show(drawn) {
    this.drawn = drawn;
    this.over.replaceChildren();
    this.view.setPoints(drawn.points);
    const thinned = drawn.count < drawn.measured ? `, of which ${counted(drawn.count)} are drawn` : "";
    const missing =
      drawn.inFile - drawn.measured ? `; ${counted(drawn.inFile - drawn.measured)} of the file were not measured` : "";
    this.resting =
      `${counted(drawn.measured)} points${thinned}${missing}. ` + "Drag to turn, shift-drag to move, + and − zoom.";
    this.told.textContent = this.resting;
    this.recolour();
  }

  /** Colours the points by what an answer says of them. */
  explain(answer, model, scene) {
    this.seen = new Seen(this.drawn, answer, model, scene);
    if (scene) this.view.setMarks(answer.objects.map((object) => this.#mark(object)));
    this.chooseObject(this.object);
    this.recolour();
  }

  /** Highlights segments of the object that is shown; null for none. @param {number[]|null} segments */
  highlight(segments) {
    if (!this.seen) return;
    const wanted = new Set(segments ?? []);
    const own = (point) => this.object === null || this.seen.objects[point] === this.object;
    const lit =
      segments &&
      Uint8Array.from({ length: this.drawn.count }, (_, point) => own(point) && wanted.has(this.seen.segments[point]));
    this.view.setHighlight(lit);
  }

  /** Marks the object of a scene that is shown. */
  chooseObject(object) {
    this.object = this.seen?.scene === false ? null : object;
    for (const mark of this.view.marks.children)
      mark.setAttribute("aria-pressed", String(Number(mark.dataset.object) === object));
    if (this.seen) this.recolour();
  }

  /** Colours the points as the URL says. */
  recolour() {
    if (!this.drawn) return;
    const ways = waysToColour(this.seen);
    const wanted = this.place.get("colour");
    const way = ways.some(([value]) => value === wanted) ? wanted : ways[0][0];
    this.choice.replaceChildren(...ways.map(([value, text]) => h("option", { value, selected: value === way }, text)));
    const { colours, legend, note } = this.seen
      ? paint(way, this.seen, this.object)
      : paintHeights(this.drawn, (point) => -this.drawn.points[3 * point + 1]);
    this.view.setColours(colours);
    this.legend.replaceChildren(...legend, ...(note ? [h("p", { class: "fine" }, note)] : []));
  }

  #choose() {
    this.place.set({ colour: this.choice.value });
    this.recolour();
  }

  #mark(object) {
    const pick = () => this.onObject(object.number);
    const name = `Object ${object.number}${object.answer ? "" : ", not answered"}`;
    const element = h(
      "button",
      { type: "button", class: "mark", title: name, "aria-label": name, "data-object": object.number, click: pick },
      object.number,
    );
    return { position: object.sensor_position_m, element };
  }

  #tell(point) {
    if (!this.seen || point < 0) {
      this.told.textContent = this.resting ?? "";
      return;
    }
    const [object, segment] = [this.seen.objects[point], this.seen.segments[point]];
    const where = this.seen.scene && object >= 0 ? `Object ${object}, ` : "";
    const explained = this.seen.answers[object]?.explanation.segments[segment];
    this.told.textContent = explained
      ? `${where}segment ${segment}: ${percent(explained.share)} of what was seen, words ${explained.words.join(", ")}`
      : `${where || "This point is "}part of no ${where ? "segment" : "object"}`;
  }
}

function percent(share) {
  return `${Math.round(100 * share)} %`;
}
