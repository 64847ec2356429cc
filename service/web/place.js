/** The place that the URL names: a view and parameters, as in `#/concepts?model=default:1&time=0.4`. */
export class Place {
  /** @param {string} hash of the URL, with its #. */
  constructor(hash) {
    this.moveTo(hash);
  }

  /** Takes over what another hash says. */
  moveTo(hash) {
    const [path, query = ""] = hash.replace(/^#\/?/, "").split("?", 2);
    this.view = path || "try";
    this.parameters = new URLSearchParams(query);
  }

  /** A parameter, or null. */
  get(name) {
    return this.parameters.get(name);
  }

  /** A parameter as a number, or null where it is none. */
  number(name) {
    const text = this.parameters.get(name);
    return text === null || text.trim() === "" || !Number.isFinite(Number(text)) ? null : Number(text);
  }

  /**
   * Writes parameters into the URL; those that are null or "" leave it.
   *
   * @param {Object<string, string|number|null>} changes by name.
   * @param {{push?: boolean}} how `push`: the user can go back to what was before.
   */
  set(changes, { push = false } = {}) {
    for (const [name, value] of Object.entries(changes)) {
      if (value === null || value === undefined || value === "") this.parameters.delete(name);
      else this.parameters.set(name, String(value));
    }
    const hash = this.link();
    if (hash !== location.hash) history[push ? "pushState" : "replaceState"](null, "", hash);
  }

  /** The hash of this place. */
  link() {
    return linkTo(this.view, this.parameters);
  }
}

/**
 * The hash of a place of any view.
 *
 * @param {string} view name of the view.
 * @param {URLSearchParams|Object<string, string>} parameters of the place.
 */
export function linkTo(view, parameters = {}) {
  const query = new URLSearchParams(parameters).toString().replaceAll("%3A", ":").replaceAll("%2C", ",");
  return `#/${view}${query ? `?${query}` : ""}`;
}
