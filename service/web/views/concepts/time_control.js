/** The filtration time as a slider, with what there is at that time. */
import { counted, h } from "../../parts/elements.js";

export class TimeControl {
  /** @param {import("./selection.js").Selection} selection */
  constructor(selection) {
    this.selection = selection;
    this.slider = h("input", {
      type: "range",
      id: "time",
      min: 0,
      max: 1,
      step: 0.002,
      input: () => selection.setTime(Number(this.slider.value), false),
      change: () => selection.setTime(Number(this.slider.value)),
    });
    this.value = h("output", { for: "time", class: "number" });
    this.told = h("p", { class: "fine" });
    const own = h(
      "button",
      {
        type: "button",
        title: "The time of the model's own concepts",
        click: () => selection.setTime(selection.model.epsilonMax),
      },
      `ε max ${selection.model.epsilonMax.toFixed(3)}`,
    );
    this.element = h(
      "section",
      { class: "panel time-control", "aria-label": "Filtration time" },
      h(
        "div",
        { class: "time-row" },
        h("label", { for: "time" }, "Filtration time"),
        h("span", { class: "fine" }, "specific"),
        this.slider,
        h("span", { class: "fine" }, "generic"),
        this.value,
        own,
      ),
      this.told,
    );
  }

  update() {
    const { time, concepts, held, model } = this.selection;
    this.slider.value = time;
    this.value.textContent = time.toFixed(3);
    this.slider.setAttribute("aria-valuetext", `${time.toFixed(3)}: ${concepts.length} concepts`);
    const count = concepts.length === 1 ? "1 concept holds" : `${concepts.length} concepts hold`;
    const all = `${counted(model.objects.length)} training objects of ${model.reference}`;
    this.told.textContent = `At ${time.toFixed(3)}, ${count} ${counted(held)} of ${all}.`;
  }
}
