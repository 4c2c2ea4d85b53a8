// Shows the picture live: what a tracker sends as server-sent events becomes the columns that Picture
// draws. Only so much is kept that a page that stays open does not grow.

const run = JSON.parse(document.getElementById("run").textContent);
// Rows of tracks that are kept, and shortest and longest number of updates of a track; detections.
const MOST_ROWS = 60000, MOST_UPDATES = 300, MOST_PLOTS = 20000;
// Time without news after which the page says so.
const SILENT_MS = 15000;
const COLUMNS = ["x", "y", "vx", "vy", "course", "level", "climb", "class", "share", "weight", "state",
  "minor", "major", "angle"];
const SAID = ["mark", "chance", "since"]; // of trackers with receivers of self-reports

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

const EMPTY = { number: [], start: [], frame: [], x: [], y: [] };

class Live extends Picture {
  constructor() {
    super({ ...run.picture, corner: [-1000, -1000], extent: [2000, 2000], quantum: 1 }, none(), [0], 1);
    this.updates = []; // the newest ones, oldest first
    this.frame = 0;
    this.fitted = false;
    for (const name of ["truth", "carriers"]) this.groups[name] = { ...EMPTY };
    this.groups.plots = { frame: [], x: [], y: [], shade: [], radar: [] };
    this.take("alarms", { kind: [], first: [], second: [], alarm: [], chance: [], x: [], y: [], text: [] });
  }

  take(kind, found) {
    if (kind === "tracks") this.takeTracks(found);
    else if (kind === "plots") this.takePlots(found);
    else if (kind === "alarms") {
      const now = this.frame;
      this.groups.alarms = { ...found, looked: [now], frame: found.x.map(() => now) };
      // The most probable one comes first.
      const [text, more] = [found.text[0] || "", found.text.length - 1];
      document.getElementById("alarm").textContent = more > 0 ? `${text}; and ${more} more` : text;
    } else if (kind === "carriers") {
      const [start, frame] = [found.x.map((_, k) => k), found.x.map(() => this.frame)];
      this.groups.carriers = { ...found, start, frame };
    } else if (kind === "health") {
      const shown = document.getElementById("health");
      shown.textContent = found.text;
      shown.className = found.level ? "wrong" : "";
    } else if (kind === "head") Object.assign(this.head, found);
    this.ask();
  }

  takeTracks(found) {
    if (this.updates.length && found.time_s < this.updates[this.updates.length - 1].time_s) this.updates = [];
    this.updates.push(found);
    let rows = 0;
    let first = this.updates.length;
    while (first > 0 && this.updates.length - first < MOST_UPDATES
      && (first === this.updates.length || rows + this.updates[first - 1].number.length < MOST_ROWS)) {
      first -= 1;
      rows += this.updates[first].number.length;
    }
    this.updates.splice(0, first);
    this.frame += 1;
    this.times = this.updates.map((update) => update.time_s);
    this.began = this.frame - this.updates.length + 1;
    this.arrange();
    document.getElementById("shown").textContent = `${new Date(1000 * found.time_s).toISOString().slice(0, 19).replace("T", " ")} UTC`;
    if (found.x.length && this.outgrown(found)) this.fitTo(found);
  }

