"use strict";
// Asks for the page again and puts its tables in place of the old ones: what was scrolled to and focused stays.
const pause = 1000 * Number(document.body.dataset.every);
const regions = () => new Map(Array.from(document.querySelectorAll(".scroll"), (one) => [one.getAttribute("aria-label"), one]));

function show(page) {
  const [left, focused] = [new Map(), document.activeElement];
  for (const [label, region] of regions()) left.set(label, region.scrollLeft);
  const label = focused && focused.classList.contains("scroll") ? focused.getAttribute("aria-label") : null;
  document.title = page.title;
  document.querySelector("main").replaceWith(page.querySelector("main"));
  for (const [name, region] of regions()) {
    region.scrollLeft = left.get(name) || 0;
    if (name === label) region.focus({ preventScroll: true });
  }
}

async function again() {
  try {
    const answer = await fetch(location.href, { cache: "no-store" });
    if (!answer.ok) throw new Error(answer.statusText);
    show(new DOMParser().parseFromString(await answer.text(), "text/html"));
  } catch (error) {
    document.querySelector("[role=status]").textContent = "The server of this page does not answer; what is below is of before.";
  }
  setTimeout(again, pause);
}

setTimeout(again, pause);
