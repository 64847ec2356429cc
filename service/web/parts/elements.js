/** Elements of the page. */

/**
 * Makes an HTML element.
 *
 * @param {string} tag name of the element.
 * @param {Object} attributes by name; a function is a listener ("click", not "onclick"), true an attribute without a
 *   value, null and false none.
 * @param {...(Node|string|number|null|Array)} children null ones are left out.
 */
export function h(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

/** A count as people write it: 10,000. */
export function counted(number) {
  return number.toLocaleString("en");
}

/** As `h`, an SVG element. */
export function svg(tag, attributes = {}, ...children) {
  return fill(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value);
  }
  element.append(
    ...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false),
  );
  return element;
}
