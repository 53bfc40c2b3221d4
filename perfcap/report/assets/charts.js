// Curves over frames, drawn in SVG: a click goes to the frame, a drag scrubs.

const SVG = "http://www.w3.org/2000/svg";
const HEIGHT = 100; // of the drawing's own units; its width is one unit a frame

/** An SVG element with attributes. */
export function drawn(tag, attributes, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

function built(tag, name, ...children) {
  const element = document.createElement(tag);
  if (name) element.className = name;
  element.append(...children);
  return element;
}

export class Chart {
  constructor(chart, data, player) {
    this.chart = chart;
    this.data = data;
    this.player = player;
    this.stacks = stacked(chart);
    this.range = niceRange(this.stacks.flat());
    this.values = chart.lines.map(() => built("b", ""));
    this.plot = this.drawPlot();
    this.element = this.build();
    this.update();
  }

  build() {
    const { chart } = this;
    const head = built("div", "chart-head", built("h3", "", chart.title), this.worstButton());
    const legend = built("ul", "legend", ...chart.lines.map((line, index) => (
      built("li", `line-${index % 6}`, built("i", ""), `${line.name} `, this.values[index])
    )));
    legend.setAttribute("aria-hidden", "true");
    const scale = built("div", "scale", ...[this.range[1], this.range[0]].map((value) => built("span", "", round(value))));
    scale.setAttribute("aria-hidden", "true");
    const figure = built("figure", "chart", head, built("div", "plot", scale, this.plot), legend, built("p", "hint", chart.about));
    return figure;
  }

  /** A way to the worst frame for hands and for readers of screens. */
  worstButton() {
    const found = worst(this.chart, this.stacks);
    if (found === null) return "";
    const { first } = this.data;
    const text = `${this.chart.worst === "low" ? "lowest" : "highest"} ${short(found.value)}${unit(this.chart)} at ${first + found.frame}`;
    const button = built("button", "jump", text);
    button.type = "button";
    button.addEventListener("click", () => this.player.seek(found.frame));
    this.worst = found;
    return button;
  }

  drawPlot() {
    const { frames, marks, first } = this.data;
    const svg = drawn("svg", { viewBox: `-0.5 0 ${frames} ${HEIGHT}`, preserveAspectRatio: "none", role: "img", "aria-label": this.describe() });
    for (const mark of marks) {
      svg.append(drawn("rect", { class: `mark-${mark.kind}`, x: mark.start - first - 0.5, y: 0, width: mark.stop - mark.start, height: HEIGHT }));
    }
    this.stacks.forEach((values, index) => svg.append(this.drawLine(values, index)));
    this.ghost = drawn("line", { class: "ghost", y1: 0, y2: HEIGHT, x1: -9, x2: -9 });
    this.cursor = drawn("line", { class: "cursor", y1: 0, y2: HEIGHT });
    svg.append(this.ghost, this.cursor);
    this.listen(svg);
    return svg;
  }

  drawLine(values, index) {
    const runs = defined(values).map((run) => run.map(([x, value]) => `${x} ${this.y(value)}`));
    const name = `line-${index % 6}`;
    if (!this.chart.stacked) {
      return drawn("path", { class: name, d: runs.map((run) => `M${run.length > 1 ? run.join("L") : `${run[0]}h0.01`}`).join("") });
    }
    const below = index > 0 ? this.stacks[index - 1] : values.map(() => 0);
    const area = defined(values).map((run) => {
      const back = [...run].reverse().map(([x]) => `${x} ${this.y(below[x])}`);
      return `M${run.map(([x, value]) => `${x} ${this.y(value)}`).join("L")}L${back.join("L")}Z`;
    });
    return drawn("path", { class: `${name} area`, d: area.join("") });
  }

  y(value) {
    const [low, high] = this.range;
    return (HEIGHT * (1 - (value - low) / (high - low))).toFixed(2);
  }

  describe() {
    const { chart } = this;
    const parts = chart.lines.map((line) => {
      const known = line.values.filter((value) => value !== null);
      if (known.length === 0) return `${line.name}: no values`;
      const mean = known.reduce((sum, value) => sum + value, 0) / known.length;
      return `${line.name}: mean ${short(mean)}, ${short(Math.min(...known))} to ${short(Math.max(...known))}${unit(chart)}`;
    });
    return `${chart.title} over frames. ${parts.join("; ")}.`;
  }

  listen(svg) {
    const frameAt = (event) => {
      const box = svg.getBoundingClientRect();
      const share = (event.clientX - box.left) / box.width;
      return Math.min(this.data.frames - 1, Math.max(0, Math.floor(share * this.data.frames)));
    };
    svg.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      svg.setPointerCapture(event.pointerId);
      this.player.pause();
      this.player.seek(frameAt(event));
    });
    svg.addEventListener("pointermove", (event) => {
      const frame = frameAt(event);
      for (const end of ["x1", "x2"]) this.ghost.setAttribute(end, frame);
      if (svg.hasPointerCapture(event.pointerId)) this.player.seek(frame);
      else this.tell(frame);
    });
    svg.addEventListener("pointerleave", () => {
      for (const end of ["x1", "x2"]) this.ghost.setAttribute(end, -9);
      this.tell(this.player.frame);
    });
  }

  /** Show the current frame. */
  update() {
    for (const end of ["x1", "x2"]) this.cursor.setAttribute(end, this.player.frame);
    this.tell(this.player.frame);
  }

  tell(frame) {
    this.chart.lines.forEach((line, index) => {
      const value = line.values[frame];
      this.values[index].textContent = value === null ? "–" : `${short(value)}${unit(this.chart)}`;
    });
  }
}

