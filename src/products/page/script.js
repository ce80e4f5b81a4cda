"use strict";
// Without this script the page shows all frames and all values on hover; with it, knobs and arrow keys as well.
for (const figure of document.querySelectorAll("figure")) {
  const frames = [...figure.querySelectorAll(".frame")];
  if (frames.length) {
    figure.classList.add("scripted");
    const show = (index) => frames.forEach((frame, i) => frame.classList.toggle("now", i === index));
    show(0);
    const which = figure.querySelector(".which-frame");
    if (which) which.addEventListener("input", () => show(which.valueAsNumber - 1));
    const at = figure.querySelector(".wipe-at");
    const wipe = () => frames.forEach((f) => f.querySelector(".wipe").style.setProperty("--at", at.value));
    if (at) { at.addEventListener("input", wipe); wipe(); }
  }
  const read = figure.querySelector(".read");
  for (const plot of figure.querySelectorAll("svg.plot")) {
    // Arrow keys go from left to right, whatever the order in the file.
    const box = (mark) => { const b = mark.getBBox(); return [b.x + b.width / 2, b.y + b.height / 2]; };
    let marks = null, now = -1;
    const point = (mark) => {
      figure.querySelectorAll(".m.on").forEach((m) => m.classList.remove("on"));
      mark.classList.add("on");
      read.textContent = mark.querySelector("title").textContent;
    };
    plot.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1, PageDown: 10, PageUp: -10, Home: -Infinity, End: Infinity }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      if (!marks) {
        marks = [...plot.querySelectorAll(".m")].map((m) => [m, box(m)]).sort((a, b) => a[1][0] - b[1][0] || a[1][1] - b[1][1]).map((m) => m[0]);
      }
      if (!marks.length) return;
      now = Math.min(marks.length - 1, Math.max(0, now < 0 && step > 0 && Number.isFinite(step) ? 0 : now + step));
      point(marks[now]);
    });
    plot.addEventListener("pointerover", (event) => {
      const mark = event.target.closest(".m");
      if (mark) point(mark);
    });
  }
}
