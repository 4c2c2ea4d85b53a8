"use strict";
// Draws the picture of the traffic, whose rows and view its subclass Picture has.

const UNKNOWN_PLACE = "position on the earth unknown";
const NEW_LABEL = [[1, -1], [1, 1], [-1, 1], [-1, -1]]; // where labels are tried, in this order

const MOST_LABELS = 400;
const ALARM = "#d32f2f";
const [REPORTS, DOUBTFUL] = ["#2e7d32", "#d500d5"];
const ZONES = { guard: "#c77700", exclusion: "#808080", land: "#8a6d3b" };

function meet(box, other) {
  return box[0] < other[2] && box[2] > other[0] && box[1] < other[3] && box[3] > other[1];
}

// A length in its unit.
function length(metres) {
  return metres >= 1000 ? `${+(metres / 1000).toPrecision(6)} km` : `${+metres.toPrecision(6)} m`;
}

class Drawing {
  draw() {
    const { brush } = this;
    brush.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    brush.clearRect(0, 0, this.width, this.height);
    brush.font = "12px system-ui, 'Segoe UI', 'Liberation Sans', sans-serif";
    brush.lineJoin = "round";
    this.ink = colour("--ink");
    this.soft = colour("--soft");
    this.rule = colour("--rule");
    this.written = []; // boxes of all texts but the tracks' labels, and of the radars' symbols
    this.drawScale();
    if (this.clutter && this.option("clutter")) this.drawClutter();
    if (this.option("lines")) this.drawLines();
    if (this.option("alarms")) this.drawZones();
    const trails = this.since(this.option("trails"));
    if (this.option("truth")) this.drawTruth(trails);
    this.drawDetections(this.since(this.option("detections")));
    this.drawRadars();
    const shown = this.head.sources.filter((name) => this.option(name));
    const trailed = shown[shown.length - 1];
    if (trailed) this.drawTrails(trailed, trails);
    for (const name of shown) this.drawSource(name);
    if (this.option("alarms")) this.drawAlarms();
    if (this.main) this.list();
  }

  // The outlines of zones with their names.
  drawZones() {
    const { brush } = this;
    brush.lineWidth = 1.5;
    for (const { name, kind, sides } of this.head.zones) {
      brush.strokeStyle = brush.fillStyle = ZONES[kind];
      brush.setLineDash(kind === "exclusion" ? [6, 4] : []);
      brush.beginPath();
      for (let k = 0; k < sides.length; k += 4) {
        brush.moveTo(this.px(sides[k]), this.py(sides[k + 1]));
        brush.lineTo(this.px(sides[k + 2]), this.py(sides[k + 3]));
      }
      brush.stroke();
      this.writeApart(name, [[this.px(sides[0]) + 4, this.py(sides[1]) - 4]]);
    }
    brush.setLineDash([]);
  }

