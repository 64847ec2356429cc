/** What is shown where there is nothing to see: it is empty, it is loading, it failed, it is not permitted. */
import { askForKey } from "./key_dialog.js";
import { h } from "./elements.js";

/** Nothing is there yet: `what` says so and what to do; further children may be links or buttons. */
export function empty(what, ...children) {
  return h("div", { class: "state state-empty" }, h("p", {}, what), children);
}

/** Something is under way. */
export function loading(what = "Loading …") {
  return h("div", { class: "state state-loading", role: "status" }, h("span", { class: "spinner" }), h("p", {}, what));
}

/**
 * An error in place: the service's own words; a form for the access key where it was refused for want of one.
 *
 * @param {Error} error a Problem of api.js, or any other.
 * @param {{again?: function(): void}} ways `again`: what a button "Try again" does, where that may help.
 */
export function failure(error, { again } = {}) {
  if (error.status === 401 || error.status === 403) return refused(error);
  if (error.status === undefined) console.error(error); // a fault of the page: whoever mends it wants to know where
  const passing = !error.status || error.status === 429 || error.status >= 500;
  const parts = [h("p", { class: "title" }, error.title ?? "The page failed"), h("p", {}, error.message)];
  if (error.instance) parts.push(h("p", { class: "fine" }, `Request ${error.instance.replace("urn:uuid:", "")}`));
  if (again && passing) parts.push(h("button", { type: "button", click: again }, "Try again"));
  return h("div", { class: "state state-error", role: "alert" }, parts);
}

function refused(error) {
  return h(
    "div",
    { class: "state state-refused", role: "alert" },
    h("p", { class: "title" }, error.status === 401 ? "An access key is needed" : "The access key does not allow this"),
    h("p", {}, error.message),
    h("button", { type: "button", click: askForKey }, error.status === 401 ? "Enter a key" : "Enter another key"),
  );
}
