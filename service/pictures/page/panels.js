// A cloud, and what stands beside it: the concepts that it resembles, why, and how long it took. The modules are those of
// the service's page. Text is always set as text.
import { CloudView } from "cloud_view";
import { toPixel } from "colours";
import { h as make } from "elements";

function unpack(text, Type) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Type(bytes.buffer);
}

function bar(share, colour) {
  const filled = make("i");
  filled.style.width = `${(100 * share).toFixed(1)}%`;
  if (colour) filled.style.background = colour;
  return make("span", { class: "bar" }, filled);
}

function concepts(answer) {
  const row = (concept) =>
    make(
      "li",
      { title: `distance ${concept.distance.toFixed(3)} (Eq. 4), ${concept.prototypes} prototypes, time ${concept.time.toFixed(2)}` },
      make("span", { class: "name" }, concept.called),
      bar(concept.closeness, concept.colour),
      make("span", {}, concept.response.toFixed(2)),
    );
  const others = answer.concepts.filter((concept) => concept.time !== answer.time);
  const rows = answer.concepts.filter((concept) => !others.includes(concept)).map(row);
  const apart = others.length > 0 && [make("h3", {}, "Of other filtration times"), make("ol", { class: "bars" }, ...others.map(row))];
  const note = `The longer the bar, the closer; the number is the response, smaller is closer. The first ${answer.concepts.length} of ${answer.of} concepts.`;
  return make("section", { class: "block" }, make("h2", {}, "Concepts, best first"), make("ol", { class: "bars" }, ...rows), apart, make("p", { class: "pale", style: "margin-top:8px" }, note));
}

function novelty(answer) {
  const said = answer.novelty >= 0.95 ? "unlike what was learned" : answer.novelty >= 0.75 ? "rather new" : "like what was learned";
  const row = make("li", {}, make("span", {}, answer.novelty.toFixed(2)), bar(answer.novelty), make("span", {}));
  return make("section", { class: "block" }, make("h2", {}, "Novelty"), make("ol", { class: "bars" }, row), make("p", { class: "pale", style: "margin:6px 0 0" }, said));
}

function thumbnails(near, picture) {
  return make(
    "div",
    { class: "thumbnails" },
    ...near.map((one) =>
      make("figure", {}, make("img", { src: picture.thumbnails[one.object], alt: one.key, width: 76, height: 76 }), `${one.key}, ${one.distance.toPrecision(3)}`),
    ),
  );
}

function prototypes(picture) {
  const why = picture.answer.explanation;
  const names = new Map(picture.answer.concepts.map((concept) => [concept.id, concept.called]));
  const best = why.concepts.flatMap((concept) => [
    make("h3", {}, names.get(concept.id) || `concept ${concept.id}`),
    thumbnails(concept.nearest, picture),
  ]);
  return make(
    "section",
    { class: "block" },
    make("h2", {}, "Prototypes of the best concepts"),
    make("p", { class: "pale" }, "Training objects of the concept nearest to this cloud, with their distances."),
    ...best,
    make("h3", {}, "Most like the cloud as a whole"),
    thumbnails(why.wholes, picture),
  );
}

function motifs(picture, highlight) {
  const fired = picture.answer.explanation.vertices;
  const buttons = fired.map((vertex, place) => {
    const button = make(
      "button",
      { type: "button", "aria-pressed": "false", title: `vertex ${vertex.vertex} of H_${vertex.hierarchy}; words ${vertex.words.join(", ")}; ${vertex.prototypes} motif prototypes` },
      make("img", { src: picture.thumbnails[vertex.nearest[0].object], alt: vertex.nearest[0].key, width: 36, height: 36 }),
      make("span", { class: "name" }, picture.answer.motifs[place]),
      make("span", {}, vertex.stimulus.toFixed(3)),
    );
    button.addEventListener("click", () => {
      const on = button.getAttribute("aria-pressed") !== "true";
      for (const other of buttons) other.setAttribute("aria-pressed", String(on && other === button));
      highlight(on ? vertex.segments : null);
    });
    return button;
  });
  return make(
    "section",
    { class: "block late" },
    make("h2", {}, "Why: the motifs that fired"),
    make("p", { class: "pale" }, "Strongest first, each with the training object that it remembers best, and its stimulus. Choose one to see the segments that it covers."),
    make("ul", { class: "motifs" }, ...buttons.map((button) => make("li", {}, button))),
  );
}

