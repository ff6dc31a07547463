"use strict";
const all = (selector, within = document) => [...within.querySelectorAll(selector)];
const root = document.documentElement;

// ------------------------------------------------------------------------------------------------ tables: sort, filter
// "0.396 (10, 9 of 10)" and "[0.39, 0.4]" are sorted by their first number, "-" stands last, anything else is text.
function keyOf(row, column) {
  const text = row.cells[column].textContent.trim();
  const number = text.match(/^\[?(-?[\d.]+(?:e[-+]?\d+)?)(?=$|[\s,\]])/);
  return text === "" || text === "-" ? null : number ? Number(number[1]) : text;
}

function compared(one, other) {
  if (typeof one === "number" && typeof other === "number") return one - other;
  return String(one).localeCompare(String(other), "en", { numeric: true });
}

function sort(table, head) {
  const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
  for (const each of all("th[aria-sort]", table)) each.setAttribute("aria-sort", "none");
  head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
  const rows = [...table.tBodies[0].rows].map((row) => [keyOf(row, head.cellIndex), row]);
  rows.sort(([one], [other]) =>
    one === null || other === null ? (one === null) - (other === null) : sign * compared(one, other),
  );
  table.tBodies[0].append(...rows.map(([, row]) => row));
}

for (const head of all("thead th")) {
  head.setAttribute("aria-sort", "none");
  head.addEventListener("click", () => sort(head.closest("table"), head));
}

function filter() {
  const words = document.querySelector("#filter").value.toLowerCase().split(/\s+/);
  const counts = [];
  for (const id of ["overview", "cells"]) {
    const rows = all(`#${id}-table tbody tr`);
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = !words.every((word) => text.includes(word));
    }
    counts.push(`${rows.filter((row) => !row.hidden).length} of ${rows.length}`);
  }
  document.querySelector("#count").textContent = `${counts[0]} rows, ${counts[1]} cells`;
}
document.querySelector("#filter").addEventListener("input", filter);
filter();

// ------------------------------------------------------------------------------------------------- tasks, theme, print
function openPart() {
  const part = document.getElementById(location.hash.slice(1));
  if (part?.matches("details")) {
    part.open = true;
    part.scrollIntoView();
  }
}
addEventListener("hashchange", openPart);
openPart();

document.querySelector("#theme").addEventListener("change", (event) => (root.dataset.theme = event.target.value));

let closed = [];
addEventListener("beforeprint", () => {
  closed = all("details:not([open])");
  for (const each of closed) each.open = true;
});
addEventListener("afterprint", () => closed.forEach((each) => (each.open = false)));

root.dataset.ready = "yes";