  // The columns of the kept updates, track by track.
  arrange() {
    const of = new Map();
    this.updates.forEach((update, k) => update.number.forEach((number, row) => {
      if (!of.has(number)) of.set(number, []);
      of.get(number).push([k, row]);
    }));
    const group = { number: [], start: [], frame: [], identity: [] };
    for (const name of COLUMNS) group[name] = [];
    if (this.updates.some((update) => update.mark)) for (const name of [...SAID, "source"]) group[name] = [];
    const [known, told] = [new Map(), new Map([["", 0]])];
    for (const number of [...of.keys()].sort((a, b) => a - b)) {
      group.number.push(number);
      group.start.push(group.frame.length);
      for (const [k, row] of of.get(number)) {
        const update = this.updates[k];
        group.frame.push(this.began + k);
        for (const name of COLUMNS) group[name].push(update[name][row]);
        const who = update.who[row].join(" ");
        if (!known.has(who)) known.set(who, [known.size, [...update.who[row], ""]]);
        group.identity.push(known.get(who)[0]);
        if (!group.mark) continue;
        for (const name of SAID) group[name].push(update[name] ? update[name][row] : 0);
        const from = update.source ? update.source[row] : "";
        if (!told.has(from)) told.set(from, told.size);
        group.source.push(told.get(from));
      }
    }
    this.head.told = [...told.keys()];
    this.head.identities = [...known.values()].map(([, who]) => who);
    this.groups[this.main] = group;
    // An alarm, and the place of a moving radar, stay until the next ones.
    const { alarms, carriers } = this.groups;
    alarms.looked = [this.frame];
    alarms.frame.fill(this.frame);
    carriers.frame.fill(this.frame);
  }

  takePlots(found) {
    const { plots } = this.groups;
    for (const name of ["x", "y", "radar"]) plots[name].push(...found[name]);
    found.x.forEach(() => { plots.frame.push(this.frame); plots.shade.push(-1); });
    const over = plots.x.length - MOST_PLOTS;
    if (over > 0) for (const column of Object.values(plots)) column.splice(0, over);
  }

  // The frame some seconds before the shown one.
  since(seconds) {
    if (seconds === "all" || !this.updates.length) return -1;
    const begin = this.times[this.times.length - 1] - Number(seconds);
    return this.began + above(this.times, begin - 1e-9, 0, this.times.length) - 1;
  }

  fit() {
    super.fit();
    this.home = String([...this.centre, this.scale]);
  }

  // Whether tracks are beyond the view, which nobody has moved.
  outgrown({ x, y }) {
    if (!this.fitted) return true;
    if (this.home !== String([...this.centre, this.scale])) return false;
    return x.some((value, k) => Math.abs(this.px(value) - this.width / 2) > this.width / 2
      || Math.abs(this.py(y[k]) - this.height / 2) > this.height / 2);
  }

  fitTo({ x, y }) {
    const [{ sites }, { carriers }] = [this.head, this.groups];
    const all = [[...x, ...carriers.x, ...sites.map((site) => site[1])], [...y, ...carriers.y, ...sites.map((site) => site[2])]];
    const [low, high] = [Math.min, Math.max].map((end) => all.map((values) => values.reduce((a, b) => end(a, b))));
    const half = 0.55 * Math.max(high[0] - low[0], high[1] - low[1], 1000);
    this.head.corner = low.map((value, k) => (value + high[k]) / 2 - half);
    this.head.extent = [2 * half, 2 * half];
    this.km = 2 * half >= 2000;
    this.fitted = true;
    this.fit();
    this.ahead = this.secondsAhead();
  }

  list() {
    super.list();
    // Rows of tracks that have gone are not kept.
    const there = new Set(this.groups[this.main].number);
    for (const number of this.rows.keys()) if (!there.has(number)) this.rows.delete(number);
  }
}

function none() {
  const columns = {};
  for (const name of [...run.picture.sources, "truth", "plots", "carriers", "alarms"]) {
    for (const key of ["number", "start", "frame", "x", "y", ...COLUMNS]) columns[`${name}.${key}`] = [];
  }
  return columns;
}

const live = new Live();
const source = new EventSource(`events${location.search}`);
let last = Date.now();
for (const kind of ["head", "carriers", "tracks", "plots", "alarms", "health"]) {
  source.addEventListener(kind, (event) => {
    last = Date.now();
    live.take(kind, JSON.parse(event.data));
  });
}
setInterval(() => {
  if (Date.now() - last > SILENT_MS) live.take("health", { level: 2, text: "nothing comes from the tracker" });
}, 5000);
document.documentElement.dataset.drawn = "yes";
live.ask();
