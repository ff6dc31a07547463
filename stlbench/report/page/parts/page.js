"use strict";
// Every text of the results is put in by textContent; what charts say was escaped when the page was made.
const $ = (selector, within = document) => within.querySelector(selector);
const $$ = (selector, within = document) => [...within.querySelectorAll(selector)];
const nonce = document.currentScript.nonce;

function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

// ------------------------------------------------------------------------------------------------------- what is packed
async function unzipped(id) {
  const bytes = Uint8Array.from(atob($("#" + CSS.escape(id)).textContent), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

const texts = new Map(), coming = new Map();
function unpacked(id) {
  if (!coming.has(id)) coming.set(id, unzipped(id).then((text) => texts.set(id, text)));
  return coming.get(id);
}

const parsed = new Map();
function parse(key) {
  if (!parsed.has(key)) parsed.set(key, JSON.parse(texts.get("payload-" + key)));
  return parsed.get(key);
}
const payload = (key) => unpacked("payload-" + key).then(() => parse(key));

function run() {
  if (!window.Plotly) {
    const script = element("script", texts.get("plotly"));
    script.nonce = nonce;
    document.head.append(script);
  }
  return window.Plotly;
}
const plotly = () => unpacked("plotly").then(run);

// --------------------------------------------------------------------------------------------------------------- charts
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
const real = (colour) => (colour.startsWith("@") ? style(colour.slice(1)) : colour);

function coloured(value, key = "") {
  if (Array.isArray(value)) return value.map((each) => coloured(each));
  if (value && typeof value === "object")
    return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, coloured(each, name)]));
  return typeof value === "string" && /color$/.test(key) ? real(value) : value;
}

