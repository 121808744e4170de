// How shapes in three dimensions look on a plane: x to the right or forward, y away or left, z up.
"use strict";
window.space = (() => {
  const NEAR = 0.15; // metres before a camera, nearer than which nothing is drawn
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const less = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const mix = (a, b, t) => [0, 1, 2].map((i) => a[i] + t * (b[i] - a[i]));

  // Along two axes, as far away as you like: everything of `seen`, [least, greatest] of x, y, z.
  function plane(right, up, seen, w, h, pad) {
    const span = (axis) => [0, 1, 2].reduce((sum, i) => sum + Math.abs(axis[i]) * (seen[i][1] - seen[i][0]), 0);
    const scale = Math.min((w - 2 * pad) / Math.max(span(right), 1e-9), (h - 2 * pad) / Math.max(span(up), 1e-9));
    const middle = seen.map(([low, high]) => (low + high) / 2), away = [right[2] * up[1] - right[1] * up[2],
      right[0] * up[2] - right[2] * up[0], right[1] * up[0] - right[0] * up[1]];
    return {scale, near: -Infinity, far: (p) => dot(less(p, middle), away), size: () => scale,
      at: (p) => [w / 2 + scale * dot(less(p, middle), right), h / 2 - scale * dot(less(p, middle), up)]};
  }

  // From an eye towards a point, 75 degrees wide, level with the horizon.
  function camera(eye, towards, w, h) {
    const along = less(towards, eye), length = Math.hypot(...along), ahead = along.map((v) => v / length);
    const flat = Math.hypot(ahead[0], ahead[1]), right = [ahead[1] / flat, -ahead[0] / flat, 0];
    const up = [right[1] * ahead[2], -right[0] * ahead[2], right[0] * ahead[1] - right[1] * ahead[0]];
    const focal = Math.max(w, h) / 2 / Math.tan(75 * Math.PI / 360), far = (p) => dot(less(p, eye), ahead);
    return {near: NEAR, far, size: (p) => focal / Math.max(far(p), NEAR), at: (p) => {
      const q = less(p, eye), d = Math.max(far(p), NEAR);
      return [w / 2 + focal * dot(q, right) / d, h / 2 - focal * dot(q, up) / d];
    }};
  }

  // Each a lens, for a vehicle there; a pilot looks along +x and has +y on the left.
  const VIEWS = {
    "behind": (v, seen, w, h) => camera([v[0] - 4, v[1], v[2] + 1.8], [v[0] + 2, v[1], v[2] - 0.9], w, h),
    "on board": (v, seen, w, h) => camera([v[0], v[1], v[2] - 0.1], [v[0] + 0.6, v[1], v[2] - 2], w, h),
    "above": (v, seen, w, h) => plane([0, -1, 0], [1, 0, 0], seen, w, h, 26),
    "side": (v, seen, w, h) => plane([1, 0, 0], [0, 0, 1], seen, w, h, 26),
  };

  // What of a straight line lies before a lens; null for nothing.
  function cut(lens, a, b) {
    const da = lens.far(a) - lens.near, db = lens.far(b) - lens.near;
    if (da < 0 && db < 0) return null;
    if (da >= 0 && db >= 0) return [a, b];
    const there = mix(a, b, da / (da - db));
    return da >= 0 ? [a, there] : [there, b];
  }

  function stroke(c, lens, points, width) {
    for (let i = 0; i + 1 < points.length; i++) {
      const part = cut(lens, points[i], points[i + 1]);
      if (!part) continue;
      c.lineWidth = Math.min(6, Math.max(1.5, width * (lens.size(part[0]) + lens.size(part[1])) / 2));
      c.beginPath(); c.moveTo(...lens.at(part[0])); c.lineTo(...lens.at(part[1])); c.stroke();
    }
  }

  // Outline of points on the plane, counter-clockwise (Andrew's monotone chain).
  function outline(points) {
    const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const half = (all) => all.reduce((hull, p) => {
      while (hull.length > 1) {
        const [a, b] = hull.slice(-2);
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        hull.pop();
      }
      return [...hull, p];
    }, []);
    return [...half(sorted).slice(0, -1), ...half(sorted.reverse()).slice(0, -1)];
  }

  function box(c, lens, [x, y, z], [sx, sy, sz]) {
    const corners = Array.from({length: 8}, (_, k) =>
      [x + (k & 1 ? sx : -sx) / 2, y + (k & 2 ? sy : -sy) / 2, z + (k & 4 ? sz : -sz) / 2]);
    const found = [];
    for (let k = 0; k < 8; k++) for (const bit of [1, 2, 4]) {
      const part = k & bit ? null : cut(lens, corners[k], corners[k | bit]);
      if (part) found.push(lens.at(part[0]), lens.at(part[1]));
    }
    if (!found.length) return;
    c.beginPath();
    outline(found).forEach((p, i) => (i ? c.lineTo(...p) : c.moveTo(...p)));
    c.closePath(); c.fill();
  }

  function ball(c, lens, point, size) {
    if (lens.far(point) < lens.near) return;
    const s = lens.size(point);
    c.beginPath();
    c.ellipse(...lens.at(point), Math.max(3, s * size[0] / 2), Math.max(3, s * size[2] / 2), 0, 0, 7);
    c.fill();
  }

  // Lines a metre apart, and where things stand above: heights are hard to see without.
  function ground(c, lens, floor, shapes) {
    const [x, y] = floor.points[0], [sx, sy] = floor.size, top = floor.points[0][2] + floor.size[2] / 2;
    c.strokeStyle = "rgba(97,110,124,0.35)";
    for (let k = Math.ceil(x - sx / 2); k <= x + sx / 2; k++) stroke(c, lens, [[k, y - sy / 2, top], [k, y + sy / 2, top]], 0);
    for (let k = Math.ceil(y - sy / 2); k <= y + sy / 2; k++) stroke(c, lens, [[x - sx / 2, k, top], [x + sx / 2, k, top]], 0);
    c.fillStyle = "rgba(31,41,51,0.35)";
    for (const shape of shapes) {
      if (shape.kind === "line" || shape === floor || shape.points[0][2] < top) continue;
      const [u, v] = shape.points[0], r = shape.size[0] / 2;
      box(c, lens, [u, v, top], [2 * r, 2 * r, 0.001]);
    }
  }

  function middle(shape) {
    return [0, 1, 2].map((i) => shape.points.reduce((sum, p) => sum + p[i], 0) / shape.points.length);
  }

  function paint(c, shapes, lens, hidden) {
    const floor = shapes.find((shape) => shape.name === "floor");
    const order = shapes.filter((s) => s !== floor && s.name !== hidden);
    if (lens.near > 0) order.sort((a, b) => lens.far(middle(b)) - lens.far(middle(a)));
    for (const shape of floor ? [floor, ...order] : order) {
      const [r, g, b, a] = shape.colour;
      c.fillStyle = c.strokeStyle = `rgba(${r},${g},${b},${a})`;
      c.lineCap = c.lineJoin = "round";
      if (shape.kind === "line") stroke(c, lens, shape.points, shape.size[0]);
      else (shape.kind === "ball" ? ball : box)(c, lens, shape.points[0], shape.size);
      if (shape === floor) ground(c, lens, floor, shapes);
    }
  }

  return {VIEWS, paint, camera, plane};
})();
