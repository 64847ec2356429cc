/** What barcode and tree have in common: time runs from left to right, and its line can be dragged. */
import { Chart } from "../../parts/chart.js";
import { pageColour } from "../../parts/colours.js";

export const LEFT = 8; // pixels beside the axis
export const RIGHT = 14;
export const BOTTOM = 20; // pixels below, for its numbers
const STILL = 4; // pixels that a click may move

/**
 * A chart over time.
 *
 * @param {import("./selection.js").Selection} selection
 * @param {string} label what the chart shows.
 * @param {function(CanvasRenderingContext2D, function(number): number, number, number): void} paint draws it: told
 *   where a time is, width, and height without the axis.
 * @param {function(number, number): void} onPick told the time and the height of a click, pixels.
 */
export function timeChart(selection, label, paint, onPick) {
  const x = (time, width) => LEFT + time * (width - LEFT - RIGHT);
  const chart = new Chart(label, (context, width, height) => {
    context.clearRect(0, 0, width, height);
    paint(context, (time) => x(time, width), width, height - BOTTOM);
    drawAxis(context, (time) => x(time, width), height);
    drawLine(context, x(selection.time, width), height - BOTTOM);
  });
  const timeAt = (event) => (chart.at(event)[0] - LEFT) / (chart.element.clientWidth - LEFT - RIGHT);
  let pressed = null;
  chart.canvas.addEventListener("pointerdown", (event) => {
    chart.canvas.setPointerCapture(event.pointerId);
    pressed = { x: event.clientX, dragging: false };
  });
  chart.canvas.addEventListener("pointermove", (event) => {
    if (!pressed) return;
    pressed.dragging ||= Math.abs(event.clientX - pressed.x) > STILL;
    if (pressed.dragging) selection.setTime(timeAt(event), false);
  });
  chart.canvas.addEventListener("pointerup", (event) => {
    if (pressed?.dragging) selection.setTime(timeAt(event));
    else if (pressed) onPick(timeAt(event), chart.at(event)[1]);
    pressed = null;
  });
  chart.canvas.addEventListener("pointercancel", () => (pressed = null));
  chart.element.classList.add("over-time");
  return chart;
}

function drawAxis(context, x, height) {
  context.fillStyle = pageColour("faint");
  context.strokeStyle = pageColour("line");
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "center";
  context.beginPath();
  for (const time of [0, 0.25, 0.5, 0.75, 1]) {
    context.moveTo(x(time) + 0.5, height - BOTTOM);
    context.lineTo(x(time) + 0.5, height - BOTTOM + 4);
    context.fillText(time, x(time), height - 4);
  }
  context.moveTo(x(0), height - BOTTOM + 0.5);
  context.lineTo(x(1), height - BOTTOM + 0.5);
  context.stroke();
}

function drawLine(context, at, height) {
  context.strokeStyle = pageColour("ink");
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(at, 0);
  context.lineTo(at, height);
  context.stroke();
  context.fillStyle = pageColour("accent");
  context.beginPath();
  context.arc(at, height - 7, 7, 0, 2 * Math.PI);
  context.fill();
}
