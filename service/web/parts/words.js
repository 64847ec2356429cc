/** Numbers, times and lengths of time as people read them. */
import { h } from "./elements.js";

/** A moment, exact in its title. @param {string|null} iso @returns {Node|string} */
export function when(iso) {
  if (!iso) return "–";
  const date = new Date(iso);
  const sameDay = date.toDateString() === new Date().toDateString();
  const time = { hour: "2-digit", minute: "2-digit", second: sameDay ? "2-digit" : undefined };
  const said = sameDay ? time : { year: "numeric", month: "short", day: "numeric", ...time };
  return h("time", { datetime: iso, title: date.toLocaleString() }, date.toLocaleString(undefined, said));
}

/** A length of time, as "2 min 5 s". @param {number} seconds */
export function duration(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(whole / 3600)} h ${Math.floor((whole % 3600) / 60)} min`;
}

/** A number of bytes, as "3.4 MB". */
export function bytes(count) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let place = 0;
  for (; count >= 1000 && place < units.length - 1; place += 1) count /= 1000;
  return `${place && count < 10 ? count.toFixed(1) : Math.round(count)} ${units[place]}`;
}

/** How many there are of something, as "1 cloud" and "3 clouds". */
export function count(number, one, many = `${one}s`) {
  return `${number.toLocaleString("en")} ${number === 1 ? one : many}`;
}
