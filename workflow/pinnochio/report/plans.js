// The plans of a patient as 3D faces that turn together.
"use strict";

const view = JSON.parse(document.getElementById("view").textContent);
const decode = (text, Kind) => new Kind(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
const rest = decode(view.points, Float32Array);
const faces = decode(view.faces, Int32Array);
const every = (values, which) => values.filter((_, i) => i % 3 === which);
const [I, J, K] = [0, 1, 2].map((which) => every(faces, which));
const plots = [...document.querySelectorAll(".plot")];
const pressed = (button) => button.getAttribute("aria-pressed") === "true";
const states = [...document.querySelectorAll("[data-state]")];
const mapped = document.querySelector("[data-map]");
const EYES = { front: { x: 0, y: -1.8, z: 0.1 }, profile: { x: 1.8, y: -0.1, z: 0.1 }, oblique: { x: 1, y: -1.5, z: 0.2 } };
const LIGHT = { ambient: 0.32, diffuse: 0.7, specular: 0.1, roughness: 0.6, fresnel: 0.05 }; // as in the report
const LAMP = { x: -60000, y: 50000, z: 100000 };
const axis = { visible: false };
const camera = (eye) => ({ eye, up: { x: 0, y: 0, z: 1 } });
const shifts = view.moved.map((text) => decode(text, Int16Array));
const scene = { xaxis: axis, yaxis: axis, zaxis: axis, aspectmode: "data", dragmode: "orbit" };
// Kept, so that a face stays as it was turned when it is drawn anew.
const layouts = plots.map(() => ({
  margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: "turned", scene: { ...scene, camera: camera(EYES.oblique) },
}));
let turning = false;

function face(place) {
  const after = states.find(pressed).dataset.state === "after";
  const shift = shifts[place];
  const at = rest.map((value, i) => value + (after ? view.step * shift[i] : 0));
  const look = {
    type: "mesh3d", x: every(at, 0), y: every(at, 1), z: every(at, 2), i: I, j: J, k: K, hoverinfo: "skip",
    lighting: LIGHT, lightposition: LAMP,
  };
  const last = view.colours.length - 1;
  look.vertexcolor = Array.from(every(shift, 0), (_, i) => {
    const way = view.step * Math.hypot(shift[3 * i], shift[3 * i + 1], shift[3 * i + 2]);
    return after && pressed(mapped) ? view.colours[Math.min(Math.round((last * way) / view.farthest), last)] : view.skin;
  });
  return [look];
}

function draw() {
  return Promise.all(plots.map((plot, place) =>
    Plotly.react(plot, face(place), layouts[place], { displayModeBar: false, responsive: true, scrollZoom: true })));
}

async function turn(eye, besides) {
  turning = true;
  await Promise.all(plots.filter((plot) => plot !== besides).map((plot) => Plotly.relayout(plot, { "scene.camera": eye })));
  turning = false;
}

// The page scrolls over a face until it is clicked.
for (const plot of plots) {
  plot.parentElement.addEventListener("click", () => plot.classList.add("on"));
  plot.parentElement.addEventListener("mouseleave", () => plot.classList.remove("on"));
}
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") plots.forEach((plot) => plot.classList.remove("on"));
});
for (const button of document.querySelectorAll("#tools button")) {
  button.addEventListener("click", () => {
    if (button.dataset.look) return turn(camera(EYES[button.dataset.look]));
    if (button === mapped) button.setAttribute("aria-pressed", String(!pressed(button)));
    else states.forEach((other) => other.setAttribute("aria-pressed", String(other === button)));
    return draw();
  });
}
draw().then(() => {
  for (const plot of plots) {
    plot.on("plotly_relayout", (changed) => {
      if (!turning && changed["scene.camera"]) turn(changed["scene.camera"], plot);
    });
  }
  document.body.dataset.drawn = "yes";
});
