const SVG = "http://www.w3.org/2000/svg";
const DASHES = ["", "7 4", "2 3", "9 3 2 3", "4 2"];

function svg(name, attributes, words) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (words !== undefined) node.textContent = words;
  return node;
}

/** A round distance between ticks, for about n of them. */
function tickOf(range, n) {
  const rough = range / n;
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((m) => m * power >= rough);
}

/** Entropy by step, a line for each track, with a cursor at the step that is shown. */
class Curve {
  constructor(place, tracks, last, seek) {
    Object.assign(this, { place, tracks, last, seek });
    this.top = Math.max(...tracks.flatMap((track) => track.entropy), 1e-3) * 1.05;
    const move = (event) => {
      if (event.type === "pointermove" && event.buttons !== 1) return;
      const left = this.place.getBoundingClientRect().left + 46;
      seek(Math.round(((event.clientX - left) / (this.width - 58)) * last));
    };
    place.addEventListener("pointerdown", move);
    place.addEventListener("pointermove", move);
  }

  x(step) {
    return 46 + (step / Math.max(this.last, 1)) * (this.width - 58);
  }

  y(nats) {
    return 8 + (1 - nats / this.top) * (this.height - 46);
  }

  /** Draw everything but the cursor, for the width there is. */
  resize() {
    this.width = Math.max(this.place.clientWidth, 240);
    this.height = 190;
    const names = this.tracks.map((t) => `${t.agent} from ${t.entropy[0].toFixed(2)} to `
      + `${t.entropy.at(-1).toFixed(2)} nat in ${t.entropy.length - 1} steps`);
    const root = svg("svg", {
      viewBox: `0 0 ${this.width} ${this.height}`, height: this.height, role: "img",
      "aria-label": `Entropy by step: ${names.join("; ")}`,
    });
    this.drawAxes(root);
    this.tracks.forEach((track, i) => this.drawTrack(root, track, i));
    this.cursor = svg("line", { class: "cursor", y1: 8, y2: this.height - 38 });
    this.dots = this.tracks.map((_, i) => svg("circle", {
      r: 4.5, fill: `var(--series-${(i % 5) + 1})`, stroke: "var(--card)", "stroke-width": 1.5,
    }));
    root.append(this.cursor, ...this.dots);
    this.place.replaceChildren(root);
  }

  drawAxes(root) {
    const foot = this.height - 38;
    const up = tickOf(this.top, 5);
    for (let nats = 0; nats <= this.top; nats += up) {
      const y = this.y(nats);
      root.append(svg("line", { class: "grid", x1: 46, x2: this.width - 12, y1: y, y2: y }));
      const words = `${+nats.toFixed(3)}`;
      root.append(svg("text", { x: 40, y: y + 4, "text-anchor": "end" }, words));
    }
    const right = Math.max(1, tickOf(Math.max(this.last, 1), this.width < 500 ? 5 : 10));
    for (let step = 0; step <= this.last; step += right) {
      const x = this.x(step);
      root.append(svg("line", { class: "axis", x1: x, x2: x, y1: foot, y2: foot + 4 }));
      root.append(svg("text", { x, y: foot + 17, "text-anchor": "middle" }, `${step}`));
    }
    root.append(svg("line", { class: "axis", x1: 46, x2: this.width - 12, y1: foot, y2: foot }));
    const middle = (46 + this.width - 12) / 2;
    root.append(svg("text", { x: middle, y: this.height - 4, "text-anchor": "middle" }, "step"));
    const turn = `translate(11 ${foot / 2 + 4}) rotate(-90)`;
    root.append(svg("text", { transform: turn, "text-anchor": "middle" }, "entropy [nat]"));
  }

  drawTrack(root, track, i) {
    const points = track.entropy.map((h, s) => `${this.x(s).toFixed(1)},${this.y(h).toFixed(1)}`);
    const colour = `var(--series-${(i % 5) + 1})`;
    root.append(svg("polyline", {
      class: "line", points: points.join(" "), stroke: colour, "stroke-dasharray": DASHES[i % 5],
    }));
    if (track.carried_at !== null) {
      const x = this.x(track.carried_at);
      root.append(svg("line", { class: "event", x1: x, x2: x, y1: 8, y2: this.height - 38 }));
      root.append(svg("text", { x: x + 4, y: 18 }, "carried off"));
    }
  }

  show(step) {
    this.cursor.setAttribute("x1", this.x(step));
    this.cursor.setAttribute("x2", this.x(step));
    this.tracks.forEach((track, i) => {
      const s = Math.min(step, track.entropy.length - 1);
      this.dots[i].setAttribute("cx", this.x(s));
      this.dots[i].setAttribute("cy", this.y(track.entropy[s]));
    });
  }
}
