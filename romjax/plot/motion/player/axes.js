// Axes of the plane; of space a floor, directions and a length.

const nice = least => {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map(x => x * power).find(x => x >= least * 0.999999);
};
const number = (x, step) => {
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return digits > 4 || Math.abs(x) >= 1e5 ? x.toExponential(1) : (x + 0).toFixed(digits);
};

// The floor, level with the lowest point: squares under all that moves.
const drawFloor = step => {
  const at = project(axes()), [x, y] = [0, 1].map(i => {
    const reach = 0.15 * box.radius;
    return [Math.floor((box.low[i] - reach) / step) * step, Math.ceil((box.high[i] + reach) / step) * step];
  });
  const line = (a, b) => `M${at([...a, box.low[2]], 0)}L${at([...b, box.low[2]], 0)}`;
  const along = ([low, high], draw) => {
    for (let k = Math.round((high - low) / step); k >= 0; k--) draw(low + k * step);
  };
  let d = "";
  along(x, one => { d += line([one, y[0]], [one, y[1]]); });
  along(y, one => { d += line([x[0], one], [x[1], one]); });
  make("path", {d, class: "floor"}, grid);
};

const drawAxes = () => {
  const {left, right, top, bottom} = MARGIN, {width, height, pixels, centre} = view;
  grid.replaceChildren();
  Object.entries({x: left, y: top, width: Math.max(0, width - left - right), height: Math.max(0, height - top - bottom)})
    .forEach(([key, value]) => clip.setAttribute(key, value));
  drawColours();
  const step = nice(80 / pixels);
  if (solid) {  // no axis is in the plane of the picture: a length, and where x, y and z point
    drawFloor(nice(0.2 * box.radius || 1));
    const foot = [left + 40, height - bottom - 40], [r, u] = axes();
    ["x", "y", "z"].forEach((name, i) => {
      const tip = [foot[0] + 28 * r[i], foot[1] - 28 * u[i]];
      make("path", {d: `M${foot}L${tip}`, class: "frame"}, grid);
      make("text", {x: foot[0] + 38 * r[i], y: foot[1] - 38 * u[i] + 4, "text-anchor": "middle"}, grid, name);
    });
    const x = width - right - 10, y = height - bottom - 12;
    make("path", {d: `M${x - step * pixels} ${y - 4}v4H${x}v-4`, class: "frame"}, grid);
    make("text", {x: x - step * pixels / 2, y: y - 6, "text-anchor": "middle"}, grid, `${number(step, step)} m`);
    return;
  }
  const middle = amid();
  [width - left - right, height - top - bottom].forEach((length, i) => {
    const half = length / 2 / pixels;
    for (let k = Math.ceil((centre[i] - half) / step); k * step <= centre[i] + half; k++) {
      const place = middle[i] + (i ? -1 : 1) * (k * step - centre[i]) * pixels;
      make("path", {d: i ? `M${left} ${place}H${width - right}` : `M${place} ${top}V${height - bottom}`}, grid);
      const where = i ? {x: left - 6, y: place + 4, "text-anchor": "end"}
        : {x: place, y: height - bottom + 17, "text-anchor": "middle"};
      make("text", where, grid, number(k * step, step));
    }
  });
  make("path", {d: `M${left} ${top}V${height - bottom}H${width - right}`, class: "frame"}, grid);
  make("text", {x: middle[0], y: height - 8, "text-anchor": "middle"}, grid, "x [m]");
  make("text", {transform: `translate(14 ${middle[1]}) rotate(-90)`, "text-anchor": "middle"}, grid, "y [m]");
};
