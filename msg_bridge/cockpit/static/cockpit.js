// Draws what the socket says, and says where the stick is. Everything moves on the page from here.
"use strict";
window.cockpit = (() => {
  const HEARTBEAT = 50; // ms between two words of the browser that has the stick
  const HISTORY = 240; // states kept for the lines of a task without a picture
  const SMOOTH_FROM = 40, SMOOTH_MOST = 600; // ms between pictures that are filled in
  // Okabe and Ito's colours, which the colour-blind can tell apart; the neutral action is grey.
  const COLOURS = ["#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#F0E442"];
  const GREY = "#D5DADF", INK = "#1f2933", SOFT = "#616e7c", TEAL = "#0b7285", AMBER = "#b35900";
  const PHASES = ["Move the stick or press a key: nothing has been heard yet",
    "Move the stick to begin", "Get ready", "You fly", "Keep this episode, or discard it?",
    "The demonstration is over", "Paused: the stick was silent"];
  const SLIDERS = {speed: (x) => `${number(x, 2)} ×`, corruption: (x) => `${Math.round(100 * x)} %`};
  const is = {}; // the newest of each part
  const keys = new Set(), touched = new Set();
  let socket = null, me = null, latched = false, pad = [0, 0], lastSaid = "", said = 0;
  let history = [], picture = {from: null, to: null, at: 0, span: 0, episode: -1}, view = null, image = null;
  let mapShows = "action", seenFrom = "behind";
  const $ = (name) => document.getElementById(name);

  // ---------------------------------------------------------------- socket
  function connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    socket = new WebSocket(`${scheme}://${location.host}/socket`);
    socket.onmessage = (event) => {
      const {part, is: content} = JSON.parse(event.data);
      take(part, content);
    };
    socket.onclose = () => { me = null; is.stick = null; linked(); setTimeout(connect, 1000); };
    socket.onopen = linked;
  }
  const open = () => socket !== null && socket.readyState === WebSocket.OPEN;
  const say = (what) => { if (open()) socket.send(JSON.stringify(what)); };
  const holding = () => me !== null && is.stick && is.stick.holder === me;

  function linked() {
    $("link").textContent = open() ? "connected" : "connection lost";
    $("link").classList.toggle("lost", !open());
    showStick();
  }

  function take(part, content) {
    is[part] = content;
    if (part === "you") { me = content; showStick(); }
    else if (part === "task") showTask();
    else if (part === "now") takeNow();
    else if (part === "picture") takePicture(content);
    else if (part === "image") takeImage(content);
    else if (part === "stick") showStick();
    else if (part === "said") toast(content);
    else if (part === "advice") showAdvice();
    else if (part === "health") showHealth();
    else if (part === "piloting" || part === "takeover" || part === "help") showPiloting();
    else if (part in SLIDERS) showTuned(part, content);
    if (part === "scores") drawScores();
    if (part === "policy" || part === "visits") drawMaps();
  }

  // ---------------------------------------------------------------- stick
  function deflection() {
    let [x, y] = pad;
    if (keys.has("ArrowLeft")) x = 1;
    if (keys.has("ArrowRight")) x = -1;
    if (keys.has("ArrowUp")) y = 1;
    if (keys.has("ArrowDown")) y = -1;
    const n = is.task ? is.task.actions.length : 0;
    const buttons = Array.from({length: n}, (_, i) => +(keys.has(String(i + 1)) || touched.has(i)));
    let takeover = keys.has(" ") || latched;
    const gamepad = [...(navigator.getGamepads ? navigator.getGamepads() : [])].find((g) => g);
    if (gamepad) {
      const axis = (i) => (Math.abs(gamepad.axes[i] || 0) > 0.08 ? gamepad.axes[i] : 0);
      const down = (i) => Boolean(gamepad.buttons[i] && gamepad.buttons[i].pressed);
      if (axis(0) || axis(1)) { x = -axis(0); y = -axis(1); }
      if (down(14)) x = 1;
      if (down(15)) x = -1;
      // A, B, X, Y: the last actions, the last of all first, as a release is.
      for (let i = 0; i < 4 && i < n; i++) if (down(i)) buttons[n - 1 - i] = 1;
      takeover = takeover || down(4) || down(5);
    }
    return {say: "move", axes: [x, y], buttons: [...buttons, +takeover]};
  }

  function moved(repeat) {
    if (!holding() || !is.task) return;
    const text = JSON.stringify(deflection());
    if (!repeat && text === lastSaid) return;
    lastSaid = text;
    said = performance.now();
    if (open()) socket.send(text);
    markHeld();
  }

  function letGo() {
    keys.clear(); touched.clear(); pad = [0, 0]; latched = false;
    moved(false);
  }

  function leave() {
    if (holding()) { letGo(); say({say: "give"}); }
  }

  function typing(event) {
    return event.ctrlKey || event.altKey || event.metaKey
      || ["INPUT", "TEXTAREA", "SELECT"].includes(event.target.tagName);
  }

  window.addEventListener("keydown", (event) => {
    if (typing(event)) return;
    if (event.key.toLowerCase() === "v" && !event.repeat && deep()) {
      const views = Object.keys(space.VIEWS);
      lookFrom(views[(views.indexOf(seenFrom) + 1) % views.length]);
      return;
    }
    if (!holding()) return;
    const verdict = {k: "keep", d: "discard", u: "undo", f: "finish"}[event.key.toLowerCase()];
    if (verdict && !event.repeat) { call(verdict); return; }
    if (!event.key.startsWith("Arrow") && event.key !== " " && !/^[1-9]$/.test(event.key)) return;
    event.preventDefault();
    keys.add(event.key);
    moved(false);
  }, {capture: true});
  window.addEventListener("keyup", (event) => {
    if (keys.delete(event.key)) { event.preventDefault(); moved(false); }
  }, {capture: true});
  window.addEventListener("blur", letGo);
  window.addEventListener("pagehide", leave);
  document.addEventListener("visibilitychange", () => { if (document.hidden) leave(); });
  setInterval(() => {
    if (!document.hidden && performance.now() - said > HEARTBEAT * 0.8) moved(true);
  }, HEARTBEAT);

  function call(service) { say({say: "call", service}); }
  function showTuned(what, value) {
    $(what).value = value;
    $(`${what}-is`).textContent = SLIDERS[what](value);
  }
  function bindSlider(what) {
    const slider = $(what);
    slider.addEventListener("input", () => showTuned(what, Number(slider.value)));
    slider.addEventListener("change", () => {
      say({say: "tune", what, value: Number(slider.value)});
      slider.blur(); // arrow keys are the stick's again
    });
  }
  function toggleStick() { say({say: holding() ? "give" : "ask"}); }
  function toggleTakeover() { latched = !latched; moved(false); }

  function bindPad() {
    const canvas = $("pad");
    const at = (event) => {
      const box = canvas.getBoundingClientRect();
      const clip = (v) => Math.max(-1, Math.min(1, v));
      pad = [-clip((2 * (event.clientX - box.left)) / box.width - 1) * 1.15,
        -clip((2 * (event.clientY - box.top)) / box.height - 1) * 1.15].map(clip);
      moved(false); drawPad();
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId); at(event);
    });
    canvas.addEventListener("pointermove", (event) => { if (event.buttons) at(event); });
    for (const end of ["pointerup", "pointercancel"])
      canvas.addEventListener(end, () => { pad = [0, 0]; moved(false); drawPad(); });
  }

  // ---------------------------------------------------------------- words and numbers
  const words = (text) => text.replace(/_/g, " ");
  function number(value, digits = 3) {
    if (value === null || value === undefined) return "–";
    if (value !== 0 && (Math.abs(value) >= 1e5 || Math.abs(value) < 1e-3)) return value.toExponential(1);
    return String(Number(value.toPrecision(digits)));
  }
  const colour = (action) => (action === is.task.neutral ? GREY
    : COLOURS[(action - (action > is.task.neutral ? 1 : 0)) % COLOURS.length]);

  function element(tag, text, classes = "") {
    const made = document.createElement(tag);
    made.textContent = text;
    made.className = classes;
    return made;
  }

  function showTask() {
    $("task").textContent = words(is.task.name);
    document.title = `${words(is.task.name)} – cockpit`;
    $("actions").replaceChildren(...is.task.actions.map((name, i) => {
      const button = element("button", "", "action");
      if (i < 9) button.append(element("kbd", String(i + 1)));
      button.append(name);
      button.style.setProperty("--colour", colour(i));
      button.addEventListener("pointerdown", (event) => {
        button.setPointerCapture(event.pointerId); touched.add(i); moved(false);
      });
      for (const end of ["pointerup", "pointercancel"])
        button.addEventListener(end, () => { touched.delete(i); moved(false); });
      return button;
    }));
    $("help").textContent = "Arrow keys are the stick, numbers the actions while held, space the "
      + "takeover. A gamepad's left stick and shoulder buttons do the same; its A is the last action."
      + " V changes the view of what moves in three dimensions.";
    $("policy-key").replaceChildren(...is.task.actions.map((name, i) => {
      const entry = element("span", name);
      const box = element("i", "");
      box.style.background = colour(i);
      entry.prepend(box);
      return entry;
    }));
    view = image = null; history = [];
    linked();
  }

  function showStick() {
    const stick = is.stick, mine = holding();
    document.body.classList.toggle("holding", Boolean(mine));
    const label = $("stick-button").querySelector(".q-btn__content span") || $("stick-button");
    const others = stick ? stick.asking.length : 0;
    label.textContent = mine ? (others ? `Hand the stick over (${others} asking)` : "Put the stick down")
      : stick && stick.holder !== null
        ? (stick.asking.includes(me) ? "Asked for the stick" : "Ask for the stick") : "Take the stick";
    const watching = stick ? stick.browsers - (stick.holder === null ? 0 : 1) : 0;
    $("crowd").textContent = stick ? `${watching} watching${stick.holder === null ? ""
      : mine ? ", you have the stick" : ", somebody has the stick"}` : "";
    if (!mine) { keys.clear(); touched.clear(); latched = false; }
    lastSaid = marked = "";
    drawPad();
    showPiloting();
  }

  function showPiloting() {
    const p = is.piloting, held = is.takeover && is.takeover.held > 0;
    let text = "";
    if (p) {
      text = PHASES[p.phase] || "";
      if (p.phase === 2) text += ` … ${Math.ceil(p.countdown)}`;
      if (p.phase < 5 || p.phase === 6) text += ` · ${p.kept} of ${p.n_episodes} kept`
        + (p.discarded ? `, ${p.discarded} discarded` : "");
    }
    if (p && p.phase === 5) text += holding() ? "; space takes over" : "; take the stick to take over";
    if (p && p.phase === 4 && is.now && is.now.ended) text = `${is.now.ended}. ${text}`;
    if (held && p && p.phase === 5) text = "You have the vehicle; let go to hand it back";
    const asks = is.help && is.help.asks > 0 && !(held && p && p.phase === 5);
    if (asks) text = `${asking(is.help)}${text ? ` · ${text}` : ""}`;
    $("piloting").classList.toggle("asks", Boolean(asks));
    $("piloting").textContent = text;
    $("advice").style.display = p && p.phase === 3 && holding() ? "none" : ""; // eyes are elsewhere
    $("verdicts").style.display = p && p.phase !== 5 ? "" : "none";
    markHeld();
  }

  const asking = (h) => "The learner asks for help: " + (h.vetoes > h.unsure
    ? `its shield vetoed ${Math.round(100 * h.vetoes)} % of the last steps`
    : "it has hardly been where it is now");

  let marked = "";
  function markHeld() {
    const now = deflection(), text = JSON.stringify([now, is.now && is.now.action]);
    if (text === marked) return;
    marked = text;
    document.querySelectorAll(".action").forEach((button, i) => {
      button.classList.toggle("held", Boolean(now.buttons[i]));
      button.classList.toggle("done", Boolean(is.now && is.now.action === i));
    });
    $("takeover").classList.toggle("held", Boolean(now.buttons[now.buttons.length - 1]));
    drawPad();
  }

  function takeNow() {
    const now = is.now;
    history.push(now);
    if (history.length > HISTORY) history.shift();
    if ($("who").textContent !== now.who) $("who").textContent = now.who;
    $("who").dataset.who = now.source === 2 ? "person" : now.source < 2 && now.source >= 0 ? "learner" : "";
    markHeld();
  }

  function showNumbers() {
    const now = is.now || {}, u = is.update || {}, scores = is.scores || [];
    const last = scores.length ? scores[scores.length - 1][1] : null;
    const shown = [["episode", now.episode ?? "–"], ["step", now.step ?? "–"],
      ["reward", number(now.reward)], ["last score", number(last, 4)],
      ["ε", number(u.epsilon)], ["updates", u.number === undefined ? "–" : number(u.number, 6)],
      ["samples", u.samples === undefined ? "–" : number(u.samples, 7)],
      ["× real time", is.rate ? number(is.rate.factor, 2) : "–"]];
    (is.task ? is.task.variables : []).forEach((v, d) => shown.push([v.name, now.state ? number(now.state[d]) : "–"]));
    const boxes = $("numbers");
    if (boxes.children.length !== shown.length) {
      boxes.replaceChildren(...shown.map(([name]) => {
        const box = element("div", "");
        box.append(element("b", ""), name);
        return box;
      }));
    }
    shown.forEach(([, value], i) => {
      const box = boxes.children[i].firstChild, text = String(value);
      if (box.textContent !== text) box.textContent = text;
    });
  }

  function showHealth() {
    $("health").replaceChildren(...is.health.map((node) =>
      element("li", `${node.name.split(":")[0]}: ${node.text}`, ["", "warn", "bad", "bad"][node.level])));
  }

  function showAdvice() {
    $("advice").replaceChildren(...is.advice.map((line) => element("p", line)));
  }

  let toasting = 0;
  function toast({text, good}) {
    $("said").textContent = text;
    $("said").className = good ? "shown" : "shown bad";
    clearTimeout(toasting);
    toasting = setTimeout(() => { $("said").className = ""; }, 3500);
  }

  // ---------------------------------------------------------------- drawing
  function canvasOf(name) {
    const canvas = $(name), scale = window.devicePixelRatio || 1;
    const w = canvas.clientWidth, h = canvas.clientHeight;
    if (canvas.width !== Math.round(w * scale) || canvas.height !== Math.round(h * scale)) {
      canvas.width = Math.round(w * scale); canvas.height = Math.round(h * scale);
    }
    const c = canvas.getContext("2d");
    c.setTransform(scale, 0, 0, scale, 0, 0);
    c.clearRect(0, 0, w, h);
    c.font = "13px system-ui, Roboto, sans-serif";
    c.textBaseline = "alphabetic"; c.textAlign = "left"; c.lineWidth = 1; c.setLineDash([]);
    return [c, w, h];
  }

  function takePicture(shapes) {
    const now = performance.now(), episode = is.now ? is.now.episode : -1;
    const span = now - picture.at;
    const smooth = span > SMOOTH_FROM && span < SMOOTH_MOST && picture.to && episode === picture.episode;
    picture = {from: smooth ? between(now) : null, before: picture.to, to: shapes, at: now, span, episode};
    shapes.forEach((shape, i) => see(shape, picture.before && picture.before[i]));
    showViews();
  }

  // What the vehicle draws itself; the one before stays until the new one can be drawn.
  function takeImage(source) {
    const next = new Image();
    next.onload = () => { image = next; };
    next.src = source;
  }

  function drawImage(c, w, h) {
    const scale = Math.min(w / image.width, h / image.height);
    const [a, b] = [scale * image.width, scale * image.height];
    c.drawImage(image, (w - a) / 2, (h - b) / 2, a, b);
  }

  function between(now) {
    const {from, to, at, span} = picture;
    const share = from ? Math.min(1, (now - at) / span) : 1;
    if (share >= 1) return to;
    return to.map((shape, i) => {
      const old = from[i];
      if (!old || old.name !== shape.name || old.points.length !== shape.points.length) return shape;
      return {...shape, points: shape.points.map((point, k) =>
        point.map((v, d) => old.points[k][d] + share * (v - old.points[k][d])))};
    });
  }

  // What has been seen stays in view: also where a line of two points that moves could swing to.
  function see(shape, before) {
    const grow = (point, margin) => {
      if (!point.every(Number.isFinite)) return;
      view = point.map((v, d) => [Math.min(view ? view[d][0] : v, v - margin[d]),
        Math.max(view ? view[d][1] : v, v + margin[d])]);
    };
    const line = shape.kind === "line";
    for (const point of shape.points) grow(point, line ? [0, 0, 0] : shape.size.map((v) => v / 2));
    const moves = before && JSON.stringify(before.points) !== JSON.stringify(shape.points);
    if (line && shape.points.length === 2 && moves) {
      const [a, b] = shape.points, r = Math.hypot(...a.map((v, d) => b[d] - v));
      grow(a, [r, deep() ? r : 0, r]);
    }
  }

  // Whether anything is beside the plane in which a task of two dimensions moves.
  const deep = () => Boolean(picture.to && picture.to.some((shape) => shape.points.some((p) => Math.abs(p[1]) > 1e-6)));

  function showViews() {
    const wanted = deep() ? Object.keys(space.VIEWS) : [], box = $("views");
    if (box.children.length !== wanted.length) {
      box.replaceChildren(...wanted.map((name) => {
        const button = element("button", name);
        button.addEventListener("click", () => { lookFrom(name); button.blur(); });
        return button;
      }));
      lookFrom(seenFrom);
    }
  }
  function lookFrom(name) {
    seenFrom = name;
    for (const button of $("views").children) button.setAttribute("aria-pressed", String(button.textContent === name));
    shown = null;
  }

  function drawVehicle(now) {
    const [c, w, h] = canvasOf("vehicle");
    $("vehicle").setAttribute("aria-label", is.now ? `the vehicle, episode ${is.now.episode}` : "no vehicle yet");
    if (!picture.to || !view) { (image ? drawImage : drawLines)(c, w, h); return; }
    const shapes = between(now), vehicle = shapes.find((shape) => shape.name === "vehicle");
    const from = deep() ? (vehicle ? seenFrom : "side") : "side";
    const lens = space.VIEWS[from](vehicle ? vehicle.points[0] : null, view, w, h);
    if (lens.scale) drawScale(c, w, h, lens.scale);
    space.paint(c, shapes, lens, from === "on board" ? "vehicle" : "");
  }

  function drawScale(c, w, h, scale) {
    const wanted = 80 / scale, power = 10 ** Math.floor(Math.log10(wanted));
    const length = [1, 2, 5, 10].map((k) => k * power).filter((k) => k <= wanted * 1.3).pop();
    c.strokeStyle = c.fillStyle = SOFT;
    c.beginPath(); c.moveTo(10, h - 10); c.lineTo(10 + length * scale, h - 10); c.stroke();
    c.fillText(length < 1 ? `${number(100 * length)} cm` : `${number(length)} m`, 10, h - 16);
  }

  // A task without a picture: each variable over time, and where it stands between its limits.
  function drawLines(c, w, h) {
    if (!is.task || !history.length) {
      c.fillStyle = SOFT; c.textAlign = "center"; c.font = "16px system-ui, Roboto, sans-serif";
      c.fillText(is.task ? "waiting for the vehicle" : "waiting for a task", w / 2, h / 2);
      return;
    }
    const n = is.task.variables.length, row = h / n, left = 10, bar = 26, right = w - bar - 20;
    is.task.variables.forEach((v, d) => {
      const values = history.map((s) => s.state[d]).filter((x) => x !== null);
      let low = v.low ?? Math.min(...values), high = v.high ?? Math.max(...values);
      if (!(high > low)) { low -= 1; high += 1; }
      const top = d * row + 22, bottom = (d + 1) * row - 8;
      const Y = (x) => bottom - Math.max(0, Math.min(1, (x - low) / (high - low))) * (bottom - top);
      c.fillStyle = INK;
      c.fillText(`${v.name}: ${number(values[values.length - 1])}`, left, d * row + 14);
      c.fillStyle = "#eef2f5"; c.fillRect(left, top, right - left, bottom - top);
      c.fillRect(right + 12, top, bar, bottom - top);
      c.fillStyle = TEAL;
      const zero = Y(Math.max(low, Math.min(high, 0))), end = Y(values[values.length - 1]);
      c.fillRect(right + 12, Math.min(zero, end), bar, Math.max(2, Math.abs(zero - end)));
      c.strokeStyle = TEAL; c.lineWidth = 1.5; c.beginPath();
      history.forEach((s, i) => {
        if (s.state[d] === null) return;
        const x = left + (right - left) * i / (HISTORY - 1), y = Y(s.state[d]);
        const jump = i === 0 || s.episode !== history[i - 1].episode
          || (v.periodic && Math.abs(s.state[d] - history[i - 1].state[d]) > (high - low) / 2);
        if (jump) c.moveTo(x, y); else c.lineTo(x, y);
      });
      c.stroke();
    });
  }

  function drawPad() {
    if (!holding()) return;
    const [c, w, h] = canvasOf("pad"), {axes: [x, y]} = deflection();
    const r = Math.min(w, h) / 2 - 4;
    c.fillStyle = "#eef2f5"; c.strokeStyle = "#cbd2d9";
    c.beginPath(); c.arc(w / 2, h / 2, r, 0, 7); c.fill(); c.stroke();
    c.beginPath(); c.moveTo(w / 2 - r, h / 2); c.lineTo(w / 2 + r, h / 2);
    c.moveTo(w / 2, h / 2 - r); c.lineTo(w / 2, h / 2 + r); c.stroke();
    c.fillStyle = TEAL; c.beginPath();
    c.arc(w / 2 - 0.7 * r * x, h / 2 - 0.7 * r * y, r * 0.28, 0, 7); c.fill();
  }

  function ticks(low, high, most) {
    const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= rough);
    const found = [];
    for (let t = Math.ceil(low / step) * step; t <= high + 1e-9 * step; t += step) found.push(t);
    return found;
  }

  function drawScores() {
    const [c, w, h] = canvasOf("scores"), all = is.scores || [];
    const left = 58, right = w - 10, top = 8, bottom = h - 24;
    c.fillStyle = SOFT;
    if (!all.length) { c.fillText("no episode has ended yet", 4, h / 2); return; }
    let low = Math.min(...all.map((s) => s[1])), high = Math.max(...all.map((s) => s[1]));
    if (!(high > low)) { low -= 1; high += 1; }
    const first = all[0][0], last = Math.max(all[all.length - 1][0], first + 1);
    const X = (e) => left + (right - left) * (e - first) / (last - first);
    const Y = (s) => bottom - (bottom - top) * (s - low) / (high - low);
    c.textAlign = "right"; c.strokeStyle = "#e4e7eb";
    for (const t of ticks(low, high, 4)) {
      c.fillText(number(t, 6), left - 8, Y(t) + 4);
      c.beginPath(); c.moveTo(left, Y(t)); c.lineTo(right, Y(t)); c.stroke();
    }
    c.textAlign = "center";
    for (const t of ticks(first, last, 5)) if (Number.isInteger(t)) c.fillText(String(t), X(t), h - 6);
    const size = all.length > 120 ? 2 : 3.5;
    for (const [episode, score, demonstrated, interventions] of all) {
      const x = X(episode), y = Y(score);
      c.beginPath();
      if (demonstrated) { // a diamond; a dot for the learner
        c.strokeStyle = AMBER; c.lineWidth = 1.5;
        c.moveTo(x, y - size - 1); c.lineTo(x + size + 1, y); c.lineTo(x, y + size + 1);
        c.lineTo(x - size - 1, y); c.closePath(); c.stroke();
      } else { c.fillStyle = TEAL; c.arc(x, y, size, 0, 7); c.fill(); }
      if (interventions) {
        c.fillStyle = INK; c.beginPath(); c.moveTo(x, bottom - 9); c.lineTo(x + 5, bottom); c.lineTo(x - 5, bottom); c.fill();
      }
    }
    $("scores-key").textContent = "● learner   ◇ person or pilot   ▲ somebody took over";
    $("scores").setAttribute("aria-label", `scores of ${all.length} episodes, the last ${number(all[all.length - 1][1])}`);
  }

  // From dark blue to yellow, as cividis: evenly brighter, also to the colour-blind.
  const CIVIDIS = [[0, 34, 78], [62, 78, 108], [125, 124, 120], [189, 175, 107], [254, 232, 56]];
  function shade(share) {
    const at = Math.max(0, Math.min(1, share)) * 4, k = Math.min(3, Math.floor(at));
    const mix = CIVIDIS[k].map((v, i) => Math.round(v + (at - k) * (CIVIDIS[k + 1][i] - v)));
    return `rgb(${mix})`;
  }

  function fitted(c, text, width) {
    let short = text;
    while (short.length > 3 && c.measureText(short).width > width) short = `${short.replace("…", "").slice(0, -1)}…`;
    return short;
  }

  function drawMap(name, n, fill, limits) {
    const [c, w, h] = canvasOf(name), left = 44, bottom = h - 36, right = w - 6, top = 6;
    const cw = (right - left) / n, ch = (bottom - top) / n;
    for (let j = 0; j < n; j++) for (let i = 0; i < n; i++) {
      const paint = fill(j * n + i);
      if (!paint) continue;
      c.fillStyle = paint;
      c.fillRect(left + i * cw, bottom - (j + 1) * ch, cw + 0.6, ch + 0.6);
    }
    c.strokeStyle = "#cbd2d9"; c.strokeRect(left, top, right - left, bottom - top);
    c.fillStyle = SOFT; c.textAlign = "center";
    c.fillText(fitted(c, is.task.axes[0], right - left), (left + right) / 2, h - 4);
    c.save(); c.translate(11, (top + bottom) / 2); c.rotate(-Math.PI / 2);
    c.fillText(fitted(c, is.task.axes[1], bottom - top - 40), 0, 0); c.restore();
    if (!limits) return;
    const [[x0, x1], [y0, y1]] = limits;
    c.fillText(number(x0), left + 8, bottom + 14); c.fillText(number(x1), right - 10, bottom + 14);
    c.textAlign = "right";
    c.fillText(number(y1), left - 3, top + 11); c.fillText(number(y0), left - 3, bottom);
  }

  function drawMaps() {
    const p = is.policy, v = is.visits;
    if (!is.task) return;
    const which = p ? ` ${p.number}` : "";
    $("policy-title").textContent = mapShows === "action"
      ? `Policy${which} (click: its value)` : `Value of policy${which} (click: its actions)`;
    $("visits-title").textContent = "Visits";
    if (p) {
      drawMap("policy", p.points, (k) => (mapShows === "action" ? colour(p.action[k]) : shade(p.value[k])), p.limits);
      $("policy").setAttribute("aria-label", `map of the policy of update ${p.number}`);
    } else {
      const [c, , h] = canvasOf("policy");
      c.fillStyle = SOFT; c.fillText("nothing learned yet", 8, h / 2);
    }
    if (v) {
      const most = Math.log1p(Math.max(1, ...v.counts));
      drawMap("visits", v.bins, (k) => (v.counts[k] ? `rgba(11,114,133,${0.15 + 0.85 * Math.log1p(v.counts[k]) / most})` : ""), v.limits);
    }
  }

  // ---------------------------------------------------------------- begin
  let drawn = 0, numbered = 0, shown = null;
  function frame(now) {
    moved(false); // a gamepad says nothing by itself
    const newest = picture.to || is.now;
    if (newest !== shown || now - picture.at < picture.span || now - drawn > 1000) drawVehicle(now);
    shown = newest;
    if (now - numbered > 120) { numbered = now; showNumbers(); } // nobody reads faster
    if (now - drawn > 1000) { drawn = now; drawScores(); drawMaps(); } // also when it was resized
    requestAnimationFrame(frame);
  }
  function begin() {
    if (!$("vehicle") || !$("health")) { setTimeout(begin, 30); return; } // not laid out yet
    bindPad();
    Object.keys(SLIDERS).forEach(bindSlider);
    $("policy-figure").addEventListener("click", () => {
      mapShows = mapShows === "action" ? "value" : "action"; drawMaps();
    });
    connect();
    requestAnimationFrame(frame);
  }
  begin();
  return {call, toggleStick, toggleTakeover, is};
})();
