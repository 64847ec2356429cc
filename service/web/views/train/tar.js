/** Files packed as a tar, so that a whole folder and its labels are one request. Nothing is read into memory. */
const BLOCK = 512;
const NAME = 100; // bytes of a name that a plain header takes

/** @param {import("./dropped.js").Dropped[]} files @returns {Blob} */
export function pack(files) {
  const parts = [];
  for (const { path, file } of files) {
    const name = new TextEncoder().encode(path);
    if (name.length > NAME || name.length !== path.length) {
      const said = longName(path);
      parts.push(header("pax", said.length, "x"), said, padding(said.length));
    }
    parts.push(header(path, file.size, "0"), file, padding(file.size));
  }
  return new Blob([...parts, new Uint8Array(2 * BLOCK)]);
}

/** A header as POSIX has it ("ustar"). A name that is too long for it stands in the header before. */
function header(path, size, kind) {
  const block = new Uint8Array(BLOCK);
  const write = (text, at, room) => block.set(new TextEncoder().encode(text).slice(0, room), at);
  write(path, 0, NAME);
  write("0000644\0", 100, 8);
  write("0000000\0", 108, 8);
  write("0000000\0", 116, 8);
  write(`${size.toString(8).padStart(11, "0")}\0`, 124, 12);
  write("00000000000\0", 136, 12);
  write("        ", 148, 8); // the checksum counts as blanks
  write(kind, 156, 1);
  write("ustar\x0000", 257, 8);
  const sum = block.reduce((total, octet) => total + octet, 0);
  write(`${sum.toString(8).padStart(6, "0")}\0 `, 148, 8);
  return block;
}

/** The extended header of a name (pax): "LENGTH path=NAME\n", where the length counts its own digits. */
function longName(path) {
  const rest = new TextEncoder().encode(` path=${path}\n`).length;
  let length = rest + String(rest).length;
  if (String(length).length > String(rest).length) length += 1;
  return new TextEncoder().encode(`${length} path=${path}\n`);
}

function padding(size) {
  return new Uint8Array((BLOCK - (size % BLOCK)) % BLOCK);
}
