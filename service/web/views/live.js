/** Live: the clouds that robots publish over zenoh, and their answers, as they come. */
import { get } from "../api.js";
import { h } from "../parts/elements.js";
import { follow } from "../parts/events.js";
import { empty, failure, loading } from "../parts/states.js";
import { Detail } from "./live/detail.js";
import { Robots } from "./live/robots.js";

/** @param {HTMLElement} root @param {import("../place.js").Place} place */
export function show(root, place) {
  const view = new Live(root, place);
  view.load();
  return { changed: () => view.changed(), leave: () => view.leave() };
}

class Live {
  constructor(root, place) {
    this.root = root;
    this.place = place;
    this.leaving = new AbortController();
    this.paused = false;
    this.robots = new Robots((key) => this.choose(key, { push: true }));
    this.detail = new Detail();
    this.state = h("span", { class: "badge", role: "status" });
    this.why = h("div");
    this.stream = h("select", { change: () => this.chooseStream(), "aria-label": "Stream" });
    this.pause = h("button", { type: "button", "aria-pressed": "false", click: () => this.turn() }, "Pause");
    this.nothing = h("div");
    this.shown = h("div", { class: "live hidden" }, this.robots.element, this.detail.element);
  }

  async load() {
    const title = h("h1", { class: "unseen" }, "Live");
    this.root.replaceChildren(title, loading());
    try {
      const { streams } = await get("v1/streams", { signal: this.leaving.signal });
      if (!streams.length) this.root.replaceChildren(title, noStreams());
      else this.begin(streams);
    } catch (error) {
      if (!this.leaving.signal.aborted) {
        this.root.replaceChildren(title, failure(error, { again: () => this.load() }));
      }
    }
  }

  begin(streams) {
    const keys = [...new Set(streams.map((stream) => stream.key))];
    const wanted = this.place.get("stream");
    this.stream.replaceChildren(h("option", { value: "" }, "all streams"),
      ...keys.map((key) => h("option", { value: key, selected: key === wanted }, key)));
    this.nothing.replaceChildren(nothingYet(keys));
    this.root.replaceChildren(
      h("h1", { class: "unseen" }, "Live"),
      h("div", { class: "live-head" }, this.stream, this.pause, this.state),
      this.why,
      this.nothing,
      this.shown,
    );
    this.chosen = this.place.get("key");
    this.robots.choose(this.chosen);
    this.detail.clear(this.chosen);
    // Nobody sees a page in the background: the service need not work for it.
    document.addEventListener("visibilitychange", () => this.connect(), { signal: this.leaving.signal });
    this.ticking = setInterval(() => this.robots.tick(), 1000);
    this.connect();
  }

  /** Watches anew: what is asked for has changed. Only the robot that is looked at sends its points. */
  async connect() {
    this.watching?.abort();
    if (this.paused || document.hidden) return;
    const watching = new AbortController();
    this.watching = watching;
    const signal = AbortSignal.any([watching.signal, this.leaving.signal]);
    this.asked = this.chosen;
    this.tell("connecting");
    try {
      await follow("v1/streams/events", {
        signal,
        query: { stream: this.stream.value || null, key: this.asked },
        connected: (is, why) => this.tell(is ? "live" : "lost", why),
        on: ({ kind, data }) => { if (kind === "cloud") this.take(JSON.parse(data)); },
      });
    } catch (error) {
      if (signal.aborted) return;
      this.tell("refused");
      this.why.replaceChildren(failure(error, { again: () => this.connect() }));
    }
  }

  /** Shows a cloud; one that cannot be shown, of a replica of another release, keeps nobody from the next. */
  take(told) {
    try {
      this.came(told);
    } catch (error) {
      this.why.replaceChildren(failure(error));
    }
  }

  came(told) {
    if (!this.chosen) this.choose(told.key);
    this.robots.add(told);
    this.nothing.replaceChildren();
    this.shown.classList.remove("hidden");
    if (told.key === this.chosen) this.detail.show(told);
    else if (!this.asked) this.connect(); // of all others, no points are needed
  }

  choose(key, { push = false } = {}) {
    const other = this.chosen !== key;
    this.chosen = key;
    this.robots.choose(key);
    this.place.set({ key }, { push });
    if (!other) return;
    const last = this.robots.last(key);
    if (last) this.detail.show(last);
    else this.detail.clear(key);
    if (push) this.connect();
  }

  chooseStream() {
    this.place.set({ stream: this.stream.value || null, key: null }, { push: true });
    this.forget();
    this.connect();
  }

  /** What one stream has shown is nothing of another one. */
  forget() {
    this.chosen = null;
    this.robots.clear();
    this.detail.clear();
    this.shown.classList.add("hidden");
    this.nothing.replaceChildren(nothingYet(this.stream.value ? [this.stream.value]
      : [...this.stream.options].slice(1).map((option) => option.value)));
  }

  turn() {
    this.paused = !this.paused;
    this.pause.textContent = this.paused ? "Go on" : "Pause";
    this.pause.setAttribute("aria-pressed", String(this.paused));
    this.connect();
    if (this.paused) this.tell("paused");
  }

  /** Says how the connection stands. @param {string} state @param {?Error} why it is lost. */
  tell(state, why = null) {
    const words = { live: "live", lost: "connection lost, trying again …", connecting: "connecting …",
      paused: "paused", refused: "refused" };
    this.state.textContent = words[state];
    this.state.className = `badge badge-${{ live: "done", lost: "failed", refused: "failed" }[state] ?? state}`;
    this.why.replaceChildren(...(why?.detail ? [h("p", { class: "note" }, why.detail)] : []));
  }

  changed() {
    if (!this.ticking) return; // it begins with what the URL says by then
    const wanted = this.place.get("stream");
    const stream = [...this.stream.options].some((option) => option.value === wanted) ? wanted : "";
    if (stream !== this.stream.value) {
      this.stream.value = stream;
      this.forget();
      this.chosen = this.place.get("key");
      this.robots.choose(this.chosen);
      this.detail.clear(this.chosen);
      this.connect();
    } else if (this.place.get("key") && this.place.get("key") !== this.chosen) {
      this.choose(this.place.get("key"));
      this.connect();
    }
  }

  leave() {
    this.leaving.abort();
    clearInterval(this.ticking);
    this.detail.close();
  }
}

function noStreams() {
  return empty("This service answers no streams yet.", h("p", {}, "An operator sets them up, for instance:"),
    h("pre", { class: "log" }, "SHAPE_CONCEPTS_ZENOH_CONNECT=tcp/ROUTER:7447\n"
      + "SHAPE_CONCEPTS_STREAMS='[{\"key\": \"robots/*/cloud\"}]'"));
}

function nothingYet(keys) {
  return empty("Nothing has come yet. Whatever cloud is published over zenoh on ",
    h("p", {}, keys.map((key, place) => [place > 0 && " or ", h("code", {}, key)])),
    h("p", {}, "appears here, answered."));
}
