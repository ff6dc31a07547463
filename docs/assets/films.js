"use strict";
// A picture that links to its film plays it in its place at a click, and stops at the next. Without this, the link opens
// the film by itself.
for (const link of document.querySelectorAll("a.film")) {
  const picture = link.querySelector("img"), still = picture.src, film = link.href, alt = picture.alt;
  link.setAttribute("role", "button");
  const show = (playing) => {
    picture.src = playing ? film : still;
    link.setAttribute("aria-pressed", String(playing));
    link.setAttribute("aria-label", `${playing ? "Stop" : "Play"} the film of ${alt}`);
  };
  const toggle = (event) => {
    event.preventDefault();
    event.stopPropagation(); // the site's own script would follow the link
    show(link.getAttribute("aria-pressed") !== "true");
  };
  show(false);
  link.addEventListener("click", toggle);
  link.addEventListener("keydown", (event) => event.key === " " && toggle(event));
}
