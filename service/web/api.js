/**
 * Requests to the service: with the access key that the user entered, and errors as the service words them.
 *
 * Paths are relative to the page ("v1/models"), so that the service may stand behind a proxy under a path of its own.
 */
const KEY = "shape-concepts-key";
const ATTEMPTS = 5; // of a request that a busy service, or the limits of an access key, did not let in
const LONGEST = 5; // seconds
const keyChanges = new EventTarget();

/** What went wrong, as RFC 9457 tells it; `status` 0: the service was not reached. */
export class Problem extends Error {
  constructor({ status = 0, title = "The service did not answer", detail = "", type = "", instance = "" }) {
    super(detail || title);
    this.name = "Problem";
    Object.assign(this, { status, title, detail, type: type.replace("urn:shape-concepts:error:", ""), instance });
  }
}

/** Whether the user entered an access key. */
export function hasKey() {
  return sessionStorage.getItem(KEY) !== null;
}

/** Keeps an access key for this tab until it is closed; null forgets it. */
export function setKey(key) {
  if (key) sessionStorage.setItem(KEY, key);
  else sessionStorage.removeItem(KEY);
  keyChanges.dispatchEvent(new Event("change"));
}

/** Calls a function whenever the access key changed. */
export function onKeyChange(listener) {
  keyChanges.addEventListener("change", listener);
}

/**
 * A path with names in it that were typed or stand in the URL, whatever they are: pathOf`v1/jobs/${id}/events`.
 *
 * @returns {string}
 */
export function pathOf(parts, ...names) {
  const quoted = names.map((name) => encodeURIComponent(name).replaceAll("%3A", ":").replaceAll("%40", "@"));
  return String.raw({ raw: parts }, ...quoted);
}

/**
 * Sends a request; its answer was a success. One that is not let in (429) is sent again after a pause.
 *
 * @param {string} path relative to the page; a leading / is taken for the service's root.
 * @param {Object} options of `fetch`; further: `query`: parameters, of which null ones are left out, `json`: a body.
 * @returns {Promise<Response>}
 * @throws {Problem} the service refused, failed or was not reached; an AbortError where `options.signal` says so.
 */
export async function request(path, { query = {}, json, headers = {}, ...options } = {}) {
  const url = new URL(path.replace(/^\//, ""), document.baseURI);
  for (const [name, value] of Object.entries(query)) {
    if (value !== null && value !== undefined && value !== "") url.searchParams.set(name, value);
  }
  const sent = { ...headers };
  if (hasKey()) sent.Authorization = `Bearer ${sessionStorage.getItem(KEY)}`;
  if (json !== undefined) {
    sent["Content-Type"] = "application/json";
    options = { method: "POST", ...options, body: JSON.stringify(json) };
  }
  for (let attempt = 1; ; attempt += 1) {
    const response = await send(url, { ...options, headers: sent });
    if (response.ok) return response;
    if (response.status !== 429 || attempt === ATTEMPTS) throw await problemOf(response);
    await pause(response.headers.get("retry-after"), attempt); // it was not let in: nothing was done yet
  }
}

async function send(url, options) {
  try {
    return await fetch(url, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem({ detail: "The service cannot be reached. Is it still running, and is there a network?" });
  }
}

/** Waits as long as the service asks for, and a little longer each time, so that requests do not come back at once. */
function pause(asked, attempt) {
  const seconds = Math.min(LONGEST, Number(asked) || 1) * (0.3 + 0.7 * Math.random()) * attempt;
  return new Promise((resolve) => setTimeout(resolve, 1000 * seconds));
}

/** As `request`; the answer's JSON. */
export async function get(path, options) {
  return (await request(path, options)).json();
}

async function problemOf(response) {
  try {
    if (/json/.test(response.headers.get("content-type") ?? "")) return new Problem(await response.json());
  } catch {
    // the body was cut off: its status says enough
  }
  return new Problem({
    status: response.status,
    title: "The service refused",
    detail: `The service answered ${response.status} ${response.statusText}.`,
  });
}

/**
 * A picture that needs the access key, as a URL for an image. Revoke it when it is no longer shown.
 *
 * @returns {Promise<string>}
 */
export async function pictureUrl(path, options) {
  return URL.createObjectURL(await (await request(path, options)).blob());
}
