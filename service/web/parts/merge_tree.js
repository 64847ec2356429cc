/**
 * The merge tree of a model's filtration: which concepts exist at a time, of which objects, in which colour.
 *
 * Nodes 0 to N-1 are the training objects; node N + k is what the annexation of place k made. A concept is a node of at
 * least two objects; it exists from its own time until its parent's. Each annexation is also the end of a bar of the
 * barcode: that of the object that represented the smaller component. A concept has the colour of the bar of the object
 * that represents it, so that it keeps its colour when it annexes smaller ones. Long bars come first among the colours.
 */
import { colourOf } from "./colours.js";

export class MergeTree {
  /** @param {{edges: number[][], time: number[], order: number[]}} graph of GET /v1/models/{model}/annexations. */
  constructor({ edges, time, order }) {
    const leaves = edges.length + 1;
    this.leaves = leaves;
    const nodes = 2 * leaves - 1;
    this.time = new Float64Array(nodes); // at which it came to be
    this.size = new Int32Array(nodes).fill(1);
    this.parent = new Int32Array(nodes).fill(-1);
    this.children = new Int32Array(2 * nodes).fill(-1); // of node v at 2v: the one that sustains, the one taken in
    this.representative = Int32Array.from({ length: nodes }, (_, node) => (node < leaves ? node : -1));
    this.death = new Float64Array(leaves).fill(Infinity); // of the bar of each object
    this.#join(edges, time, order);
    this.#arrange();
    this.moments = [...new Set(time)].sort((one, other) => one - other);
    this.bars = Int32Array.from({ length: leaves }, (_, leaf) => leaf);
    this.bars.sort((one, other) => this.death[other] - this.death[one] || one - other);
    this.rank = new Int32Array(leaves); // of each object's bar, the longest first
    this.bars.forEach((leaf, rank) => (this.rank[leaf] = rank));
  }

  /** The concepts at a time: nodes, the largest first; of equal ones the one with the first object. */
  conceptsAt(time) {
    const made = this.madeUntil(time);
    const found = [];
    for (let node = this.leaves; node < this.leaves + made; node += 1) {
      if (this.parent[node] < 0 || this.parent[node] >= this.leaves + made) found.push(node);
    }
    const first = new Map(
      found.map((node) => [node, this.objectsOf(node).reduce((one, other) => Math.min(one, other))]),
    );
    return found.sort((one, other) => this.size[other] - this.size[one] || first.get(one) - first.get(other));
  }

  /** How many annexations there were until a time. */
  madeUntil(time) {
    let [low, high] = [0, this.leaves - 1];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[this.leaves + middle] <= time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** The objects of a node, in the order of the tree. */
  objectsOf(node) {
    return this.arranged.subarray(this.first[node], this.first[node] + this.size[node]);
  }

  /** The concept that a node is, or is part of, at a time; before it came to be, the largest that becomes part. */
  conceptFor(node, time) {
    const last = this.leaves + this.madeUntil(time);
    let found = node;
    while (found >= last) {
      const [one, other] = [this.children[2 * found], this.children[2 * found + 1]];
      found = this.size[one] >= this.size[other] ? one : other;
    }
    while (this.parent[found] >= 0 && this.parent[found] < last) found = this.parent[found];
    return found >= this.leaves ? found : -1;
  }

  /** Whether a node is a concept at some time: of annexations at one time, only the last makes one. */
  isConcept(node) {
    return node >= this.leaves && node < 2 * this.leaves - 1 && this.conceptFor(node, this.time[node]) === node;
  }

  /** The concept of each object at a time, -1 for none. */
  assignmentAt(time) {
    const assigned = new Int32Array(this.leaves).fill(-1);
    for (const concept of this.conceptsAt(time)) for (const leaf of this.objectsOf(concept)) assigned[leaf] = concept;
    return assigned;
  }

  /** The colour of a node: of the bar of the object that represents it; grey for none. */
  colour(node) {
    return node < 0 ? colourOf(-1) : colourOf(this.rank[this.representative[node]]);
  }

  #join(edges, time, order) {
    const top = Int32Array.from({ length: this.leaves }, (_, leaf) => leaf); // node of the component of a root
    const root = Int32Array.from(top);
    const find = (leaf) => {
      while (root[leaf] !== leaf) leaf = root[leaf] = root[root[leaf]];
      return leaf;
    };
    const rows = Int32Array.from({ length: edges.length }, (_, row) => row).sort(
      (one, other) => order[one] - order[other],
    );
    rows.forEach((row, k) => {
      const [annexed, annexing] = edges[row];
      const [one, other] = [find(annexing), find(annexed)];
      const node = this.leaves + k;
      this.children[2 * node] = top[one];
      this.children[2 * node + 1] = top[other];
      this.parent[top[one]] = this.parent[top[other]] = node;
      this.size[node] = this.size[top[one]] + this.size[top[other]];
      this.time[node] = time[row];
      this.representative[node] = annexing;
      this.death[annexed] = time[row];
      root[other] = one;
      top[one] = node;
    });
  }

  /** Puts the objects in an order in which those of each node stand together. */
  #arrange() {
    const nodes = 2 * this.leaves - 1;
    this.first = new Int32Array(nodes);
    this.arranged = new Int32Array(this.leaves);
    for (let node = nodes - 1; node >= this.leaves; node -= 1) {
      const [one, other] = [this.children[2 * node], this.children[2 * node + 1]];
      this.first[one] = this.first[node];
      this.first[other] = this.first[node] + this.size[one];
    }
    for (let leaf = 0; leaf < this.leaves; leaf += 1) this.arranged[this.first[leaf]] = leaf;
  }
}
