import { empty } from "../parts/states.js";

/** @param {HTMLElement} root @param {import("../place.js").Place} place */
export function show(root, place) {
  root.append(empty(""));
}
