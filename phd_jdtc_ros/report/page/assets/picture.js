// The picture of the traffic on a canvas. What it draws are columns of whole numbers, see picture.py:
// estimates and truth one track after the other, detections in order of their frames. A frame is a
// position of the slider. Places are in the map's metres.

const KNOT = 0.514444; // m/s
const MOST_LISTED = 500; // lines of the list
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

function flightLevel(level) {
  return `FL${level < 0 ? "-" : ""}${String(Math.abs(level)).padStart(3, "0")}`;
}

// The order of two numbers, or of two names with numbers in them.
function compare(a, b) {
  return typeof a === "number" && typeof b === "number" ? a - b
    : String(a).localeCompare(String(b), "en", { numeric: true });
}

class Picture extends Drawing {
  constructor(head, columns, times, unit_s) {
    super();
    Object.assign(this, { head, columns, times, unit_s });
    this.canvas = document.getElementById("map");
    this.brush = this.canvas.getContext("2d");
    this.groups = Object.fromEntries(
      [...head.sources, "truth", "plots", "carriers", "alarms"].map((name) => [name, group(head, columns, name)]));
    this.main = head.sources[0];
    this.frame = head.first;
    this.selected = 0;
    this.rows = new Map(); // of the list, by track
    // The list's column that it is sorted by, by track number at first, and 1 up or -1 down.
    this.order = [null, 1];
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
    const [code, address, sign] = this.head.identities[identity[row]];
    const { alert, source, said } = this.said(name, row);
    const height = level[row];
    const rate = climb[row] > 15 ? "\u2191" : climb[row] < -15 ? "\u2193" : "";
    const metres = this.speed(name, row);
    return {
      who: source.split(" (")[0] || sign || code || address || String(number),
      sign, code, address, source, alert, said,
      level: this.grounded(name, row) ? "ground" : !this.head.levels || height === this.head.no_level ? ""
        : (this.head.levels === "FL" ? flightLevel(height) : `${height} m`) + rate,
      speed: this.head.ground ? `${Math.round(metres / KNOT)} kt` : `${metres.toFixed(1)} m/s`,
      course: `${String(course[row]).padStart(3, "0")}\u00b0`,
    };
  }

  // What self-reports say of a row: its source, a word where it matters, and the whole sentence.
  said(name, row) {
    const { mark, chance, since, source } = this.groups[name];
    if (!mark) return { alert: "", source: "", said: "" };
    const [what, from] = [this.head.marks[mark[row]], this.head.told[source[row]]];
    const urgent = what === "dark" || what === "doubtful";
    const ago = since[row] < 0 ? "" : `, ${what === "dark" || what === "reports" ? "last heard" : "for"} ${since[row]} s`
      + (what === "dark" || what === "reports" ? " ago" : "");
    return {
      alert: urgent ? `${what} ${chance[row]} %` : what === "left by" ? "left" : "",
      // Who has left a track is not its name.
      source: what === "left by" ? "" : from,
      said: what === "left by" ? `left by ${from}${ago}`
        : what === "reports" ? `${from || "a transmitter"} reports${ago}`
          : what === "doubtful" ? `${from} is not where radars look for it (${chance[row]} %)${ago}`
            : what === "dark" ? `does not transmit (${chance[row]} %)${ago || ", never heard"}` : what,
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
    for (const name of ["options", "search"]) {
      document.getElementById(name).addEventListener("input", () => this.ask());
    }
    document.querySelectorAll(".list th button").forEach((button, column) => {
      button.addEventListener("click", () => {
        const [before, way] = this.order;
        this.order = [column, before === column ? -way : 1];
        this.ask();
      });
    });
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

  // --- the list of tracks -------------------------------------------------------------------------

  list() {
    const body = document.getElementById("tracks");
    const wanted = document.getElementById("search").value.trim().toLowerCase();
    const [lines, keys] = [[], new Map()];
    let count = 0;
    document.getElementById("details").textContent = this.selected
      ? `Track ${this.selected} is not there now.` : "No track is selected.";
    for (const { number, row } of this.newest(this.main)) {
      if (!number || !this.passes(this.main, row)) continue;
      count += 1;
      const words = this.words(this.main, number, row);
      if (number === this.selected) this.tell(number, row, words);
      const names = [words.source, words.alert, words.sign, words.code, words.address, String(number)].filter(Boolean);
      if (!names.some((name) => name.toLowerCase().includes(wanted)) || lines.length === MOST_LISTED) continue;
      if (!this.rows.has(number)) this.rows.set(number, this.newRow(number));
      const line = this.rows.get(number);
      const texts = [(words.who === String(number) ? words.who : `${words.who} (${number})`)
        + (words.alert ? `: ${words.alert}` : ""),
        ...(this.head.levels || this.head.ground ? [words.level] : []), words.speed, words.course];
      line.cells[0].firstChild.setAttribute("aria-pressed", number === this.selected);
      texts.forEach((text, k) => { (line.cells[k].firstChild || line.cells[k]).textContent = text; });
      keys.set(line, [words.who === String(number) ? number : words.who, ...this.amounts(row), number]);
      lines.push(line);
    }
    this.sort(lines, keys);
    // Lines that are in their place stay, so that the focus does.
    lines.forEach((line, k) => { if (body.children[k] !== line) body.insertBefore(line, body.children[k] || null); });
    while (body.children.length > lines.length) body.lastChild.remove();
    const found = lines.length === count ? "" : `${lines.length} of `;
    document.getElementById("count").textContent = `${found}${count} tracks`;
  }

  // The numbers of a row by which the columns after the first are sorted.
  amounts(row) {
    const { level, course } = this.groups[this.main];
    const low = this.grounded(this.main, row) || level[row] === this.head.no_level;
    return [...(this.head.levels || this.head.ground ? [low ? this.head.no_level : level[row]] : []),
      this.speed(this.main, row), course[row]];
  }

  sort(lines, keys) {
    const [column, way] = this.order;
    lines.sort((a, b) => {
      const [first, second] = [keys.get(a), keys.get(b)];
      return way * compare(first[column], second[column]) || compare(first.at(-1), second.at(-1));
    });
    document.querySelectorAll(".list th").forEach((head, k) => head.setAttribute(
      "aria-sort", k !== column ? "none" : way > 0 ? "ascending" : "descending"));
  }

  newRow(number) {
    const line = document.createElement("tr");
    const columns = document.querySelectorAll(".list th").length;
    line.innerHTML = `<td><button type=button></button></td>${"<td></td>".repeat(columns - 1)}`;
    line.addEventListener("click", () => this.select(number));
    return line;
  }

  tell(number, row, words) {
    const { x, y, class: kind, share, weight, state } = this.groups[this.main];
    document.getElementById("details").textContent = [
      `Track ${number}`,
      words.sign && `call sign ${words.sign}`, words.code && `code ${words.code}`, words.address && `address ${words.address}`,
      `${this.head.classes[kind[row]].title} (${share[row]} %)`,
      words.said, words.level, words.speed, `course ${words.course}`, this.place(x[row], y[row]),
      `exists with ${weight[row]} %`, state[row] === 2 && "coasting",
    ].filter(Boolean).join(", ");
  }
}
