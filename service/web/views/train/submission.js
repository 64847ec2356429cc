/** The panel in which a job is put together: one that learns, one that simulates, one that judges. */
import { get } from "../../api.js";
import { h } from "../../parts/elements.js";
import { failure } from "../../parts/states.js";
import { datasetNames, doing, field, heard, models, tell, tick } from "./changes.js";
import { scheduling } from "./schedules.js";
import { ParameterFields, SimulationFields } from "./parameters.js";

const NAME = "[a-z0-9][a-z0-9\\-]*";

/** @param {import("./changes.js").Context} context */
export function submissionPanel(context) {
  const { place, signal } = context;
  const forms = { train: new LearnForm(signal), simulate: new SimulateForm(), evaluate: new JudgeForm() };
  const titles = { train: "Learn a model", simulate: "Simulate clouds", evaluate: "Judge a model" };
  const state = h("div");
  const button = h("button", { type: "submit", class: "main" }, "Submit");
  const form = h("form", {
    submit: (event) => {
      event.preventDefault();
      doing(button, state, submit);
    },
  });
  form.addEventListener("invalid", (event) => unfold(event.target), { capture: true });
  const kinds = Object.keys(forms).map((kind) => {
    const radio = h("input", { type: "radio", name: "kind", value: kind, change: () => choose(kind) });
    return h("label", {}, radio, h("span", {}, titles[kind]));
  });
  const again = scheduling(context, () => (form.reportValidity() ? forms[kind].spec() : null));
  let kind = "train";
  let attempt = newId(); // a request that is repeated is one job

  function choose(chosen) {
    kind = chosen;
    kinds.forEach((label) => { label.firstChild.checked = label.firstChild.value === kind; });
    form.replaceChildren(forms[kind].element, state, h("p", { class: "buttons" }, button), again);
    state.replaceChildren();
  }

  async function submit() {
    const spec = forms[kind].spec();
    const said = JSON.stringify(spec);
    if (said !== attempt.said) attempt = { ...newId(), said };
    const job = await get("v1/jobs", { json: spec, headers: { "Idempotency-Key": attempt.id }, signal });
    attempt = newId();
    place.set({ job: job.id }, { push: true });
    tell(context, "jobs");
  }

  async function refresh() {
    try {
      const [datasets, known] = await Promise.all([datasetNames(signal), models(signal).catch(noneFor403)]);
      Object.values(forms).forEach((one) => one.offer(datasets, known));
      state.replaceChildren();
    } catch (error) {
      if (!signal.aborted) state.replaceChildren(failure(error, { again: refresh }));
    }
  }

  heard(context, "datasets", refresh);
  heard(context, "models", refresh);
  choose(kind);
  refresh();
  return {
    element: h("section", { class: "panel", "aria-labelledby": "submission-title" },
      h("h2", { id: "submission-title" }, "New job"),
      h("div", { class: "segmented", role: "radiogroup", "aria-labelledby": "submission-title" }, kinds), form),
  };
}

/** Who may train, but not look at models, chooses among none. */
function noneFor403(error) {
  if (error.status === 403) return [];
  throw error;
}

