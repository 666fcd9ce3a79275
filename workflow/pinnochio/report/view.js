// The 3D views: one Plotly scene per patient, whose buttons change what its meshes show. A view takes neither the wheel
// nor a finger until it is clicked.
"use strict";

const NOT_JUDGED = -32768;
const [INSIDE, NONE, OUTSIDE] = [[59, 76, 192], [221, 221, 221], [180, 4, 38]]; // of the pictures' scale, as RGB
const LIGHT = { ambient: 0.32, diffuse: 0.7, specular: 0.1, roughness: 0.6, fresnel: 0.05 };
const CAMERAS = { front: { x: 0, y: -1.8, z: 0.1 }, profile: { x: 1.8, y: -0.1, z: 0.1 }, reset: { x: 1, y: -1.5, z: 0.2 } };
const LAMP = { x: -60000, y: 50000, z: 100000 }; // as seen from the camera: to the left, above and behind it

const decode = (text, Kind) => new Kind(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);

// What the page carries as gzip in base64.
async function unpacked(text) {
  const stream = new Blob([decode(text, Uint8Array)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

// A surface as Plotly takes it: coordinates, moved by a displacement (in steps) where there is one, and corners.
function shape(surface, moved, step) {
  const points = decode(surface.points, Float32Array);
  const shift = moved ? decode(moved, Int16Array) : null;
  const at = points.map((value, i) => value + (shift ? step * shift[i] : 0));
  const every = (values, which) => values.filter((_, i) => i % 3 === which);
  const faces = decode(surface.faces, Int32Array);
  return {
    x: every(at, 0), y: every(at, 1), z: every(at, 2), i: every(faces, 0), j: every(faces, 1), k: every(faces, 2),
  };
}

const rgb = (values) => `rgb(${values})`;

// Colour of a signed distance, as a share of the farthest.
function colour(share) {
  const end = share < 0 ? INSIDE : OUTSIDE;
  const part = Math.min(Math.abs(share), 1);
  return rgb(NONE.map((value, i) => Math.round(value + part * (end[i] - value))));
}

async function show(box) {
  const view = JSON.parse(await unpacked(box.querySelector("script").textContent));
  const stage = box.querySelector(".stage");
  const plot = box.querySelector(".plot");
  const states = [...box.querySelectorAll("[data-state]")];
  const method = box.querySelector("select");
  const error = box.querySelector(".error");
  const bone = box.querySelector(".bone");
  const axis = { visible: false };
  const scale = box.querySelector(".scale");
  scale.querySelector("i").style.background = `linear-gradient(90deg, ${[INSIDE, NONE, OUTSIDE].map(rgb)})`;
  const layout = {
    margin: { l: 0, r: 0, t: 0, b: 0 },
    uirevision: "the camera stays where it was turned to",
    scene: {
      xaxis: axis, yaxis: axis, zaxis: axis, aspectmode: "data", dragmode: "orbit",
      camera: { eye: CAMERAS.reset },
    },
  };

  function meshes() {
    const state = states.find((button) => button.ariaPressed === "true").dataset.state;
    const planned = state !== "before";
    const chosen = view.methods[method.value];
    const skin = view.skins[chosen.skin];
    const look = { type: "mesh3d", lighting: LIGHT, lightposition: LAMP, hoverinfo: "skip" };
    const flesh = { ...look, color: view.colours.skin, opacity: bone.checked ? 0.35 : 1 };
    const mapped = error.checked && state !== "scan";
    scale.style.visibility = mapped ? "visible" : "hidden";
    if (state === "scan") Object.assign(flesh, shape(view.scan));
    else Object.assign(flesh, shape(skin, planned && chosen.moved, view.step));
    if (mapped) {
      flesh.vertexcolor = Array.from(decode(planned ? chosen.error : skin.error, Int16Array), (steps) =>
        steps === NOT_JUDGED ? view.colours.unknown : colour((steps * view.step) / view.farthest));
    }
    const bones = {
      ...look, ...shape(view.bone, planned && view.bone.moved, view.step), visible: bone.checked,
      vertexcolor: view.bone.segment.map((segment) => view.colours.bones[segment]),
    };
    return [flesh, bones];
  }

  const draw = () => Plotly.react(plot, meshes(), layout, { displayModeBar: false, responsive: true });
  for (const button of states) {
    button.addEventListener("click", () => {
      states.forEach((other) => { other.ariaPressed = String(other === button); });
      draw();
    });
  }
  for (const input of [method, error, bone]) input.addEventListener("change", draw);
  for (const button of box.querySelectorAll("[data-from]")) {
    button.addEventListener("click", () => {
      Plotly.relayout(plot, { "scene.camera": { eye: CAMERAS[button.dataset.from] } });
    });
  }
  document.addEventListener("pointerdown", (event) => {
    stage.classList.toggle("active", stage.contains(event.target));
  });
  draw();
}

unpacked(document.getElementById("plotly").textContent).then((program) => {
  const script = document.createElement("script");
  script.textContent = program;
  document.head.append(script);
  document.querySelectorAll(".view").forEach(show);
});
