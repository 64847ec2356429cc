/** A choice of a model and its version. */
import * as api from "../api.js";
import { h } from "./elements.js";

/**
 * A select with every version of every model.
 *
 * @param {string|null} chosen NAME:VERSION, NAME@ALIAS or NAME; null for the one that the service answers with.
 * @param {function(string): void} onChoose told NAME:VERSION.
 * @returns {Promise<{element: HTMLElement, reference: string|null}>} `reference`: what is chosen at first; null where
 *   there is no model.
 * @throws {api.Problem}
 */
export async function modelChooser(chosen, onChoose) {
  const { models } = await api.get("v1/models");
  const options = models.flatMap((model) =>
    model.versions.toReversed().map((version) => {
      const aliases = Object.keys(model.aliases).filter((alias) => model.aliases[alias] === version);
      const text = [`${model.name}:${version}`, aliases.join(", "), model.built_in && "built in"]
        .filter(Boolean)
        .join(" · ");
      return { value: `${model.name}:${version}`, text };
    }),
  );
  // Of one that is not there, the service says so.
  const reference = exactly(chosen, models) ?? chosen ?? options[0]?.value ?? null;
  const select = h(
    "select",
    { id: "model", change: () => onChoose(select.value) },
    options.map(({ value, text }) => h("option", { value, selected: value === reference }, text)),
  );
  return { element: h("label", { class: "chooser" }, "Model ", select), reference };
}

/** NAME:VERSION that a reference means, null if there is no such version. */
function exactly(reference, models) {
  const [, name, kind, which] = (reference ?? "").match(/^([^@:]+)([@:])?(.*)$/) ?? [];
  const model = name
    ? models.find((one) => one.name === name)
    : (models.find((one) => one.aliases.production) ?? models[0]);
  if (!model) return null;
  const version =
    kind === ":" ? Number(which) : (model.aliases[which || "production"] ?? (name ? null : model.versions.at(-1)));
  return model.versions.includes(version) ? `${model.name}:${version}` : null;
}
