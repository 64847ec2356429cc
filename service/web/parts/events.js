/** Server-sent events by `fetch`: an EventSource could not send the access key. */
import { Problem, request } from "../api.js";

const SHORTEST = 1000; // milliseconds before the first attempt to connect again
const LONGEST = 15000;
const SILENT = 45000; // milliseconds without a word, though the service says every 15 s that it is there

/**
 * Follows events until one of them is the last, or the signal says so; connects again when the connection is lost.
 *
 * @param {string} path of the events, as `request` takes it.
 * @param {Object} how
 * @param {Object} [how.query] parameters.
 * @param {AbortSignal} how.signal ends it.
 * @param {function({kind: string, id: string, data: string}): (boolean|void)} how.on is given each event, and returns
 *   false for the last.
 * @param {function(boolean, ?Problem): void} [how.connected] is told when it is connected, and when it is not and why.
 * @throws {Problem} the service refused, and would again.
 */
export async function follow(path, { query, signal, on, connected = () => {} }) {
  let lastId = null;
  let wait = SHORTEST;
  while (!signal.aborted) {
    let why = null;
    try {
      const headers = { Accept: "text/event-stream", ...(lastId && { "Last-Event-ID": lastId }) };
      const response = await request(path, { query, signal, headers, cache: "no-store" });
      connected(true, null);
      wait = SHORTEST;
      for await (const event of events(response.body)) {
        lastId = event.id || lastId;
        if (on(event) === false) return;
      }
    } catch (error) {
      if (signal.aborted) return;
      if (error instanceof Problem && !passes(error)) throw error;
      if (error instanceof Problem) why = error;
      else if (!(error instanceof Lost)) throw error; // of our own
    }
    if (signal.aborted) return;
    connected(false, why);
    await pause(wait, signal);
    wait = Math.min(2 * wait, LONGEST);
  }
}

/** Whether the same request may succeed later. */
export function passes(error) {
  return !error.status || error.status === 408 || error.status === 429 || error.status >= 500;
}

/** Waits some milliseconds, or until the signal says that nobody waits any longer. */
export function pause(milliseconds, signal) {
  return new Promise((resolve) => {
    const end = () => {
      clearTimeout(timer);
      signal?.removeEventListener("abort", end); // the signal may outlive many pauses
      resolve();
    };
    const timer = setTimeout(end, milliseconds);
    signal?.addEventListener("abort", end);
  });
}

/** The connection broke off. */
class Lost extends Error {}

/** What is read, unless the connection breaks off, or breaks without a word, as where a cable is pulled. */
function inTime(reading) {
  return new Promise((read, failed) => {
    const lost = (why) => failed(new Lost(why));
    const timer = setTimeout(() => lost("silent"), SILENT);
    reading.then(read, (error) => lost(error.message)).finally(() => clearTimeout(timer));
  });
}

/** The events of a body as they come. Comments and what announces nothing are left out. */
async function* events(body) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  let from = 0; // before it, no event ends
  try {
    for (;;) {
      const { value, done } = await inTime(reader.read());
      if (done) return;
      text += value.replaceAll("\r", "");
      for (let end; (end = text.indexOf("\n\n", from)) >= 0; from = 0) {
        const event = parse(text.slice(0, end));
        text = text.slice(end + 2);
        if (event) yield event;
      }
      from = Math.max(0, text.length - 1);
    }
  } finally {
    reader.cancel().catch(() => {}); // it may have ended already
  }
}

function parse(text) {
  const event = { kind: "message", id: "", data: "" };
  const data = [];
  for (const line of text.split("\n")) {
    const [name, value] = split(line);
    if (name === "event") event.kind = value;
    else if (name === "id") event.id = value;
    else if (name === "data") data.push(value);
  }
  event.data = data.join("\n");
  return data.length ? event : null;
}

function split(line) {
  const colon = line.indexOf(":");
  return colon < 0 ? [line, ""] : [line.slice(0, colon), line.slice(colon + 1).replace(/^ /, "")];
}
