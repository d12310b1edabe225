/** Colours of a scheme; the belief's run away from the floor's, ever darker or ever brighter. */
const SCHEMES = {
  light: {
    wall: [43, 50, 61], unknown: [201, 205, 210], text: "#21252b", halo: "#ffffff",
    truth: "#0062b2", beam: "0, 114, 190", estimate: "#141418", heading: "#24080c",
    particle: "110, 6, 24", path: "rgba(0, 98, 178, 0.45)",
  },
  dark: {
    wall: [170, 178, 190], unknown: [62, 68, 78], text: "#e8eaed", halo: "#0b0d11",
    truth: "#6cc5ff", beam: "120, 200, 255", estimate: "#ffffff", heading: "#fff3d6",
    particle: "255, 214, 130", path: "rgba(108, 197, 255, 0.5)",
  },
};

/** One agent's map: draws a moment of a track. */
class Stage {
  constructor(canvas, map, track) {
    Object.assign(this, { canvas, map, track, belief: null });
    this.ink = canvas.getContext("2d");
  }

  /** Fit the canvas into its pane; heights stay under most of a screen. */
  resize(width, height) {
    const [x0, x1, y0, y1] = this.map.extent;
    this.scale = Math.min(width / (x1 - x0), height / (y1 - y0));
    this.width = this.scale * (x1 - x0);
    this.height = this.scale * (y1 - y0);
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.canvas.style.width = `${this.width}px`;
    this.ink.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.unit = Math.min(1.3, Math.max(0.75, this.width / 600));
  }

  at(x, y) {
    const [x0, , , y1] = this.map.extent;
    return [(x - x0) * this.scale, (y1 - y) * this.scale];
  }

  /** The place ahead of a pixel; headings are counter-clockwise and pixels grow downwards. */
  static ahead([x, y], heading, distance) {
    return [x + distance * Math.cos(heading), y - distance * Math.sin(heading)];
  }

  draw(step, view) {
    const { ink, track } = this;
    const scheme = SCHEMES[view.scheme];
    const s = Math.min(step, track.entropy.length - 1);
    const [r, g, b] = view.ramp;
    ink.fillStyle = `rgb(${r}, ${g}, ${b})`;
    ink.fillRect(0, 0, this.width, this.height);
    if (view.layers.belief) this.drawBelief(s, view);
    // Cells that are large are squares; small ones are blended, so that thin walls stay.
    ink.imageSmoothingEnabled = this.width / this.map.shape[1] < 2;
    ink.drawImage(this.map.sheets[view.scheme], 0, 0, this.width, this.height);
    this.drawScale(scheme);
    if (view.layers.particles && track.particles) this.drawParticles(s, scheme);
    if (view.layers.path) this.drawPath(s, scheme);
    if (view.layers.headings) this.drawHeadings(s, scheme, view.sector);
    if (view.layers.scan) this.drawScan(s, scheme);
    if (view.layers.estimate) this.drawEstimate(s, scheme);
    if (view.layers.truth) this.drawRobot(s, scheme);
  }

  drawBelief(s, view) {
    const slice = view.sector >= 0 && this.track.slices.bytes;
    const block = slice ? this.track.slices : this.track.shades;
    const [rows, cols] = block.shape.slice(-2);
    const start = rows * cols * (slice ? s * block.shape[1] + view.sector : s);
    if (!this.belief || this.belief.width !== cols || this.belief.height !== rows) {
      this.belief = sheetOf(cols, rows);
      this.pixels = this.belief.getContext("2d").createImageData(cols, rows);
    }
    const out = new Uint32Array(this.pixels.data.buffer);
    const ramp = new Uint32Array(view.ramp.buffer);
    const step = 256 / block.levels;
    for (let row = 0; row < rows; row++) {
      const line = start + row * cols;
      const to = (rows - 1 - row) * cols;
      for (let col = 0; col < cols; col++) {
        const level = block.bytes[line + col];
        out[to + col] = ramp[level === 0 ? 0 : Math.floor((level + 0.5) * step)];
      }
    }
    this.belief.getContext("2d").putImageData(this.pixels, 0, 0);
    const side = block.resolution;
    const [left, top] = this.at(this.track.origin[0], this.track.origin[1] + rows * side);
    this.ink.imageSmoothingEnabled = side * this.scale < 20;
    const size = side * this.scale;
    this.ink.drawImage(this.belief, left, top, cols * size, rows * size);
  }

  drawParticles(s, scheme) {
    const { bytes, counts, ends } = this.track.particles;
    const pairs = new Uint16Array(bytes.buffer, 4 * (ends[s] - counts[s]), 2 * counts[s]);
    const dot = Math.max(1.5, 1.8 * this.unit);
    this.ink.fillStyle = `rgba(${scheme.particle}, 0.55)`;
    for (let i = 0; i < pairs.length; i += 2) {
      const x = (pairs[i] / 65535) * this.width;
      const y = this.height - (pairs[i + 1] / 65535) * this.height;
      this.ink.fillRect(x - dot / 2, y - dot / 2, dot, dot);
    }
  }

  drawPath(s, scheme) {
    const { ink, track } = this;
    ink.strokeStyle = scheme.path;
    ink.lineWidth = 2 * this.unit;
    ink.lineJoin = "round";
    ink.beginPath();
    for (let i = 0; i <= s; i++) {
      const [x, y] = this.at(...track.poses[i]);
      if (i === 0 || i === track.carried_at) ink.moveTo(x, y);
      else ink.lineTo(x, y);
    }
    ink.stroke();
  }