  // The alarms that were found last: lines between two objects, or from one to where it enters a zone.
  drawAlarms() {
    const { brush } = this;
    const { looked, frame, kind, first, second, alarm, chance, x, y } = this.groups.alarms;
    const last = above(looked, this.frame, 0, looked.length) - 1;
    if (last < 0) return;
    const places = new Map();
    for (const { number, row } of this.main ? this.newest(this.main) : []) {
      places.set(number, [this.groups[this.main].x[row], this.groups[this.main].y[row]]);
    }
    const { carriers } = this.groups;
    // Own ship is the first of them; a track may be in its place, which is not known here.
    for (const { row } of this.newest("carriers")) {
      if (!places.has(0)) places.set(0, [carriers.x[row], carriers.y[row]]);
    }
    const begin = above(frame, looked[last] - 1, 0, frame.length);
    for (let k = begin; k < frame.length && frame[k] === looked[last]; k++) {
      const there = [x[k], y[k]];
      const one = places.get(first[k]) || (first[k] === 0 && there);
      const other = kind[k] === 2 ? there : places.get(second[k]);
      if (!one || !other) continue;
      const [[ax, ay], [bx, by]] = [one, other].map(([u, v]) => [this.px(u), this.py(v)]);
      brush.strokeStyle = brush.fillStyle = ALARM;
      brush.lineWidth = alarm[k] === 1 ? 3 : 1;
      brush.beginPath();
      brush.moveTo(ax, ay);
      brush.lineTo(bx, by);
      brush.stroke();
      const text = `${chance[k]} %`;
      // To the left, because the labels of tracks are to the right if there is room.
      this.writeApart(text, [[(ax + bx) / 2 - 9 - brush.measureText(text).width, (ay + by) / 2 - 5]]);
    }
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
      labels.forEach((text, k) => this.writeAtEdge(text, xs, ys, k * points, (k + 1) * points));
    } else this.drawGrid();
    brush.setLineDash([2, 4]);
    brush.strokeStyle = this.soft;
    for (const [x, y, radius, text] of head.rings) {
      brush.beginPath();
      brush.arc(this.px(x), this.py(y), radius * this.scale, 0, 2 * Math.PI);
      brush.globalAlpha = 0.5;
      brush.stroke();
      brush.globalAlpha = 1;
      this.writeApart(text, [[this.px(x) + 3, this.py(y + radius) - 3]]);
    }
    brush.setLineDash([]);
  }

  // Writes the label of a line where the line, from one row to before another, meets the edge of the
  // picture: a parallel's at the left, a meridian's at the bottom.
  writeAtEdge(text, xs, ys, from, to) {
    const parallel = /[NS]$/.test(text);
    const edge = parallel ? 0 : this.height;
    const along = (k) => (parallel ? this.px(xs[k]) : this.py(ys[k])) - edge;
    for (let k = from + 1; k < to; k++) {
      const [before, after] = [along(k - 1), along(k)];
      if (before * after > 0 || before === after) continue;
      const part = before / (before - after);
      const at = (values) => values[k - 1] + part * (values[k] - values[k - 1]);
      if (parallel) this.writeApart(text, [[3, this.py(at(ys)) - 3]]);
      else {
        const [px, width] = [this.px(at(xs)), this.brush.measureText(text).width];
        this.writeApart(text, [[px + 3, this.height - 4], [px - 3 - width, this.height - 4]]);
      }
      return;
    }
  }

  // Writes a text at the first place in the picture where no other one is; nowhere if there is none.
  writeApart(text, places) {
    const width = this.brush.measureText(text).width;
    for (const [px, py] of places) {
      const box = [px - 3, py - 10, px + width + 3, py + 3];
      if (!this.inside(box) || this.written.some((other) => meet(box, other))) continue;
      this.written.push(box);
      this.brush.fillText(text, px, py);
      return;
    }
  }

  inside(box) {
    return box[0] >= 0 && box[1] >= 0 && box[2] <= this.width && box[3] <= this.height;
  }

  // A bar of a round length, at the bottom right.
  drawScale() {
    const { brush } = this;
    const power = 10 ** Math.floor(Math.log10(120 / this.scale));
    const metres = [5, 2, 1].map((m) => m * power).find((m) => m * this.scale <= 120);
    const [left, right, py] = [this.width - 12 - metres * this.scale, this.width - 12, this.height - 24];
    brush.strokeStyle = brush.fillStyle = this.ink;
    brush.lineWidth = 1.5;
    brush.beginPath();
    brush.moveTo(left, py - 5);
    brush.lineTo(left, py);
    brush.lineTo(right, py);
    brush.lineTo(right, py - 5);
    brush.stroke();
    const text = length(metres);
    const width = brush.measureText(text).width;
    brush.fillText(text, (left + right - width) / 2, py - 4);
    this.written.push([Math.min(left, (left + right - width) / 2) - 4, py - 16, right + 4, py + 4]);
    if (this.head.place_unknown) this.writeApart(UNKNOWN_PLACE, [[6, 16]]);
  }

  drawGrid() {
    const { brush } = this;
    const least = 90 / this.scale; // metres from line to line
    const power = 10 ** Math.floor(Math.log10(least));
    const step = [1, 2, 5, 10].map((m) => m * power).find((m) => m >= least);
    const [[left, top], [right, bottom]] = [this.at(0, 0), this.at(this.width, this.height)];
    const text = (value) => (this.km ? `${+(value / 1000).toPrecision(6)} km` : `${+value.toPrecision(6)} m`);
    const marks = [];
    brush.beginPath();
    for (let x = Math.ceil(left / step) * step; x < right; x += step) {
      brush.moveTo(this.px(x), 0);
      brush.lineTo(this.px(x), this.height);
      marks.push([text(x), this.px(x) + 3, this.height - 4]);
    }
    for (let y = Math.ceil(bottom / step) * step; y < top; y += step) {
      brush.moveTo(0, this.py(y));
      brush.lineTo(this.width, this.py(y));
      marks.push([text(y), 3, this.py(y) - 4]);
    }
    brush.stroke();
    for (const [mark, px, py] of marks) this.writeApart(mark, [[px, py]]);
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
      const [px, py] = [this.px(x), this.py(y)];
      this.outline(1, px, py, 6);
      this.brush.fill();
      this.written.push([px - 6, py - 7, px + 6, py + 6]);
      const left = px - 9 - this.brush.measureText(name).width;
      this.writeApart(name, [[px + 9, py + 14], [left, py + 14], [px + 9, py - 6], [left, py - 6]]);
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
      if (name === this.main && rows.mark) this.drawMark(rows.mark[row], px, py);
      if (name === this.main) {
        const ahead = 0.1 * this.ahead * this.scale;
        brush.strokeStyle = this.ink;
        brush.lineWidth = 1;
        brush.beginPath();
        const [vx, vy] = [rows.vx[row] * ahead, -rows.vy[row] * ahead];
        brush.moveTo(px, py);
        brush.lineTo(px + vx, py + vy);
        brush.stroke();
        if (number) labelled.push([number, row, px, py, vx, vy]);
      }
      brush.globalAlpha = 1;
    }
    if (name === this.main && this.option("labels")) this.drawLabels(name, labelled);
  }

  // What self-reports say: a thin ring about those that report, a thick one about dark targets, a
  // broken one about doubtful sources and about tracks that their sources have left.
  drawMark(mark, px, py) {
    const { brush } = this;
    const [shade, width, dash] = {
      reports: [REPORTS, 2, []], dark: [this.ink, 4, []],
      "left by": [DOUBTFUL, 2, [2, 3]], doubtful: [DOUBTFUL, 4, [5, 4]],
    }[this.head.marks[mark]] || [];
    if (!shade) return;
    brush.strokeStyle = shade;
    brush.lineWidth = width;
    brush.setLineDash(dash);
    brush.beginPath();
    brush.arc(px, py, 11, 0, 2 * Math.PI);
    brush.stroke();
    brush.setLineDash([]);
  }

  // Labels beside their tracks, where no other text is and, if there is such a place, no velocity;
  // the chosen track's comes first.
  drawLabels(name, given) {
    const { brush } = this;
    const labelled = given.filter(([, , px, py]) => px >= 0 && py >= 0 && px <= this.width && py <= this.height);
    const taken = labelled.map(([, , px, py]) => [px - 5, py - 5, px + 5, py + 5]).concat(this.written);
    const free = (box, own) => this.inside(box)
      && taken.every((other, k) => k === own || !meet(box, other));
    // Points of the velocities, a third of a label's height apart.
    const points = labelled.flatMap(([, , px, py, vx, vy]) => {
      const steps = Math.ceil(Math.hypot(vx, vy) / 9);
      return Array.from({ length: steps }, (_, k) => [px + vx * (k + 1) / steps, py + vy * (k + 1) / steps]);
    });
    const clear = (box) => points.every(([px, py]) => px < box[0] - 1 || px > box[2] + 1
      || py < box[1] - 1 || py > box[3] + 1);
    // More would hide each other, and to look for places takes a time that grows with the square.
    const many = labelled.length > MOST_LABELS;
    const order = labelled.map((_, k) => k).filter((k) => !many || labelled[k][0] === this.selected)
      .sort((a, b) => (labelled[b][0] === this.selected) - (labelled[a][0] === this.selected));
    for (const k of order) {
      const [number, row, px, py] = labelled[k];
      const { who, level, speed, alert } = this.words(name, number, row);
      const lines = [[who, alert].filter(Boolean).join(": "), [level, speed].filter(Boolean).join(" ")];
      const width = Math.max(...lines.map((line) => brush.measureText(line).width));
      const boxes = NEW_LABEL.flatMap(([right, down]) => [12, 30].map((apart) => {
        const x = px + right * apart - (right < 0 ? width : 0);
        const y = py + down * apart - 14;
        return [x, y, x + width, y + 28];
      }));
      const places = boxes.filter((one) => free(one, k));
      const box = places.find(clear) || places[0] || (number === this.selected && boxes[0]);
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
}
