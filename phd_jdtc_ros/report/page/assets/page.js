// The report's script. The page holds a JSON document: the charts as Plotly figures, the times of the
// frames, and the head of the picture; beside it, compressed, are the picture's columns and Plotly.

const run = JSON.parse(document.getElementById("run").textContent);
// The buttons are listed, because plotly's default may include one that uploads the chart.
const CONFIG = { displaylogo: false, responsive: true, plotlyServerURL: "",
  modeBarButtons: [["zoom2d", "pan2d"], ["zoomIn2d", "zoomOut2d", "resetScale2d"], ["toImage"]] };
const STEP_MS = 125;
// The charts' line of the time shown follows the slider at most so often.
const CURSOR_MS = 200;
// Pages narrower than this, in pixels, are those of phones: nothing may stand beside a chart.
const narrow = innerWidth < 600;

const charts = run.charts.map((chart) => ({ ...chart, element: document.getElementById(chart.name) }));
const slider = document.getElementById("scan");
const shown = document.getElementById("shown");
const play = document.getElementById("play");
let picture = null;
let timer = null;
let cursorTimer = null;

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// Returns what is compressed in an element of the page.
async function inflate(id) {
  const text = document.getElementById(id).textContent;
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

// Applies the page's colours.
function paint(figure) {
  const { data, layout } = figure;
  layout.font.color = colour("--ink");
  for (const note of layout.annotations || []) note.font.color = colour("--ink");
  for (const axis of Object.keys(layout).filter((key) => /^[xy]axis\d*$/.test(key))) {
    layout[axis].gridcolor = colour("--grid");
    layout[axis].linecolor = colour("--rule");
  }
  layout.hoverlabel = { ...layout.hoverlabel, bgcolor: colour("--card"),
    font: { ...layout.hoverlabel.font, color: colour("--ink") } };
  layout.modebar = { bgcolor: "rgba(0,0,0,0)", color: colour("--soft"),
    activecolor: colour("--ink") };
  for (const trace of data.filter((trace) => trace.meta === "ink")) {
    if (trace.line) trace.line.color = colour("--ink");
    if (trace.marker) trace.marker.color = colour("--ink");
  }
}

// Makes titles and margins smaller.
function squeeze({ layout }) {
  layout.margin = { ...layout.margin, l: 44, r: 8 };
  // A finger that scrolls the page must not select a part of a chart.
  if (layout.dragmode === "zoom") layout.dragmode = false;
  for (const note of layout.annotations || []) note.font.size = 11;
}

// Whether a chart's horizontal axis is the time.
function isOfTime({ figure }) {
  return figure.layout.meta !== "distance";
}

// The shown scan's time, as a line through all rows of a chart.
function cursor(scan) {
  return [{ type: "line", xref: "x", yref: "paper", x0: run.times[scan], x1: run.times[scan],
    y0: 0, y1: 1, line: { color: colour("--soft"), width: 1, dash: "dot" } }];
}

// What the slider's position is.
function position(scan) {
  const time = `${run.times[scan].toFixed(1)} ${run.unit}, scan ${scan + 1} of ${run.times.length}`;
  if (run.utc_s === null) return time;
  const seconds = run.utc_s + run.times[scan] * (run.unit === "min" ? 60 : 1);
  return `${new Date(1000 * seconds).toISOString().slice(11, 19)} UTC, ${time}`;
}

function show(scan) {
  slider.value = scan;
  shown.textContent = position(scan);
  picture.frame = scan;
  picture.ask();
  cursorTimer ??= setTimeout(moveCursors, CURSOR_MS);
}

function moveCursors() {
  cursorTimer = null;
  for (const chart of charts.filter(isOfTime)) {
    Plotly.relayout(chart.element, { shapes: cursor(slider.value) });
  }
}

function nearest(time) {
  let best = 0;
  run.times.forEach((other, scan) => {
    if (Math.abs(other - time) < Math.abs(run.times[best] - time)) best = scan;
  });
  return best;
}

function stop() {
  clearInterval(timer);
  timer = null;
  play.textContent = "Play";
}

function start() {
  if (Number(slider.value) === run.times.length - 1) show(0);
  play.textContent = "Pause";
  timer = setInterval(() => {
    if (Number(slider.value) >= run.times.length - 1) stop();
    else show(Number(slider.value) + 1);
  }, STEP_MS);
}

function go(scan) {
  stop();
  show(Math.min(Math.max(scan, 0), run.times.length - 1));
}

// Has the controls of the time show the picture.
async function begin() {
  picture = new Picture(run.picture, unfold(await inflate("columns"), run.picture.columns),
    run.times, run.unit === "min" ? 60 : 1);
  slider.max = run.times.length - 1;
  // Room for the longest text, so that the slider keeps its length.
  shown.style.minWidth = `${position(run.times.length - 1).length}ch`;
  slider.addEventListener("input", () => go(Number(slider.value)));
  play.addEventListener("click", () => (timer === null ? start() : stop()));
  document.getElementById("back").addEventListener("click", () => go(Number(slider.value) - 1));
  document.getElementById("forth").addEventListener("click", () => go(Number(slider.value) + 1));
  const asked = /^#scan=(\d+)$/.exec(location.hash);
  go(asked ? Number(asked[1]) - 1 : run.picture.first);
}

async function draw() {
  if (run.charts.length) {
    const library = document.createElement("script");
    library.textContent = new TextDecoder().decode(await inflate("plotly"));
    document.head.append(library);
  }
  if (run.picture) await begin();
  for (const chart of charts) {
    const { element, figure } = chart;
    paint(figure);
    if (narrow) squeeze(figure);
    await Plotly.newPlot(element, figure.data, figure.layout,
      { ...CONFIG, displayModeBar: !narrow && "hover" });
    await new Promise((next) => setTimeout(next)); // lets the browser show the chart
    if (!isOfTime(chart)) continue;
    element.on("plotly_click", (event) => picture && go(nearest(event.points[0].x)));
  }
  if (picture) moveCursors();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    for (const { element } of charts) {
      paint(element);
      Plotly.redraw(element);
    }
    if (picture) show(Number(slider.value));
  });
  document.documentElement.dataset.drawn = "yes";
}

draw().catch((fault) => {
  // A browser that is older than 2023 does not know DecompressionStream.
  document.getElementById("fault").hidden = false;
  throw fault;
});
