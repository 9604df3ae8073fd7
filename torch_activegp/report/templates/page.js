"use strict";
// Copy buttons: the clipboard where the browser allows it, else the old way.
for (const button of document.querySelectorAll("button.copy")) {
  button.hidden = false;
  const name = button.textContent;
  button.addEventListener("click", async () => {
    const text = document.getElementById(button.dataset.copy).textContent;
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      const area = Object.assign(document.createElement("textarea"), { value: text });
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    button.textContent = button.dataset.done;
    setTimeout(() => { button.textContent = name; }, 1500);
  });
}

// Paper shows everything.
addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll("details")) details.open = true;
});

// A pointer on a chart reads the values of its lines.
const readAxis = (text) => {
  const [low, high, log] = text.split(" ").map(Number);
  return (part) => (log ? low * (high / low) ** part : low + (high - low) * part);
};
const short = (value) => String(Number(value.toPrecision(4))).replace("-", "\u2212");

for (const plot of document.querySelectorAll(".plot")) {
  const lines = [...plot.querySelectorAll("path[data-label]")].map((path) => ({
    label: path.dataset.label,
    points: path.getAttribute("d").split(/[ML]/).filter(Boolean).map((pair) => pair.split(" ").map(Number)),
  })).filter((line) => line.points.length);
  if (!lines.length) continue;
  const [atX, atY] = [readAxis(plot.dataset.x), readAxis(plot.dataset.y)];
  const cross = Object.assign(document.createElement("i"), { className: "cross" });
  const box = Object.assign(document.createElement("div"), { className: "readout" });
  plot.append(cross, box);
  plot.addEventListener("pointermove", (event) => {
    const area = plot.getBoundingClientRect();
    const part = Math.min(1, Math.max(0, (event.clientX - area.left) / area.width));
    const nearest = (points) => points.reduce((a, b) => (Math.abs(b[0] - 1000 * part) < Math.abs(a[0] - 1000 * part) ? b : a));
    const rows = lines.map((line) => `${line.label}: ${short(atY(1 - nearest(line.points)[1] / 1000))}`);
    box.textContent = [`${plot.dataset.name.replace(/ \[.*/, "")}: ${short(atX(part))}`, ...rows].join("\n");
    cross.style.left = `${100 * part}%`;
    box.style.left = part < 0.5 ? `calc(${100 * part}% + 10px)` : "auto";
    box.style.right = part < 0.5 ? "auto" : `calc(${100 * (1 - part)}% + 10px)`;
    plot.classList.add("reading");
  });
  plot.addEventListener("pointerleave", () => plot.classList.remove("reading"));
}
