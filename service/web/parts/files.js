/** Files that a user picked: their bytes are read from the disk only when they are sent. */
import { Problem } from "../api.js";

/**
 * Why a file can no longer be read, or null. A request that sends it would only say that it failed.
 *
 * @param {File} file
 * @param {number} from byte from which on it is wanted.
 * @returns {Promise<?Problem>}
 */
export async function faultOf(file, from = 0) {
  try {
    await file.slice(from, from + 1).arrayBuffer();
    return null;
  } catch {
    return new Problem({
      status: 422,
      title: "The file cannot be read",
      detail: `${file.name ?? "The file"} is a folder, or was changed or taken away since it was picked: pick it again.`,
    });
  }
}
