/** The dialog in which a user enters an access key. */
import * as api from "../api.js";
import { h } from "./elements.js";

/** Opens it. The key is kept until the tab is closed. */
export function askForKey() {
  const field = h("input", { type: "password", id: "key-field", autocomplete: "off", spellcheck: "false" });
  const close = () => dialog.close();
  const dialog = h(
    "dialog",
    { "aria-labelledby": "key-title", close: () => dialog.remove() },
    h(
      "form",
      {
        submit: (event) => {
          event.preventDefault();
          close();
          if (field.value.trim()) api.setKey(field.value.trim());
        },
      },
      h("h2", { id: "key-title" }, "Access key"),
      h(
        "p",
        {},
        "Your operator makes one with ",
        h("code", {}, "shape-concepts keys create"),
        ". It is kept in this tab ",
        "only, until the tab is closed, and sent to this service only.",
      ),
      h("label", { for: "key-field" }, "Key"),
      field,
      h(
        "p",
        { class: "buttons" },
        h("button", { type: "submit", class: "main" }, "Use it"),
        api.hasKey() &&
          h(
            "button",
            {
              type: "button",
              click: () => {
                close();
                api.setKey(null);
              },
            },
            "Forget the key",
          ),
        h("button", { type: "button", click: close }, "Cancel"),
      ),
    ),
  );
  document.body.append(dialog);
  dialog.showModal();
}
