// Buttons, sliders, keys and the mouse.

const show = () => { fit(); drawAxes(); drawOutputs(); draw(); };

const play = playing => {
  state.playing = playing && data.frames > 1;
  element("play").textContent = state.playing ? "❚❚" : "▶";
  element("play").setAttribute("aria-label", state.playing ? "pause" : "play");
  let last = null;
  const advance = now => {
    if (!state.playing || last === undefined) return;
    if (last !== null) state.t += (now - last) / 1000 * state.rate;
    last = now;
    if (state.t > end) state.t = start;
    draw();
    play.next = requestAnimationFrame(advance);
  };
  cancelAnimationFrame(play.next);
  if (state.playing) play.next = requestAnimationFrame(advance);
};
const go = t => { play(false); state.t = Math.min(end, Math.max(start, t)); draw(); };
const step = by => go(times[Math.min(data.frames - 1, Math.max(0, Math.round(frameAt(state.t)) + by))]);

const speed = element("speed");
const rates = Array.from({length: 17}, (_, k) => k - 9).flatMap(power => [1, 2, 5].map(x => x * 10 ** power));
for (const factor of data.clock.unit === "s" ? rates.map(x => x / data.clock.rate) : [0.1, 0.2, 0.5, 1, 2, 5]) {
  if (factor < 0.0099 || factor > 101) continue;
  const rate = Number((factor * data.clock.rate).toPrecision(6));
  const label = data.clock.unit === "s" ? `${rate} × real time` : `${rate} ${data.clock.unit}/s`;
  speed.append(new Option(label, rate, false, Math.abs(factor - 1) < 1e-6));
}
speed.onchange = () => { state.rate = Number(speed.value); };
const faster = by => {
  speed.selectedIndex = Math.min(speed.length - 1, Math.max(0, speed.selectedIndex + by));
  speed.onchange();
};
element("play").onclick = () => play(!state.playing);
element("scrub").oninput = event => go(start + (end - start) * event.target.value / 1000);
if (data.scales.length) {
  const slider = element("scale");
  slider.max = data.scales.length - 1;
  slider.value = data.scales.indexOf(data.scale);
  const label = () => { element("factor").textContent = `× ${state.scale}`; };
  slider.oninput = () => { state.scale = data.scales[slider.value]; label(); measure(); show(); };
  label();
}
element("controls").hidden = data.frames < 2;
element("deformation").hidden = !data.scales.length;

const legend = element("legend");
const buttons = models.filter(model => model.name).map(model => {
  const button = document.createElement("button");
  const sample = make("svg", {width: 34, height: 10, viewBox: "0 0 34 10"}, button);
  const path = make("path", {d: "M1 5H33", class: "body", style: `--model: ${model.colour}`, "stroke-width": model.width}, sample);
  if (model.dash.length) path.setAttribute("stroke-dasharray", model.dash.join(" "));
  button.append(model.name);
  button.onclick = () => {
    if (data.alternatives) models.forEach(other => { other.shown = other === model; });
    else model.shown = !model.shown;
    press();
    show();
  };
  legend.append(button);
  return [button, model];
});
legend.classList.toggle("alternatives", data.alternatives);
const press = () => buttons.forEach(([button, model]) => button.setAttribute("aria-pressed", model.shown));
press();

const turn = (a, e) => { Object.assign(view, {azimuth: a, elevation: e}); show(); };
const reset = () => { Object.assign(view, {middle: [0, 0], zoom: 1}); turn(azimuth, elevation); };
const VIEWS = {front: [-Math.PI / 2, 0], side: [0, 0], top: [-Math.PI / 2, Math.PI / 2], oblique: [azimuth, elevation]};
if (solid) Object.entries(VIEWS).forEach(([name, angles], i) => {
  const button = document.createElement("button");
  Object.assign(button, {textContent: name, title: `key ${i + 1}`, onclick: () => turn(...angles)});
  element("views").append(button);
});

const zoom = (by, where = amid()) => {  // what is there stays there
  const away = where.map((x, i) => (i ? -1 : 1) * (x - amid()[i]) / view.pixels);
  view.zoom *= by;
  view.middle = view.middle.map((x, i) => x + away[i] * (1 - 1 / by));
  show();
};
const keys = {
  " ": () => play(!state.playing), ArrowRight: () => step(1), ArrowLeft: () => step(-1),
  ArrowUp: () => faster(1), ArrowDown: () => faster(-1), Home: () => go(start), End: () => go(end),
  "+": () => zoom(1.25), "-": () => zoom(0.8), "0": reset,
};
if (solid) Object.values(VIEWS).forEach((angles, i) => { keys[i + 1] = () => turn(...angles); });
document.addEventListener("keydown", event => {
  const own = event.target.matches?.("select, #scale") && event.key !== " ";
  if (!keys[event.key] || own || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  keys[event.key]();
});

// In a page around it the wheel scrolls that page until the picture was pressed.
let held = window === window.top;
const leave = () => { held = window === window.top; };
document.documentElement.addEventListener("pointerleave", leave);
picture.addEventListener("wheel", event => {
  if (!held && !event.ctrlKey) return;
  event.preventDefault();
  const {left, top} = picture.getBoundingClientRect(), pace = event.deltaMode ? 0.05 : event.ctrlKey ? 0.01 : 0.0015;
  zoom(Math.exp(-pace * event.deltaY), [event.clientX - left, event.clientY - top]);
}, {passive: false});
picture.addEventListener("dblclick", reset);

// Moves until the button is up, wherever the mouse is; nothing else is selected meanwhile.
const drag = (target, move) => target.addEventListener("pointerdown", event => {
  event.preventDefault();
  held = true;
  target.setPointerCapture(event.pointerId);
  target.addEventListener("pointermove", move);
  target.addEventListener("lostpointercapture", () => target.removeEventListener("pointermove", move), {once: true});
  move(event);
});
drag(picture, event => {
  if (solid && !event.shiftKey) {
    view.azimuth -= 0.01 * event.movementX;
    view.elevation = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, view.elevation + 0.01 * event.movementY));
  } else {
    view.middle[0] -= event.movementX / view.pixels;
    view.middle[1] += event.movementY / view.pixels;
  }
  show();
});
charts.forEach(({chart}) => drag(chart, event => go(timeUnder(chart, event.clientX))));

element("frame").onclick = saveFrame;
element("film").onclick = saveFilm;
element("film").hidden = data.frames < 2;

measure();
show();
new ResizeObserver(show).observe(document.body);
const asked = /[#&]t=([-+.\deE]+)/.exec(location.hash);
if (asked) go(Number(asked[1])); else play(data.playing && !matchMedia("(prefers-reduced-motion: reduce)").matches);
