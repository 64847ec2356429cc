/** The focus stays where it is when what has it is made anew: who goes by keys would have to begin from the top. */
const SAYS = ["href", "value", "aria-label", "data-concept"]; // attributes that tell an element from its neighbours

/**
 * Changes what an element holds; if that takes the focus away, what stands for the same as before gets it.
 *
 * @param {HTMLElement} element
 * @param {function(): void} change
 */
export function keepingFocus(element, change) {
  const focused = document.activeElement;
  const had = element.contains(focused) && focused !== element;
  change();
  if (!had || element.contains(document.activeElement)) return;
  const same = [...element.querySelectorAll(focused.localName)].find((one) => markOf(one) === markOf(focused));
  same?.focus({ preventScroll: true });
}

function markOf(element) {
  const said = SAYS.map((name) => element.getAttribute(name));
  return said.some((one) => one !== null) || element.localName !== "button" ? said.join("\n") : element.textContent;
}