function dressed(layout) {
  const made = coloured(structuredClone(layout));
  const ink = style("ink"), line = style("line");
  Object.assign(made, { paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", autosize: true });
  made.font = { color: ink, size: 12, family: "system-ui, sans-serif" };
  made.hoverlabel = { font: { size: 12 }, namelength: -1 };
  made.dragmode = matchMedia("(pointer: coarse)").matches ? false : "zoom";
  for (const name of Object.keys(made)) {
    if (/^[xy]axis/.test(name)) Object.assign(made[name], { gridcolor: line, linecolor: line, zerolinecolor: ink });
  }
  return made;
}

async function draw(place) {
  if (place.dataset.drawn) return;
  place.classList.add("waiting");
  await Promise.all([unpacked("payload-" + place.dataset.payload), unpacked("plotly")]);
  if (!place.dataset.drawn) drawNow(place);
}

function drawNow(place) {
  place.classList.remove("waiting");
  return drawn(run(), place, parse(place.dataset.payload).charts[place.dataset.chart]);
}

async function drawn(Plotly, place, chart) {
  place.chart = chart;
  place.dataset.drawn = "yes";
  if (place.nextElementSibling?.classList.contains("legend")) place.nextElementSibling.remove();
  if (chart.legend.length) place.after(legend(Plotly, place, chart));
  await Plotly.newPlot(place, coloured(chart.data), dressed(chart.layout), { responsive: true, displaylogo: false, displayModeBar: false });
}

function legend(Plotly, place, chart) {
  const list = element("ul", undefined, { class: "legend" });
  for (const entry of chart.legend) {
    const item = element("li");
    const has = entry.group && chart.data.some((trace) => trace.legendgroup === entry.group);
    const inside = has ? element("button", undefined, { type: "button", "aria-pressed": "true" }) : item;
    inside.append(swatch(entry), element("span", entry.label));
    if (has) {
      inside.addEventListener("click", () => toggle(Plotly, place, entry.group, inside));
      item.append(inside);
    }
    list.append(item);
  }
  return list;
}

function swatch(entry) {
  const glyph = { x: "\u2715", o: "\u25cf", d: "\u25c6", s: "\u25a0", c: "\u25cb" }[entry.line];
  if (glyph) return element("span", glyph, { class: "swatch mark", style: `color:${real(entry.color)}`, "aria-hidden": "true" });
  const mark = element("span", undefined, { class: "swatch", "aria-hidden": "true" });
  if (entry.line === "box") {
    mark.classList.add("box");
    mark.style.background = real(entry.color);
  } else {
    mark.style.borderTopColor = real(entry.color);
    mark.style.borderTopStyle = { "--": "dashed", ":": "dotted" }[entry.line] ?? "solid";
  }
  return mark;
}

function toggle(Plotly, place, group, button) {
  const show = button.getAttribute("aria-pressed") !== "true";
  button.setAttribute("aria-pressed", String(show));
  const indices = place.chart.data.flatMap((trace, i) => (trace.legendgroup === group ? [i] : []));
  Plotly.restyle(place, { visible: show }, indices);
}

const watcher = new IntersectionObserver(
  (entries) => entries.filter((entry) => entry.isIntersecting).forEach((entry) => draw(entry.target)),
  { rootMargin: "200px" },
);
$$(".plot").forEach((place) => watcher.observe(place));

const redraw = () => $$(".plot").filter((each) => each.chart).forEach((place) => drawn(run(), place, place.chart));
$("#theme").addEventListener("change", (event) => {
  document.documentElement.dataset.theme = event.target.value;
  redraw();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

// ------------------------------------------------------------------------------------------------ tables: sort, filter
function keyOf(row, column) {
  const cell = row.cells[column];
  const text = cell.dataset.key ?? cell.textContent.trim();
  if (text === "" || text === "-") return null;
  const number = Number(text);
  return Number.isNaN(number) ? text : number;
}

function compared(one, other) {
  if (one === null || other === null) return one === other ? 0 : null;
  if (typeof one === "number" && typeof other === "number") return one - other;
  return String(one).localeCompare(String(other), "en", { numeric: true });
}

function sort(table, head) {
  const down = head.getAttribute("aria-sort") === "ascending";
  $$("th[aria-sort]", table).forEach((each) => each.setAttribute("aria-sort", "none"));
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  const body = table.tBodies[0], column = head.cellIndex, sign = down ? -1 : 1;
  const rows = [...body.rows].map((row) => [keyOf(row, column), row]);
  rows.sort(([one], [other]) => {
    const order = compared(one, other);
    return order === null ? (one === null) - (other === null) : sign * order;
  });
  body.append(...rows.map(([, row]) => row));
}

for (const table of $$("table.sortable")) {
  for (const head of $$("thead th", table)) {
    head.setAttribute("aria-sort", "none");
    $("button.sort", head).addEventListener("click", () => sort(table, head));
  }
}

const filters = $$("[data-filter]");
function matches(row) {
  return filters.every((filter) => !filter.value || row.dataset[filter.dataset.filter].split("|").includes(filter.value));
}

function filter() {
  for (const row of $$("table.filtered tbody tr")) row.hidden = !matches(row);
  const task = $("[data-filter=task]").value;
  for (const part of $$("details.task")) part.hidden = Boolean(task) && part.dataset.task !== task;
  const counts = ["#overview-table", "#cells-table"].map((id) => {
    const rows = $$(id + " tbody tr");
    return [rows.filter((row) => !row.hidden).length, rows.length];
  });
  $("#count").textContent = `${counts[0][0]} of ${counts[0][1]} rows, ${counts[1][0]} of ${counts[1][1]} cells`;
}
filters.forEach((each) => each.addEventListener("change", filter));
$(".filters").addEventListener("reset", () => setTimeout(filter));
filter();

// ------------------------------------------------------------------------------------------------------ tasks and cells
$$("[data-open]").forEach((link) => {
  const part = $$("details.task").find((each) => each.dataset.task === link.dataset.open);
  link.href = "#" + part.id;
});
function openTask() {
  const part = location.hash.startsWith("#task-") && document.getElementById(location.hash.slice(1));
  if (part) {
    part.open = true;
    part.scrollIntoView();
    $("summary", part).focus({ preventScroll: true });
  }
}
addEventListener("hashchange", openTask);
openTask();

$$("[data-stories]").forEach((select) =>
  select.addEventListener("change", () => {
    for (const story of $$(".story", select.closest("details"))) story.hidden = story.dataset.story !== select.value;
  }),
);

function tableOf({ title, heads, rows }) {
  const around = element("div", undefined, { class: "scroll", role: "region", tabindex: "0", "aria-label": title });
  const table = element("table"), body = element("tbody"), top = element("tr");
  table.append(element("caption", title));
  for (const [text, right] of heads) top.append(element("th", text, { scope: "col", class: right ? "num" : "" }));
  for (const row of rows) {
    const line = element("tr");
    row.forEach((text, i) => line.append(element("td", text, { class: heads[i][1] ? "num" : "" })));
    body.append(line);
  }
  const head = element("thead");
  head.append(top);
  table.append(head, body);
  around.append(table);
  return around;
}

function factsOf(facts) {
  const list = element("dl");
  for (const [name, text] of facts) {
    const line = element("div");
    line.append(element("dt", name), element("dd", text));
    list.append(line);
  }
  return list;
}

async function openCell(button) {
  const cell = (await payload(button.dataset.payload)).cells[button.dataset.cell];
  const body = $("#cell-body");
  $("#cell-title").textContent = cell.name;
  body.replaceChildren(factsOf(cell.facts), ...cell.tables.map(tableOf));
  for (const [title, text] of [["Traceback", cell.traceback], ["End of its log", cell.written]]) {
    if (text) body.append(element("h3", title), element("pre", text, { tabindex: "0", role: "region", "aria-label": title }));
  }
  if (cell.provenance.length) {
    const more = element("details");
    more.append(element("summary", "Provenance"), factsOf(cell.provenance));
    body.append(more);
  }
  $("#cell").showModal();
  $("#cell").scrollTop = 0;
  if (cell.curve?.[0]?.length > 1) await curveOf(cell.curve, body);
}

async function curveOf([steps, satisfied, robustness], body) {
  const figure = element("figure"), place = element("div", undefined, { class: "plot", role: "img", style: "height:260px" });
  place.setAttribute("aria-label", "Learning: robustness and satisfaction of the checkpoints on the selection starts");
  figure.append(element("figcaption", "Checkpoints, on the selection starts"), place);
  body.children[0].after(figure);
  const line = { type: "scatter", mode: "lines", x: steps, hovertemplate: "%{x:~s} steps: %{y:.4g}<extra>%{fullData.name}</extra>" };
  const data = [
    { ...line, y: robustness, name: "robustness", legendgroup: "r", line: { color: "#0072B2" } },
    { ...line, y: satisfied, name: "satisfied [%]", legendgroup: "s", yaxis: "y2", line: { color: "#D55E00", dash: "dash" } },
  ];
  const layout = {
    margin: { l: 56, r: 56, t: 8, b: 44 }, showlegend: false,
    xaxis: { title: { text: "environment steps" }, tickformat: "~s" },
    yaxis: { title: { text: "mean robustness" }, zeroline: true },
    yaxis2: { title: { text: "satisfied [%]" }, overlaying: "y", side: "right", range: [-4, 104], showgrid: false, zeroline: false, tickmode: "linear", tick0: 0, dtick: 25 },
  };
  const entries = [
    { group: "r", label: "mean robustness", color: "#0072B2", line: "-" },
    { group: "s", label: "starts that satisfy [%], right axis", color: "#D55E00", line: "--" },
  ];
  await drawn(await plotly(), place, { data, layout, legend: entries });
}
$$("button.open").forEach((button) => button.addEventListener("click", () => openCell(button)));
$("#cell").addEventListener("click", (event) => event.target === $("#cell") && $("#cell").close());

// --------------------------------------------------------------------------------------------------------------- print
// What a browser prints is what stands there when "beforeprint" ends: nothing can be waited for, so all is unpacked before.
const root = document.documentElement;
addEventListener("load", () =>
  Promise.all($$("[id^=payload-], #plotly").map((each) => unpacked(each.id))).then(() => (root.dataset.unpacked = "yes")),
);

let before;
addEventListener("beforeprint", () => {
  const parts = $$("details.task:not([open])"), theme = root.dataset.theme ?? "";
  const dark = theme === "dark" || (!theme && matchMedia("(prefers-color-scheme: dark)").matches);
  before = { parts, theme, dark };
  parts.forEach((part) => (part.open = true));
  root.dataset.theme = "light";
  if (dark) redraw();
  const places = $$(".plot").filter((each) => each.clientWidth);
  if (root.dataset.unpacked) places.filter((each) => !each.dataset.drawn).forEach(drawNow);
  for (const place of places) {
    const [width, height] = [place.clientWidth, place.clientHeight];
    place.style.aspectRatio = `${width} / ${height}`;
    $$("svg.main-svg", place).forEach((drawing) => drawing.setAttribute("viewBox", `0 0 ${width} ${height}`));
  }
});

addEventListener("afterprint", () => {
  if (!before) return;
  $$("svg.main-svg").forEach((drawing) => drawing.removeAttribute("viewBox"));
  root.dataset.theme = before.theme;
  if (before.dark) redraw();
  before.parts.forEach((part) => (part.open = false));
  before = undefined;
});

document.documentElement.dataset.ready = "yes";
