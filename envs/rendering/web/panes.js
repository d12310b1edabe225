/** An element with attributes and children. */
function make(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

const LAYERS = [
  ["belief", "belief", '<rect x="4" y="2" width="20" height="12" fill="#e85a3c"/>'],
  ["headings", "likely headings", '<path d="M22 8 8 13 11 8 8 3z" fill="currentColor"/>'],
  ["particles", "particles",
    '<g fill="currentColor"><circle cx="6" cy="5" r="1.6"/><circle cx="13" cy="10" r="1.6"/>'
    + '<circle cx="20" cy="6" r="1.6"/><circle cx="24" cy="12" r="1.6"/></g>'],
  ["scan", "scan",
    '<path d="M2 8h20" stroke="var(--series-1)" stroke-width="2"/>'
    + '<circle cx="22" cy="8" r="3" fill="var(--series-1)"/>'],
  ["truth", "true pose",
    '<circle cx="14" cy="8" r="6" fill="var(--series-1)"/>'
    + '<path d="M14 8h6" stroke="var(--card)" stroke-width="2"/>'],
  ["path", "true path", '<path d="M2 12q8-10 12-4t12-4" fill="none" stroke="var(--series-1)" stroke-width="2" opacity="0.6"/>'],
  ["estimate", "estimate",
    '<g fill="none" stroke="currentColor" stroke-width="1.6"><circle cx="13" cy="8" r="4.5"/>'
    + '<path d="M17.500 8h8M8.500 8h-3M13 3.500v-3M13 12.500v3"/></g>'],
];

/** One agent: its name, how it ended, its map, and what the numbers are. */
class Pane {
  constructor(track, index, map) {
    const id = `readout-${index}`;
    this.track = track;
    this.canvas = make("canvas", {
      role: "img", "aria-describedby": id,
      "aria-label": `Map of ${map.name}: belief, scan, true pose and estimate of ${track.agent}`,
    });
    this.stage = new Stage(this.canvas, map, track);
    const names = ["Entropy", "Near estimate", "Error", "Action"];
    this.fields = names.map(() => make("dd"));
    const list = make("dl", { id });
    names.forEach((name, i) => list.append(make("div", {}, make("dt", {}, name), this.fields[i])));
    this.fields[0].className = "entropy";
    const mark = svg("svg", { viewBox: "0 0 28 8", width: 28, height: 8, "aria-hidden": "true" });
    mark.append(svg("line", {
      x1: 0, x2: 28, y1: 4, y2: 4, stroke: `var(--series-${(index % 5) + 1})`, "stroke-width": 3,
      "stroke-dasharray": DASHES[index % 5],
    }));
    const end = `${track.outcome} after ${track.entropy.length - 1} steps`;
    this.node = make("section", { class: "pane card", "aria-label": track.agent },
      make("header", {}, mark, make("h2", {}, track.agent), make("span", { class: "quiet" }, end)),
      this.canvas, list);
  }

  /** What is true at a step, as strings. */
  words(step) {
    const { track } = this;
    const s = Math.min(step, track.entropy.length - 1);
    const degrees = Math.round((track.error_rad[s] * 180) / Math.PI);
    return [
      `${track.entropy[s].toFixed(2)} nat (${Math.round(100 * track.fraction[s])} %)`,
      `${Math.round(100 * track.mass[s])} %`,
      `${track.error_m[s].toFixed(2)} m, ${degrees}\u00b0`,
      step >= track.entropy.length ? "ended"
        : s === 0 ? "start" : track.commands[s - 1].replaceAll(" deg", "\u00b0"),
    ];
  }

  show(step, view) {
    this.stage.draw(step, view);
    this.words(step).forEach((words, i) => { this.fields[i].textContent = words; });
  }

  say(step) {
    const [entropy, mass, error, action] = this.words(step);
    return `${this.track.agent}: ${action}; entropy ${entropy}; ${mass} near the estimate; `
      + `error ${error}`;
  }
}

/** The numbers of every step, for those who would rather read them. */
function tableOf(panes, last) {
  const table = make("table", {}, make("caption", {}, "Entropy as nats and as a share of the uniform belief's."));
  const names = ["Step", "Agent", "Entropy", "Near the estimate", "Error", "Action"];
  table.append(make("thead", {}, make("tr", {}, ...names.map((n) => make("th", { scope: "col" }, n)))));
  const body = make("tbody");
  for (let step = 0; step <= last; step++) {
    for (const pane of panes) {
      if (step >= pane.track.entropy.length) continue;
      const cells = pane.words(step).map((words) => make("td", {}, words));
      body.append(make("tr", {}, make("th", { scope: "row" }, `${step}`),
        make("td", { class: "words" }, pane.track.agent), ...cells));
    }
  }
  table.append(body);
  return table;
}
