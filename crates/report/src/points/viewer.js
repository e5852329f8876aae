"use strict";
// Draws clouds of points on a plain canvas with a depth buffer of its own.
for (const canvas of document.querySelectorAll("canvas[data-points]")) {
  const raw = Uint8Array.from(atob(canvas.dataset.points), (c) => c.charCodeAt(0));
  const bytes = new DataView(raw.buffer);
  const count = raw.length >> 3;
  // Positions in [-1, 1]: right, forward, up.
  const at = new Float32Array(3 * count);
  for (let i = 0; i < count; i++)
    for (let k = 0; k < 3; k++) at[3 * i + k] = bytes.getUint16(8 * i + 2 * k, true) / 32767.5 - 1;
  const start = { yaw: 0.6, pitch: 0.75, far: 2.9, x: 0, y: 0 };
  const look = { ...start };
  const show = { colour: "views", 1: true, 2: true, height: 1 };
  let low = 1, high = -1;
  for (let i = 0; i < count; i++) { low = Math.min(low, at[3 * i + 2]); high = Math.max(high, at[3 * i + 2]); }
  const context = canvas.getContext("2d");
  let waiting = false;

  function colour(i) {
    const grey = raw[8 * i + 6], light = 0.45 + 0.55 * grey / 255;
    if (show.colour === "grey") return [grey, grey, grey];
    if (show.colour === "height") {
      const t = (at[3 * i + 2] - low) / Math.max(high - low, 1e-6);
      const r = 68 + t * (-140 + 325 * t), g = 1 + t * (300 - 70 * t), b = 84 + t * (230 - 278 * t);
      return [Math.max(r, 20) * light, g * light, b * light];
    }
    return raw[8 * i + 7] === 1 ? [235 * light, 55 * light, 50 * light] : [40 * light, 175 * light, 70 * light];
  }

  function draw() {
    waiting = false;
    const width = canvas.width, height = canvas.height;
    const picture = context.createImageData(width, height);
    const pixels = new Uint32Array(picture.data.buffer);
    const near = new Float32Array(width * height).fill(Infinity);
    pixels.fill(0xfff9fbfb);
    const cy = Math.cos(look.yaw), sy = Math.sin(look.yaw), cp = Math.cos(look.pitch), sp = Math.sin(look.pitch);
    const focal = 0.95 * Math.min(width, height * 1.5);
    const spread = 3.2 * focal / Math.sqrt(count + 1);
    for (let i = 0; i < count; i++) {
      if (!show[raw[8 * i + 7]]) continue;
      const x = at[3 * i], y = at[3 * i + 1], z = at[3 * i + 2] * show.height;
      const right = cy * x + sy * y, ahead = -sy * x + cy * y;
      // Seen from above at the angle `pitch`: forward and up turn about the right axis.
      const vertical = sp * ahead + cp * z, away = look.far + cp * ahead - sp * z;
      if (away < 0.05) continue;
      const size = Math.max(1, Math.min(6, Math.round(spread / away)));
      const u = Math.round(width / 2 + focal * (right + look.x) / away - size / 2);
      const v = Math.round(height / 2 - focal * (vertical + look.y) / away - size / 2);
      if (u < 0 || v < 0 || u + size > width || v + size > height) continue;
      const [r, g, b] = colour(i);
      const packed = 0xff000000 | (b & 255) << 16 | (g & 255) << 8 | (r & 255);
      for (let q = v; q < v + size; q++)
        for (let p = u; p < u + size; p++) {
          const k = q * width + p;
          if (away < near[k]) { near[k] = away; pixels[k] = packed; }
        }
    }
    context.putImageData(picture, 0, 0);
  }
  const redraw = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };

  function fit() {
    const sharp = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * sharp));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * sharp));
    redraw();
  }

  canvas.addEventListener("pointerdown", (e) => canvas.setPointerCapture(e.pointerId));
  canvas.addEventListener("pointermove", (e) => {
    if (!(e.buttons & 3)) return;
    if (e.shiftKey || e.buttons & 2) {
      look.x += e.movementX * look.far / canvas.clientHeight;
      look.y -= e.movementY * look.far / canvas.clientHeight;
    } else {
      look.yaw -= e.movementX * 0.008;
      look.pitch = Math.min(1.57, Math.max(-0.2, look.pitch + e.movementY * 0.008));
    }
    redraw();
  });
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    look.far = Math.min(12, Math.max(0.15, look.far * Math.exp(e.deltaY * 0.001)));
    redraw();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { Object.assign(look, start); redraw(); });
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());

  const controls = document.querySelector(`[data-for="${canvas.id}"]`);
  function control(kind, name, text, checked, change) {
    const label = document.createElement("label"), input = document.createElement("input");
    Object.assign(input, { type: kind, name: canvas.id + name, checked });
    input.addEventListener("change", () => { change(input.checked); redraw(); });
    label.append(input, " " + text);
    controls.append(label);
  }
  for (const [key, text] of [["views", "view 1 red, view 2 green"], ["grey", "grey levels"], ["height", "height"]])
    control("radio", "-colour", text, key === show.colour, () => { show.colour = key; });
  for (const view of [1, 2]) control("checkbox", "-view", `view ${view}`, true, (on) => { show[view] = on; });
  control("checkbox", "-height", "heights × 3", false, (on) => { show.height = on ? 3 : 1; });
  window.addEventListener("resize", fit);
  fit();
}
