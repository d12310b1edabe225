/** Unpack the blocks, build the page, and keep everything at the same step. */
async function main() {
  const replay = JSON.parse(document.getElementById("replay").textContent);
  const { map, tracks } = replay;
  const find = (id) => document.getElementById(id);
  const last = Math.max(...tracks.map((track) => track.entropy.length)) - 1;
  const unpack = async (block) => { block.bytes ??= await bytesOf(block.packed); };
  await Promise.all([map, ...tracks.map((track) => track.shades),
    ...tracks.flatMap((track) => track.particles || [])].map(unpack));
  map.sheets = { light: mapSheet(map, "light"), dark: mapSheet(map, "dark") };

  const view = { step: 0, playing: false, sector: -1, scheme: "light", ramp: null, layers: {} };
  const panes = tracks.map((track, i) => new Pane(track, i, map));
  find("panes").append(...panes.map((pane) => pane.node));
  find("main").classList.toggle("several", panes.length > 1);
  const curve = new Curve(find("curve"), tracks, last, (step) => { pause(); seek(step); });

  function show() {
    panes.forEach((pane) => pane.show(view.step, view));
    curve.show(view.step);
    const words = `step ${view.step} of ${last}`;
    find("at").textContent = words;
    find("scrubber").value = view.step;
    find("scrubber").setAttribute("aria-valuetext", words);
  }

  function seek(step) {
    view.step = Math.min(Math.max(step, 0), last);
    show();
    if (!view.playing) say();
  }

  let saying = 0;
  /** Tell a screen reader where things stand, once they stand. */
  function say() {
    clearTimeout(saying);
    saying = setTimeout(() => {
      const words = panes.map((pane) => pane.say(view.step)).join(". ");
      find("said").textContent = `Step ${view.step} of ${last}. ${words}.`;
    }, 250);
  }

  const PAUSE = "M3 2h4v12H3zM9 2h4v12H9z";
  const PLAY = find("play").querySelector("path").getAttribute("d");

  function setPlaying(playing) {
    view.playing = playing;
    find("play").setAttribute("aria-label", playing ? "Pause" : "Play");
    find("play").querySelector("path").setAttribute("d", playing ? PAUSE : PLAY);
  }

  function pause() {
    if (!view.playing) return;
    setPlaying(false);
    say();
  }

  function play() {
    if (view.step >= last) seek(0);
    setPlaying(true);
    let before = performance.now();
    let due = 0;
    const tick = (now) => {
      if (!view.playing) return;
      due += ((now - before) / 1000) * Number(find("speed").value);
      before = now;
      if (due >= 1) {
        // A tab that slept does not jump ahead when it wakes.
        seek(view.step + Math.min(Math.floor(due), 5));
        due %= 1;
      }
      if (view.step >= last) pause();
      else requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  const toggle = () => (view.playing ? pause() : play());
  const by = (steps) => { pause(); seek(view.step + steps); };
  const keys = { " ": toggle, ArrowLeft: () => by(-1), ArrowRight: () => by(1),
    Home: () => by(-Infinity), End: () => by(Infinity) };

  find("scrubber").max = last;
  find("scrubber").addEventListener("input", (event) => {
    pause();
    seek(Number(event.target.value));
  });
  find("play").addEventListener("click", toggle);
  find("first").addEventListener("click", keys.Home);
  find("back").addEventListener("click", keys.ArrowLeft);
  find("next").addEventListener("click", keys.ArrowRight);
  document.addEventListener("keydown", (event) => {
    if (!(event.key in keys) || event.ctrlKey || event.altKey || event.metaKey) return;
    // Controls that use these keys themselves keep them.
    const own = event.key === " " ? "button, summary, input:not([type=range]), select, a"
      : "input, select, [tabindex]";
    if (event.target.closest(own)) return;
    event.preventDefault();
    keys[event.key]();
  });

  for (const [name, words, mark] of LAYERS) {
    if (name === "particles" && !tracks.some((track) => track.particles)) continue;
    view.layers[name] = true;
    const box = make("input", { type: "checkbox", checked: "", id: `layer-${name}` });
    box.addEventListener("change", () => { view.layers[name] = box.checked; show(); });
    const icon = svg("svg", { viewBox: "0 0 28 16", "aria-hidden": "true" });
    icon.innerHTML = mark;
    find("layers").append(make("label", {}, box, icon, words));
  }

  const sectors = tracks[0].slices.shape[1];
  for (let i = -1; i < (sectors > 1 ? sectors : 0); i++) {
    // From east, counter-clockwise; the slices begin in the west.
    const sector = i < 0 ? -1 : (i + sectors / 2) % sectors;
    const box = make("input", { type: "radio", name: "sector", value: `${sector}` });
    box.checked = i < 0;
    box.addEventListener("change", async () => {
      if (sector >= 0) await Promise.all(tracks.map((track) => unpack(track.slices)));
      view.sector = sector;
      show();
    });
    const label = make("label", {}, box);
    const degrees = (360 * i) / sectors;
    if (i >= 0) {
      const arrow = svg("svg", { viewBox: "0 0 28 16", "aria-hidden": "true" });
      const path = svg("path", { d: "M5 8h16M15 3l6 5-6 5", fill: "none", stroke: "currentColor" });
      path.setAttribute("stroke-width", "2");
      path.setAttribute("transform", `rotate(${-degrees} 14 8)`);
      arrow.append(path);
      label.append(arrow);
    }
    label.append(i < 0 ? "any" : `${degrees}\u00b0`);
    find("sectors").append(label);
  }

  const system = matchMedia("(prefers-color-scheme: dark)");
  function setScheme() {
    const chosen = find("theme").value;
    document.documentElement.dataset.theme = chosen;
    view.scheme = chosen || (system.matches ? "dark" : "light");
    view.ramp = rampOf(replay.ramps[view.scheme]);
    const ink = find("ramp").getContext("2d");
    ink.putImageData(new ImageData(view.ramp, 256, 1), 0, 0);
  }

  function resize() {
    panes.forEach((pane) => {
      const style = getComputedStyle(pane.node);
      const inner = pane.node.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
      pane.stage.resize(inner, Math.max(260, 0.68 * window.innerHeight));
    });
    curve.resize();
    show();
  }

  find("theme").addEventListener("change", () => { setScheme(); show(); });
  system.addEventListener("change", () => { setScheme(); show(); });
  find("table").addEventListener("toggle", (event) => {
    const place = event.target.querySelector(".scroll");
    if (event.target.open && !place.firstChild) place.append(tableOf(panes, last));
  });
  const wanted = /^#step=(\d+)$/.exec(location.hash);
  view.step = wanted ? Math.min(Number(wanted[1]), last) : 0;
  setScheme();
  resize();
  let width = window.innerWidth;
  addEventListener("resize", () => {
    // On a phone the height changes whenever the address bar hides.
    if (window.innerWidth !== width) {
      width = window.innerWidth;
      resize();
    }
  });
  document.documentElement.dataset.ready = `${Math.round(performance.now())}`;
}

main();
