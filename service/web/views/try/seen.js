/** What an answer says of each point that is drawn: its object, its segment, its visual words, its concept. */

/** The points of a cloud, and what is said of them. */
export class Seen {
  /**
   * @param {import("../../parts/ply.js").Drawn} drawn
   * @param {Object} answer of POST /v1/responses, with segments and an explanation; a scene's has `objects`.
   * @param {import("../../parts/model.js").Model} model that answered.
   * @param {boolean} scene
   */
  constructor(drawn, answer, model, scene) {
    Object.assign(this, { drawn, model, scene });
    this.answers = scene ? answer.objects.map((object) => object.answer) : [answer];
    this.objects = new Int32Array(drawn.count).fill(-1);
    this.segments = new Int32Array(drawn.count).fill(-1);
    if (scene) this.#splitScene(answer);
    else this.#take(answer.point_segments);
    this.up = scene ? intoSensorFrame(answer.plane.normal, drawn.viewpoint) : [0, -1, 0];
    this.assignments = new Map();
  }

  /** Number of levels of the dictionary. */
  get levels() {
    return this.answers.find(Boolean)?.explanation.segments[0]?.words.length ?? 0;
  }

  /** The visual word of a drawn point on a level, -1 for none. */
  word(point, level) {
    const segment = this.segments[point];
    return segment < 0 ? -1 : this.answers[this.objects[point]].explanation.segments[segment].words[level - 1];
  }

  /**
   * The concept of a drawn point, -1 for none. In a scene: the best one of its object. Of a lone object: the one, at
   * the answer's time, of the training object a part of which is most like the point's segment.
   */
  concept(point) {
    const object = this.objects[point];
    const answer = this.answers[object];
    if (!answer) return -1;
    if (this.scene) return answer.concepts[0]?.id ?? -1;
    const segment = this.segments[point];
    return segment < 0 ? -1 : this.#assignment(answer.time)[answer.explanation.segments[segment].nearest[0].object];
  }

  /** The height of a drawn point, metres: over the plane's normal, or over the camera's horizontal. */
  height(point) {
    return this.up.reduce((sum, value, axis) => sum + value * this.drawn.points[3 * point + axis], 0);
  }

  #assignment(time) {
    if (!this.assignments.has(time)) this.assignments.set(time, this.model.tree.assignmentAt(time));
    return this.assignments.get(time);
  }

  #take(ofFile) {
    this.drawn.places.forEach((place, point) => {
      this.segments[point] = ofFile[place];
      this.objects[point] = ofFile[place] < 0 ? -1 : 0;
    });
  }

  /** The segments of an object's answer are those of its points, in the order of the file. */
  #splitScene({ point_objects: objectOf }) {
    const met = new Int32Array(this.answers.length);
    const segmentOf = new Int32Array(objectOf.length).fill(-1);
    objectOf.forEach((object, place) => {
      if (object < 0) return;
      segmentOf[place] = this.answers[object]?.point_segments[met[object]] ?? -1;
      met[object] += 1;
    });
    this.drawn.places.forEach((place, point) => {
      this.objects[point] = objectOf[place];
      this.segments[point] = segmentOf[place];
    });
  }
}

/** A direction of the cloud's own frame in the sensor's: turned back by the pose's rotation. */
function intoSensorFrame([x, y, z], [, , , w, qx, qy, qz]) {
  const length = Math.hypot(w, qx, qy, qz);
  const [a, b, c, d] = [w / length, -qx / length, -qy / length, -qz / length];
  const t = [2 * (c * z - d * y), 2 * (d * x - b * z), 2 * (b * y - c * x)];
  return [x + a * t[0] + c * t[2] - d * t[1], y + a * t[1] + d * t[0] - b * t[2], z + a * t[2] + b * t[1] - c * t[0]];
}
