/** Fields for the parameters of the method and of the simulation; only what differs from the default is sent. */
import { get } from "../../api.js";
import { h } from "../../parts/elements.js";
import { loadInto } from "../../parts/load.js";
import { field, tick } from "./changes.js";

const PRESETS = { default: "the default", paper: "the paper's own choices" };

/** The parameters of every stage, as the service's own description (/openapi.json) has them. */
export class ParameterFields {
  constructor(signal) {
    this.fields = []; // { stage, name, value: the default, read, write }
    this.place = h("div");
    this.element = h("details", {}, h("summary", {}, "Parameters of every stage"), this.place);
    this.element.addEventListener("toggle", () => {
      if (this.element.open && !this.place.hasChildNodes()) this.load(signal);
    });
  }

  load(signal) {
    return loadInto(this.place, signal, () => get("openapi.json", { signal }), ({ components: { schemas } }) => {
      this.fields = [];
      const stages = Object.entries(schemas.ModelParams.properties).map(([stage, told]) => {
        const schema = schemas[told.$ref.split("/").pop()];
        return h("details", { class: "stage-parameters" }, h("summary", {}, stage, h("span", { class: "fine" },
          ` ${schema.description.split("\n")[0]}`)),
        h("div", { class: "two" }, Object.entries(schema.properties).map(([name, parameter]) =>
          this.fieldOf(stage, name, parameter))));
      });
      return [this.presetField(schemas.ModelParams["x-presets"]), stages];
    });
  }

  /** What fills all fields at once; each can be altered afterwards. */
  presetField(presets) {
    const preset = h("select", { change: () => {
      for (const { stage, name, value, write } of this.fields) write(presets[preset.value][stage]?.[name] ?? value);
    } }, Object.keys(presets).map((name) => h("option", { value: name }, PRESETS[name] ?? name)));
    return field("Begin with", preset, "fills in all of the fields below");
  }

  fieldOf(stage, name, told) {
    const value = told.default;
    let control;
    if (told.enum) {
      control = h("select", {}, told.enum.map((one) => h("option", { value: one, selected: one === value }, one)));
    } else if (told.type === "boolean") {
      control = h("input", { type: "checkbox", checked: value });
    } else {
      control = h("input", { type: "number", required: true, value, step: told.type === "integer" ? 1 : "any",
        min: told.minimum ?? told.exclusiveMinimum, max: told.maximum ?? told.exclusiveMaximum });
    }
    const read = () => {
      if (told.type === "boolean") return control.checked;
      return told.enum ? control.value : Number(control.value);
    };
    const write = (other) => {
      if (told.type === "boolean") control.checked = other;
      else control.value = other;
    };
    this.fields.push({ stage, name, value, read, write });
    if (told.type === "boolean") {
      return h("div", { class: "field" }, tick(name, control), h("p", { class: "fine" }, told.description));
    }
    return field(name, control, told.description);
  }

  /** Those that differ, by stage. */
  chosen() {
    const params = {};
    for (const { stage, name, value, read } of this.fields) {
      if (read() !== value) (params[stage] ??= {})[name] = read();
    }
    return params;
  }
}

/** The main parameters of mental simulation. */
export class SimulationFields {
  constructor() {
    this.from = h("input", { type: "number", min: 1, max: 12, value: 1, required: true, "aria-label": "fewest parts",
      input: () => { this.to.min = this.from.value; } });
    this.to = h("input", { type: "number", min: 1, max: 12, value: 5, required: true, "aria-label": "most parts" });
    this.noise = h("select", {}, h("option", { value: "kinect" }, "as of a Kinect"),
      h("option", { value: "none" }, "none"));
    this.renderer = h("select", {}, h("option", { value: "sapien" }, "SAPIEN"),
      h("option", { value: "raycast" }, "ray casting"));
    this.element = h("fieldset", {}, h("legend", {}, "Simulated objects"),
      h("div", { class: "row counted" }, h("span", {}, "composed of"), this.from, h("span", {}, "to"), this.to,
        h("span", {}, "parts")),
      h("div", { class: "two" }, field("Noise of the sensor", this.noise), field("Renderer", this.renderer)),
      h("p", { class: "fine" }, "Ray casting is for workers on which SAPIEN finds no graphics driver."));
  }

  chosen() {
    const [first, last] = [Number(this.from.value), Number(this.to.value)];
    const orders = Array.from({ length: Math.max(0, last - first + 1) }, (_, place) => first + place);
    const chosen = {};
    if (first !== 1 || last !== 5) chosen.orders = orders;
    if (this.noise.value !== "kinect") chosen.noise = this.noise.value;
    if (this.renderer.value !== "sapien") chosen.renderer = this.renderer.value;
    return chosen;
  }
}