  drawHeadings(s, scheme, sector) {
    const { ink, track } = this;
    const sectors = track.slices.shape[1];
    const flat = track.headings[s];
    const length = 17 * this.unit;
    for (let i = 0; i < flat.length; i += 3) {
      const heading = flat[i + 2];
      const here = Math.round(((heading + Math.PI) / (2 * Math.PI)) * sectors) % sectors;
      if (sector >= 0 && here !== sector) continue;
      const place = this.at(flat[i], flat[i + 1]);
      const corners = [
        Stage.ahead(place, heading, 0.62 * length),
        Stage.ahead(place, heading + 2.45, 0.42 * length),
        Stage.ahead(place, heading + Math.PI, 0.16 * length),
        Stage.ahead(place, heading - 2.45, 0.42 * length),
      ];
      ink.beginPath();
      corners.forEach(([x, y]) => ink.lineTo(x, y));
      ink.closePath();
      ink.strokeStyle = scheme.halo;
      ink.lineWidth = 2.2 * this.unit;
      ink.stroke();
      ink.fillStyle = scheme.heading;
      ink.fill();
    }
  }

  drawScan(s, scheme) {
    const { ink, track } = this;
    const [x, y, theta] = track.poses[s];
    const from = this.at(x, y);
    const opacity = Math.min(1, Math.max(0.35, 12 / track.bearings.length));
    track.scans[s].forEach((z, i) => {
      if (z === null) return;
      const hit = z < track.z_max;
      const angle = theta + track.bearings[i];
      const to = this.at(x + z * Math.cos(angle), y + z * Math.sin(angle));
      ink.strokeStyle = `rgba(${scheme.beam}, ${opacity * (hit ? 0.75 : 0.4)})`;
      ink.lineWidth = 1.3 * this.unit;
      ink.beginPath();
      ink.moveTo(...from);
      ink.lineTo(...to);
      ink.stroke();
      if (hit) this.disc(to, 2.4 * this.unit, `rgba(${scheme.beam}, ${opacity})`);
    });
  }

  radius() {
    return Math.max((this.track.radius || 0) * this.scale, 6 * this.unit, 4);
  }

  drawEstimate(s, scheme) {
    const { ink } = this;
    const [x, y, theta] = this.track.estimates[s];
    const place = this.at(x, y);
    const radius = 1.7 * this.radius();
    for (const [colour, width] of [[scheme.halo, 4.2], [scheme.estimate, 1.7]]) {
      ink.strokeStyle = colour;
      ink.lineWidth = width * this.unit;
      ink.beginPath();
      ink.arc(...place, radius, 0, 2 * Math.PI);
      for (const [turn, reach] of [[0, 2.1], [0.5, 1.5], [1, 1.5], [1.5, 1.5]]) {
        ink.moveTo(...Stage.ahead(place, theta + turn * Math.PI, radius));
        ink.lineTo(...Stage.ahead(place, theta + turn * Math.PI, reach * radius));
      }
      ink.stroke();
    }
  }

  drawRobot(s, scheme) {
    const { ink } = this;
    const [x, y, theta] = this.track.poses[s];
    const place = this.at(x, y);
    const radius = this.radius();
    this.disc(place, radius + 1.5 * this.unit, scheme.halo);
    this.disc(place, radius, scheme.truth);
    ink.strokeStyle = scheme.halo;
    ink.lineWidth = Math.max(1.5, 0.3 * radius);
    ink.beginPath();
    ink.moveTo(...place);
    ink.lineTo(...Stage.ahead(place, theta, radius));
    ink.stroke();
  }

  disc([x, y], radius, colour) {
    this.ink.fillStyle = colour;
    this.ink.beginPath();
    this.ink.arc(x, y, radius, 0, 2 * Math.PI);
    this.ink.fill();
  }

  /** A bar of a round number of metres, in the corner. */
  drawScale(scheme) {
    const { ink } = this;
    const metres = [50, 20, 10, 5, 2, 1, 0.5].find((m) => m * this.scale < this.width / 4) || 0.2;
    const [left, foot] = [10, this.height - 10];
    ink.font = "600 13px system-ui, sans-serif";
    const width = Math.max(metres * this.scale, ink.measureText(`${metres} m`).width);
    ink.globalAlpha = 0.85;
    ink.fillStyle = scheme.halo;
    ink.fillRect(left - 5, foot - 20, width + 10, 25);
    ink.globalAlpha = 1;
    ink.fillStyle = scheme.text;
    ink.fillRect(left, foot - 1, metres * this.scale, 2);
    ink.fillText(`${metres} m`, left, foot - 6);
  }
}

/** The map as a sheet to lay over the belief: walls and the unknown, free ground clear. */
function mapSheet(map, scheme) {
  const [rows, cols] = map.shape;
  const sheet = sheetOf(cols, rows);
  const pixels = sheet.getContext("2d").createImageData(cols, rows);
  for (let row = 0; row < rows; row++) {
    for (let col = 0; col < cols; col++) {
      const cell = map.bytes[row * cols + col];
      const to = 4 * ((rows - 1 - row) * cols + col);
      const colour = cell === 1 ? SCHEMES[scheme].wall : SCHEMES[scheme].unknown;
      pixels.data.set([...colour, cell === 0 ? 0 : 255], to);
    }
  }
  sheet.getContext("2d").putImageData(pixels, 0, 0);
  return sheet;
}
