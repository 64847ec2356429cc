/** Files that a user dropped or picked, and those in folders among them. */

/** @typedef {{path: string, file: File}} Dropped a file, and its path in what was dropped. */

/**
 * All files of a drop.
 *
 * @param {DataTransfer} transfer of the drop; it is empty as soon as the event is over.
 * @returns {Promise<Dropped[]>}
 */
export async function filesOf(transfer) {
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
  if (!entries.length) return [...transfer.files].map((file) => ({ path: file.name, file }));
  return (await Promise.all(entries.map(filesBelow))).flat();
}

/** All files of a field. @param {HTMLInputElement} field @returns {Dropped[]} */
export function filesIn(field) {
  return [...field.files].map((file) => ({ path: file.webkitRelativePath || file.name, file }));
}

async function filesBelow(entry) {
  const path = entry.fullPath.replace(/^\//, "");
  if (entry.isFile) return [{ path, file: await new Promise((found, failed) => entry.file(found, failed)) }];
  const below = [];
  const reader = entry.createReader();
  for (;;) {
    const some = await new Promise((found, failed) => reader.readEntries(found, failed)); // a hundred at a time
    if (!some.length) return below.flat();
    below.push(...(await Promise.all(some.map(filesBelow))));
  }
}
