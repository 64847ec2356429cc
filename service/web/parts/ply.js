/** The points that POST /v1/points sends: a binary PLY with x, y, z, and the place of each point in its file. */

/**
 * @typedef {Object} Drawn
 * @property {Float32Array} points x, y, z of each, metres: x right, y down, z forward from the sensor. Each beginning
 *   of them is an even sample of the cloud.
 * @property {Int32Array} places the place of each among the points of the file.
 * @property {number} count how many they are.
 * @property {number} measured how many points the sensor measured.
 * @property {number} inFile how many points the file holds.
 * @property {number[]} viewpoint the sensor's pose in the cloud's own frame: x, y, z (metres), qw, qx, qy, qz.
 */

const END = "end_header\n";
const ROW = 16; // bytes

/**
 * @param {ArrayBuffer} buffer
 * @returns {Drawn}
 */
export function readPoints(buffer) {
  const head = new TextDecoder("latin1").decode(new Uint8Array(buffer, 0, Math.min(buffer.byteLength, 2048)));
  const start = head.indexOf(END) + END.length;
  const said = (word) =>
    (head.match(new RegExp(`\\n(?:comment|element) ${word} (.+)\\n`))?.[1] ?? "").split(" ").map(Number);
  const [count] = said("vertex");
  const body = buffer.slice(start); // rows begin at a multiple of four
  const numbers = new Float32Array(body);
  const wholes = new Int32Array(body);
  if (body.byteLength !== count * ROW) throw new Error("The service's points were cut off on the way.");
  const points = new Float32Array(3 * count);
  const places = new Int32Array(count);
  for (let row = 0; row < count; row += 1) {
    for (let axis = 0; axis < 3; axis += 1) points[3 * row + axis] = numbers[4 * row + axis];
    places[row] = wholes[4 * row + 3];
  }
  return {
    points,
    places,
    count,
    measured: said("measured")[0],
    inFile: said("file")[0],
    viewpoint: said("viewpoint"),
  };
}
