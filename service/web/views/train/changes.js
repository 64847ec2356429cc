/** What the panels of Train have in common. */
import { get } from "../../api.js";
import { h } from "../../parts/elements.js";
import { failure } from "../../parts/states.js";

/** What each panel is given. @typedef {{place: Place, shared: EventTarget, signal: AbortSignal}} Context */

/** Tells the other panels that there are other "datasets", "jobs" or "models" now. */
export function tell({ shared }, what) {
  shared.dispatchEvent(new Event(what));
}

/** Calls a function when another panel has changed something, until the view is left. */
export function heard({ shared, signal }, what, listener) {
  shared.addEventListener(what, listener, { signal });
}

/** Names of all datasets. @returns {Promise<string[]>} */
export async function datasetNames(signal) {
  return (await get("v1/datasets", { signal })).datasets.map((dataset) => dataset.name);
}

/** All models, with versions and aliases. */
export async function models(signal) {
  return (await get("v1/models", { signal })).models;
}

/**
 * Does something that a button asked for, while it cannot be pressed again; tells in `place` why it failed.
 *
 * @param {HTMLButtonElement} button
 * @param {HTMLElement} place for the error.
 * @param {function(): Promise<void>} work
 */
export async function doing(button, place, work) {
  button.disabled = true;
  place.replaceChildren();
  try {
    await work();
  } catch (error) {
    if (error.name !== "AbortError") place.replaceChildren(failure(error));
  } finally {
    button.disabled = false;
  }
}

/** A labelled control. @param {string} label @param {HTMLElement} control @param {?string} hint below it. */
export function field(label, control, hint = null) {
  control.id ||= `field-${(field.count = (field.count ?? 0) + 1)}`;
  const below = hint && h("p", { class: "fine", id: `${control.id}-hint` }, hint);
  if (below) control.setAttribute("aria-describedby", below.id);
  return h("div", { class: "field" }, h("label", { for: control.id }, label), control, below);
}

/** A box to tick, with its label. */
export function tick(label, control) {
  return h("label", { class: "tick" }, control, " ", label);
}

/** Asks before something is done that others will notice. @returns {Promise<boolean>} */
export function confirmed(title, text, action) {
  return new Promise((resolve) => {
    let sure = false;
    const close = () => dialog.close();
    const dialog = h(
      "dialog",
      { "aria-labelledby": "confirm-title", close: () => { dialog.remove(); resolve(sure); } },
      h("h2", { id: "confirm-title" }, title),
      h("p", {}, text),
      h(
        "p",
        { class: "buttons" },
        h("button", { type: "button", class: "main", click: () => { sure = true; close(); } }, action),
        h("button", { type: "button", click: close }, "Cancel"),
      ),
    );
    document.body.append(dialog);
    dialog.showModal();
  });
}
