/** The objects of a scene, of which one is shown. */
import { counted, h } from "../../parts/elements.js";
import { titleOf } from "../../parts/model.js";

/**
 * @param {Object} answer of a scene.
 * @param {import("../../parts/model.js").Model} model
 * @param {number|null} chosen number of the object that is shown.
 * @param {function(number): void} onChoose
 */
export function objectsPanel(answer, model, chosen, onChoose) {
  const centimetres = (metres) => (100 * metres).toFixed(0);
  const entry = (object) => {
    const best = object.answer?.concepts[0];
    const said = best ? titleOf(model, best.id) : "not answered";
    const size = `${object.box.size_m.map(centimetres).join(" × ")} cm, ${object.distance_m.toFixed(2)} m away`;
    return h(
      "button",
      {
        type: "button",
        class: "object",
        "aria-pressed": String(object.number === chosen),
        click: () => onChoose(object.number),
      },
      h("span", { class: "mark" }, object.number),
      h("span", {}, said, h("span", { class: "fine block" }, size)),
    );
  };
  const standing = answer.objects.length === 1 ? "1 object stands" : `${answer.objects.length} objects stand`;
  return h(
    "section",
    { class: "panel", "aria-label": "Objects of the scene" },
    h("h2", {}, `${standing} on the plane`),
    answer.warnings.map((warning) => h("p", { class: "warning" }, warning)),
    h("div", { class: "objects" }, answer.objects.map(entry)),
    answer.left_out.length > 0 &&
      h(
        "p",
        { class: "fine" },
        "Left out: ",
        answer.left_out.map((left) => `${counted(left.points)} points, ${left.detail}`).join("; "),
        ".",
      ),
  );
}
