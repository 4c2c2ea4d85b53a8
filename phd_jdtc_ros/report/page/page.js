"use strict";
// The report's script. The page holds one JSON document: the charts as Plotly figures, the times
// of the scans, and the properties of the map's traces that change from scan to scan.

const run = JSON.parse(document.getElementById("run").textContent);
// The buttons are listed, because plotly's default may include one that uploads the chart.
const CONFIG = { displaylogo: false, responsive: true, plotlyServerURL: "",
  modeBarButtons: [["zoom2d", "pan2d"], ["zoomIn2d", "zoomOut2d", "resetScale2d"], ["toImage"]] };
const STEP_MS = 125;
// Pages narrower than this, in pixels, are those of phones: nothing may stand beside a chart.
const narrow = innerWidth < 600;

const charts = run.charts.map((chart) => ({ ...chart, element: document.getElementById(chart.name) }));
const overTime = charts.filter((chart) => chart.name !== "map");
const map = charts.find((chart) => chart.name === "map");
const slider = document.getElementById("scan");
const shown = document.getElementById("shown");
const play = document.getElementById("play");
let timer = null;

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

// Applies the page's colours; on dark pages high amplitudes are light.
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
  if (layout.coloraxis) {
    layout.coloraxis.colorscale = run.amplitude_scales[colour("--scheme")];
  }
  for (const trace of data.filter((trace) => trace.meta === "ink")) {
    if (trace.line) trace.line.color = colour("--ink");
    if (trace.marker) trace.marker.color = colour("--ink");
  }
}

// Puts the colour scale below the map, and makes titles and margins smaller.
function squeeze({ layout }) {
  layout.margin = { ...layout.margin, l: 44, r: 8 };
  // A finger that scrolls the page must not select a part of a chart.
  if (layout.dragmode === "zoom") layout.dragmode = false;
  for (const note of layout.annotations || []) note.font.size = 11;
  if (!layout.coloraxis) return;
  layout.height = 620;
  const { colorbar } = layout.coloraxis;
  layout.coloraxis.colorbar = { ...colorbar, orientation: "h", len: 1, y: -0.2, yanchor: "top",
    title: { ...colorbar.title, side: "top" } };
}

// The shown scan's time, as a line through all rows of a chart.
function cursor(scan) {
  return [{ type: "line", xref: "x", yref: "paper", x0: run.times[scan], x1: run.times[scan],
    y0: 0, y1: 1, line: { color: colour("--soft"), width: 1, dash: "dot" } }];
}

// What the slider's position is.
function position(scan) {
  return `${run.times[scan].toFixed(1)} ${run.unit}, scan ${scan + 1} of ${run.times.length}`;
}

function set(trace, key, value) {
  const [outer, inner] = key.split(".");
  if (inner) trace[outer][inner] = value;
  else trace[outer] = value;
}

function show(scan) {
  for (const layer of map.moving) {
    const trace = map.element.data[layer.trace];
    for (const [key, values] of Object.entries(layer)) {
      if (key === "upto") {
        trace.x = layer.all.x.slice(0, values[scan]);
        trace.y = layer.all.y.slice(0, values[scan]);
      } else if (key !== "trace" && key !== "all") set(trace, key, values[scan]);
    }
  }
  Plotly.redraw(map.element);
  for (const chart of overTime) Plotly.relayout(chart.element, { shapes: cursor(scan) });
  slider.value = scan;
  shown.textContent = position(scan);
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

async function draw() {
  for (const { name, element, figure } of charts) {
    paint(figure);
    if (narrow) squeeze(figure);
    // Over the other charts the wheel scrolls the page.
    const config = { ...CONFIG, scrollZoom: name === "map", displayModeBar: !narrow && "hover" };
    await Plotly.newPlot(element, figure.data, figure.layout, config);
    await new Promise((next) => setTimeout(next)); // lets the browser show the chart
  }
  for (const layer of map ? map.moving : []) {
    const { x, y } = map.element.data[layer.trace];
    if (layer.upto) layer.all = { x, y };
  }
  for (const { element } of overTime) {
    element.on("plotly_click", (event) => map && go(nearest(event.points[0].x)));
  }
  if (map) {
    slider.max = run.times.length - 1;
    // Room for the longest text, so that the slider keeps its length.
    shown.style.minWidth = `${position(run.times.length - 1).length}ch`;
    slider.addEventListener("input", () => go(Number(slider.value)));
    play.addEventListener("click", () => (timer === null ? start() : stop()));
    document.getElementById("back").addEventListener("click", () => go(Number(slider.value) - 1));
    document.getElementById("forth").addEventListener("click", () => go(Number(slider.value) + 1));
    const asked = /^#scan=(\d+)$/.exec(location.hash);
    go(asked ? Number(asked[1]) - 1 : run.first);
  }
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    for (const { element } of charts) {
      paint(element);
      Plotly.redraw(element);
    }
    if (map) show(Number(slider.value));
  });
  document.documentElement.dataset.drawn = "yes";
}

draw();
