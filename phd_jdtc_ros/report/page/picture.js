"use strict";
// The picture of the traffic on a canvas. What it draws are columns of whole numbers, see picture.py:
// estimates and truth one track after the other, detections in order of their frames. A frame is a
// position of the slider. Places are in the map's metres.

const NEW_LABEL = [[1, -1], [1, 1], [-1, 1], [-1, -1]]; // where labels are tried, in this order
const KNOT = 0.514444; // m/s
const AHEAD_S = [0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600];

// Returns the columns of the page by name: bytes of one weight after the other, of differences.
function unfold(buffer, index) {
  const bytes = new Uint8Array(buffer);
  const columns = {};
  let offset = 0;
  for (const [name, count] of index) {
    const values = new Int32Array(count);
    let last = 0;
    for (let k = 0; k < count; k++) {
      const at = offset + k;
      const folded = bytes[at] | (bytes[at + count] << 8) | (bytes[at + 2 * count] << 16)
        | (bytes[at + 3 * count] << 24);
      last += (folded >>> 1) ^ -(folded & 1);
      values[k] = last;
    }
    columns[name] = values;
    offset += 4 * count;
  }
  return columns;
}

// Returns the columns whose names begin with a group's, and x and y in metres.
function group(head, columns, name) {
  const found = {};
  for (const [key, values] of Object.entries(columns)) {
    if (key.startsWith(name + ".")) found[key.slice(name.length + 1)] = values;
  }
  found.x = Float64Array.from(found.x, (value) => head.corner[0] + value * head.quantum);
  found.y = Float64Array.from(found.y, (value) => head.corner[1] + value * head.quantum);
  return found;
}

// Returns the first of the entries from `low` to before `high` that is above a value.
function above(values, value, low, high) {
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] > value) high = middle;
    else low = middle + 1;
  }
  return low;
}

class Picture {
  constructor(head, columns, times, unit_s) {
    Object.assign(this, { head, columns, times, unit_s });
    this.canvas = document.getElementById("map");
    this.brush = this.canvas.getContext("2d");
    this.groups = Object.fromEntries(
      [...head.sources, "truth", "plots", "carriers"].map((name) => [name, group(head, columns, name)]));
    this.main = head.sources[0];
    this.frame = head.first;
    this.selected = 0;
    this.rows = new Map(); // of the list, by track
    this.km = Math.max(...head.extent) >= 2000;
    this.ahead = this.secondsAhead();
    this.clutter = this.clutterImage();
    this.fit();
    this.listen();
  }

  // --- what is shown ------------------------------------------------------------------------------

  option(name) {
    const input = document.getElementById(name);
    return input !== null && (input.type === "checkbox" ? input.checked : input.value);
  }

  // The frame some seconds, as a text, before the shown one; the first for "all".
  since(seconds) {
    if (seconds === "all") return -1;
    const begin = this.times[this.frame] - Number(seconds) / this.unit_s;
    return above(this.times, begin - 1e-9, 0, this.frame + 1) - 1;
  }

  // Yields the newest row of each track of a source, and its track's first and last row.
  *newest(name) {
    const { number, start, frame } = this.groups[name];
    const hold = this.head.hold[name] || 1;
    for (let k = 0; k < number.length; k++) {
      const end = k + 1 < number.length ? start[k + 1] : frame.length;
      const last = above(frame, this.frame, start[k], end) - 1;
      if (last < start[k] || this.frame - frame[last] >= hold) continue;
      yield { number: number[k], row: last, first: start[k] };
      // Estimates without a number are all of the number 0.
      for (let row = last - 1; !number[k] && row >= start[k] && frame[row] === frame[last]; row--) {
        yield { number: 0, row, first: start[k] };
      }
    }
  }

  // Whether a row is of an aircraft on the ground: slow, and low if its level is known.
  grounded(name, row) {
    const { ground, no_level } = this.head;
    const { level } = this.groups[name];
    const low = !level || level[row] === no_level || !this.head.levels || level[row] <= ground?.level;
    return ground !== null && low && this.speed(name, row) < ground.speed;
  }