/** Lines as drawn: summed up where they are stacked. */
function stacked(chart) {
  const lines = chart.lines.map((line) => line.values);
  if (!chart.stacked) return lines;
  const sum = lines[0].map(() => 0);
  return lines.map((values) => values.map((value, frame) => {
    sum[frame] = value === null || sum[frame] === null ? null : sum[frame] + value;
    return sum[frame];
  }));
}

/** The frame where any line is highest, or where the last one is lowest. */
function worst(chart, lines) {
  let found = null;
  const looked = chart.worst === "low" ? lines.slice(-1) : lines;
  for (const values of looked) {
    values.forEach((value, frame) => {
      if (value === null) return;
      const worse = found === null || (chart.worst === "low" ? value < found.value : value > found.value);
      if (worse) found = { frame, value };
    });
  }
  return found;
}

/** Runs of frames with a value, as pairs [frame, value]. */
function defined(values) {
  const runs = [];
  values.forEach((value, frame) => {
    if (value === null) return;
    if (frame === 0 || values[frame - 1] === null) runs.push([]);
    runs[runs.length - 1].push([frame, value]);
  });
  return runs;
}

/** Round numbers below and above all values. */
function niceRange(values) {
  const known = values.filter((value) => value !== null);
  if (known.length === 0) return [0, 1];
  let low = Math.min(...known);
  let high = Math.max(...known);
  if (low >= 0 && low < 0.5 * high) low = 0;
  const step = 10 ** Math.floor(Math.log10(Math.max(high - low, 1e-9 * Math.abs(high), 1e-12)));
  const fine = step / 2;
  low = Math.floor(low / fine + 1e-9) * fine;
  high = Math.ceil(high / fine - 1e-9) * fine;
  return high > low ? [low, high] : [low, low + fine];
}

/** Three digits or so. */
function short(value) {
  const size = Math.abs(value);
  if (size >= 100 || value === 0) return value.toFixed(0);
  return value.toFixed(size >= 10 ? 1 : 2);
}

/** Without zeros at the end, for scales. */
function round(value) {
  return String(Number(short(value)));
}

function unit(chart) {
  return chart.unit ? ` ${chart.unit}` : "";
}
