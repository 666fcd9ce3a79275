// The 3D views: one Plotly scene per patient, whose buttons change what its meshes show. A view takes neither the wheel
// nor a finger until it is clicked.
"use strict";

const NOT_JUDGED = -32768;
const [INSIDE, NONE, OUTSIDE] = [[59, 76, 192], [221, 221, 221], [180, 4, 38]]; // of the pictures' scale, as RGB
const LIGHT = { ambient: 0.32, diffuse: 0.7, specular: 0.1, roughness: 0.6, fresnel: 0.05 };
const CAMERAS = { front: { x: 0, y: -1.8, z: 0.1 }, profile: { x: 1.8, y: -0.1, z: 0.1 }, reset: { x: 1, y: -1.5, z: 0.2 } };
const LAMP = { x: -60000, y: 50000, z: 100000 }; // as seen from the camera: to the left, above and behind it

// What the page carries as gzip in base64.
function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")));
}

// Numbers as view.py encodes them.
async function numbers(text, Kind, columns) {
  const bytes = new Uint8Array(await unpacked(text).arrayBuffer());
  const count = bytes.length / Kind.BYTES_PER_ELEMENT, rows = count / columns, all = new Kind(count);
  for (let column = 0; column < columns; column++) {
    for (let row = 0; row < rows; row++) {
      let step = 0;
      for (let b = 0; b < Kind.BYTES_PER_ELEMENT; b++) step |= bytes[b * count + column * rows + row] << (8 * b);
      const at = row * columns + column;
      all[at] = (row ? all[at - columns] : 0) + step; // wraps around
    }
  }
  return all;
}

const surfaceOf = async (surface) => ({
  points: await numbers(surface.points, Int16Array, 3), faces: await numbers(surface.faces, Int32Array, 3),
});

// A surface as Plotly takes it: coordinates, moved by a displacement (in steps) where there is one, and corners.
function shape({ points, faces }, view, moved) {
  const at = Array.from(points, (value, i) => view.step * (value + (moved ? moved[i] : 0)));
  const every = (values, which) => values.filter((_, i) => i % 3 === which);
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
  const view = JSON.parse(box.querySelector("script").textContent);
  for (const skin of view.skins) Object.assign(skin, await surfaceOf(skin), { error: await numbers(skin.error, Int16Array, 1) });
  for (const one of [view.scan, view.bone]) Object.assign(one, await surfaceOf(one));
  view.bone.moved = await numbers(view.bone.moved, Int16Array, 3);
  for (const one of Object.values(view.methods)) {
    Object.assign(one, { moved: await numbers(one.moved, Int16Array, 3), error: await numbers(one.error, Int16Array, 1) });
  }
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
    if (state === "scan") Object.assign(flesh, shape(view.scan, view));
    else Object.assign(flesh, shape(skin, view, planned && chosen.moved));
    if (mapped) {
      flesh.vertexcolor = Array.from(planned ? chosen.error : skin.error, (steps) =>
        steps === NOT_JUDGED ? view.colours.unknown : colour((steps * view.step) / view.farthest));
    }
    const bones = {
      ...look, ...shape(view.bone, view, planned && view.bone.moved), visible: bone.checked,
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

unpacked(document.getElementById("plotly").textContent).text().then((program) => {
  const script = document.createElement("script");
  script.textContent = program;
  document.head.append(script);
  document.querySelectorAll(".view").forEach(show);
});
