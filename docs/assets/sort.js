"use strict";
// Tables inside .sortable: a click on a column's name sorts by it, a second click the other way round.
function keyOf(cell) {
  const text = cell.textContent.trim();
  if (text === "" || text === "-") return null;
  const number = Number.parseFloat(text.replace(/^\[/, ""));
  return Number.isNaN(number) ? text : number;
}

function compared(one, other) {
  if (typeof one === "number" && typeof other === "number") return one - other;
  return String(one).localeCompare(String(other), "en", { numeric: true });
}

function sort(table, head) {
  const down = head.getAttribute("aria-sort") === "ascending", column = head.cellIndex;
  for (const each of table.tHead.rows[0].cells) each.setAttribute("aria-sort", "none");
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  const rows = [...table.tBodies[0].rows].map((row) => [keyOf(row.cells[column]), row]);
  rows.sort(([one], [other]) => {
    if (one === null || other === null) return (one === null) - (other === null); // what there is none of comes last
    return (down ? -1 : 1) * compared(one, other);
  });
  table.tBodies[0].append(...rows.map(([, row]) => row));
}

for (const table of document.querySelectorAll(".sortable table")) {
  for (const head of table.tHead.rows[0].cells) {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    button.addEventListener("click", () => sort(table, head));
    head.append(button);
    head.setAttribute("aria-sort", "none");
  }
}

// Tables that are wider than the page scroll; so they can by keyboard.
addEventListener("load", () => {
  for (const wide of document.querySelectorAll(".md-typeset__scrollwrap")) wide.tabIndex = 0;
});