  // Whether a row of a source has one of the levels and classes that are asked for.
  passes(name, row) {
    const { class: kind, level } = this.groups[name];
    if (!this.option("ground") && this.grounded(name, row)) return false;
    const box = document.getElementById(`class${kind[row]}`);
    if (box !== null && !box.checked) return false;
    if (!level || !this.head.levels) return true;
    const [low, high] = [this.option("low"), this.option("high")];
    if (level[row] === this.head.no_level) return low === "" && high === "";
    return (low === "" || level[row] >= Number(low)) && (high === "" || level[row] <= Number(high));
  }

  speed(name, row) {
    const { vx, vy, speed } = this.groups[name];
    return 0.1 * (speed ? speed[row] : Math.hypot(vx[row], vy[row]));
  }

  secondsAhead() {
    const speeds = [];
    for (let row = 0; this.main && row < this.groups[this.main].x.length; row += 7) {
      speeds.push(this.speed(this.main, row));
    }
    const fast = speeds.sort((a, b) => a - b)[Math.floor(0.95 * speeds.length)] || 1;
    return AHEAD_S.filter((s) => s * fast < this.head.extent[0] / 12).pop() || AHEAD_S[0];
  }

  // The texts of a row: who it is, level with an arrow if it climbs or sinks, and speed.
  words(name, number, row) {
    const { level, climb, identity, course } = this.groups[name];
    const [code, address] = this.head.identities[identity[row]];
    const height = level[row];
    const rate = climb[row] > 15 ? "\u2191" : climb[row] < -15 ? "\u2193" : "";
    const metres = this.speed(name, row);
    return {
      who: code || address || String(number),
      code, address,
      level: this.grounded(name, row) ? "ground" : !this.head.levels || height === this.head.no_level ? ""
        : (this.head.levels === "FL" ? `FL${String(height).padStart(3, "0")}` : `${height} m`) + rate,
      speed: this.head.ground ? `${Math.round(metres / KNOT)} kt` : `${metres.toFixed(1)} m/s`,
      course: `${String(course[row]).padStart(3, "0")}\u00b0`,
    };
  }

  // Latitude and longitude, or x and y, of a place.
  place(x, y) {
    const { earth } = this.head;
    const [scale, digits, unit] = this.km ? [1000, 2, "km"] : [1, 1, "m"];
    const plain = `${(x / scale).toFixed(digits)}, ${(y / scale).toFixed(digits)} ${unit}`;
    if (!earth) return plain;
    const [u, v] = [(x - earth.corner[0]) / earth.cell[0], (y - earth.corner[1]) / earth.cell[1]];
    const [i, j] = [Math.floor(u), Math.floor(v)];
    if (i < 0 || j < 0 || i + 1 >= earth.nodes || j + 1 >= earth.nodes) return plain;
    const read = (name) => {
      const at = (a, b) => this.columns[`earth.${name}`][b * earth.nodes + a] * earth.degree;
      const [p, q] = [u - i, v - j];
      return (1 - q) * ((1 - p) * at(i, j) + p * at(i + 1, j))
        + q * ((1 - p) * at(i, j + 1) + p * at(i + 1, j + 1));
    };
    const [north, east] = [read("latitude"), ((read("longitude") + 540) % 360) - 180];
    return `${Math.abs(north).toFixed(4)}\u00b0 ${north < 0 ? "S" : "N"}, `
      + `${Math.abs(east).toFixed(4)}\u00b0 ${east < 0 ? "W" : "E"}`;
  }

  // --- the view -----------------------------------------------------------------------------------

  fit() {
    const { corner, extent } = this.head;
    this.centre = [corner[0] + extent[0] / 2, corner[1] + extent[1] / 2];
    this.size();
    this.scale = Math.min(this.width, this.height) / Math.max(...extent);
  }

  size() {
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.canvas.width = Math.round(this.width * devicePixelRatio);
    this.canvas.height = Math.round(this.height * devicePixelRatio);
  }

