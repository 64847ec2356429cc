/** A canvas that is drawn anew when its size changes, or the page becomes light or dark. */
import { onLightChange } from "./colours.js";
import { h } from "./elements.js";

export class Chart {
  /**
   * @param {string} label what it shows, for those who do not see it.
   * @param {function(CanvasRenderingContext2D, number, number): void} paint draws it: told width and height in CSS
   *   pixels, which are the units of the context.
   */
  constructor(label, paint) {
    this.paint = paint;
    this.canvas = h("canvas", { role: "img", "aria-label": label });
    this.element = h("div", { class: "chart" }, this.canvas);
    this.resizing = new ResizeObserver(() => this.redraw());
    this.resizing.observe(this.element);
    this.endLight = onLightChange(() => this.redraw());
  }

  /** Draws it with the next frame; asked for several times before, once. */
  redraw() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      const { clientWidth: width, clientHeight: height } = this.element;
      if (!width || !height) return;
      const scale = Math.min(devicePixelRatio || 1, 2);
      this.canvas.width = Math.round(width * scale);
      this.canvas.height = Math.round(height * scale);
      const context = this.canvas.getContext("2d");
      context.scale(scale, scale);
      this.paint(context, width, height);
    });
  }

  /** Where an event happened, in the units of `paint`. */
  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  /** Ends its listening. */
  close() {
    this.resizing.disconnect();
    this.endLight();
    cancelAnimationFrame(this.frame);
  }
}