function times(answer, colours) {
  const stages = Object.entries(answer.timings_ms);
  const all = stages.reduce((sum, [, time]) => sum + time, 0);
  const parts = stages.map(([stage, time], i) =>
    make("i", { style: `width:${(100 * time) / all}%;background:${colours[i % colours.length]}`, title: `${stage}: ${time.toFixed(1)} ms` }),
  );
  const legend = stages.map(([stage, time], i) =>
    make("li", {}, make("i", { style: `background:${colours[i % colours.length]}` }), `${stage} ${time.toFixed(1)} ms`),
  );
  return make("section", { class: "block late" }, make("h2", {}, `Time per stage: ${all.toFixed(0)} ms`), make("div", { class: "stages" }, ...parts), make("ul", { class: "legend" }, ...legend));
}

function legend(colouring, used) {
  if (colouring.by === "height") {
    const ends = make("i", { style: `background:linear-gradient(90deg, ${colouring.colours.join(", ")})` });
    return [make("li", { class: "scale" }, colouring.labels[0], ends, colouring.labels[1])];
  }
  return colouring.labels.flatMap((label, place) => (used.has(place) ? [make("li", {}, make("i", { style: `background:${colouring.colours[place]}` }), label)] : []));
}

function cloud(picture) {
  const view = new CloudView({ label: `The cloud of ${picture.title}` });
  view.setPoints(Float32Array.from(unpack(picture.points, Int16Array), (steps) => steps * picture.step));
  const segments = unpack(picture.segments, Int16Array);
  const highlight = (chosen) => view.setHighlight(chosen && Uint8Array.from(segments, (segment) => chosen.includes(segment)));
  const keys = make("ul", { class: "legend" });
  const buttons = picture.colourings.map((colouring) => {
    const places = unpack(colouring.values, Uint16Array);
    const pixels = colouring.colours.map(toPixel);
    const colours = Uint32Array.from(places, (place) => pixels[place]);
    const used = new Set(places);
    const choose = () => {
      for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
      view.setColours(colours);
      keys.replaceChildren(...legend(colouring, used));
    };
    const button = make("button", { type: "button", click: choose }, colouring.by);
    return button;
  });
  buttons[0].click();
  const shown = picture.of > segments.length ? `${segments.length} of ${picture.of} points are drawn. ` : `${picture.of} points. `;
  const block = make(
    "section",
    { class: "block" },
    make("div", { class: "choices", role: "group", "aria-label": "Coloured by" }, make("span", { class: "pale" }, "Coloured by"), buttons),
    view.element,
    keys,
    make("p", { class: "pale" }, `${shown}Drag or arrow keys turn, shift-drag moves, + and - or pinching zoom, Home goes back.`),
  );
  return [block, highlight];
}

function panel(picture, colours) {
  const answer = picture.answer;
  const said = answer && `${answer.model}:${answer.version} at time ${answer.time.toFixed(2)}: ${answer.segments} segments, ${(100 * answer.extent_m).toFixed(1)} cm across`;
  const [block, highlight] = cloud(picture);
  const left = make("div", {}, block, answer && motifs(picture, highlight), answer && times(answer, colours));
  const right = answer && make("div", {}, concepts(answer), novelty(answer), prototypes(picture));
  return [
    make("h1", {}, picture.title),
    said && make("p", { class: "pale" }, said),
    ...picture.notes.map((note) => make("p", { class: "pale" }, note)),
    make("div", { class: answer ? "panel" : "panel alone" }, left, right),
  ].filter((part) => part);
}

const { pictures, colours } = JSON.parse(document.getElementById("data").textContent);
document.getElementById("pictures").replaceChildren(...pictures.flatMap((picture) => panel(picture, colours)));
