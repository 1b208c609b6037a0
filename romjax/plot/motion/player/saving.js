// The picture as a file: one frame as PNG, or all of them as GIF.

const COLOURS = ["ink", "page", "soft", "grid", "edge", "lit", "shade", "pull", "push", "none"].map(name => `--${name}`);
const FILM = {rate: 20, most: 240};  // frames per second, and at most

// The picture, its outputs and the time, as they are now, on a canvas.
const photograph = async scale => {
  const parts = [picture, ...charts.map(({chart}) => chart)], style = getComputedStyle(document.body);
  const width = picture.clientWidth, height = parts.reduce((sum, part) => sum + part.clientHeight, 24);
  const canvas = Object.assign(document.createElement("canvas"), {width: scale * width, height: scale * height});
  const pen = canvas.getContext("2d", {willReadFrequently: true});
  const rules = [...document.styleSheets].flatMap(sheet => [...sheet.cssRules]).map(rule => rule.cssText).join("");
  const colours = COLOURS.map(name => `${name}: ${style.getPropertyValue(name)}`);
  pen.scale(scale, scale);
  pen.fillStyle = style.backgroundColor;
  pen.fillRect(0, 0, width, height);
  let top = 0;
  for (const part of parts) {
    const copy = part.cloneNode(true), tall = part.clientHeight;
    const size = `width: ${width}px; height: ${tall}px; font: ${style.font}`;
    Object.entries({width, height: tall, style: [...colours, size].join(";")}).forEach(pair => copy.setAttribute(...pair));
    make("style", {}, copy, rules);
    const drawn = new Image();
    drawn.src = `data:image/svg+xml,${encodeURIComponent(new XMLSerializer().serializeToString(copy))}`;
    await drawn.decode();
    pen.drawImage(drawn, 0, top, width, tall);
    top += tall;
  }
  Object.assign(pen, {fillStyle: style.color, font: style.font, textAlign: "right"});
  pen.fillText(element("time").textContent, width - 14, height - 8);
  return canvas;
};

const offer = (blob, ending) => {
  const link = Object.assign(document.createElement("a"), {href: URL.createObjectURL(blob)});
  link.download = `${document.title.replace(/\W+/g, "_") || "romjax"}.${ending}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1e4);
};
const saveFrame = async () => (await photograph(2)).toBlob(blob => offer(blob, "png"));

const saveFilm = async () => {
  const button = element("film"), [t, name] = [state.t, button.textContent];
  play(false);
  button.disabled = true;
  const seconds = (end - start) / state.rate, count = Math.max(2, Math.min(FILM.most, Math.round(FILM.rate * seconds)));
  const film = newFilm(Math.round(100 * seconds / count));
  for (let k = 0; k < count; k++) {
    state.t = start + (end - start) * k / (data.alternatives ? count : count - 1);  // a period ends as it begins
    draw();
    const canvas = await photograph(1);
    film.add(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height));
    button.textContent = `${Math.round(100 * (k + 1) / count)} %`;
    await new Promise(done => setTimeout(done));  // shows it
  }
  offer(new Blob([film.end()], {type: "image/gif"}), "gif");
  Object.assign(button, {disabled: false, textContent: name});
  go(t);
};
