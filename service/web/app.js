/**
 * The page: which view is open, and how one goes to another.
 *
 * How a view is written. Each view is a module in views/ that exports one function:
 *
 *     export function show(root, place) { ...; return { changed() {...}, leave() {...} }; }
 *
 * `root` is an empty element that the view fills. `place` (place.js) is what the URL says: `place.get(name)` reads a
 * parameter, `place.set({name: value})` writes some without leaving the view, so that the URL can be shared. What is
 * returned, and each of its members, may be left out: `changed()` is called when the user went back or forward within
 * the view or followed a link to another place of it, `leave()` when another view opens: stop timers and streams there.
 * A view is shown anew, from an empty root, when the user enters another access key.
 *
 * Data come from api.js alone. parts/ has what several views share: `h` makes elements, states.js says that something
 * is empty, loading, failed or not permitted. Nothing is loaded from elsewhere, no markup is made of text
 * (no innerHTML), and neither scripts nor styles stand in markup: the service forbids it (Content-Security-Policy).
 * Styles are in style.css, with colours as variables; an element's own style is set as `element.style.x`.
 */
import * as api from "./api.js";
import { askForKey } from "./parts/key_dialog.js";
import { h } from "./parts/elements.js";
import { failure, loading } from "./parts/states.js";
import { Place } from "./place.js";

const VIEWS = [
  { name: "try", title: "Try" },
  { name: "concepts", title: "Concepts" },
  { name: "train", title: "Train" },
  { name: "live", title: "Live" },
];

const root = document.getElementById("view");
const navigation = document.getElementById("navigation");
let open = { name: null, shown: null, turn: 0 };

/** Opens the view that the URL names, or tells the open one that its place changed. */
async function follow() {
  const place = new Place(location.hash);
  const view = VIEWS.find((one) => one.name === place.view) ?? VIEWS[0];
  place.view = view.name; // of a view that there is not, nothing stays in the URL
  if (view.name === open.name && open.shown) {
    open.place.moveTo(place.link());
    open.shown.changed?.();
    return;
  }
  await show(view, place);
}

async function show(view, place) {
  open.shown?.leave?.();
  const turn = open.turn + 1;
  open = { name: view.name, shown: null, place, turn };
  for (const link of navigation.children) {
    link.toggleAttribute("aria-current", link.dataset.view === view.name);
    if (link.dataset.view === view.name) link.setAttribute("aria-current", "page");
  }
  document.title = `${view.title} · Shape Concepts`;
  root.className = `view-${view.name}`;
  root.replaceChildren(loading());
  try {
    const { show: fill } = await import(`./views/${view.name}.js`);
    if (open.turn !== turn) return; // another view was opened meanwhile
    root.replaceChildren();
    open.shown = fill(root, place) ?? {};
  } catch (error) {
    if (open.turn === turn) root.replaceChildren(failure(error, { again: () => show(view, place) }));
  }
}

/** Keeps the browser from opening, in the place of the page, a file that is dropped beside what takes files. */
function refuseFiles(event) {
  if (event.defaultPrevented || !event.dataTransfer?.types.includes("Files")) return;
  event.preventDefault();
  event.dataTransfer.dropEffect = "none";
}

for (const view of VIEWS) {
  navigation.append(h("a", { href: `#/${view.name}`, "data-view": view.name }, view.title));
}
document.getElementById("key").addEventListener("click", askForKey);
document.querySelector(".skip").addEventListener("click", (event) => {
  event.preventDefault(); // the hash is the place
  root.focus();
});
for (const name of ["dragover", "drop"]) addEventListener(name, refuseFiles);
addEventListener("hashchange", follow);
api.onKeyChange(() => {
  document.getElementById("key").classList.toggle("held", api.hasKey());
  const name = open.name;
  open.shown?.leave?.();
  open = { name: null, shown: null, turn: open.turn };
  if (name) follow();
});
document.getElementById("key").classList.toggle("held", api.hasKey());
follow();