/** Opens whatever hides a field: of one that is hidden, no browser can say what is wrong with it. */
function unfold(control) {
  for (let fold = control.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
}

/** Learns a model from datasets, from simulated objects, or from both. */
class LearnForm {
  constructor(signal) {
    this.name = h("input", { required: true, pattern: NAME, maxlength: "63", value: "mine", list: "models-known",
      spellcheck: "false", autocomplete: "off" });
    this.known = h("datalist", { id: "models-known" });
    this.datasets = h("div", { class: "ticks" });
    this.simulating = h("input", { type: "checkbox", checked: true, change: () => this.tidy() });
    this.count = number({ value: 250, min: 2, max: 10_000_000, label: "Number of simulated objects" });
    this.seed = number({ value: 7, min: 0 });
    this.before = h("select", { change: () => this.tidy() });
    this.how = h("select", {}, h("option", { value: "parent" }, "is its parent"),
      h("option", { value: "extend" }, "is extended: its clouds, too"));
    this.labelled = h("select", { change: () => this.tidy() });
    this.promote = h("select", { change: () => this.tidy() },
      h("option", { value: "always" }, "always"),
      h("option", { value: "not-worse" }, "if not worse"),
      h("option", { value: "never" }, "never, I do it by hand"));
    this.tolerance = number({ value: 0.02, min: 0, max: 1, step: "any" });
    this.tolerated = field("A figure may be lower by", this.tolerance, "of 1, each");
    this.howField = field("That model", this.how);
    this.simulation = new SimulationFields();
    this.parameters = new ParameterFields(signal);
    this.element = h("div", { class: "fields" }, this.known,
      field("Name of the model", this.name, "a name that is there already gets another version"),
      h("fieldset", {}, h("legend", {}, "Learn from"), this.datasets,
        h("div", { class: "row" }, tick("simulated objects", this.simulating), this.count)),
      h("div", { class: "two" }, field("Follows", this.before), this.howField),
      h("div", { class: "two" }, field("Judge it by the labels of", this.labelled),
        field("Let it serve (production)", this.promote)),
      this.tolerated,
      h("details", {}, h("summary", {}, "Seed and parameters"),
        field("Seed", this.seed, "the same seed, clouds and parameters make the same model, bit for bit"),
        this.simulation.element, this.parameters.element));
    this.tidy();
  }

  /** What there is to choose from. */
  offer(datasets, known) {
    const ticked = new Set(this.ticked());
    this.datasets.replaceChildren(...datasets.map((name) => tick(name,
      h("input", { type: "checkbox", value: name, checked: ticked.has(name), change: () => this.tidy() }))));
    const learnt = known.filter((model) => !model.built_in);
    this.known.replaceChildren(...known.map((model) => h("option", { value: model.name })));
    choices(this.before, "no earlier version", learnt.map((model) => model.name));
    choices(this.labelled, "no dataset", datasets);
    this.tidy();
  }

  ticked() {
    return [...this.datasets.querySelectorAll("input:checked")].map((box) => box.value);
  }

  /** Shows what matters by what was chosen. */
  tidy() {
    this.count.disabled = !this.simulating.checked;
    this.howField.classList.toggle("hidden", !this.before.value);
    const notWorse = this.promote.querySelector("[value=not-worse]");
    notWorse.disabled = !this.labelled.value;
    if (notWorse.disabled && this.promote.value === "not-worse") this.promote.value = "always";
    this.tolerated.classList.toggle("hidden", this.promote.value !== "not-worse");
    this.simulation.element.classList.toggle("hidden", !this.simulating.checked);
  }

  spec() {
    const simulating = this.simulating.checked;
    const spec = { kind: "train", name: this.name.value, seed: Number(this.seed.value), promote: this.promote.value };
    if (this.ticked().length) spec.datasets = this.ticked();
    if (simulating) Object.assign(spec, { simulate: Number(this.count.value), simulation: this.simulation.chosen() });
    if (this.before.value) spec[this.how.value] = this.before.value;
    if (this.labelled.value) spec.labelled = this.labelled.value;
    if (spec.promote === "not-worse") spec.tolerance = Number(this.tolerance.value);
    const params = this.parameters.chosen();
    if (Object.keys(params).length) spec.params = params;
    return spec;
  }
}

/** Simulates objects into a dataset. */
class SimulateForm {
  constructor() {
    this.dataset = h("input", { required: true, pattern: NAME, maxlength: "63", value: "simulated",
      list: "datasets-known", spellcheck: "false", autocomplete: "off" });
    this.known = h("datalist", { id: "datasets-known" });
    this.count = number({ value: 250, min: 1, max: 10_000_000 });
    this.seed = number({ value: 7, min: 0 });
    this.simulation = new SimulationFields();
    this.element = h("div", { class: "fields" }, this.known,
      field("Into the dataset", this.dataset, "made if there is none of that name"),
      h("div", { class: "two" }, field("Objects", this.count),
        field("Seed", this.seed, "other objects only with another one")),
      this.simulation.element);
  }

  offer(datasets) {
    this.known.replaceChildren(...datasets.map((name) => h("option", { value: name })));
  }

  spec() {
    return { kind: "simulate", dataset: this.dataset.value, count: Number(this.count.value),
      seed: Number(this.seed.value), simulation: this.simulation.chosen() };
  }
}

/** Judges a model by the labels of a dataset. */
class JudgeForm {
  constructor() {
    this.model = h("select", { required: true });
    this.dataset = h("select", { required: true });
    this.robustness = h("input", { type: "checkbox" });
    this.element = h("div", { class: "fields" }, field("Model", this.model),
      field("By the labels of", this.dataset, "labels.csv, dropped into a dataset, says what its clouds show"),
      tick("with disturbed clouds as well (takes longer)", this.robustness));
  }

  offer(datasets, known) {
    choices(this.model, null, known.filter((model) => !model.built_in).flatMap((model) => [...model.versions].reverse()
      .map((version) => `${model.name}:${version}`)));
    choices(this.dataset, null, datasets);
  }

  spec() {
    return { kind: "evaluate", model: this.model.value, dataset: this.dataset.value,
      robustness: this.robustness.checked };
  }
}

/** A field for a number. */
function number({ label = null, step = 1, ...given }) {
  return h("input", { type: "number", required: true, step, inputmode: step === 1 ? "numeric" : "decimal",
    "aria-label": label, ...given });
}

/** Puts choices into a list; what was chosen stays so, if it is there still. */
function choices(select, none, values) {
  const before = select.value;
  const options = values.map((value) => h("option", { value }, value));
  if (none !== null) options.unshift(h("option", { value: "" }, none));
  else if (!values.length) options.push(h("option", { value: "" }, "there is none yet"));
  select.replaceChildren(...options);
  if (values.includes(before)) select.value = before;
}

/** An id for a job; `crypto.randomUUID` is there over TLS only. */
function newId() {
  const octets = crypto.getRandomValues(new Uint8Array(16));
  return { id: [...octets].map((octet) => octet.toString(16).padStart(2, "0")).join("") };
}