  px(x) { return this.width / 2 + (x - this.centre[0]) * this.scale; }
  py(y) { return this.height / 2 - (y - this.centre[1]) * this.scale; }
  at(px, py) {
    return [this.centre[0] + (px - this.width / 2) / this.scale,
      this.centre[1] - (py - this.height / 2) / this.scale];
  }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.at(px, py);
    this.scale *= factor;
    this.centre = [x - (px - this.width / 2) / this.scale, y + (py - this.height / 2) / this.scale];
    this.ask();
  }

  pan(right, up) {
    this.centre = [this.centre[0] + right / this.scale, this.centre[1] + up / this.scale];
    this.ask();
  }

  listen() {
    const { canvas } = this;
    const held = new Map(); // pointers that are down
    let moved = 0;
    const here = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    const spread = () => {
      const [[ax, ay], [bx, by]] = [...held.values()];
      return Math.hypot(ax - bx, ay - by);
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      held.set(event.pointerId, here(event));
      moved = 0;
    });
    canvas.addEventListener("pointermove", (event) => {
      const [px, py] = here(event);
      document.getElementById("pointer").textContent = this.place(...this.at(px, py));
      const before = held.get(event.pointerId);
      if (!before) return;
      const apart = held.size === 2 ? spread() : 0;
      held.set(event.pointerId, [px, py]);
      moved += Math.hypot(px - before[0], py - before[1]);
      if (apart > 0) this.zoom(spread() / apart, px, py);
      else this.pan(before[0] - px, py - before[1]);
    });
    canvas.addEventListener("pointerup", (event) => {
      if (moved < 4) this.pick(...here(event));
      held.delete(event.pointerId);
    });
    canvas.addEventListener("pointercancel", (event) => held.delete(event.pointerId));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY / 500), ...here(event));
    }, { passive: false });
    canvas.addEventListener("dblclick", () => { this.fit(); this.ask(); });
    canvas.addEventListener("keydown", (event) => {
      const step = 60;
      const keys = {
        ArrowLeft: () => this.pan(-step, 0), ArrowRight: () => this.pan(step, 0),
        ArrowUp: () => this.pan(0, step), ArrowDown: () => this.pan(0, -step),
        "+": () => this.zoom(1.25), "-": () => this.zoom(0.8), 0: () => { this.fit(); this.ask(); },
        Escape: () => this.select(0),
      };
      if (!keys[event.key]) return;
      event.preventDefault();
      keys[event.key]();
    });
    document.getElementById("options").addEventListener("input", () => this.ask());
    addEventListener("resize", () => { this.size(); this.ask(); });
  }

  pick(px, py) {
    let [nearest, best] = [0, 18];
    for (const { number, row } of this.main ? this.newest(this.main) : []) {
      const { x, y } = this.groups[this.main];
      const apart = Math.hypot(this.px(x[row]) - px, this.py(y[row]) - py);
      if (number && this.passes(this.main, row) && apart < best) [nearest, best] = [number, apart];
    }
    this.select(nearest);
  }

  select(number) {
    this.selected = this.selected === number ? 0 : number;
    this.ask();
    const row = this.rows.get(this.selected);
    if (row) row.scrollIntoView({ block: "nearest" });
  }

  // Draws before the browser shows the next picture, once however often it is asked.
  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => { this.asked = false; this.draw(); });
  }

  // --- drawing ------------------------------------------------------------------------------------

  draw() {
    const { brush } = this;
    brush.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    brush.clearRect(0, 0, this.width, this.height);
    brush.font = "12px system-ui, 'Segoe UI', 'Liberation Sans', sans-serif";
    brush.lineJoin = "round";
    this.ink = colour("--ink");
    this.soft = colour("--soft");
    this.rule = colour("--rule");
    if (this.clutter && this.option("clutter")) this.drawClutter();
    if (this.option("lines")) this.drawLines();
    const trails = this.since(this.option("trails"));
    if (this.option("truth")) this.drawTruth(trails);
    this.drawDetections(this.since(this.option("detections")));
    this.drawRadars();
    const shown = this.head.sources.filter((name) => this.option(name));
    const trailed = shown[shown.length - 1];
    if (trailed) this.drawTrails(trailed, trails);
    for (const name of shown) this.drawSource(name);
    if (this.main) this.list();
  }

  drawClutter() {
    const { corner, cell, shape } = this.head.clutter;
    this.brush.imageSmoothingEnabled = false;
    this.brush.drawImage(this.clutter, this.px(corner[0]), this.py(corner[1] + shape[0] * cell),
      shape[1] * cell * this.scale, shape[0] * cell * this.scale);
  }

  clutterImage() {
    const { clutter } = this.head;
    if (!clutter) return null;
    const [rows, across] = clutter.shape;
    const image = document.createElement("canvas");
    [image.width, image.height] = [across, rows];
    const brush = image.getContext("2d");
    const pixels = brush.createImageData(across, rows);
    const shade = clutter.colour.split(",").map(Number);
    this.columns.clutter.forEach((level, k) => {
      const at = 4 * ((rows - 1 - Math.floor(k / across)) * across + (k % across));
      pixels.data.set([...shade, (255 * 0.9 * level) / clutter.steps], at);
    });
    brush.putImageData(pixels, 0, 0);
    return image;
  }

  // Lines of latitude and longitude or a grid, and rings of range.
  drawLines() {
    const { brush, head } = this;
    brush.lineWidth = 1;
    brush.strokeStyle = this.rule;
    brush.fillStyle = this.soft;
    if (head.graticule) {
      const { points, labels } = head.graticule;
      const [xs, ys] = [this.columns["graticule.x"], this.columns["graticule.y"]];
      brush.beginPath();
      xs.forEach((x, k) => (k % points ? brush.lineTo(this.px(x), this.py(ys[k]))
        : brush.moveTo(this.px(x), this.py(ys[k]))));
      brush.stroke();
      for (const [x, y, text] of labels) brush.fillText(text, this.px(x) + 3, this.py(y) - 3);
    } else this.drawGrid();
    brush.setLineDash([2, 4]);
    brush.strokeStyle = this.soft;
    for (const [x, y, radius, text] of head.rings) {
      brush.beginPath();
      brush.arc(this.px(x), this.py(y), radius * this.scale, 0, 2 * Math.PI);
      brush.globalAlpha = 0.5;
      brush.stroke();
      brush.globalAlpha = 1;
      brush.fillText(text, this.px(x) + 3, this.py(y + radius) - 3);
    }
    brush.setLineDash([]);
  }

  drawGrid() {
    const { brush } = this;
    const least = 90 / this.scale; // metres from line to line
    const power = 10 ** Math.floor(Math.log10(least));
    const step = [1, 2, 5, 10].map((m) => m * power).find((m) => m >= least);
    const [[left, top], [right, bottom]] = [this.at(0, 0), this.at(this.width, this.height)];
    const text = (value) => (this.km ? `${+(value / 1000).toPrecision(6)} km` : `${+value.toPrecision(6)} m`);
    brush.beginPath();
    for (let x = Math.ceil(left / step) * step; x < right; x += step) {
      brush.moveTo(this.px(x), 0);
      brush.lineTo(this.px(x), this.height);
      brush.fillText(text(x), this.px(x) + 3, this.height - 4);
    }
    for (let y = Math.ceil(bottom / step) * step; y < top; y += step) {
      brush.moveTo(0, this.py(y));
      brush.lineTo(this.width, this.py(y));
      if (this.py(y) < this.height - 30) brush.fillText(text(y), 3, this.py(y) - 4);
    }
    brush.stroke();
  }

  // Traces a track's rows from a frame on up to one, with a gap where it was not there.
  trace(rows, first, last, since, hold) {
    const { brush } = this;
    let before = -1;
    brush.beginPath();
    for (let row = last; row >= first && rows.frame[row] > since; row--) {
      const [px, py] = [this.px(rows.x[row]), this.py(rows.y[row])];
      if (before >= 0 && before - rows.frame[row] <= 2 * hold) brush.lineTo(px, py);
      else brush.moveTo(px, py);
      before = rows.frame[row];
    }
    brush.stroke();
  }

  drawTruth(since) {
    const { brush } = this;
    const truth = this.groups.truth;
    brush.lineWidth = 1;
    for (const { number, row, first } of this.newest("truth")) {
      if (!this.passes("truth", row)) continue;
      const [px, py] = [this.px(truth.x[row]), this.py(truth.y[row])];
      brush.strokeStyle = this.classColour(truth.class[row]);
      brush.globalAlpha = 0.55;
      if (number) this.trace(truth, first, row, since, 1);
      brush.globalAlpha = 1;
      brush.beginPath();
      brush.moveTo(px - 6, py);
      brush.lineTo(px + 6, py);
      brush.moveTo(px, py - 6);
      brush.lineTo(px, py + 6);
      brush.stroke();
    }
  }

  drawTrails(name, since) {
    const { brush } = this;
    const rows = this.groups[name];
    for (const { number, row, first } of this.newest(name)) {
      if (!this.passes(name, row)) continue;
      brush.strokeStyle = brush.fillStyle = this.classColour(rows.class[row]);
      const chosen = number !== 0 && number === this.selected;
      brush.lineWidth = chosen ? 2.5 : 1;
      brush.globalAlpha = chosen ? 0.9 : 0.5;
      if (number) this.trace(rows, first, row, since, this.head.hold[name]);
      for (let k = row - 1; k >= first && rows.frame[k] > since; k--) {
        brush.fillStyle = this.classColour(rows.class[k]);
        brush.fillRect(this.px(rows.x[k]) - 1, this.py(rows.y[k]) - 1, 2, 2);
      }
    }
    brush.globalAlpha = 1;
  }

  drawDetections(since) {
    const { brush } = this;
    const { frame, x, y, shade, radar } = this.groups.plots;
    if (this.option("detections") === "none") return;
    const scale = run.amplitude_scales[colour("--scheme")];
    const begin = above(frame, Math.min(since, this.frame - 1), 0, frame.length);
    const end = above(frame, this.frame, begin, frame.length);
    for (let k = begin; k < end; k++) {
      const [px, py] = [this.px(x[k]), this.py(y[k])];
      brush.fillStyle = brush.strokeStyle = shade[k] < 0 ? scale[3] : scale[shade[k]];
      if (radar[k] % 2) { // a cross for every other radar
        brush.lineWidth = 1;
        brush.beginPath();
        brush.moveTo(px - 3, py - 3);
        brush.lineTo(px + 3, py + 3);
        brush.moveTo(px - 3, py + 3);
        brush.lineTo(px + 3, py - 3);
        brush.stroke();
      } else brush.fillRect(px - 2, py - 2, 4, 4);
    }
  }

  drawRadars() {
    const carriers = this.groups.carriers;
    const moving = [...this.newest("carriers")].map(({ number, row }) =>
      [this.head.radars[number], carriers.x[row], carriers.y[row]]);
    this.brush.fillStyle = this.ink;
    for (const [name, x, y] of [...this.head.sites, ...moving]) {
      this.outline(1, this.px(x), this.py(y), 6);
      this.brush.fill();
      this.brush.fillText(name, this.px(x) + 9, this.py(y) + 14);
    }
  }

  classColour(kind) {
    return this.head.classes[kind].colour;
  }

  // The outline of a class's symbol: circle, triangle, square or diamond.
  outline(kind, px, py, size) {
    const { brush } = this;
    brush.beginPath();
    if (kind % 4 === 0) brush.arc(px, py, size, 0, 2 * Math.PI);
    else {
      const [corners, turn] = [[], [3, Math.PI / 2], [4, Math.PI / 4], [4, 0]][kind % 4];
      for (let k = 0; k < corners; k++) {
        const angle = turn + (2 * Math.PI * k) / corners;
        brush.lineTo(px + 1.2 * size * Math.cos(angle), py - 1.2 * size * Math.sin(angle));
      }
      brush.closePath();
    }
  }

  drawSource(name) {
    const { brush, head } = this;
    const rows = this.groups[name];
    const filled = name === "smoothed";
    const labelled = [];
    for (const { number, row } of this.newest(name)) {
      if (!this.passes(name, row)) continue;
      const [px, py] = [this.px(rows.x[row]), this.py(rows.y[row])];
      const chosen = number !== 0 && number === this.selected;
      brush.strokeStyle = brush.fillStyle = this.classColour(rows.class[row]);
      brush.lineWidth = chosen ? 3 : 1.5;
      // A track without a detection in its last scan is paler.
      brush.globalAlpha = rows.state[row] === 2 ? 0.5 : 1;
      if (this.option("ellipses")) {
        const axis = (value) => head.axis[1] * 2 ** (value / head.axis[0]) * this.scale;
        brush.setLineDash(filled ? [] : [3, 3]);
        brush.beginPath();
        brush.ellipse(px, py, axis(rows.major[row]), axis(rows.minor[row]),
          (-rows.angle[row] * Math.PI) / 180, 0, 2 * Math.PI);
        brush.stroke();
        brush.setLineDash([]);
      }
      this.outline(rows.class[row], px, py, filled ? 3 : 5.5);
      if (filled) brush.fill();
      else brush.stroke();
      if (name === this.main) {
        const ahead = 0.1 * this.ahead * this.scale;
        brush.strokeStyle = this.ink;
        brush.lineWidth = 1;
        brush.beginPath();
        brush.moveTo(px, py);
        brush.lineTo(px + rows.vx[row] * ahead, py - rows.vy[row] * ahead);
        brush.stroke();
        if (number) labelled.push([number, row, px, py]);
      }
      brush.globalAlpha = 1;
    }
    if (name === this.main && this.option("labels")) this.drawLabels(name, labelled);
  }

  // Labels beside their tracks, where no other label is; the chosen track's comes first.
  drawLabels(name, labelled) {
    const { brush } = this;
    const taken = labelled.map(([, , px, py]) => [px - 5, py - 5, px + 5, py + 5]);
    const free = (box, own) => taken.every((other, k) => k === own || box[0] > other[2]
      || box[2] < other[0] || box[1] > other[3] || box[3] < other[1]);
    const order = labelled.map((_, k) => k)
      .sort((a, b) => (labelled[b][0] === this.selected) - (labelled[a][0] === this.selected));
    for (const k of order) {
      const [number, row, px, py] = labelled[k];
      if (px < 0 || py < 0 || px > this.width || py > this.height) continue;
      const { who, level, speed } = this.words(name, number, row);
      const lines = [who, [level, speed].filter(Boolean).join(" ")];
      const width = Math.max(...lines.map((line) => brush.measureText(line).width));
      const boxes = NEW_LABEL.flatMap(([right, down]) => [12, 30].map((apart) => {
        const x = px + right * apart - (right < 0 ? width : 0);
        const y = py + down * apart - 14;
        return [x, y, x + width, y + 28];
      }));
      const box = boxes.find((one) => free(one, k)) || (number === this.selected && boxes[0]);
      if (!box) continue;
      taken.push(box);
      brush.strokeStyle = this.soft;
      brush.lineWidth = 1;
      brush.beginPath();
      brush.moveTo(px, py);
      brush.lineTo(box[0] > px ? box[0] - 2 : box[2] + 2, (box[1] + box[3]) / 2);
      brush.stroke();
      brush.fillStyle = this.ink;
      lines.forEach((line, n) => brush.fillText(line, box[0], box[1] + 11 + 14 * n));
      if (number === this.selected) brush.strokeRect(box[0] - 3, box[1] - 2, width + 6, 32);
    }
  }

  // --- the list of tracks -------------------------------------------------------------------------

  list() {
    const body = document.getElementById("tracks");
    const seen = new Set();
    let before = null;
    document.getElementById("details").textContent = this.selected
      ? `Track ${this.selected} is not there now.` : "No track is selected.";
    for (const { number, row } of this.newest(this.main)) {
      if (!number || !this.passes(this.main, row)) continue;
      seen.add(number);
      const words = this.words(this.main, number, row);
      if (!this.rows.has(number)) this.rows.set(number, this.newRow(number));
      const line = this.rows.get(number);
      const [who, level, speed, course] = line.cells;
      who.firstChild.textContent = words.who === String(number) ? number : `${words.who} (${number})`;
      who.firstChild.setAttribute("aria-pressed", number === this.selected);
      [level.textContent, speed.textContent, course.textContent] = [words.level, words.speed, words.course];
      if ((before ? before.nextSibling : body.firstChild) !== line) body.insertBefore(line, before ? before.nextSibling : body.firstChild);
      before = line;
      if (number === this.selected) this.tell(number, row, words);
    }
    for (const [number, line] of this.rows) if (!seen.has(number)) line.remove();
    document.getElementById("count").textContent = `${seen.size} tracks`;
  }

  newRow(number) {
    const line = document.createElement("tr");
    line.innerHTML = "<td><button type=button></button></td><td></td><td></td><td></td>";
    line.addEventListener("click", () => this.select(number));
    return line;
  }

  tell(number, row, words) {
    const { x, y, class: kind, share, weight, state } = this.groups[this.main];
    document.getElementById("details").textContent = [
      `Track ${number}`,
      words.code && `code ${words.code}`, words.address && `address ${words.address}`,
      `${this.head.classes[kind[row]].title} (${share[row]} %)`,
      words.level, words.speed, `course ${words.course}`, this.place(x[row], y[row]),
      `exists with ${weight[row]} %`, state[row] === 2 && "coasting",
    ].filter(Boolean).join(", ");
  }
}
