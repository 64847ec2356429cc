/** Files into a dataset: small ones together, archives in pieces, so that one sees how far it is and loses nothing. */
import { get, pathOf, Problem, request } from "../../api.js";
import { passes, pause } from "../../parts/events.js";
import { faultOf } from "../../parts/files.js";
import { pack } from "./tar.js";

const TOGETHER = 8 * 2 ** 20; // bytes of files that are sent as one
const MANY = 24; // files that are
const PIECE = 8 * 2 ** 20; // bytes of an archive that are sent at a time
const SMALLEST = 256 * 2 ** 10; // bytes of a piece that the service takes, unless it is the last
const TRIES = 5; // of a request while the service cannot be reached or has too much to do
const ARCHIVE = /\.(zip|tar|tgz|tar\.gz)$/i;
const TAR = "application/x-tar";

/** @typedef {{key: string, outcome: string, error: ?{type: string, detail: string}}} Verdict on a file. */

/**
 * Sends files.
 *
 * @param {string} dataset name of the one that they are added to.
 * @param {import("./dropped.js").Dropped[]} files clouds, archives of clouds, and labels.csv, in folders or not.
 * @param {Object} how
 * @param {AbortSignal} how.signal stops it; what was taken stays.
 * @param {?string} how.unit of the coordinates; null: their own, or metres.
 * @param {boolean} how.replace whether clouds may stand in the place of others of their keys.
 * @param {function(number): void} how.sent is told the bytes that have been sent.
 * @returns {AsyncGenerator<Verdict[]>} verdicts as they come.
 * @throws {Problem} the dataset is not there, or may not be altered, or the service cannot be reached.
 */
export async function* send(dataset, files, { signal, unit, replace, sent }) {
  const how = { path: pathOf`v1/datasets/${dataset}`, signal, unit, replace: replace || null, sent };
  const archives = files.filter(({ file }) => ARCHIVE.test(file.name));
  const labels = files.filter(({ file }) => file.name === "labels.csv");
  const clouds = files.filter((one) => !archives.includes(one) && !labels.includes(one));
  for (const { path, file } of archives) yield refusedOr(path, () => inPieces(file, how));
  for (const group of groups(clouds)) yield* those(group, how);
  if (labels.length) yield* those(labels, how); // last, when the clouds are there
}

function* groups(files) {
  let group = [];
  let size = 0;
  for (const one of files) {
    if (group.length && (group.length >= MANY || size + one.file.size > TOGETHER)) {
      yield group;
      [group, size] = [[], 0];
    }
    group.push(one);
    size += one.file.size;
  }
  if (group.length) yield group;
}

/** Sends those files of a group that can be read. */
async function* those(files, how) {
  const faults = await Promise.all(files.map(({ file }) => faultOf(file)));
  const gone = files.filter((_, place) => faults[place]);
  if (gone.length) {
    how.sent(sizeOf(gone));
    yield gone.map((one) => refusal(one.path, faults[files.indexOf(one)]));
  }
  const there = files.filter((_, place) => !faults[place]);
  if (there.length) yield* together(there, how);
}

/** Sends files as one archive; where that is refused as a whole, by halves, so that what is good of it is taken. */
async function* together(files, how) {
  const verdicts = await refusedOr(files.length === 1 ? files[0].path : null, () => archive(pack(files), how));
  if (verdicts) {
    how.sent(sizeOf(files));
    yield verdicts;
    return;
  }
  const half = Math.ceil(files.length / 2);
  yield* together(files.slice(0, half), how);
  yield* together(files.slice(half), how);
}

/** Verdicts; if the whole is refused, that of the file, or null where it is not one file alone. */
async function refusedOr(path, work) {
  try {
    return await work();
  } catch (error) {
    const itsOwnFault = error instanceof Problem && [400, 413, 415, 422].includes(error.status);
    if (!itsOwnFault) throw error;
    if (path === null) return null;
    return [refusal(path, error)];
  }
}

function refusal(path, { type, detail }) {
  return { key: path, outcome: "refused", error: { type, detail } };
}

function sizeOf(files) {
  return files.reduce((total, { file }) => total + file.size, 0);
}

async function archive(body, { path, signal, unit, replace }) {
  const options = { method: "POST", query: { unit, replace }, body, signal, headers: { "Content-Type": TAR } };
  return (await (await patiently(() => request(`${path}/archive`, options), signal)).json()).verdicts;
}

async function inPieces(file, { path, signal, unit, replace, sent }) {
  const begun = await patiently(() => begin(file, { path, signal, unit, replace }), signal);
  const place = `${path}/uploads/${begun.id}`;
  let [offset, piece] = [begun.offset, PIECE];
  while (offset < file.size) {
    const before = offset;
    const fault = await faultOf(file, offset);
    if (fault) throw fault; // otherwise it would be tried for ever
    try {
      const body = file.slice(offset, offset + piece);
      const headers = { "Content-Type": "application/offset+octet-stream", "Upload-Offset": String(offset) };
      const answer = await request(place, { method: "PATCH", body, headers, signal });
      offset = (await answer.json()).offset;
    } catch (error) {
      if (error.status === 413 && piece > SMALLEST) piece = Math.max(SMALLEST, Math.floor(piece / 2));
      else if (!(error instanceof Problem) || !(passes(error) || error.status === 409)) throw error;
      else offset = (await patiently(() => get(place, { signal }), signal)).offset; // it may have arrived all the same
    }
    sent(offset - before);
  }
  const finish = () => request(`${place}/finish`, { method: "POST", signal });
  return (await (await patiently(finish, signal)).json()).verdicts;
}

function begin(file, { path, signal, unit, replace }) {
  return get(`${path}/uploads`, { json: { length: file.size, unit, replace: Boolean(replace) }, signal });
}

/** Tries again while the service cannot be reached or has too much to do. Everything here may be done twice. */
async function patiently(work, signal) {
  for (let tries = 1; ; tries += 1) {
    try {
      return await work();
    } catch (error) {
      if (!(error instanceof Problem) || !passes(error) || error.status === 500 || tries >= TRIES) throw error;
      await pause(1000 * tries, signal);
    }
  }
}
