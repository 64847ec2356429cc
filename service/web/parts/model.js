/** What the page knows of a version of a model: its objects, its merge tree, the names of its concepts. */
import * as api from "../api.js";
import { MergeTree } from "./merge_tree.js";
import { Thumbnails } from "./thumbnails.js";

/**
 * @typedef {Object} Model
 * @property {string} name
 * @property {number} version
 * @property {string} reference NAME:VERSION.
 * @property {number} epsilonMax filtration time at which concepts are taken unless another one is asked for.
 * @property {{object: number, key: string, map: number[]}[]} objects the training objects.
 * @property {MergeTree} tree
 * @property {Map<number, string>} names of concepts, by id.
 * @property {(string|null)[]} categories what people say of each object; null for none.
 * @property {number} labelled how many objects have a category.
 * @property {Thumbnails} thumbnails
 */

const KEPT = 3;
const known = new Map(); // promises, by reference
api.onKeyChange(() => known.clear());

/**
 * Loads a model; one that was loaded lately is kept, but for the names, which are asked for again.
 *
 * @param {string|null} reference NAME, NAME@ALIAS or NAME:VERSION; null for the service's default model.
 * @returns {Promise<Model>}
 */
export async function loadModel(reference) {
  const { name, version } = await resolve(reference);
  const exact = `${name}:${version}`;
  if (!known.has(exact)) {
    if (known.size >= KEPT) known.delete(known.keys().next().value);
    const loading = load(name, version, exact);
    loading.catch(() => known.delete(exact));
    known.set(exact, loading);
    return loading;
  }
  const model = await known.get(exact);
  await renew(model);
  return model;
}

/** Asks for the names of a model's concepts again. */
export async function renew(model) {
  const { names } = await api.get(`v1/models/${model.reference}/names`);
  model.names.clear();
  for (const { concept, name } of names) model.names.set(concept, name);
}

/** What a concept is called, or "Concept 433". */
export function titleOf(model, concept) {
  return model.names.get(concept) ?? `Concept ${concept}`;
}

/** The category that most objects of a concept have, and their share of those that have one; null if none has. */
export function purityOf(model, concept) {
  const counts = new Map();
  for (const object of model.tree.objectsOf(concept)) {
    const category = model.categories[object];
    if (category) counts.set(category, (counts.get(category) ?? 0) + 1);
  }
  if (!counts.size) return null;
  const labelled = [...counts.values()].reduce((sum, count) => sum + count, 0);
  const [category, count] = [...counts].sort((one, other) => other[1] - one[1] || one[0].localeCompare(other[0]))[0];
  return { category, share: count / labelled, labelled };
}

async function resolve(reference) {
  if (reference) {
    const { name, version } = await api.get(api.pathOf`v1/models/${reference}`);
    if (version === null)
      throw new api.Problem({
        status: 404,
        title: "No version is meant",
        detail: `${name} has no version in production: choose one.`,
      });
    return { name, version };
  }
  const { models } = await api.get("v1/models");
  const meant = models.find((model) => model.aliases.production) ?? models[0];
  if (!meant)
    throw new api.Problem({
      status: 404,
      title: "There is no model",
      detail: "The store holds no model yet: train one.",
    });
  return { name: meant.name, version: meant.aliases.production ?? meant.versions.at(-1) };
}

async function load(name, version, reference) {
  const path = `v1/models/${reference}`;
  const [concepts, graph, labels, named] = await Promise.all(
    // Of the concepts those of one time only: what is wanted are the objects, and of a large model each time is long.
    ["concepts?time=0", "annexations", "labels", "names"].map((what) => api.get(`${path}/${what}`)),
  );
  return {
    name,
    version,
    reference,
    epsilonMax: graph.epsilon_max,
    objects: concepts.objects,
    tree: new MergeTree(graph),
    names: new Map(named.names.map((entry) => [entry.concept, entry.name])),
    categories: labels.categories,
    labelled: labels.labelled,
    thumbnails: new Thumbnails(name, version),
  };
}
