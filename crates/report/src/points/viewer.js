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
  const half = +canvas.dataset.half, middle = +canvas.dataset.middle, unit = canvas.dataset.unit;
  const axes = canvas.dataset.axes.split(",");
  const start = { yaw: 0.6, pitch: 0.75, far: 2.9, x: 0, y: 0 };
  const look = { ...start };
  const show = { colour: "grey", 1: true, 2: true, height: 1 };
  let low = 1, high = -1;
  for (let i = 0; i < count; i++) { low = Math.min(low, at[3 * i + 2]); high = Math.max(high, at[3 * i + 2]); }
  const viridis = [[68, 1, 84], [58, 82, 139], [32, 144, 140], [94, 201, 97], [253, 231, 36]];
  const ramp = (t) => {
    const k = Math.min(3, Math.floor(4 * t)), s = 4 * t - k;
    return [0, 1, 2].map((c) => viridis[k][c] * (1 - s) + viridis[k + 1][c] * s);
  };
  const ramped = Array.from({ length: 256 }, (_, k) => ramp(k / 255));
  const views = [[230, 120, 0], [0, 114, 178]];
  const context = canvas.getContext("2d");
  let waiting = false;

  function colour(i) {
    const grey = raw[8 * i + 6], light = 0.45 + 0.55 * grey / 255;
    if (show.colour === "grey") return [grey, grey, grey];
    const base = show.colour === "height"
      ? ramped[Math.round(255 * (at[3 * i + 2] - low) / Math.max(high - low, 1e-6))]
      : views[raw[8 * i + 7] - 1] || views[0];
    return base.map((c) => c * light);
  }

  // Right, up and away of a place, as the eye sees it from above at the angle `pitch`.
  function seen(x, y, z) {
    const cy = Math.cos(look.yaw), sy = Math.sin(look.yaw), cp = Math.cos(look.pitch), sp = Math.sin(look.pitch);
    const ahead = -sy * x + cy * y;
    return [cy * x + sy * y, sp * ahead + cp * z, cp * ahead - sp * z];
  }
  const focalLength = () => 0.95 * Math.min(canvas.width, canvas.height * 1.5);

  // As near as all of it stays inside.
  function frame() {
    const step = Math.max(1, Math.floor(count / 4000));
    const focal = focalLength();
    let [near, far] = [0.3, 12];
    for (let turn = 0; turn < 18; turn++) {
      const distance = (near + far) / 2;
      let ends = [Infinity, -Infinity, Infinity, -Infinity], behind = false;
      for (let i = 0; i < count; i += step) {
        const [right, up, away] = seen(at[3 * i], at[3 * i + 1], at[3 * i + 2] * show.height);
        if (away + distance < 0.1) { behind = true; break; }
        const u = right / (away + distance), v = up / (away + distance);
        ends = [Math.min(ends[0], u), Math.max(ends[1], u), Math.min(ends[2], v), Math.max(ends[3], v)];
      }
      const fits = !behind && (ends[1] - ends[0]) * focal < 0.94 * canvas.width && (ends[3] - ends[2]) * focal < 0.9 * canvas.height;
      if (fits) {
        far = distance;
        Object.assign(look, { far: distance, x: -distance * (ends[0] + ends[1]) / 2, y: -distance * (ends[2] + ends[3]) / 2 });
      } else near = distance;
    }
  }

  // 1, 2 or 5 times a power of ten, not above a length.
  function round(length) {
    const power = 10 ** Math.floor(Math.log10(length));
    return [5, 2, 1].map((m) => m * power).find((r) => r <= length * 1.0001);
  }
  const words = (length) => unit === "m" && Math.abs(length) >= 1000
    ? `${+(length / 1000).toFixed(2)} km` : `${+length.toPrecision(3)} ${unit}`;

  // Scale bar, axes, and what the colours mean.
  function marks() {
    const sharp = canvas.width / Math.max(canvas.clientWidth, 1), style = getComputedStyle(canvas);
    context.save();
    context.scale(sharp, sharp);
    const [width, height] = [canvas.width / sharp, canvas.height / sharp];
    Object.assign(context, { font: "12px system-ui, sans-serif", fillStyle: style.color, strokeStyle: style.color, lineWidth: 2 });
    const pixels = focalLength() / sharp / look.far / half;
    const length = round(150 / pixels), y = height - 14;
    context.strokeRect(14, y, length * pixels, 0);
    context.fillText(`${words(length)} (at the middle)`, 14, y - 7);
    const [ox, oy] = [width - 76, height - 58];
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => {
      const [right, up] = seen(...axis);
      context.beginPath();
      context.moveTo(ox, oy);
      context.lineTo(ox + 34 * right, oy - 34 * up);
      context.stroke();
      context.textAlign = "center";
      context.fillText(axes[k], ox + 50 * right, oy - 46 * up + 4);
    });
    context.textAlign = "left";
    if (show.colour === "height") {
      for (let k = 0; k < 120; k++) {
        context.fillStyle = `rgb(${ramped[Math.round(255 * k / 119)].map(Math.round)})`;
        context.fillRect(14, 134 - k, 12, 1.5);
      }
      context.fillStyle = style.color;
      context.fillText(words(middle + half * high), 32, 24);
      context.fillText(words(middle + half * low), 32, 136);
    } else if (show.colour === "views") {
      views.forEach((c, k) => {
        context.fillStyle = `rgb(${c})`;
        context.fillRect(14, 14 + 18 * k, 12, 12);
        context.fillStyle = style.color;
        context.fillText(`view ${k + 1}`, 32, 24 + 18 * k);
      });
    }
    context.restore();
  }

  function draw() {
    waiting = false;
    const width = canvas.width, height = canvas.height;
    const picture = context.createImageData(width, height);
    const pixels = new Uint32Array(picture.data.buffer);
    const near = new Float32Array(width * height).fill(Infinity);
    const [paperRed, paperGreen, paperBlue] = getComputedStyle(canvas).backgroundColor.match(/\d+/g).map(Number);
    pixels.fill((0xff000000 | paperBlue << 16 | paperGreen << 8 | paperRed) >>> 0);
    const focal = focalLength();
    const spread = 3.2 * focal / Math.sqrt(count + 1);
    for (let i = 0; i < count; i++) {
      if (!show[raw[8 * i + 7]]) continue;
      const x = at[3 * i], y = at[3 * i + 1], z = at[3 * i + 2] * show.height;
      const [right, vertical, ahead] = seen(x, y, z), away = look.far + ahead;
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
    marks();
  }
  const redraw = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };

  // A view that the reader has not touched stays framed.
  let moved = false;
  function fit() {
    const sharp = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * sharp));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * sharp));
    if (!moved) frame();
    redraw();
  }

  canvas.addEventListener("pointerdown", (e) => canvas.setPointerCapture(e.pointerId));
  canvas.addEventListener("pointermove", (e) => {
    if (!(e.buttons & 3)) return;
    moved = true;
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
    moved = true;
    look.far = Math.min(12, Math.max(0.15, look.far * Math.exp(e.deltaY * 0.001)));
    redraw();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { Object.assign(look, start); moved = false; frame(); redraw(); });
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());

  const controls = document.querySelector(`[data-for="${canvas.id}"]`);
  function control(kind, name, text, checked, change) {
    const label = document.createElement("label"), input = document.createElement("input");
    Object.assign(input, { type: kind, name: canvas.id + name, checked });
    input.addEventListener("change", () => { change(input.checked); redraw(); });
    label.append(input, " " + text);
    controls.append(label);
  }
  for (const [key, text] of [["grey", "as in the pictures"], ["height", "by height"], ["views", "by view"]])
    control("radio", "-colour", text, key === show.colour, () => { show.colour = key; });
  for (const view of [1, 2]) control("checkbox", "-view", `view ${view}`, true, (on) => { show[view] = on; });
  control("checkbox", "-height", "heights × 3", false, (on) => { show.height = on ? 3 : 1; if (!moved) frame(); });
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  window.addEventListener("resize", fit);
  fit();
}
