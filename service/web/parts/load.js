/** Places that are filled with what the service tells. */
import { keepingFocus } from "./focus.js";
import { failure, loading } from "./states.js";

/**
 * Fills an element with what is loaded; while it loads, or where that fails, the element says so.
 *
 * What is there already stays until the new content has come. Of two loads of one element, the later one counts.
 *
 * @param {HTMLElement} element to be filled.
 * @param {AbortSignal} signal after which nothing is filled any more.
 * @param {function(): Promise<*>} load gives what is needed.
 * @param {function(*): (Node|Array)} fill makes the content of it.
 */
export async function loadInto(element, signal, load, fill) {
  const turn = (element.loadTurn ?? 0) + 1;
  element.loadTurn = turn;
  const outdated = () => signal.aborted || element.loadTurn !== turn;
  if (!element.hasChildNodes()) element.replaceChildren(loading());
  element.setAttribute("aria-busy", "true");
  try {
    const loaded = await load();
    if (outdated()) return;
    const content = [fill(loaded)].flat(Infinity).filter(Boolean);
    keepingFocus(element, () => element.replaceChildren(...content));
  } catch (error) {
    if (!outdated()) {
      element.replaceChildren(failure(error, { again: () => loadInto(element, signal, load, fill) }));
    }
  } finally {
    if (!outdated()) element.removeAttribute("aria-busy");
  }
}
